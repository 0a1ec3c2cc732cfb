"""Harmonics at given directions, from Cartesian components: no angles, no poles.

``Y_lm = Q_lm(z) Re or Im (x + i y)^|m|`` with ``Q_lm = N_lm P_lm / sin^m``, a polynomial
in z; so values and derivatives of any order are finite everywhere. The expressions are
also defined off the unit sphere (``3 z^2 - 1`` stays as it is, as in [RH01, Eq. 3]).
"""

from __future__ import annotations

import functools
import math

import jax
import jax.numpy as jnp
from jaxtyping import Float

from shjax.arrays import Array, as_float, check_vectors
from shjax.harmonics.degrees import check_l_max, degree_of_coefs


@functools.partial(jax.jit, static_argnames=("l_max",))
def basis(
    directions: Float[Array, "*batch 3"], *, l_max: int
) -> Float[Array, "*batch K"]:
    """Values of all harmonics up to ``l_max`` [T4, Eq. 4.5].

    Args:
        directions: Unit vectors.
        l_max: Highest degree, inclusive. Static.

    Returns:
        ``(..., (l_max + 1)^2)``, steradian^-1/2.

    Raises:
        ValueError: If the last axis of ``directions`` is not 3.

    >>> [f"{y:.6f}" for y in basis(jnp.array([0.0, 0.0, 1.0]), l_max=1)]
    ['0.282095', '0.000000', '0.488603', '0.000000']
    """
    check_vectors("directions", directions.shape)
    x, y, z = jnp.moveaxis(as_float("directions", directions), -1, 0)
    values: list = [None] * (check_l_max(l_max) + 1) ** 2
    norm = math.sqrt(1 / (4 * math.pi))
    cosine, sine = jnp.ones_like(z), jnp.zeros_like(z)  # (x + i y)^m
    for m in range(l_max + 1):
        if m:
            cosine, sine = x * cosine - y * sine, x * sine + y * cosine
            norm *= math.sqrt((2 * m + 1) / (2 * m) * (2 if m == 1 else 1))
        previous, current = jnp.zeros_like(z), jnp.full_like(z, norm)
        for l in range(m, l_max + 1):
            if l > m:
                scale = math.sqrt((4 * l * l - 1) / (l * l - m * m))
                lag = math.sqrt(max((l - 1) ** 2 - m * m, 0) / (4 * (l - 1) ** 2 - 1))
                step = scale * (z * current - lag * previous)
                previous, current = current, step
            values[l * (l + 1) + m] = current * cosine
            if m:
                values[l * (l + 1) - m] = current * sine
    return jnp.stack(values, axis=-1)


@jax.jit
def evaluate(
    coefs: Float[Array, "*batch K C"], directions: Float[Array, "*points 3"]
) -> Float[Array, "*batch_points C"]:
    """Sum an expansion at given directions: ``sum_lm c_lm Y_lm(d)``.

    Args:
        coefs: Coefficients, ``(*batch, K, C)``.
        directions: Unit vectors, ``(*points, 3)``, the same for the whole batch; use
            ``jax.vmap`` for directions of each item's own.

    Returns:
        ``(*batch, *points, C)``, in the coefficients' type.

    Raises:
        ValueError: If a shape is wrong.
    """
    l_max = degree_of_coefs(coefs.shape)
    check_vectors("directions", directions.shape)
    coefs = as_float("coefs", coefs)
    directions = as_float("directions", directions).astype(coefs.dtype)
    functions = basis(directions, l_max=l_max).reshape(-1, coefs.shape[-2])
    values = jnp.matmul(functions, coefs, precision=jax.lax.Precision.HIGHEST)
    return values.reshape(*coefs.shape[:-2], *directions.shape[:-1], coefs.shape[-1])
