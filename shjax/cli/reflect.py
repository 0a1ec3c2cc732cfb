"""``shjax reflect``: a panorama and a BRDF in; the model that an error allows out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from shjax.cli.options import (
    Output,
    Reading,
    Reflectance,
    number,
    out_option,
    output_options,
    reading_options,
    reflectance_options,
    rotate_option,
)

if TYPE_CHECKING:
    import numpy as np


@click.command(short_help="The reflection model for an error, and spheres.")
@click.argument("env", required=False, type=click.Path(path_type=Path))
@out_option
@reflectance_options
@number("--size", 160, click.IntRange(8, 512), "Side of each sphere.", metavar="PIXELS")
@rotate_option
@reading_options
@output_options
def reflect(
    env: Path | None,
    out: Path,
    reflectance: Reflectance,
    size: int,
    rotate: np.ndarray | None,
    reading: Reading,
    output: Output,
) -> None:
    """Choose the fastest reflection model of a material whose error is small enough.

    ENV is an environment map; left out, the panorama that comes with shjax. The model is
    the one that is read the fastest among coefficients over the normal, a radial map, a
    map without azimuth, the spherical harmonic reflection map and a low-rank one fitted
    to the material, each with as many light sources apart as help, whose predicted
    error over all orientations and views is small enough. Its error is then measured
    against the integral (over ENV averaged to 256 x 128).

    With --material the light is prefiltered once for every roughness and reflectance
    (the lighting layer), and --rms-error and --max-bytes do not count.

    \b
    DIR receives
      NAME_reflect.json   the model and why, errors predicted and measured
      NAME_shrm.exr       its map, one layer per coefficient (p1q-1.R, p1q-1.G, ...)
      NAME_light.exr      with --material: the prefiltered light; with NAME_light.json
                          it is all that a shader needs, which that file describes
      NAME_reflection.exr a sphere: by the model; by the exact integral; their
                          difference (.png: red too bright, blue too dark, full
                          colour at a tenth of white)

    \b
    Examples:
      shjax reflect --brdf "ggx alpha=0.4 f0=1" --rms-error 0.1 --out results
      shjax reflect studio.exr --out results \\
        --brdf "lambertian albedo=0.5 + 0.3 * phong_cosine exponent=30"
      shjax reflect --material roughness=0.4,metallic=1,albedo=1,0.8,0.4 --out results
    """
    material = reflectance.material
    if material is not None and material.mesh:
        raise click.UsageError("--material mesh needs a mesh; use shjax render.")
    from shjax.io import isolation

    isolation.start()  # the reader gets ready while the rest is imported
    from shjax.cli import reflect_run

    reflect_run.main(env, out, reflectance, size, rotate, reading, output)
