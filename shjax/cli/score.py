"""``shjax score``: how far a predicted light is from the true one."""

from __future__ import annotations

from pathlib import Path

import click

from shjax.cli.options import invalid_option, json_option, layout_option, number

DEGREE = 10  # the highest that is compared


@click.command(short_help="How far a predicted light is from the true one.")
@click.argument("predicted", type=click.Path(path_type=Path))
@click.argument("truth", type=click.Path(path_type=Path))
@number("--l-max", 2, click.IntRange(0, DEGREE), "Highest degree that is compared.")
@layout_option
@invalid_option
@json_option
def score(
    predicted: Path, truth: Path, l_max: int, layout: str, invalid: str, as_json: bool
) -> None:
    """Compare two lights: coefficients, irradiance, and three spheres.

    PREDICTED and TRUTH are panoramas or files of coefficients (of shjax estimate, shjax
    convert, three.js, cmgen). Coefficients are drawn as the panorama they add up to, and
    what of it is negative as black. The spheres are a mirror, matte silver (GGX, alpha
    0.3) and white diffuse; on each the RMSE, the RMSE after the best scale, and the mean
    angle between colours, in degrees.

    \b
    Example:
      shjax score ball_light.json studio.exr
    """
    from shjax.io import isolation

    isolation.start()  # the reader gets ready while the rest is imported
    from shjax.cli import score_run

    score_run.main(predicted, truth, l_max, layout, invalid, as_json)
