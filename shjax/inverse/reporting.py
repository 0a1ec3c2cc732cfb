"""The answer in all its places, with what the data determined of it."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from shjax.arrays import safe_sqrt
from shjax.estimate import Estimate
from shjax.harmonics.degrees import degrees
from shjax.inverse import priors
from shjax.inverse.compression import Compressed, first_columns, predicted
from shjax.inverse.linear import diagnose, embed, tolerance_of
from shjax.inverse.predicting import predict_lighting
from shjax.inverse.surfaces import Surface

_FORGIVEN = 1e-3  # share of an unknown in the null space, below which it is determined


class Fit(NamedTuple):
    """An answer in all fitted unknowns.

    Attributes:
        mean: ``(J, C)``.
        covariance: ``(C, J, J)``.
        within: Of one prior in the mean, ``(C, J, J)``.
        share: Of each unknown that did not come from the data, ``(J, C)``.
        weights: Of the priors, ``(G,)``.
        unit: About L_00, which the priors are relative to, ``(C,)``.
        problem: What was solved.
        variance: Of a pixel of weight 1, ``(C,)``.
        steps: Of the solver.
        converged: Whether it ended well.
    """

    mean: jax.Array
    covariance: jax.Array
    within: jax.Array
    share: jax.Array
    weights: jax.Array
    unit: jax.Array
    problem: Compressed
    variance: jax.Array
    steps: jax.Array
    converged: jax.Array


def report(
    answer: Fit,
    surface: Surface,
    design: jax.Array,
    seen: np.ndarray,
    deviations: jax.Array | None,
    gains: jax.Array | None,
    *,
    l_max: int,
    highest: int,
) -> Estimate:
    """The estimate of degrees up to ``l_max`` from a fit up to ``highest``.

    Args:
        answer: In the unknowns that the surface shows.
        surface: What the pixels show.
        design: ``(D, N, J)``.
        seen: Positions of the unknowns among all coefficients, rising.
        deviations: Of the priors, relative to L_00, ``(G, L)``, or None.
        gains: Of several pictures, ``(V, C)``, or None.
        l_max: Highest degree asked for.
        highest: Highest degree fitted.
    """
    size, everything = (l_max + 1) ** 2, (highest + 1) ** 2
    asked = first_columns(answer.problem, int(np.sum(seen < size)))
    tolerance = tolerance_of(asked.r)
    _, rank, _ = jax.vmap(functools.partial(diagnose, tolerance=tolerance))(asked.r)
    values, vectors = _directions(asked.r, seen[seen < size], size)
    channels, dtype = answer.mean.shape[1], answer.mean.dtype
    full = jnp.zeros((everything, channels), dtype).at[seen].set(answer.mean)
    share = jnp.ones((everything, channels), dtype).at[seen].set(answer.share)
    covariance = jax.vmap(lambda c: embed(c, seen, everything))(answer.covariance)
    covariance = covariance + jax.vmap(jnp.diag)(
        _unknown_variance(answer, share, seen, deviations, highest)
    )
    made = predicted(design, answer.mean)
    if gains is not None:
        each = made.reshape(gains.shape[0], -1, channels)
        made = (each * jnp.broadcast_to(gains[:, None], each.shape)).reshape(made.shape)
    left = jnp.where(
        surface.pixels.weights[:, None] > 0, surface.pixels.image - made, 0
    )
    squares = jnp.sum(surface.pixels.weights[:, None] * left * left, axis=0)
    chosen = answer.weights.shape[0] > 1
    details = priors.chosen(answer.weights, highest) if chosen else {}
    if gains is not None:
        details["gains"] = gains
    return Estimate(
        value=full[:size],
        covariance=covariance[:, :size, :size],
        singular_values=values,
        singular_vectors=vectors,
        rank=rank,
        prior_fraction=share[:size],
        residual_norm=safe_sqrt(squares),
        noise=safe_sqrt(answer.variance),
        steps=answer.steps,
        converged=answer.converged,
        full_value=full,
        full_covariance=covariance,
        forward=jax.tree_util.Partial(predict_lighting, surface.brdf),
        details=details,
        tolerance=tolerance,
    )


def _directions(r: jax.Array, seen: np.ndarray, size: int):
    """Singular values (root mean square over channels) and vectors, all ``size``."""
    channels, kept = r.shape[0], r.shape[1]
    # The rows of all channels, and enough rows of zeros that there are K values.
    stacked = (
        jnp.zeros((channels * kept + size, size), r.dtype)
        .at[: channels * kept, seen]
        .set(r.reshape(-1, kept) / math.sqrt(channels))
    )
    _, values, vectors = jnp.linalg.svd(stacked, full_matrices=False)
    return values, vectors


def _unknown_variance(
    answer: Fit, share: jax.Array, seen: np.ndarray, deviations, highest: int
) -> jax.Array:
    """What is to be added to the variances, ``(C, K)``: for what the data leave open.

    Without a prior infinity; with one, its own variance where nothing is seen at all.
    """
    if deviations is None:
        return jnp.where(share > _FORGIVEN, jnp.inf, 0).astype(share.dtype).T
    hidden = np.ones(share.shape[0])
    hidden[seen] = 0
    sd = jnp.asarray(deviations, share.dtype)[:, degrees(highest)]
    mean_square = jnp.einsum("g,gk->k", answer.weights, sd**2)
    mean_square = mean_square * jnp.asarray(hidden, share.dtype)
    return (answer.unit**2)[:, None] * mean_square[None]
