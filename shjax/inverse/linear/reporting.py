"""The answer in all its places, with what the data determined of it."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from shjax.arrays import safe_sqrt
from shjax.harmonics.degrees import degrees
from shjax.inverse.estimate import Estimate, Judge
from shjax.inverse.linear import priors
from shjax.inverse.linear.compression import Compressed, first_columns, predicted
from shjax.inverse.linear.least_squares import diagnose, embed, tolerance_of
from shjax.inverse.shown.predicting import predict_lighting
from shjax.inverse.shown.surface import Picture

_FORGIVEN = 1e-3  # share of an unknown in the null space, below which it is determined


class Fit(NamedTuple):
    """Fit in all unknowns, with its covariance.

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


def lighting_estimate(
    answer: Fit,
    picture: Picture,
    design: jax.Array,
    seen: np.ndarray,
    deviations: jax.Array | None,
    gains: jax.Array,
    *,
    l_max: int,
    highest: int,
) -> Estimate:
    """Report an estimate of degrees up to ``l_max`` from a fit up to ``highest``.

    Args:
        answer: In the unknowns that the surface shows.
        picture: What was fitted.
        design: ``(D, N, J)``.
        seen: Positions of the unknowns among all coefficients, rising.
        deviations: Of the priors, relative to L_00, ``(G, L)``, or None.
        gains: Of the pictures, ``(V, C)``.
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
    if gains.shape[0] > 1:
        each = made.reshape(gains.shape[0], -1, channels)
        made = (each * jnp.broadcast_to(gains[:, None], each.shape)).reshape(made.shape)
    left = jnp.where(
        picture.pixels.weights[:, None] > 0, picture.pixels.image - made, 0
    )
    squares = jnp.sum(picture.pixels.weights[:, None] * left * left, axis=0)
    several = answer.weights.shape[0] > 1
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
        forward=jax.tree_util.Partial(predict_lighting, picture.surface.brdf),
        chosen_prior=priors.chosen(answer.weights, highest) if several else None,
        tolerance=tolerance,
        judge=LIGHTING,
    )


def _message(found: Estimate) -> str:
    """What is determined of a light, and what no light can be."""
    value = np.asarray(found.value, float)
    if not np.any(np.asarray(found.rank)):
        return "nothing is determined: no pixel has weight and light"
    line = found.rank_message
    if found.chosen_prior is not None:
        scale, slope = float(found.chosen_prior.scale), float(found.chosen_prior.slope)
        line += f", degrees above by a prior of scale {scale:.2g}, slope {slope:.2g}"
        if not np.any(value):
            line += "; the picture is black"
        elif np.any(value[0] <= 0):
            line += (
                "; no light has L_00 <= 0: look for pixels on an outline, or for wrong "
                "normals"
            )
    if not _possible(found) and bool(np.all(value[0] > 0)):
        line += (
            "; in some channel |L_1| > sqrt(3) L_00, which no light of non-negative "
            "radiance has: is the picture linear, are outlines and shadows masked? "
            "shjax.inverse.nonnegative (--nonnegative) finds the nearest that can be"
        )
    if int(np.min(np.asarray(found.rank))) == len(value):
        return line
    return f"{line}; what is missing is left at 0 (see prior_fraction)"


def _possible(found: Estimate) -> bool:
    """Whether some light of non-negative radiance has these degrees 0 and 1."""
    value = np.asarray(found.value, float)
    if len(value) < 4:
        return True
    first = np.linalg.norm(value[1:4], axis=0)
    return bool(np.all(first <= math.sqrt(3) * np.maximum(value[0], 0) * (1 + 1e-4)))


LIGHTING = Judge(_message, _possible)


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
