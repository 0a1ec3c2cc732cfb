"""The coefficient axis: degree l, order m, and the flat index ``l (l + 1) + m``."""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array, as_float, check_channels, check_floating, shape_of

MAX_DEGREE = 1024


def check_l_max(l_max: int, name: str = "l_max") -> int:
    """Check that a highest degree is an integer from 0 to 1024.

    Raises:
        ValueError: If it is not.
    """
    if isinstance(l_max, bool) or not isinstance(l_max, (int, np.integer)) or l_max < 0:
        raise ValueError(f"{name} must be an integer >= 0; got {l_max!r}.")
    if l_max > MAX_DEGREE:
        raise ValueError(f"{name} must be at most {MAX_DEGREE}; got {l_max}.")
    return int(l_max)


def num_coefs(l_max: int) -> int:
    """Number of coefficients to a degree, K = (l_max + 1)^2.

    >>> num_coefs(2)
    9
    """
    return (check_l_max(l_max) + 1) ** 2


def degree_of_coefs(coefs: Array, name: str = "coefs") -> int:
    """Highest degree of coefficients ``(..., K, C)``, from their shape.

    Raises:
        ValueError: If they are no array, or the axis before the last is not a square
            number.
    """
    check_channels(name, coefs, "K, C", 2)
    shape = coefs.shape
    l_max = math.isqrt(shape[-2]) - 1
    if (l_max + 1) ** 2 != shape[-2]:
        raise ValueError(
            f"{name} must have shape (..., K, C) with K = (l_max + 1)^2; got {shape}."
        )
    return l_max


def degrees(l_max: int) -> np.ndarray:
    """Degree l of each flat index, ``(K,)``.

    >>> degrees(1).tolist()
    [0, 1, 1, 1]
    """
    return np.repeat(np.arange(l_max + 1), 2 * np.arange(l_max + 1) + 1)


def orders(l_max: int) -> np.ndarray:
    """Order m of each flat index, ``(K,)``.

    >>> orders(1).tolist()
    [0, -1, 0, 1]
    """
    l = degrees(l_max)
    return np.arange(num_coefs(l_max)) - l * (l + 1)


def cosine_sine_slots(l_max: int) -> np.ndarray:
    """Position of each flat index in l x m x (cos, sin), ``(K,)``."""
    l, m = degrees(l_max), orders(l_max)
    return (l * (l_max + 1) + np.abs(m)) * 2 + (m < 0)


def spread(gains: Float[Array, "*batch L"]) -> Float[jax.Array, "*batch K"]:
    """Repeat per-degree gains over the orders of each degree.

    Args:
        gains: One factor per degree, ``(..., l_max + 1)``.

    Returns:
        One factor a coefficient, ``(..., (l_max + 1)^2)``.

    Raises:
        ValueError: If ``gains`` is no array.
    """
    check_channels("gains", gains, "l_max + 1", 1)
    return jnp.take(jnp.asarray(gains), degrees(gains.shape[-1] - 1), axis=-1)


def scale_degrees(
    coefs: Float[Array, "*batch K C"], gains: Float[Array, " L"]
) -> Float[jax.Array, "*batch K C"]:
    """Multiply each degree by its gain: a convolution with a radial kernel.

    Args:
        coefs: Coefficients.
        gains: One factor per degree, ``(l_max + 1,)``.

    Returns:
        Coefficients of the same shape and type.

    Raises:
        ValueError: If ``gains`` does not have one entry per degree.
    """
    l_max = degree_of_coefs(coefs)
    if shape_of("gains", gains) != (l_max + 1,):
        raise ValueError(
            f"gains must have shape ({l_max + 1},) for l_max={l_max}; got {gains.shape}."
        )
    check_floating("gains", gains)
    coefs = as_float("coefs", coefs)
    column = spread(jnp.asarray(gains, coefs.dtype))[:, None]
    return coefs * jnp.broadcast_to(column, coefs.shape)
