"""``shjax convert``: coefficients from a panorama or a file to another tool's file."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

import click

from shjax.cli import words
from shjax.cli.options import (
    Output,
    Reading,
    axes_option,
    number,
    output_options,
    packed,
    reading_options,
    rotate_option,
    window_option,
)

if TYPE_CHECKING:
    import numpy as np


class FormatName(click.Choice):
    """Name of a format, as this command or as the tool itself spells it."""

    def convert(self, value, param, ctx):
        """The format's own name."""
        from shjax.io.coefs import OTHER_NAMES

        name = value.lower()
        return super().convert(OTHER_NAMES.get(name, name), param, ctx)


@dataclasses.dataclass(frozen=True)
class Settings:
    """What is written."""

    format: str
    convention: str
    l_max: int | None
    axes: np.ndarray | None
    rotate: np.ndarray | None
    window: str
    no_mirror: bool


settings_options = packed(
    "settings",
    Settings,
    click.option(
        "--to",
        "format",
        required=True,
        type=FormatName(words.FORMATS),
        help="What to write.",
    ),
    click.option(
        "--convention",
        default="shjax",
        show_default=True,
        type=click.Choice(words.CONVENTIONS, case_sensitive=False),
        help="Axes, sign and scale of a json, csv or c file.",
    ),
    number(
        "--l-max",
        None,
        click.IntRange(min=0),
        "Highest degree to write.",
        show_default="2, or SOURCE's own",
    ),
    axes_option,
    rotate_option,
    window_option,
    click.option(
        "--no-mirror",
        is_flag=True,
        help="SOURCE is an sh.txt made with cmgen --no-mirror.",
    ),
)


@click.command(short_help="Coefficients in another tool's format.")
@click.argument("source", type=click.Path(path_type=Path))
@click.argument("target", type=click.Path(path_type=Path))
@settings_options
@reading_options
@output_options
def convert(
    source: Path, target: Path, settings: Settings, reading: Reading, output: Output
) -> int:
    """Write the lighting of SOURCE into TARGET as another tool stores it.

    SOURCE is an environment map, a coefficient file of shjax, a three.js LightProbe
    (JSON) or cmgen's sh.txt in any of its scales.

    \b
    --to three             three.js LightProbe JSON
    --to cmgen             sh.txt, radiance (also -irradiance, -shader and
                           cmgen-no-mirror...)
    --to gltf              EXT_lights_image_based block; needs --axes
    --to c, csv, json      any --convention

    \b
    Examples:
      shjax convert studio.exr probe.json --to three
      shjax convert sh.txt light.h --to c --convention unreal --axes=x,-y,z
    """
    from shjax.io import isolation

    isolation.start()  # the reader gets ready while the rest is imported
    from shjax.cli import convert_run

    return convert_run.main(source, target, settings, reading, output)
