"""``shjax score``: how far a predicted light is from the true one."""

from __future__ import annotations

from pathlib import Path

import click
import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table

import shjax
from shjax import io, metrics
from shjax.cli.options import invalid_option, layout_option, light_of
from shjax.harmonics.degrees import degree_of_coefs
from shjax.io.writing import json_text
from shjax.sphere import fibonacci_directions

SCHEMA = "shjax.score/1"
_DEGREE = 10
_ROWS = 128


@click.command(short_help="How far a predicted light is from the true one.")
@click.argument("predicted", type=click.Path(path_type=Path))
@click.argument("truth", type=click.Path(path_type=Path))
@click.option(
    "--l-max", default=2, show_default=True, type=click.IntRange(0, _DEGREE),
    help="Highest degree of the coefficients compared.",
)  # fmt: skip
@layout_option
@invalid_option
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object.")
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
    (guess, guess_map), (exact, exact_map) = (
        _read(path, layout, invalid) for path in (predicted, truth)
    )
    if guess.shape[-1] != exact.shape[-1]:
        raise click.UsageError(
            f"PREDICTED has {guess.shape[-1]} channel(s), TRUTH {exact.shape[-1]}."
        )
    degree = min(l_max, degree_of_coefs(exact))
    error = metrics.lighting_error(guess, exact, l_max=degree)
    normals = jnp.asarray(fibonacci_directions(2000), exact.dtype)
    over = metrics.irradiance_errors(guess, exact, normals)
    spheres = metrics.three_sphere_errors(guess_map, exact_map)
    result = {
        "schema": SCHEMA,
        "predicted": str(predicted),
        "truth": str(truth),
        "l_max": degree,
        "lighting_error": float(error.total),
        "lighting_error_per_degree": [
            float(e) if np.isfinite(e) else None for e in np.asarray(error.per_degree)
        ],
        "irradiance_error": {"mean": float(over.mean), "max": float(over.max)},
        "spheres": {
            name: {key: float(value) for key, value in found._asdict().items()}
            for name, found in spheres.items()
        },
    }
    if as_json:
        print(json_text(result))
        return
    console = Console(highlight=False)
    degrees = ", ".join(f"{float(e):.2%}" for e in np.asarray(error.per_degree))
    console.print(
        f"lighting to degree {degree}: {float(error.total):.2%} (by degree {degrees})\n"
        f"irradiance over all normals: mean {float(over.mean):.2%}, largest "
        f"{float(over.max):.2%} of its mean"
    )
    table = Table("sphere", "RMSE", "scale-invariant RMSE", "angle, degrees")
    for name, found in spheres.items():
        table.add_row(
            name, f"{float(found.rmse):.4g}", f"{float(found.si_rmse):.4g}",
            f"{float(found.angular):.3g}",
        )  # fmt: skip
    console.print(table)


def _read(path: Path, layout: str, invalid: str):
    """Coefficients and a panorama of one light."""
    coefs = None if path.is_dir() else io.read_coefs(path)
    if coefs is not None:
        drawn = shjax.synthesize(jnp.asarray(coefs), n_theta=_ROWS, n_phi=2 * _ROWS)
        return jnp.asarray(coefs), jnp.maximum(drawn, 0)
    envmap = io.read_envmap(path, layout=layout, invalid=invalid, isolate=True)
    lighting, _ = light_of(envmap, _DEGREE, None)
    return lighting, jnp.asarray(envmap.to_latlong(_ROWS).radiance)
