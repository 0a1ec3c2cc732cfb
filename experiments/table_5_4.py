"""Table 5.4 of the thesis: prefiltering by Phong lobes, angular over frequency.

    taskset -c 0 python experiments/table_5_4.py --out experiments/results

Both sides from a 128 x 128 map to a 128 x 128 map, RGB float32, jitted, timed in one run.
Frequency: the lighting's coefficients to F = 1 + sqrt(6 s), times a_l, synthesized.
Angular: the integral over the lobe's cap of 95 % energy, in tiles. Beside them filtered
importance sampling, today's competitor, with the fewest samples (up to 1024) whose error
is no larger than frequency's. Errors are against the whole integral.
"""

from __future__ import annotations

import functools
import math
import sys
from pathlib import Path

import click
import jax
import jax.numpy as jnp

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import shjax
import shjax.vectors
from experiments.alternatives import importance
from experiments.prefiltering import (
    SIZE,
    importance_at,
    light,
    rms,
    samples_of,
)
from experiments.timing import median_seconds
from experiments.versions import versions_line
from experiments.writing import markdown_table, write_result
from shjax import brdf
from shjax.brdf.flux import lobe_angle
from shjax.sphere import latlong_directions

PAPER = {8: 830.6, 16: 333.6, 32: 137.1, 64: 52.6, 128: 21.9, 256: 7.7, 512: 3.3}


def frequency(panorama: jax.Array, exponent: float, f: int) -> jax.Array:
    """The reflection map by harmonics."""
    gains = shjax.brdf.radial_coefs(brdf.phong(exponent), l_max=f)
    size = panorama.shape[0]
    reflected = shjax.reflection.convolve(shjax.analyze(panorama, l_max=f), gains)
    return shjax.synthesize(reflected, n_theta=size, n_phi=panorama.shape[1])


def run(size: int = SIZE, exponents: tuple[int, ...] = tuple(PAPER)) -> dict:
    """One row an exponent."""
    panorama = light(size)
    towards = jnp.asarray(latlong_directions(size, size).reshape(-1, 3), jnp.float32)
    rows = []
    for s in exponents:
        model = brdf.phong(float(s))
        f = min(1 + math.floor(math.sqrt(6 * s)), (size - 1) // 2)
        quick = jax.jit(functools.partial(frequency, exponent=float(s), f=f))
        exact = shjax.reference_reflection(panorama, model, towards, towards)

        def angular(model=model):
            return shjax.reference_reflection(
                panorama, model, towards, towards, lobe_energy=0.95
            )

        error = rms(quick(panorama).reshape(-1, 3), exact)
        slow = median_seconds(angular, 3)
        fast = median_seconds(lambda q=quick: q(panorama), 9)
        width = (1 - math.cos(lobe_angle(model, 0.95))) / 2
        sampled = importance_at(
            error,
            panorama,
            model,
            towards,
            towards,
            lambda n, s=s: functools.partial(_draw, float(s), n),
            exact,
        )
        rows.append(
            {
                "s": s,
                "F": f,
                "angular": slow,
                "frequency": fast,
                "ratio": slow / fast,
                "paper": PAPER.get(s),
                "error": error,
                "angular_error": rms(angular(), exact),
                "samples_per_second": width * towards.shape[0] ** 2 / slow,
                "importance": sampled,
            }
        )
        print(f"s = {s}: {slow / fast:.1f}", file=sys.stderr)
    return {"size": size, "rows": rows}


def _draw(exponent: float, n: int, normals, views) -> importance.Drawn:
    return importance.draw_phong(exponent, n, shjax.vectors.mirror(normals, views))


def table(result: dict) -> str:
    """The rows as markdown."""
    heading = [
        "s",
        "F",
        "angular, ms",
        "Msamples/s",
        "frequency, ms",
        "ratio",
        "paper",
        "angular error",
        "frequency error",
        "FIS samples",
        "FIS, ms",
        "FIS error",
        "FIS over frequency",
    ]
    rows = []
    for row in result["rows"]:
        fis = row["importance"]
        rows.append(
            [
                str(row["s"]),
                str(row["F"]),
                f"{1e3 * row['angular']:.0f}",
                f"{row['samples_per_second'] / 1e6:.0f}",
                f"{1e3 * row['frequency']:.2f}",
                f"**{row['ratio']:.0f}**",
                str(row["paper"]),
                f"{row['angular_error']:.1%}",
                f"{row['error']:.2%}",
                samples_of(fis),
                f"{1e3 * fis['seconds']:.0f}",
                f"{fis['error']:.2%}",
                f"{fis['seconds'] / row['frequency']:.0f}",
            ]
        )
    return "\n".join(
        [
            "# Table 5.4: Phong, angular over frequency",
            "",
            versions_line(),
            "",
            "Angular and frequency at their own errors (rms against the whole integral); "
            "importance sampling (FIS) at frequency's error, or its best to 1024 samples.",
            "",
            markdown_table(heading, rows),
        ]
    )


@click.command()
@click.option("--out", type=click.Path(path_type=Path), help="Folder for the tables.")
def main(out: Path | None) -> None:
    """Print the table, and write it where asked."""
    result = run()
    write_result(out, "table_5_4", table(result), result)


if __name__ == "__main__":
    main()
