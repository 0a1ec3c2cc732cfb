"""Outliers and clipped pixels: least squares with weights that answer back.

Each is a weight that depends on the residual: an outlier's falls with its distance
[HW77]; a clipped pixel has none while the prediction is above it. The weights are a
fixed point of solving with them; optimistix finds it, and differentiates through it
implicitly.

References:
    [HW77] P. Holland, R. Welsch, Robust regression using iteratively reweighted
    least-squares, 1977.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx

from shjax.inverse.linear.compression import compress, predicted

_MAX_STEPS = 64


@dataclasses.dataclass(frozen=True)
class Loss:
    """Robust loss by name, with the residual at which it bends, in deviations."""

    name: str
    bend: float


# 95 % of the efficiency of least squares under Gaussian noise [HW77, table 1].
_LOSSES = {"squares": Loss("squares", 0.0), "huber": Loss("huber", 1.345)}
_LOSSES["cauchy"] = Loss("cauchy", 2.385)


def make_loss(name: str) -> Loss:
    """Look up a loss by name.

    Raises:
        ValueError: If there is none.
    """
    if name not in _LOSSES:
        raise ValueError(f"loss must be one of {', '.join(_LOSSES)}; got {name!r}.")
    return _LOSSES[name]


def reweighted(
    design: jax.Array,
    image: jax.Array,
    weights: jax.Array,
    clipped: jax.Array | None,
    loss: Loss,
    sigma: jax.Array | None,
    solve: Callable[..., Any],
) -> Any:
    """Solve by iteratively reweighted least squares, clipped pixels one-sided.

    Args:
        design: ``(D, N, J)``.
        image: ``(N, C)``.
        weights: ``(N,)``.
        clipped: Where the light may be more than the image, ``(N, C)``.
        loss: Of the residuals.
        sigma: Standard deviation of a pixel of weight 1, or None.
        solve: From a compressed problem to an answer with a ``mean`` ``(J, C)``.
    """
    channels = image.shape[-1]
    shape = (channels, *design.shape[1:])
    design = jnp.broadcast_to(design, shape)
    base = jnp.broadcast_to(weights[:, None], image.shape)
    fixed = (design, image, base, clipped, sigma)

    def problem_at(mean, fixed):
        design, image, base, clipped, sigma = fixed
        weight = base * _of_residuals(
            image - predicted(design, mean), base, clipped, loss, sigma
        )
        return compress(design, image, weight)

    start = solve(
        compress(design, image, jnp.where(_or_none(clipped, image), 0, base))
    ).mean
    tight = float(jnp.finfo(image.dtype).eps) ** 0.6
    tight_linear = max(tight, 1e-10)
    solution = optx.fixed_point(
        lambda mean, fixed: solve(problem_at(mean, fixed)).mean,
        optx.FixedPointIteration(rtol=tight, atol=tight),
        start,
        args=fixed,
        max_steps=_MAX_STEPS,
        throw=False,
        adjoint=optx.ImplicitAdjoint(
            linear_solver=lx.GMRES(rtol=tight_linear, atol=tight_linear)
        ),
    )
    answer = solve(problem_at(solution.value, fixed))
    ended = solution.result == optx.RESULTS.successful
    return answer._replace(
        steps=solution.stats["num_steps"], converged=answer.converged & ended
    )


def _or_none(clipped: jax.Array | None, image: jax.Array) -> jax.Array:
    return jnp.zeros(image.shape, bool) if clipped is None else clipped


def _of_residuals(residual, base, clipped, loss: Loss, sigma) -> jax.Array:
    """Factors of the weights, ``(N, C)``."""
    factor = jnp.ones_like(residual)
    if clipped is not None:
        factor = jnp.where(clipped & (residual <= 0), 0, factor)
    if loss.name == "squares":
        return factor
    used = base * factor > 0
    scaled = jnp.sqrt(jnp.where(used, base, 1)) * jnp.where(used, residual, 0)
    if sigma is None:
        sigma = _spread(jnp.abs(scaled), used)
    distance = jnp.abs(scaled) / jnp.maximum(sigma * loss.bend, 1e-30)[None]
    if loss.name == "huber":
        return factor / jnp.maximum(distance, 1)
    return factor / (1 + distance * distance)


def _spread(magnitudes: jax.Array, used: jax.Array) -> jax.Array:
    """Robust standard deviation: 1.4826 times the median of the magnitudes in use."""
    ordered = jnp.sort(jnp.where(used, magnitudes, jnp.inf), axis=0)
    middle = jnp.sum(used, axis=0) // 2
    median = jnp.take_along_axis(ordered, middle[None], axis=0)[0]
    return 1.4826 * jnp.where(jnp.isfinite(median), median, 0)
