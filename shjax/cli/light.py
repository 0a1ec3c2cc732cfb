"""``shjax light``: a panorama in; coefficients, irradiance and spheres out."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

import click

from shjax.cli.options import (
    Output,
    Reading,
    number,
    out_option,
    output_options,
    packed,
    reading_options,
    rotate_option,
    window_option,
)

if TYPE_CHECKING:
    import numpy as np


@dataclasses.dataclass(frozen=True)
class Settings:
    """What is made of each map."""

    l_max: int = 2
    size: int = 192
    split: bool = False
    rotate: np.ndarray | None = None
    window: str = "none"
    checks: bool | None = None


settings_options = packed(
    "settings",
    Settings,
    number("--l-max", 2, click.IntRange(min=0), "Highest degree of the coefficients."),
    number(
        "--size",
        192,
        click.IntRange(8, 512),
        "Side of each rendered sphere.",
        metavar="PIXELS",
    ),
    click.option(
        "--split",
        is_flag=True,
        help="Write the brightest light sources and the rest of the map apart.",
    ),
    rotate_option,
    window_option,
    click.option(
        "--checks/--no-checks",
        default=None,
        help="Measure the coefficients against the integral, on a sphere too, and recover "
        "them from its picture; default for one ENV, not for many.",
    ),
)


@click.command(short_help="Lighting coefficients, irradiance and spheres.")
@click.argument("env", nargs=-1, type=click.Path(path_type=Path))
@out_option
@settings_options
@reading_options
@click.option("--force", is_flag=True, help="Do again what was done before.")
@output_options
def light(
    env: tuple[Path, ...],
    out: Path,
    settings: Settings,
    reading: Reading,
    force: bool,
    output: Output,
) -> int:
    """Project environment maps on spherical harmonics and show what nine numbers hold.

    ENV is an environment map of any layout (EXR, Radiance .hdr, PFM, .npy, TIFF, PNG,
    JPEG), a folder of them, or a folder of the six faces of a cube; left out, a panorama
    that comes with shjax is used. Of many, one that cannot be read does not stop the
    rest, and what an earlier run has done is kept. Two runs on one folder share the work.

    \b
    For each ENV, DIR receives
      NAME_lighting.json     coefficients; with checks: errors, what was recovered
      NAME_irradiance.exr    irradiance map, lat-long (and .png, tone-mapped)
      NAME_spheres.exr       with checks: white sphere: from the coefficients; by the
                             exact integral; their difference (.png: red too bright,
                             blue too dark, full colour at a tenth of white)
      NAME_lights.json       with --split: direction, half angle and colour of each
                             light source (a sun, lamps), for sun lamps elsewhere
      NAME_rest.exr          with --split: the map without them; the flux is kept

    \b
    Examples:
      shjax light --out results
      shjax light studio.exr sunset.hdr --l-max 4 --out results
      shjax light sunset.hdr --split --out results
      shjax light panoramas/ --out results
    """
    from shjax.io import isolation

    isolation.start()  # the reader gets ready while the rest is imported
    from shjax.cli import light_run

    return light_run.main(env, out, settings, reading, force, output)
