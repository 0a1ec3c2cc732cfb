"""What ``shjax light`` shows and writes: pictures, JSON, a table, progress."""

from __future__ import annotations

import dataclasses
import itertools
from pathlib import Path

import jax
import numpy as np
from rich.console import Console
from rich.padding import Padding
from rich.table import Table

import shjax
from shjax import io
from shjax.cli.options import quadrature_note
from shjax.cli.pictures import FRAME, as_rgb, captioned, compare, header, rotated
from shjax.display import tone_map
from shjax.envmap import EnvironmentMap, Report
from shjax.harmonics.degrees import degrees, orders
from shjax.io.writing import json_text
from shjax.lights import split_lights

_ROWS_SHOWN = 25
PANELS = "from the coefficients | by the exact integral | their difference"


@dataclasses.dataclass(frozen=True)
class Split:
    """Light sources split off a map, and what is left of it."""

    lights: list[dict]
    rest: np.ndarray


@dataclasses.dataclass(frozen=True)
class LightResult:
    """What ``shjax light`` found of one map.

    Attributes:
        summary: For the JSON file and the terminal, without the files' names.
        source: The map's name.
        lighting: Coefficients, ``(K, C)``.
        spheres: White spheres, from the coefficients and by the integral.
        split: With ``--split``.
    """

    summary: dict
    source: str
    lighting: jax.Array
    spheres: tuple[np.ndarray, np.ndarray]
    split: Split | None


def write_results(out: Path, stem: str, found: LightResult) -> dict:
    """Write the pictures, then the JSON; returns its content."""
    result, lighting = dict(found.summary), found.lighting
    irradiance = np.asarray(
        shjax.synthesize(shjax.irradiance_coefs(lighting), n_theta=64, n_phi=128)
    )
    panels, shown = compare(*found.spheres, PANELS)
    about = header(found.source, units="radiance", albedo="1", panels=PANELS)
    units = header(found.source, units="irradiance, W m^-2")
    pictures = {
        "irradiance.exr": (irradiance, units),
        "irradiance.png": (_shown_irradiance(lighting), {}),
        "spheres.exr": (panels, about),
        "spheres.png": (shown, {}),
    }
    files = {name: str(out / f"{stem}_{name}") for name in pictures}
    if found.split is not None:
        result["lights"] = found.split.lights
        files |= _write_split(out, stem, found.source, found.split)
    for name, (image, attributes) in pictures.items():
        io.write_image(files[name], image, attributes=attributes)
    files["lighting.json"] = str(out / f"{stem}_lighting.json")
    result["files"] = files
    # Last, so that its presence says that all the others are there.
    io.write_text(files["lighting.json"], json_text(result, indent=1) + "\n")
    return result


def _shown_irradiance(lighting) -> np.ndarray:
    """The irradiance map large enough to see, its scale below."""
    coefs = shjax.irradiance_coefs(lighting)
    image = np.asarray(shjax.synthesize(coefs, n_theta=256, n_phi=512))
    level = np.maximum(image, 0).mean(axis=-1)
    return captioned(
        as_rgb(tone_map(image)),
        (f"irradiance of the normals: {level.min():.3g} to {level.max():.3g}",),
    )


def split_of(envmap: EnvironmentMap, rotation: np.ndarray | None) -> Split:
    """Split the brightest light sources off a map, rotated."""
    flat = envmap
    if envmap.layout != "latlong":
        flat = envmap.to_latlong(min(len(envmap.image), 1024))
    if rotation is not None:
        flat = rotated(flat, rotation)
    lights, rest = split_lights(flat)
    found = io.lights_as_json(lights)
    for light, radiance in zip(found, np.asarray(lights.radiance), strict=True):
        light["radiance"] = radiance.astype(float).tolist()
        x, y, z = light["direction"]
        light["azimuth"] = float(np.degrees(np.arctan2(y, x)))
        light["elevation"] = float(np.degrees(np.arcsin(np.clip(z, -1, 1))))
    return Split(found, np.asarray(rest.radiance))


