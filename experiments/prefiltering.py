"""What tables 5.4 and 5.5 share: the light, timing, and importance sampling at an error."""

from __future__ import annotations

import json
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from experiments.alternatives import importance
from experiments.versions import versions
from shjax import io

SIZE = 128  # the thesis's S
_SAMPLES = (1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024)


def light(size: int = SIZE) -> jax.Array:
    """The shipped city at ``size x size``, float32."""
    image = io.read_envmap(io.shipped_panorama()).to_latlong(size).radiance
    pairs = np.asarray(image).reshape(size, size, 2, 3)
    return jnp.asarray(pairs.mean(axis=2), jnp.float32)


def seconds(function: Callable[[], object], rounds: int = 5) -> float:
    """Median time after one warm-up."""
    jax.block_until_ready(function())
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        jax.block_until_ready(function())
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def rms(value, truth) -> float:
    """Error relative to the truth's rms."""
    value, truth = (np.asarray(a, np.float64) for a in (value, truth))
    return float(np.sqrt(np.sum((value - truth) ** 2) / np.sum(truth**2)))


def importance_at(
    error: float, panorama, brdf, normals, views, draw_with: Callable, exact
) -> dict:
    """Filtered importance sampling with the fewest samples that reach an error."""
    levels = importance.pyramid(panorama)

    def run(n: int):
        return importance.reflect(levels, brdf, normals, views, draw=draw_with(n))

    errors = {}
    for n in _SAMPLES:
        errors[n] = rms(run(n), exact)
        if errors[n] <= error:
            break
    best = min(errors, key=lambda n: (errors[n], n))
    draw = draw_with(best)
    time_ = seconds(
        lambda: importance.reflect(levels, brdf, normals, views, draw=draw), 3
    )
    reached = errors[best] <= error
    return {
        "samples": best, "error": errors[best], "seconds": time_, "reached": reached,
    }  # fmt: skip


def write(out: Path | None, name: str, result: dict, text: str) -> None:
    """Print the table; write it, and the numbers, where asked."""
    print(text)
    if out:
        out.mkdir(parents=True, exist_ok=True)
        (out / f"{name}.md").write_text(text + "\n")
        (out / f"{name}.json").write_text(json.dumps(result, indent=1) + "\n")


def markdown(heading: list[str], rows: list[list[str]]) -> str:
    """A table."""
    lines = [heading, ["---"] * len(heading), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def samples_of(found: dict) -> str:
    """How many samples importance sampling took, and whether that was enough."""
    return f"{found['samples']}{'' if found['reached'] else ' (not reached)'}"


def about() -> str:
    """One line of versions for a table's head."""
    return ", ".join(f"{k} {v}" for k, v in versions().items())
