"""``shjax convert``: coefficients from a panorama or a file to another tool's file."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np

import shjax
from shjax import io
from shjax.cli.options import (
    axes_option,
    invalid_option,
    layout_option,
    light_of,
    primaries_option,
    quadrature_note,
    rotate_option,
    window_option,
)
from shjax.conventions import CONVENTIONS
from shjax.harmonics.degrees import degree_of_coefs
from shjax.io.coefs import FORMATS
from shjax.io.writing import json_text
from shjax.windows import apply_window

SCHEMA = "shjax.convert/1"


@click.command(short_help="Coefficients in another tool's format.")
@click.argument("source", type=click.Path(path_type=Path))
@click.argument("target", type=click.Path(path_type=Path))
@click.option(
    "--to", "format", required=True, type=click.Choice(list(FORMATS)),
    help="What to write.",
)  # fmt: skip
@click.option(
    "--convention", default="shjax", show_default=True,
    type=click.Choice(list(CONVENTIONS), case_sensitive=False),
    help="Axes, sign and scale of a json, csv or c file.",
)  # fmt: skip
@click.option(
    "--l-max", type=click.IntRange(min=0), show_default="2, or SOURCE's own",
    help="Highest degree to write.",
)  # fmt: skip
@layout_option
@invalid_option
@primaries_option
@axes_option
@rotate_option
@window_option
@click.option(
    "--no-mirror", is_flag=True, help="SOURCE is an sh.txt made with cmgen --no-mirror."
)
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object.")
@click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")
def convert(
    source: Path,
    target: Path,
    format: str,
    convention: str,
    l_max: int | None,
    layout: str,
    invalid: str,
    primaries: str,
    axes: np.ndarray | None,
    rotate: np.ndarray | None,
    window: str,
    no_mirror: bool,
    as_json: bool,
    quiet: bool,
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
    if (
        axes is not None
        and convention.lower() == "shjax"
        and FORMATS[format].convention is None
    ):
        raise click.UsageError("--axes are a tool's: --convention must name it.")
    found = None if source.is_dir() else io.read_coefs(source, no_mirror=no_mirror)
    if found is None:
        if no_mirror:
            raise click.UsageError("--no-mirror belongs to an sh.txt; SOURCE is a map.")
        envmap = io.read_envmap(
            source, layout=layout, invalid=invalid, primaries=primaries, isolate=True
        )
        degree = 2 if l_max is None else l_max
        coefs, quadrature = light_of(envmap, degree, rotate)
        notes = [str(envmap.report), quadrature_note(quadrature, degree)]
    else:
        coefs, notes = _cut(source, found, l_max), []
        coefs = coefs if rotate is None else shjax.rotate(coefs, rotate)
    coefs = np.asarray(apply_window(coefs, window))
    io.write_coefs(target, coefs, format=format, convention=convention, axes=axes)
    if as_json and not quiet:
        written = {"schema": SCHEMA, "source": str(source), "target": str(target)}
        written |= {"format": format, "l_max": degree_of_coefs(coefs)}
        print(json_text({**written, "notes": [note for note in notes if note]}))
    elif not quiet:
        for line in (*notes, f"{target}: {coefs.shape[0]} coefficients, {format}"):
            if line:
                print(line)
    return 0


def _cut(source: Path, coefs: np.ndarray, l_max: int | None) -> np.ndarray:
    """The coefficients of a file up to a degree that it must have."""
    known = degree_of_coefs(coefs)
    if l_max is not None and l_max > known:
        raise click.UsageError(f"--l-max must be at most {known}, {source} ends there.")
    return coefs if l_max is None else coefs[: (l_max + 1) ** 2]
