"""Nonlinear least squares from many starts, in one compilation.

The parameters have a Gaussian prior, which is a residual like any other: what the data
leave open stays where the prior has it, and its share of the answer is reported.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optimistix as optx

from shjax.arrays import matmul
from shjax.inverse.linear.least_squares import inverse_and_log_det

_COARSE_STEPS = 16
_FINE_STEPS = 256
_COARSE = 1e-3
_NEAR = 0.01
_ROUNDINGS = 8


class Found(NamedTuple):
    """End of a nonlinear search.

    Attributes:
        value: ``(P,)``.
        covariance: Of the linearised problem, ``(P, P)``.
        share: Of each parameter's variance under the prior that the data left, in [0, 1].
        jacobian: Of the data's residuals in units of the prior, ``(N, P)``.
        steps: Of the last refinement.
        converged: Whether the end is within a hundredth of a standard deviation of it, or
            within rounding.
    """

    value: jax.Array
    covariance: jax.Array
    share: jax.Array
    jacobian: jax.Array
    steps: jax.Array
    converged: jax.Array


Residual = Callable[[jax.Array, Any], jax.Array]


def search(residual: Residual, args: Any, starts: jax.Array, prior) -> jax.Array:
    """Search coarsely from many starts for the best end, ``(P,)``.

    Args:
        residual: From parameters and ``args`` to residuals in standard deviations.
        args: Of the residual.
        starts: ``(n, P)``.
        prior: Means and standard deviations, each ``(P,)``.
    """
    whole = functools.partial(_with_prior, residual)
    ends = jax.vmap(
        lambda start: (
            _descend(whole, start, (args, prior), _COARSE, _COARSE_STEPS).value
        )
    )(jnp.concatenate([starts, prior[0][None]]))
    losses = jax.vmap(lambda x: jnp.sum(whole(x, (args, prior)) ** 2))(ends)
    best = jnp.argmin(jnp.where(jnp.isfinite(losses), losses, jnp.inf))
    return jax.lax.stop_gradient(ends[best])


def approach(residual: Residual, args: Any, start: jax.Array, prior) -> jax.Array:
    """Approach the optimum in a few steps from a near start; without derivatives."""
    whole = functools.partial(_with_prior, residual)
    end = _descend(whole, start, (args, prior), _COARSE**2, 8).value
    return jax.lax.stop_gradient(end)


def refine(residual: Residual, args: Any, start: jax.Array, prior) -> Found:
    """Refine to the optimum by Levenberg-Marquardt, and say how well it is known.

    Derivatives of the value are those of the optimum, by the implicit function theorem.
    """
    whole = functools.partial(_with_prior, residual)
    tight = float(jnp.finfo(start.dtype).eps) ** 0.6
    start = jnp.where(jnp.all(jnp.isfinite(start)), start, prior[0])
    solution = _descend(whole, start, (args, prior), tight, _FINE_STEPS)
    spread = prior[1]
    left = residual(solution.value, args)
    jacobian = jax.jacfwd(lambda x: residual(x, args))(solution.value) * spread[None]
    gram = matmul(jacobian.T, jacobian)
    # The prior has unit variance here; the diagonal is made 1 for the factorisation.
    scale = 1 / jnp.sqrt(1 + jnp.diagonal(gram))
    matrix = gram * scale[:, None] * scale[None] + jnp.diag(scale * scale)
    inverse, _ = inverse_and_log_det(matrix)
    unit = inverse * scale[:, None] * scale[None]
    # At a bound the solver creeps: what matters is what is left to go, in deviations.
    slope = matmul(jacobian.T, left)
    slope = slope + (solution.value - prior[0]) / spread
    ahead = jnp.abs(matmul(unit, slope))
    deviation = jnp.sqrt(jnp.diagonal(unit))
    # Many pixels without noise tell more than the type can hold.
    rounding = _ROUNDINGS * jnp.finfo(start.dtype).eps
    rounding = rounding * jnp.maximum(jnp.abs(solution.value) / spread, deviation)
    near = jnp.all(ahead < jnp.maximum(_NEAR * deviation, rounding))
    return Found(
        solution.value,
        unit * spread[:, None] * spread[None],
        jnp.clip(jnp.diagonal(unit), 0, 1),
        jacobian,
        solution.stats["num_steps"],
        near,
    )


def _with_prior(residual: Residual, x: jax.Array, args: Any) -> jax.Array:
    inner, (centre, spread) = args
    return jnp.concatenate([residual(x, inner), (x - centre) / spread])


def _descend(residual: Residual, start: jax.Array, args: Any, tight: float, most: int):
    return optx.least_squares(
        residual,
        optx.LevenbergMarquardt(tight, tight),
        start,
        args=args,
        max_steps=most,
        throw=False,
        options={"jac": "fwd"},
    )
