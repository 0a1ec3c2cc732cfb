"""Reflection maps beside a dense product with as many operations, in one run.

    taskset -c 0 python experiments/benchmarks/reflection_maps.py --out experiments/results

The SHRM of F = 24, P = 3, 128 x 128, RGB float32; the dynamic map of a global cube SHRM of
64 x 64 x 6 at P = 3 for one view [T5, Eq. 5.35]. Times are medians, compile time apart,
memory from XLA's own analysis.
"""

from __future__ import annotations

import functools
import os
import sys
from pathlib import Path

import click
import jax
import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import shjax
from experiments.timing import interleaved_medians, stopwatch
from experiments.versions import versions, versions_line
from experiments.writing import markdown_table, write_result
from shjax import reflection
from shjax.reflection.reading import FRAMES

F, P, SIZE, FACE, CHANNELS = 24, 3, 128, 64, 3


def operations() -> dict[str, float]:
    """Multiply-adds of the sums as they are done."""
    maps = (P + 1) ** 2 * CHANNELS
    over_theta = SIZE * (F + 1) * 2 * (F + 1) * maps
    over_phi = SIZE * SIZE * 2 * (F + 1) * maps
    return {"shrm": over_theta + over_phi, "dynamic": 6 * FACE**2 * maps}


def dense(multiply_adds: float):
    """A square float32 product of as many multiply-adds."""
    n = round(multiply_adds ** (1 / 3))
    a = jnp.ones((n, n), jnp.float32)
    product = jax.jit(jnp.matmul)
    return lambda: product(a, a)


def memory(lowered) -> dict[str, int]:
    """Bytes of output and of temporaries."""
    analysis = lowered.compile().memory_analysis()
    return {
        "output": analysis.output_size_in_bytes,
        "temporary": analysis.temp_size_in_bytes,
    }


def run(rounds: int = 21) -> dict:
    """Median seconds, ratios, compile seconds, bytes."""
    rng = np.random.default_rng(0)
    lighting = jnp.asarray(rng.normal(size=((F + 1) ** 2, CHANNELS)), jnp.float32)
    rho = jnp.asarray(rng.normal(size=(F + 1, P + 1, P + 1, CHANNELS)), jnp.float32)

    def prefilter(light, kernel, frame):
        return shjax.prefilter(
            light, kernel, frame=frame, n_theta=SIZE, n_phi=SIZE
        ).coefs

    def whole(frame="local"):
        return prefilter(lighting, rho, frame)

    compile_seconds, compiled_bytes = {}, {}
    for frame in FRAMES:
        one = functools.partial(prefilter, frame=frame)

        def compiling(one=one, frame=frame):
            compiled_bytes[frame] = memory(jax.jit(one).lower(lighting, rho))

        compile_seconds[frame] = stopwatch(compiling)
    cube = reflection.prefilter_cube(lighting, rho, size=FACE, frame="global")
    view = jnp.asarray([0.48, 0.6, 0.64], jnp.float32)
    counts = operations()
    times = interleaved_medians(
        {
            "local shrm": whole,
            "global shrm": lambda: whole(frame="global"),
            "product as large as the shrm": dense(counts["shrm"]),
            "dynamic map": lambda: reflection.dynamic_map(cube, view),
            "product as large as the dynamic map": dense(counts["dynamic"]),
            "sum of the cube's coefficients": lambda: jnp.sum(cube.coefs),
        },
        rounds,
    )
    product = times["product as large as the shrm"]
    return {
        "versions": versions(),
        "threads": len(os.sched_getaffinity(0)),
        "orders": {"F": F, "P": P, "size": SIZE, "face": FACE},
        "seconds": times,
        "ratios": {
            "local shrm over product": times["local shrm"] / product,
            "global shrm over product": times["global shrm"] / product,
            "dynamic map over product": times["dynamic map"]
            / times["product as large as the dynamic map"],
        },
        "compile_seconds": compile_seconds,
        "bytes": compiled_bytes,
        "multiply_adds": counts,
    }


def table(result: dict) -> str:
    """The result as markdown."""
    times = [[name, f"{1e3 * s:.3f}"] for name, s in result["seconds"].items()]
    ratios = [[name, f"{ratio:.2f}"] for name, ratio in result["ratios"].items()]
    maps = [
        [
            frame,
            f"{result['compile_seconds'][frame]:.2f}",
            f"{sizes['output'] / 1e6:.2f}",
            f"{sizes['temporary'] / 1e6:.2f}",
        ]
        for frame, sizes in result["bytes"].items()
    ]
    head = ["map", "compile, s", "output, MB", "temporary, MB"]
    return "\n\n".join(
        [
            "# Reflection maps",
            f"{versions_line(result['versions'])}\n"
            f"{result['threads']} core(s); F = {F}, P = {P}, RGB float32",
            markdown_table(["what", "ms"], times),
            markdown_table(["ratio", ""], ratios),
            markdown_table(head, maps),
        ]
    )


@click.command()
@click.option("--out", type=click.Path(path_type=Path), help="Folder for the tables.")
def main(out: Path | None) -> None:
    """Print the table, and write it where asked."""
    result = run()
    write_result(out, "reflection_maps", table(result), result)


if __name__ == "__main__":
    main()
