"""What ``shjax light`` shows and writes: pictures, JSON, a table, progress."""

from __future__ import annotations

import dataclasses
import itertools
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console
from rich.padding import Padding
from rich.table import Table

import shjax
from shjax import io
from shjax.cli.coefficients import quadrature_note
from shjax.cli.pictures import FRAME, as_rgb, captioned, compare, header, rotated
from shjax.display import tone_map
from shjax.envmap import EnvironmentMap, Report
from shjax.harmonics.degrees import degrees, orders
from shjax.io.writing import json_text
from shjax.lights import split_lights

if TYPE_CHECKING:
    from shjax.cli.light_checks import Checks

_ROWS_SHOWN = 25
PANELS = "from the coefficients | by the exact integral | their difference"
_NOT_CHECKED = {"irradiance_error": None, "recovered_error": None, "integral": None}


@dataclasses.dataclass(frozen=True)
class Split:
    """Light sources split off a map, and what is left of it."""

    lights: list[dict]
    rest: np.ndarray


@dataclasses.dataclass(frozen=True)
class Light:
    """What ``shjax light`` found of one map.

    Attributes:
        summary: For the JSON file and the terminal, without the files' names.
        source: The map's name.
        lighting: Coefficients, ``(K, C)``.
        nine: Those to degree 2, without a window.
        split: With ``--split``.
    """

    summary: dict
    source: str
    lighting: np.ndarray
    nine: np.ndarray
    split: Split | None


def write_light(out: Path, stem: str, found: Light) -> dict:
    """Write what was asked for: the irradiance map, then the JSON; returns its content."""
    result, lighting = {**found.summary, **_NOT_CHECKED}, found.lighting
    coefs = shjax.irradiance_coefs(lighting)
    units = header(found.source, units="irradiance, W m^-2")
    files = {n: str(out / f"{stem}_{n}") for n in ("irradiance.exr", "irradiance.png")}
    irradiance = np.asarray(shjax.synthesize(coefs, n_theta=64, n_phi=128))
    io.write_image(files["irradiance.exr"], irradiance, attributes=units)
    io.write_image(files["irradiance.png"], _shown_irradiance(coefs))
    if found.split is not None:
        result["lights"] = found.split.lights
        files |= _write_split(out, stem, found.source, found.split)
    whole = not found.summary["job"]["checks"]
    return _write_record(out, stem, result, files, whole)


def write_checks(
    out: Path, stem: str, found: Light, checks: Checks, result: dict
) -> dict:
    """Write the spheres, then the JSON again; returns its content."""
    panels, shown = compare(*checks.spheres, PANELS)
    about = header(found.source, units="radiance", albedo="1", panels=PANELS)
    files = {n: str(out / f"{stem}_{n}") for n in ("spheres.exr", "spheres.png")}
    io.write_image(files["spheres.exr"], panels, attributes=about)
    io.write_image(files["spheres.png"], shown)
    files = {**result["files"], **files}
    return _write_record(out, stem, {**result, **checks.summary}, files, True)


def _write_record(
    out: Path, stem: str, result: dict, files: dict[str, str], whole: bool
) -> dict:
    """Write the JSON file; one that is to be written again names no job.

    A second run looks for the job, and does again what has none.
    """
    file = str(out / f"{stem}_lighting.json")
    result = {**result, "files": {**files, "lighting.json": file}}
    written = result if whole else {**result, "job": None}
    io.write_text(file, json_text(written, indent=1) + "\n")
    return result


def _shown_irradiance(coefs) -> np.ndarray:
    """The irradiance map large enough to see, its scale below."""
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
    words = str(Report(**result["report"]))
    if error is not None:
        mean, largest = error["mean"], error["max"]
        words += f"; irradiance error mean {mean:.2%}, max {largest:.2%}"
    words += f" (kept, from {kept})" if kept else ""
    console.print(words, markup=False, highlight=False)


def print_coefficients(console: Console, result: dict) -> None:
    """The coefficients as a table, and the light sources that were split off."""
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


def print_checks(console: Console, result: dict) -> None:
    """The errors, and why they are what they are."""
    if result["irradiance_error"] is None:
        return
    error, recovered = result["irradiance_error"], result["recovered_error"]
    integral = result["integral"]
    console.print(
        f"\n[bold]irradiance_error[/]  mean {error['mean']:.2%}, max {error['max']:.2%} "
        f"of the {error['relative_to']}"
    )
    if integral["difference"]:
        console.print(
            f"  against the integral over {integral['rows']} rows, whose irradiance is "
            f"within {integral['difference']:.2%} of the whole map's"
        )
    if error["smallest_over_mean"] < 0:
        console.print(
            "  the expansion rings: its irradiance falls to "
            f"{error['smallest_over_mean']:.1%} of its mean"
        )
    console.print(
        f"[bold]recovered_error[/]   default {recovered['default']:.1%}, plain "
        f"{recovered['plain']:.1%}, self {recovered['self']:.1e}"
    )
    for paragraph in (
        "default: nine numbers from the picture of the exact sphere, as from a photograph, "
        "by estimate_lighting, which marginalises higher degrees; "
        f"{result['recovered']['message']}.",
        "plain: by least squares of nine numbers alone. One view shows half the normals, "
        "where light of degree 4, 6, ... looks like degrees 0 to 2.",
        "self: from the sphere that nine numbers drew, a check of the code.",
    ):
        console.print(Padding.indent(paragraph, 2), highlight=False, soft_wrap=False)
    console.print(f"\nspheres: {PANELS}", highlight=False)


def print_files(console: Console, result: dict) -> None:
    """The files that were written."""
    console.print("written:")
    for name in result["files"].values():
        console.print(f"  {name}", highlight=False, markup=False)
