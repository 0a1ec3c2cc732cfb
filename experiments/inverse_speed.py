"""Time of the lighting estimates beside NumPy's and SciPy's least squares, in one run.

    python experiments/inverse_speed.py [--out experiments/results]

Eleven thousand pixels in RGB, nine unknowns a channel; the design is not in NumPy's and
SciPy's time, it is in ours. Each time is the least of several, after a first call.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import click
import jax
import numpy as np
import scipy.optimize

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import shjax
from experiments.versions import versions
from shjax import render


def least(function, repeats: int) -> tuple[float, float]:
    """Seconds of the first call, and the least of the others."""
    times = []
    for _ in range(repeats + 1):
        start = time.perf_counter()
        jax.block_until_ready(function())
        times.append(time.perf_counter() - start)
    return times[0], min(times[1:])


@click.command()
@click.option("--out", type=click.Path(path_type=Path), help="Folder for the table.")
def main(out: Path | None) -> None:
    """Time each and print the table."""
    ball = render.sphere(128)
    lighting = np.random.default_rng(0).normal(size=(9, 3)).astype(np.float32)
    lighting[0] += 4
    picture = np.asarray(render.lambertian(ball, lighting))
    seen = (np.asarray(ball.mask) == 1) & (np.asarray(ball.normals)[..., 0] < -0.2)
    normals, values = np.asarray(ball.normals)[seen], picture[seen]
    gains = np.repeat([1, 2 / 3, 1 / 4], [1, 3, 5]).astype(np.float32)
    design = np.asarray(shjax.basis(normals, l_max=2)) * gains

    def scipys():
        def one(column):
            def residual(x):
                return design @ x - column

            slopes: Any = lambda x: design  # noqa: E731
            return scipy.optimize.least_squares(residual, np.zeros(9), jac=slopes).x

        return [one(column) for column in values.T]

    given = (jax.numpy.asarray(values), jax.numpy.asarray(normals))
    jitted = {
        prior: jax.jit(
            lambda i, n, p=prior: shjax.estimate_lighting(i, n, prior=p).value
        )
        for prior in (None, "picture")
    }
    cases = {
        "numpy.linalg.lstsq": lambda: np.linalg.lstsq(design, values, rcond=None)[0],
        "scipy least_squares, exact Jacobian, by channel": scipys,
        "estimate_lighting, prior=None": lambda: jitted[None](*given),
        "estimate_lighting, prior from the picture, 69 unknowns": (
            lambda: jitted["picture"](*given)
        ),
    }
    found = {name: least(function, 20) for name, function in cases.items()}
    unit = found["numpy.linalg.lstsq"][1]
    lines = [
        f"# Lighting from {len(values)} pixels, RGB, float32",
        "",
        "| | warm, over NumPy's | warm, ms | first call, s |",
        "|---|---|---|---|",
        *(
            f"| {name} | {warm / unit:.2f} | {1e3 * warm:.2f} | {first:.2f} |"
            for name, (first, warm) in found.items()
        ),
        "",
        ", ".join(f"{k} {v}" for k, v in versions().items()),
    ]
    print("\n".join(lines))
    if out is not None:
        shjax.io.write_text(out / "inverse_speed.md", "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
