"""What ``shjax score`` does."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import click
import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table

import shjax
from shjax import io, metrics
from shjax.cli.coefficients import light_of
from shjax.cli.score import DEGREE
from shjax.harmonics.degrees import degree_of_coefs
from shjax.io.writing import json_text
from shjax.sphere import fibonacci_directions

SCHEMA = "shjax.score/1"
_ROWS = 128


@dataclasses.dataclass(frozen=True)
class ScoreResult:
    """Errors of one light against another.

    Attributes:
        l_max: Highest degree compared.
        lighting: Of the coefficients.
        irradiance: Over all normals.
        spheres: By name: mirror, glossy, diffuse.
    """

    l_max: int
    lighting: metrics.LightingError
    irradiance: metrics.IrradianceErrors
    spheres: dict[str, metrics.PictureErrors]


def main(
    predicted: Path, truth: Path, l_max: int, layout: str, invalid: str, as_json: bool
) -> None:
    """Read both, compare, show."""
    lights = [_read(path, layout, invalid) for path in (predicted, truth)]
    found = run(*lights, l_max=l_max)
    if as_json:
        about = {"schema": SCHEMA, "predicted": str(predicted), "truth": str(truth)}
        print(json_text(about | summary(found)))
    else:
        show(Console(highlight=False), found)


def run(predicted, truth, *, l_max: int) -> ScoreResult:
    """Compare two lights, each coefficients and a panorama."""
    (guess, guess_map), (exact, exact_map) = predicted, truth
    if guess.shape[-1] != exact.shape[-1]:
        raise click.UsageError(
            f"PREDICTED has {guess.shape[-1]} channel(s), TRUTH {exact.shape[-1]}."
        )
    degree = min(l_max, degree_of_coefs(exact))
    normals = jnp.asarray(fibonacci_directions(2000), exact.dtype)
    return ScoreResult(
        degree,
        metrics.lighting_error(guess, exact, l_max=degree),
        metrics.irradiance_errors(guess, exact, normals),
        metrics.three_sphere_errors(guess_map, exact_map),
    )


def summary(found: ScoreResult) -> dict[str, Any]:
    """The errors as JSON."""
    by_degree = np.asarray(found.lighting.per_degree, float)
    over = found.irradiance
    return {
        "l_max": found.l_max,
        "lighting_error": float(found.lighting.total),
        "lighting_error_per_degree": [e if np.isfinite(e) else None for e in by_degree],
        "irradiance_error": {"mean": float(over.mean), "max": float(over.max)},
        "spheres": {
            name: {key: float(value) for key, value in errors._asdict().items()}
            for name, errors in found.spheres.items()
        },
    }


def show(console: Console, found: ScoreResult) -> None:
    """Show the errors as sentences and a table."""
    degrees = ", ".join(
        f"{float(e):.2%}" for e in np.asarray(found.lighting.per_degree)
    )
    over = found.irradiance
    console.print(
        f"lighting to degree {found.l_max}: {float(found.lighting.total):.2%} (by degree "
        f"{degrees})\nirradiance over all normals: mean {float(over.mean):.2%}, largest "
        f"{float(over.max):.2%} of its mean"
    )
    table = Table("sphere", "RMSE", "scale-invariant RMSE", "angle, degrees")
    for name, errors in found.spheres.items():
        numbers = (errors.rmse, errors.si_rmse)
        cells = [f"{float(value):.4g}" for value in numbers]
        table.add_row(name, *cells, f"{float(errors.angular):.3g}")
    console.print(table)


def _read(path: Path, layout: str, invalid: str):
    """Coefficients and a panorama of one light."""
    coefs = None if path.is_dir() else io.read_coefs(path)
    if coefs is not None:
        drawn = shjax.synthesize(jnp.asarray(coefs), n_theta=_ROWS, n_phi=2 * _ROWS)
        return jnp.asarray(coefs), jnp.maximum(drawn, 0)
    envmap = io.read_envmap(path, layout=layout, invalid=invalid, isolate=True)
    lighting, _ = light_of(envmap, DEGREE, None)
    return lighting, jnp.asarray(envmap.to_latlong(_ROWS).radiance)
