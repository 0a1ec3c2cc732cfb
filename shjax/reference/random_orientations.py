"""Seeded orientations and views, and the error measured at them with its own error.

Averages over all reflected directions R and all views (uniform in R's frame, as the
predicted error has it). What a truncation misses lies mostly towards grazing views, where
few uniform samples fall: the polar angle of the view is drawn more densely there, in
strata, and the samples carry weights.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array
from shjax.vectors import frames


class Orientations(NamedTuple):
    """Random orientations: R, views and normals ``(n, 3)``, and weights ``(n,)``."""

    reflected: Float[np.ndarray, "n 3"]
    views: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    weights: Float[np.ndarray, " n"]


def draw_orientations(n: int, *, seed: int) -> Orientations:
    """Draw random orientations: ``n`` pairs of a reflected direction and a view.

    Args:
        n: How many.
        seed: Of the random numbers.
    """
    rng = np.random.default_rng(seed)
    reflected = rng.normal(size=(n, 3))
    reflected /= np.linalg.norm(reflected, axis=1, keepdims=True)
    x = (np.arange(n) + rng.uniform(size=n)) / n
    theta, phi = np.pi * (1 - x * x), 2 * np.pi * rng.uniform(size=n)
    local = np.stack(
        [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1
    )
    frame = np.asarray(frames(jnp.asarray(reflected)), np.float64)
    views = np.einsum("nij,ni->nj", frame, local)
    views /= np.linalg.norm(views, axis=1, keepdims=True)
    normals = reflected + views
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return Orientations(reflected, views, normals, np.pi * x * np.sin(theta))


class MeasuredError(NamedTuple):
    """Measured rms error relative to the rms of the truth, and its own standard error."""

    rms: float
    standard_error: float


def measured_error(
    approximate: Float[Array, "n C"],
    exact: Float[Array, "n C"],
    weights: Float[Array, " n"],
) -> MeasuredError:
    """Relative rms error of an approximation over random orientations, of all channels.

    Args:
        approximate: Radiance by the method in question.
        exact: The truth.
        weights: From :func:`draw_orientations`.
    """
    difference, truth = (
        np.sum(np.asarray(a, np.float64) ** 2, axis=-1) * np.asarray(weights)
        for a in (np.asarray(approximate, np.float64) - np.asarray(exact), exact)
    )
    whole = truth.mean()
    if whole == 0:
        return MeasuredError(0.0 if difference.mean() == 0 else float("inf"), 0.0)
    ratio = difference.mean() / whole
    # The error of a ratio of two means, from the residuals of one about the other.
    spread = np.std(difference - ratio * truth) / np.sqrt(difference.size) / whole
    rms = float(np.sqrt(ratio))
    return MeasuredError(rms, float(spread / (2 * rms)) if rms else 0.0)
