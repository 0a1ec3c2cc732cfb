"""What ``shjax estimate`` writes and shows: the light, error bars, pictures, a table."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

import shjax
from shjax import io
from shjax.cli.pictures import as_rgb, captioned, compare, header
from shjax.display import tone_map
from shjax.harmonics import basis
from shjax.harmonics.degrees import degrees, orders
from shjax.inverse.estimate import Estimate
from shjax.io.writing import json_text
from shjax.sphere import latlong_directions

PANELS = "drawn from the estimate | the picture | their difference"


def words(result: dict) -> list[str]:
    """What is determined, degree by degree."""
    degree = degrees(result["l_max"])
    share = np.array(result["prior_fraction"])
    level = np.abs(np.array(result["coefficients"])[0]).max() or 1.0
    lines = []
    for l in range(result["l_max"] + 1):
        some = [result["standard_deviation"][k] for k in np.flatnonzero(degree == l)]
        own = share[degree == l].mean()
        if any(v is None for row in some for v in row) or own > 0.5:
            lines.append(f"degree {l}: not determined by this picture")
        else:
            lines.append(
                f"degree {l}: within {np.max(some) / level:.2g} of L_00 (one standard "
                f"deviation); {own:.0%} of it from the prior"
            )
    if result["clipped_share"] > 0:
        lines.append(f"{result['clipped_share']:.1%} of the values are at white")
    return lines


@dataclasses.dataclass(frozen=True)
class EstimateResult:
    """What ``shjax estimate`` found.

    Attributes:
        summary: For the JSON file and the terminal, without the files' names.
        found: The estimate.
        picture: What was given, linear.
        again: The picture that the estimate predicts.
        mask: Coverage of what is seen, ``(H, W)``.
    """

    summary: dict
    found: Estimate
    picture: np.ndarray
    again: np.ndarray
    mask: np.ndarray


def write(out: Path, stem: str, result: EstimateResult) -> dict:
    """Write the panorama, the pictures, then the JSON; returns its content."""
    about = header(result.summary["source"], units="radiance")
    panorama = np.asarray(shjax.synthesize(result.found.value, n_theta=256, n_phi=512))
    seen = np.where(result.mask[..., None] > 0, result.picture, 0)
    panels, coloured = compare(result.again, seen, PANELS)
    names = ("light.exr", "light.png", "pictures.exr", "pictures.png", "light.json")
    files = {name: str(out / f"{stem}_{name}") for name in names}
    io.write_image(files["light.exr"], panorama, attributes=about)
    io.write_image(files["light.png"], _shown_light(result.found, panorama))
    notes = {**about, "panels": PANELS}
    values = panels.astype(np.float32)
    io.write_image(files["pictures.exr"], values, attributes=notes)
    io.write_image(files["pictures.png"], coloured)
    content = {**result.summary, "files": files}
    io.write_text(files["light.json"], json_text(content, indent=1) + "\n")
    return content


def _shown_light(found: Estimate, panorama: np.ndarray) -> np.ndarray:
    """The recovered light and beside it its standard deviation, with one white."""
    l_max = math.isqrt(found.value.shape[0]) - 1
    functions = basis(latlong_directions(*panorama.shape[:2]), l_max=l_max)
    spread = np.einsum(
        "hwj,cjk,hwk->hwc", functions, found.covariance, functions, optimize=True
    )
    deviation = np.sqrt(np.maximum(np.nan_to_num(spread, posinf=0.0), 0))
    level = np.maximum(panorama, 0)
    white = float(np.quantile(level.mean(axis=-1), 0.995)) or 1.0
    dark = float(np.mean(np.any(panorama < 0, axis=-1)))
    shown = [as_rgb(tone_map(image, white=white)) for image in (level, deviation)]
    text = f"recovered light; white {white:.2g}"
    if dark > 0:
        text += f"; below zero in {dark:.0%}, shown black"
    return captioned(
        np.concatenate(shown, axis=1), (text, "its standard deviation, the same white")
    )


def show(console: Console, result: dict) -> None:
    """Show the coefficients with their uncertainties, and what they rest on."""
    console.print(f"{result['source']}: {result['shows']}", style="bold", markup=False)
    table = Table(title="Lighting coefficients L_lm", title_justify="left")
    channels = len(result["coefficients"][0])
    names = ("R", "G", "B") if channels == 3 else tuple(map(str, range(channels)))
    for heading in ("l", "m", *names, "prior"):
        table.add_column(heading, justify="right")
    rows = zip(
        degrees(result["l_max"]),
        orders(result["l_max"]),
        result["coefficients"],
        result["standard_deviation"],
        result["prior_fraction"],
        strict=True,
    )
    for l, m, values, deviations, share in rows:
        cells = [
            f"{value:.4g} \u00b1 {'?' if sd is None else format(sd, '.1g')}"
            for value, sd in zip(values, deviations, strict=True)
        ]
        table.add_row(str(l), str(m), *cells, f"{np.mean(share):.0%}")
    console.print(table)
    for line in (*result["words"], f"the picture's values: {result['transfer']}"):
        console.print(line)
    console.print(
        f"{result['message']}\nresidual: {result['residual_rms_over_mean']:.2%} of the "
        f"picture's mean\npictures: {PANELS}\nframe: {result['frame']}\nwritten:"
    )
    for name in result["files"].values():
        console.print(f"  {name}", markup=False)
