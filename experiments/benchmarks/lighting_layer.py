"""The lighting layer's speed, beside split-sum and filtered importance sampling.

    taskset -c 0 python experiments/benchmarks/lighting_layer.py --out experiments/results

Building from a 1024 x 512 panorama (lights split off, 9 maps of five levels), shading
512 x 512 pixels of a sphere, the gradient in all inputs of a pixel, and in the light;
RGB float32. Errors are rms over the pixels against the integral over the panorama at
256 x 128, by 4096 of them. Times are medians of one interleaved run, compile time apart.
"""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import click
import jax
import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import shjax
from experiments.alternatives import importance, split_sum
from experiments.timing import first_call, interleaved_medians
from experiments.versions import versions
from experiments.writing import markdown_table, write_result
from shjax import brdf, ibl, io, render

ALPHA, F0 = 0.2, 0.04


def run(
    size: int = 512, rounds: int = 7, samples: tuple[int, ...] = (16, 64, 256, 1024)
):
    """Seconds, ratios and errors."""
    envmap = io.read_envmap(io.shipped_panorama())
    ball = render.sphere(size)
    normals, views = (a.reshape(-1, 3) for a in (ball.normals, ball.views))
    n = normals.shape[0]
    full = _material(n)
    light = ibl.prefilter_light(envmap)
    alone = ibl.prefilter_light(envmap, max_lights=0)
    simple = split_sum.prefilter(envmap.lighting(l_max=128))

    @jax.jit
    def gradient(n, v, values):
        return jax.grad(
            lambda n, v, values: jnp.sum(ibl.shade(light, n, v, **values) ** 2),
            argnums=(0, 1, 2),
        )(n, v, values)

    @jax.jit
    def light_gradient(texels):
        return jax.grad(
            lambda t: jnp.sum(
                ibl.shade(dataclasses.replace(light, texels=t), normals, views, **full)
                ** 2
            )
        )(texels)

    work = {
        "build": lambda: ibl.prefilter_light(envmap).texels,
        "build, no split": lambda: ibl.prefilter_light(envmap, max_lights=0).texels,
        "shade": lambda: ibl.shade(light, normals, views, **full),
        "shade, no light split off": lambda: ibl.shade(alone, normals, views, **full),
        "gradient in every pixel's inputs": lambda: gradient(normals, views, full),
        "gradient in the maps": lambda: light_gradient(light.texels),
        "split-sum shade": lambda: split_sum.shade(simple, normals, views, **full),
    }
    compile_seconds = {name: first_call(function) for name, function in work.items()}
    seconds = interleaved_medians(work, rounds)
    return {
        "seconds": seconds,
        "first call": compile_seconds,
        "pixels": n,
        "lights split off": len(light.lights.heights),
        "at equal error": _errors(
            envmap, normals, views, light, alone, simple, samples
        ),
        "versions": versions(),
    }


def _material(count: int) -> dict[str, jax.Array]:
    """The black dielectric at so many points."""
    return {
        "albedo": jnp.zeros((count, 3), jnp.float32),
        "roughness": jnp.full(count, np.sqrt(ALPHA), jnp.float32),
        "metallic": jnp.zeros(count, jnp.float32),
    }


def _errors(envmap, normals, views, light, alone, simple, samples) -> dict:
    """Rms error and seconds a pixel of each method at the same pixels."""
    surface = brdf.ggx(ALPHA, F0, multiscatter=True)
    seen = np.flatnonzero(np.sum(np.asarray(normals * views), axis=-1) > 0)
    some = np.random.default_rng(0).choice(seen, min(4096, seen.size), replace=False)
    n, v = (jnp.asarray(np.asarray(a)[some]) for a in (normals, views))
    small = jnp.asarray(envmap.to_latlong(128).radiance)
    exact = shjax.reference_reflection(small, surface, n, v)
    count = n.shape[0]
    values = _material(count)
    levels = importance.pyramid(small)
    work = {
        "low-rank 9, lights split": lambda: ibl.shade(light, n, v, **values),
        "low-rank 9": lambda: ibl.shade(alone, n, v, **values),
        "split-sum": lambda: split_sum.shade(simple, n, v, **values),
    }
    for s in samples:
        draw = _Draw(s)
        work[f"importance sampling, {s}"] = lambda draw=draw: importance.reflect(
            levels, surface, n, v, draw=draw, filtered=False
        )
        work[f"filtered importance sampling, {s}"] = lambda draw=draw: (
            importance.reflect(levels, surface, n, v, draw=draw)
        )
    norm = float(jnp.linalg.norm(exact))
    error = {k: float(jnp.linalg.norm(f() - exact)) / norm for k, f in work.items()}
    seconds = interleaved_medians(work, 5)
    return {
        k: {"rms": error[k], "microseconds a pixel": 1e6 * seconds[k] / count}
        for k in work
    }


@dataclasses.dataclass(frozen=True)
class _Draw:
    """Halves drawn from GGX's distribution, static for jit."""

    samples: int

    def __call__(self, normals, views):
        return importance.draw_ggx(ALPHA, self.samples, normals, views)


def markdown(result: dict) -> str:
    """The tables as text."""
    seconds, first = result["seconds"], result["first call"]
    times = [
        [name, f"{1e3 * t:.1f}", f"{t / seconds['shade']:.2f}", f"{first[name]:.2f}"]
        for name, t in seconds.items()
    ]
    errors = [
        [name, f"{row['rms']:.1%}", f"{row['microseconds a pixel']:.2f}"]
        for name, row in result["at equal error"].items()
    ]
    return "\n\n".join(
        [
            f"# Speed of the lighting layer\n\n{__doc__ or ''}",
            f"{result['pixels']} pixels, {result['lights split off']} split off.",
            markdown_table(["", "ms, warm", "times shade", "first call, s"], times),
            markdown_table(["GGX 0.2, f0 0.04", "rms error", "us per pixel"], errors),
        ]
    )


@click.command()
@click.option("--out", required=True, type=click.Path(path_type=Path))
def main(out: Path) -> None:
    """Write speed_lighting_layer.md and .json."""
    out.mkdir(parents=True, exist_ok=True)
    result = run()
    write_result(out, "speed_lighting_layer", markdown(result), result)


if __name__ == "__main__":
    main()
