"""Pictures whose exposure or white balance is not known, under one light.

``I_v = g_v A_v L`` in each channel, relative to the first picture: given the light a gain
has a closed form, given the gains the light has one; the two are a fixed point.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx

from shjax.inverse.linear.compression import compress, predicted

_MAX_STEPS = 256


def balanced(
    design: jax.Array,
    image: jax.Array,
    weights: jax.Array,
    pictures: int,
    solve: Callable[..., Any],
) -> tuple[Any, jax.Array]:
    """Solve for light and exposures together, by a fixed point.

    Args:
        design: ``(D, N, J)``.
        image: ``(N, C)``, the pictures one after another.
        weights: ``(N,)``.
        pictures: V, which divides N.
        solve: From a compressed problem to an answer with a ``mean`` ``(J, C)``.

    Returns:
        The answer, and the gains ``(V, C)``; the first are 1.
    """
    channels = image.shape[-1]
    design = jnp.broadcast_to(design, (channels, *design.shape[1:]))
    seen = jnp.where(weights[:, None] > 0, image, 0)

    def each(values):
        return values.reshape(pictures, -1, channels)

    def of_pixels(gains):
        shape = (pictures, image.shape[0] // pictures, channels)
        return jnp.broadcast_to(gains[:, None], shape).reshape(image.shape)

    def at(gains, args):
        design, seen, weights = args
        g = of_pixels(gains)
        return solve(compress(design, seen / g, weights[:, None] * g * g))

    def step(gains, args):
        design, seen, weights = args
        made = predicted(design, at(gains, args).mean) * jnp.sqrt(weights)[:, None]
        shown = seen * jnp.sqrt(weights)[:, None]
        own = jnp.sum(each(made * made), axis=1)
        found = jnp.sum(each(made * shown), axis=1) / jnp.where(own > 0, own, 1)
        found = jnp.where(found > 0, found, 1)
        return found / found[:1]

    tight = float(jnp.finfo(image.dtype).eps) ** 0.6
    solution = optx.fixed_point(
        step,
        optx.FixedPointIteration(rtol=tight, atol=tight),
        jnp.ones((pictures, channels), image.dtype),
        args=(design, seen, weights),
        max_steps=_MAX_STEPS,
        throw=False,
        adjoint=optx.ImplicitAdjoint(linear_solver=lx.GMRES(rtol=1e-10, atol=1e-10)),
    )
    answer = at(solution.value, (design, seen, weights))
    ended = solution.result == optx.RESULTS.successful
    answer = answer._replace(
        steps=solution.stats["num_steps"], converged=answer.converged & ended
    )
    return answer, solution.value
