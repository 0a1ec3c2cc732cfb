"""The answer of a compressed problem: plain least squares, or the average over priors."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np

from shjax.arrays import einsum
from shjax.inverse.linear import priors
from shjax.inverse.linear.compression import Compressed, first_columns, noise_variance
from shjax.inverse.linear.least_squares import diagnose, least_squares, tolerance_of
from shjax.inverse.linear.marginal import posterior
from shjax.inverse.linear.reporting import Fit


def solve_compressed(
    problem: Compressed, sigma, sd, degree: np.ndarray, few: bool
) -> Fit:
    """Solve a compressed problem: least squares, or the average over priors.

    With few pixels nothing is left over by all degrees, and the noise is taken from what
    the first two leave.
    """
    speaks = problem
    if few and sd is not None:
        speaks = first_columns(problem, int(np.sum(degree <= 2)))
    variance = noise_variance(speaks, sigma)
    if sd is not None:
        unit = _unit(problem, degree)
        found = posterior(problem, sd, unit, variance, degree)
        whole = jnp.all(jnp.isfinite(found.mean))
        return Fit(*found, unit, problem, variance, jnp.asarray(1), whole)
    tolerance = tolerance_of(problem.r)
    value, steps, ended = jax.vmap(
        functools.partial(least_squares, tolerance=tolerance)
    )(problem.r, problem.z)
    covariance, _, missing = jax.vmap(functools.partial(diagnose, tolerance=tolerance))(
        problem.r
    )
    covariance = covariance * variance[:, None, None]
    none = jnp.ones(1, problem.r.dtype)
    return Fit(
        value.T,
        covariance,
        covariance,
        missing.T,
        none,
        none,
        problem,
        variance,
        jnp.max(steps),
        jnp.all(ended),
    )


def widened(answer: Fit, overlap: jax.Array, degree: np.ndarray) -> Fit:
    """Widen the covariance by what light above the fit may do to the answer.

    The answer is linear in the picture: what degrees that the fit left out, as large as
    the chosen priors have them, would move it by is added.

    Args:
        answer: The fit.
        overlap: Of its unknowns with the coefficients left out
            (:func:`shjax.inverse.shown.surface.beyond_seen_by`), ``(C, T, J)``.
        degree: Of these coefficients, ``(T,)``.
    """
    size = priors.deviations_at(answer.weights, degree)
    scale = (answer.unit / answer.variance)[:, None] * size[None]
    moved = einsum("cij,ctj->cti", answer.within, overlap) * scale[..., None]
    return answer._replace(
        covariance=answer.covariance + einsum("cti,ctj->cij", moved, moved)
    )


def _unit(problem: Compressed, degree: np.ndarray) -> jax.Array:
    """About L_00: from degrees 0 and 1, lightly held together, ``(C,)``."""
    low = first_columns(problem, int(np.sum(degree <= 1)))
    gram = jnp.einsum("cji,cjk->cik", low.r, low.r)
    right = jnp.einsum("cji,cj->ci", low.r, low.z)
    tiny = jnp.finfo(gram.dtype).tiny
    held = 1e-3 * jnp.trace(gram, axis1=1, axis2=2) + tiny**0.5
    identity = jnp.broadcast_to(jnp.eye(gram.shape[1], dtype=gram.dtype), gram.shape)
    value = jnp.linalg.solve(gram + held[:, None, None] * identity, right[..., None])
    level = jnp.abs(value[:, 0, 0])
    return jnp.where(level > 0, level, 1)