def _write_split(out: Path, stem: str, source: str, split: Split) -> dict[str, str]:
    files = {name: str(out / f"{stem}_{name}") for name in ("rest.exr", "lights.json")}
    about = header(source, units="radiance", lights=f"{len(split.lights)} taken")
    io.write_image(files["rest.exr"], split.rest, attributes=about)
    content = {
        "schema": "shjax.lights/1",
        "source": source,
        "frame": FRAME,
        "units": "flux: radiance times solid angle, the irradiance of a surface that "
        "faces the light; angles in degrees, azimuth from +x towards +y",
        "lights": split.lights,
    }
    io.write_text(files["lights.json"], json_text(content, indent=1) + "\n")
    return files


def print_line(console: Console, result: dict, *, kept: str) -> None:
    """One of many files in one line, and from when it is if it was kept."""
    error = result["irradiance_error"]
    console.print(
        f"{Report(**result['report'])}; irradiance error mean {error['mean']:.2%}, max "
        f"{error['max']:.2%}" + (f" (kept, from {kept})" if kept else ""),
        markup=False,
        highlight=False,
    )


def print_result(console: Console, result: dict) -> None:
    """The coefficients as a table, the errors, and why they are what they are."""
    console.print(str(Report(**result["report"])), style="bold", markup=False)
    note = quadrature_note(result["quadrature"], max(result["l_max"], 2))
    if note:
        console.print(f"  {note}")
    table = Table(title="Lighting coefficients L_lm", title_justify="left")
    coefs = result["coefficients"]
    names = ("R", "G", "B") if len(coefs[0]) == 3 else range(len(coefs[0]))
    for heading in ("l", "m", *names):
        table.add_column(str(heading), justify="right")
    rows = zip(degrees(result["l_max"]), orders(result["l_max"]), coefs, strict=True)
    for l, m, values in itertools.islice(rows, _ROWS_SHOWN):
        table.add_row(str(l), str(m), *(f"{value:.5g}" for value in values))
    console.print(table)
    if len(coefs) > _ROWS_SHOWN:
        console.print(f"... {len(coefs) - _ROWS_SHOWN} more in the JSON file")
    console.print(
        f"frame: {result['frame']}\nbasis: {result['basis']}", highlight=False
    )
    error, recovered = result["irradiance_error"], result["recovered_error"]
    console.print(
        f"\n[bold]irradiance_error[/]  mean {error['mean']:.2%}, max {error['max']:.2%} "
        f"of the {error['relative_to']}"
    )
    if error["smallest_over_mean"] < 0:
        console.print(
            "  the expansion rings: its irradiance falls to "
            f"{error['smallest_over_mean']:.1%} of its mean"
        )
    console.print(
        f"[bold]recovered_error[/]   self {recovered['self']:.1e}, "
        f"exact {recovered['exact']:.1%}"
    )
    for paragraph in (
        "self: nine numbers from the sphere that nine numbers drew, a check of the code.",
        "exact: from the exact sphere, as from a photograph. One view shows half the "
        "normals, where light of degree 4, 6, ... looks like degrees 0 to 2; "
        f"{result['recovered']['message']}.",
    ):
        console.print(Padding.indent(paragraph, 2), highlight=False, soft_wrap=False)
    for light in result.get("lights", []):
        colour = ", ".join(f"{value:.4g}" for value in light["flux"])
        console.print(
            f"[bold]light[/]  azimuth {light['azimuth']:.1f}, elevation "
            f"{light['elevation']:.1f}, half angle {light['half_angle']:.2f} degrees, "
            f"flux {colour}",
            highlight=False,
        )
    if result.get("lights") == []:
        console.print("no light source stands out: nothing is split off")
    console.print(f"\nspheres: {PANELS}", highlight=False)
    console.print("written:")
    for name in result["files"].values():
        console.print(f"  {name}", highlight=False, markup=False)
