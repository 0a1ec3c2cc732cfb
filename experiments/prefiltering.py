"""What tables 5.4 and 5.5 share: the light, timing, and importance sampling at an error."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from experiments.alternatives import importance
from experiments.timing import median_seconds
from shjax import io

SIZE = 128  # the thesis's S
_SAMPLES = (1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024)


def light(size: int = SIZE) -> jax.Array:
    """The shipped city at ``size x size``, float32."""
    image = io.read_envmap(io.shipped_panorama()).to_latlong(size).radiance
    pairs = np.asarray(image).reshape(size, size, 2, 3)
    return jnp.asarray(pairs.mean(axis=2), jnp.float32)


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
    time_ = median_seconds(
        lambda: importance.reflect(levels, brdf, normals, views, draw=draw), 3
    )
    reached = errors[best] <= error
    return {
        "samples": best,
        "error": errors[best],
        "seconds": time_,
        "reached": reached,
    }


def samples_of(found: dict) -> str:
    """How many samples importance sampling took, and whether that was enough."""
    return f"{found['samples']}{'' if found['reached'] else ' (not reached)'}"
