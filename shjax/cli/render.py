"""``shjax render``: a mesh under a panorama, in a material of one's choice."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

import click

from shjax.cli import words
from shjax.cli.options import (
    Output,
    Reading,
    Reflectance,
    choice,
    number,
    out_option,
    output_options,
    packed,
    reading_options,
    reflectance_options,
)
from shjax.cli.texts import AreaLightText, FiniteRange

if TYPE_CHECKING:
    from shjax.lights import AreaLight


@dataclasses.dataclass(frozen=True)
class View:
    """Stance of the mesh, and the cameras around it."""

    size: int
    up: str
    azimuth: float
    elevation: float
    fov: float
    turntable: int
    background: bool


view_options = packed(
    "view",
    View,
    number(
        "--size", 384, click.IntRange(8, 4096), "Side of the picture.", metavar="PIXELS"
    ),
    choice("--up", words.UP_AXES, "y", "Which axis of the mesh points up."),
    number(
        "--azimuth",
        30.0,
        FiniteRange(),
        "Where the camera stands around the mesh.",
        metavar="DEGREES",
    ),
    number(
        "--elevation",
        12.0,
        FiniteRange(-89, 89),
        "How far above its middle.",
        metavar="DEGREES",
    ),
    number(
        "--fov",
        35.0,
        FiniteRange(1, 120),
        "The camera's horizontal field of view.",
        metavar="DEGREES",
    ),
    number(
        "--turntable",
        1,
        click.IntRange(1, 3600),
        "Pictures of a whole turn of the camera.",
        metavar="FRAMES",
    ),
    click.option(
        "--background/--no-background",
        default=True,
        show_default=True,
        help="Whether the panorama is seen behind the mesh.",
    ),
)


@click.command(short_help="A picture of a mesh under a panorama.")
@click.argument("mesh", type=click.Path(path_type=Path))
@click.argument("env", required=False, type=click.Path(path_type=Path))
@out_option
@reflectance_options
@click.option(
    "--light",
    "area_lights",
    multiple=True,
    type=AreaLightText(),
    help="An area light beside the panorama, in words; give it again for another.",
)
@view_options
@reading_options
@output_options
def render_command(
    mesh: Path,
    env: Path | None,
    out: Path,
    reflectance: Reflectance,
    area_lights: tuple[tuple[str, AreaLight], ...],
    view: View,
    reading: Reading,
    output: Output,
) -> None:
    """Draw a mesh (OBJ, OFF, PLY, glTF) under an environment map.

    The mesh is centred and scaled to radius 1. The light is distant: nothing casts a
    shadow. --brdf is drawn by the fastest model for --rms-error; --material by the lighting
    layer, which takes textures (--material mesh). --light adds area lights near the mesh:
    polygon, disk, ellipse, sphere, capsule or line, in its units (its radius is 1) and the
    panorama's frame. Needs trimesh and embreex (pip install 'shjax[mesh]').

    \b
    DIR receives
      NAME.exr, NAME.png    the picture, linear and tone-mapped; of a turntable
                            NAME_0000.exr ... and one PNG each. A second run with the
                            same settings draws only what is missing
      NAME_render.json      the model that drew it, and the settings

    \b
    Examples:
      shjax render spot.obj --brdf "ggx alpha=0.3 f0=0.9" --out results
      shjax render bunny.off studio.exr --turntable 60 --out results \\
        --brdf "lambertian albedo=0.5,0.2,0.1 + ggx alpha=0.2 f0=0.04"
      shjax render helmet.glb --material mesh --out results
      shjax render spot.obj --brdf "ggx alpha=0.3 f0=0.9" --out results \\
        --light "disk centre=0,1,2 normal=0,-1,-2 radius=0.5 radiance=8,8,6"
    """
    from shjax.io import isolation

    isolation.start()  # the reader gets ready while the rest is imported
    from shjax.cli import render_run

    render_run.main(mesh, env, out, reflectance, area_lights, view, reading, output)
