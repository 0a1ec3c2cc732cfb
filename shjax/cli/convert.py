"""``shjax convert``: coefficients from a panorama or a file to another tool's file."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import click
import numpy as np

import shjax
from shjax import io
from shjax.cli.options import (
    Output,
    Reading,
    axes_option,
    light_of,
    number,
    output_options,
    packed,
    quadrature_note,
    reading_options,
    rotate_option,
    window_option,
)
from shjax.conventions import CONVENTIONS
from shjax.harmonics.degrees import degree_of_coefs
from shjax.io.coefs import FORMATS, OTHER_NAMES
from shjax.windows import apply_window

SCHEMA = "shjax.convert/1"


class FormatName(click.Choice):
    """Name of a format, as this command or as the tool itself spells it."""

    def convert(self, value, param, ctx):
        """The format's own name."""
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
        type=FormatName(list(FORMATS)),
        help="What to write.",
    ),
    click.option(
        "--convention",
        default="shjax",
        show_default=True,
        type=click.Choice(list(CONVENTIONS), case_sensitive=False),
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


@dataclasses.dataclass(frozen=True)
class ConvertResult:
    """Coefficients ``(K, C)`` to be written, and what there is to say of them."""

    coefs: np.ndarray
    notes: list[str]


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
    if target.exists() and source.exists() and target.samefile(source):
        raise click.UsageError("TARGET is SOURCE; it would be overwritten.")
    own = settings.convention.lower() == "shjax"
    if (
        settings.axes is not None
        and own
        and FORMATS[settings.format].convention is None
    ):
        raise click.UsageError("--axes are a tool's: --convention must name it.")
    found = run(source, settings, reading)
    io.write_coefs(
        target,
        found.coefs,
        format=settings.format,
        convention=settings.convention,
        axes=settings.axes,
    )
    result = {"schema": SCHEMA, "source": str(source), "target": str(target)}
    result |= {"format": settings.format, "l_max": degree_of_coefs(found.coefs)}
    if not output.print_json({**result, "notes": found.notes}):
        print(*found.notes, sep="\n", end="\n" if found.notes else "")
        print(f"{target}: {found.coefs.shape[0]} coefficients, {settings.format}")
    return 0


def run(source: Path, settings: Settings, reading: Reading) -> ConvertResult:
    """Read coefficients, or project a map on them, and window them."""
    found = None
    if not source.is_dir():
        found = io.read_coefs(source, no_mirror=settings.no_mirror)
    notes = []
    if found is None:
        if settings.no_mirror:
            raise click.UsageError("--no-mirror belongs to an sh.txt; SOURCE is a map.")
        envmap = reading.read(source)
        degree = 2 if settings.l_max is None else settings.l_max
        coefs, quadrature = light_of(envmap, degree, settings.rotate)
        notes = [str(envmap.report), quadrature_note(quadrature, degree)]
    else:
        coefs = _cut(source, found, settings.l_max)
        if settings.rotate is not None:
            coefs = shjax.rotate(coefs, settings.rotate)
    coefs = np.asarray(apply_window(coefs, settings.window))
    return ConvertResult(coefs, [note for note in notes if note])


def _cut(source: Path, coefs: np.ndarray, l_max: int | None) -> np.ndarray:
    """The coefficients of a file up to a degree that it must have."""
    known = degree_of_coefs(coefs)
    if l_max is not None and l_max > known:
        raise click.UsageError(f"--l-max must be at most {known}, {source} ends there.")
    return coefs if l_max is None else coefs[: (l_max + 1) ** 2]
