"""Time of the lighting estimates beside NumPy's and SciPy's least squares, in one run.

    python experiments/inverse_speed.py [--out experiments/results]

Eleven thousand pixels in RGB, nine unknowns a channel; the design is not in NumPy's and
SciPy's time, it is in ours. Warm times are interleaved medians.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click
import jax
import numpy as np
import scipy.optimize

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import shjax
from experiments.timing import interleaved_medians, stopwatch
from experiments.versions import versions_line
from experiments.writing import markdown_table, write_result
from shjax import render


@click.command()
@click.option("--out", type=click.Path(path_type=Path), help="Folder for the table.")
def main(out: Path | None) -> None:
    """Time each and print the table."""
    ball = render.sphere(128)
    lighting = np.random.default_rng(0).normal(size=(9, 3)).astype(np.float32)
    lighting[0] += 4
    picture = np.asarray(render.image(ball, lighting))
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
    first = {name: stopwatch(function) for name, function in cases.items()}
    warm = interleaved_medians(cases, 20)
    unit = warm["numpy.linalg.lstsq"]
    rows = [
        [name, f"{t / unit:.2f}", f"{1e3 * t:.2f}", f"{first[name]:.2f}"]
        for name, t in warm.items()
    ]
    head = ["", "warm, over NumPy's", "warm, ms", "first call, s"]
    text = "\n\n".join(
        [
            f"# Lighting from {len(values)} pixels, RGB, float32",
            markdown_table(head, rows),
            versions_line(),
        ]
    )
    write_result(out, "inverse_speed", text)


if __name__ == "__main__":
    main()
