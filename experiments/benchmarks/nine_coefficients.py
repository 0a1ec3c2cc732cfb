"""Nine coefficients and their irradiance, as multiples of simpler work in the same run.

    python experiments/benchmarks/nine_coefficients.py

Projection of 2048 x 1024 x 3 float32 to nine coefficients over summing the same array;
the brute-force irradiance integral over the nine-coefficient one.
"""

from __future__ import annotations

import json
import platform
import sys
from pathlib import Path

import click
import jax
import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import shjax
from experiments.timing import interleaved_medians
from shjax.sphere import fibonacci_directions


def run(rounds: int = 21, normals: int = 4096) -> dict:
    """Median times in seconds and the two ratios."""
    rng = np.random.default_rng(0)
    large = jnp.asarray(rng.random((1024, 2048, 3), np.float32))
    small = jnp.asarray(rng.random((512, 1024, 3), np.float32))
    directions = jnp.asarray(fibonacci_directions(normals), jnp.float32)
    lighting = shjax.analyze(small, l_max=2)
    total = jax.jit(jnp.sum)
    quick = {
        "sum": lambda: total(large),
        "nine coefficients": lambda: shjax.analyze(large, l_max=2),
        "irradiance from nine": lambda: shjax.irradiance(lighting, directions),
    }
    slow = {
        "irradiance by integral": lambda: shjax.reference_irradiance(small, directions)
    }
    times = interleaved_medians(quick, rounds) | interleaved_medians(slow, 3)
    return {
        "machine": platform.machine(),
        "jax": jax.__version__,
        "normals": normals,
        "seconds": times,
        "projection_over_sum": times["nine coefficients"] / times["sum"],
        "integral_over_nine": times["irradiance by integral"]
        / times["irradiance from nine"],
    }


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def main(as_json: bool) -> None:
    """Print the two ratios."""
    result = run()
    if as_json:
        print(json.dumps(result))
        return
    for name, seconds in result["seconds"].items():
        print(f"{name:24} {1e3 * seconds:10.3f} ms")
    print(f"projection over sum      {result['projection_over_sum']:10.2f}")
    print(f"integral over nine       {result['integral_over_nine']:10.0f}")


if __name__ == "__main__":
    main()
