"""``shjax estimate``: the light from one picture of a known object."""

from __future__ import annotations

from pathlib import Path

import click

from shjax.cli import words
from shjax.cli.estimate_options import Fitting, Shape, fitting_options, shape_options
from shjax.cli.options import Output, out_option, output_options


@click.command(short_help="The light from a picture of a known object.")
@click.argument("image", type=click.Path(path_type=Path))
@out_option
@shape_options
@fitting_options
@output_options
def estimate(
    image: Path, out: Path, shape: Shape, fitting: Fitting, output: Output
) -> int:
    """Estimate the light from a picture of an object whose shape is known.

    IMAGE is linear (EXR, HDR) or an 8- or 16-bit picture, decoded as sRGB unless
    --transfer linear says that it is not; values
    at its white count as "at least that". Say what it shows by one of --sphere, --normals
    or --mesh. A sphere and normals of the camera's frame are seen along +x with +z up:
    that frame is the light's.

    \b
    DIR receives
      NAME_light.json       coefficients, standard deviations, what is determined
                            (shjax convert and shjax score read it)
      NAME_light.exr, .png  the estimated light as a panorama
      NAME_pictures.exr     drawn from the estimate; the picture; their difference
                            (.png: full colour at a tenth of white)

    \b
    Examples:
      shjax estimate ball.png --sphere 244.5,144.5,108 --out results
      shjax estimate photo.exr --normals normals.exr --normals-frame camera \\
        --normals-range signed --albedo 0.6,0.5,0.4 --out results
      shjax estimate bunny.exr --mesh bunny.ply --camera 0,0,4 --up 0,1,0 --out results
    """
    _check(shape, fitting)
    from shjax.io import isolation

    isolation.start()  # the reader gets ready while the rest is imported
    from shjax.cli import estimate_run

    return estimate_run.main(image, out, shape, fitting, output)


def _check(shape: Shape, fitting: Fitting) -> None:
    ways = [n for n in ("sphere", "normals", "mesh") if getattr(shape, n) is not None]
    if len(ways) != 1:
        raise click.UsageError(
            "say what the picture shows by one of --sphere, --normals and --mesh; got "
            f"{' and '.join(ways) or 'none'}."
        )
    named = shape.normals_frame and shape.normals_range
    if ways == ["normals"] and not named:
        raise click.UsageError(
            "--normals needs --normals-frame (world or camera) and --normals-range "
            "(signed or unsigned): neither can be told from the numbers."
        )
    if ways == ["mesh"] and shape.camera is None:
        raise click.UsageError("--mesh needs --camera.")
    if fitting.brdf is not None and ways == ["mesh"]:
        raise click.UsageError("--brdf does not go with --mesh: its shadows are matte.")
    unseen = shape.normals_frame not in words.SEEN_FRAMES
    if fitting.brdf is not None and ways == ["normals"] and unseen:
        raise click.UsageError(
            "--brdf needs views, which normals in the world's frame do not tell."
        )
