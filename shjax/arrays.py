"""Array types and the checks that every entry point shares.

An argument may be a JAX or a NumPy array; a result is always a JAX array. Arithmetic is
done in float32 or float64, whichever the argument has; half precision is widened to
float32, and integers are refused, since an 8-bit picture is not linear light.
"""

from __future__ import annotations

from typing import TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

Array: TypeAlias = jax.Array | np.ndarray


def as_float(name: str, value) -> jax.Array:
    """Return ``value`` as a float32 or float64 JAX array.

    Raises:
        ValueError: If ``value`` does not hold real floating-point numbers.
    """
    given = value.dtype if hasattr(value, "dtype") else np.asarray(value).dtype
    if not jnp.issubdtype(given, jnp.floating):
        raise ValueError(f"{name} must hold floating-point numbers; got {given}.")
    widened = jnp.float32 if jnp.finfo(given).bits < 32 else given
    return jnp.asarray(value, jax.dtypes.canonicalize_dtype(widened))


def shape_of(name: str, array) -> tuple[int, ...]:
    """The shape of an argument that must be an array, traced or not.

    Raises:
        ValueError: If it is a list, a number, another library's tensor, ...
    """
    if not isinstance(array, jax.Array | np.ndarray):
        kind = f"{type(array).__module__}.{type(array).__name__}"
        raise ValueError(
            f"{name} must be a JAX or NumPy array; got {kind.removeprefix('builtins.')}."
        )
    return array.shape


def check_channels(name: str, array, leading: str, rank: int) -> None:
    """Refuse what is no array, or lacks its channel axis or one in front of it.

    Args:
        name: The argument's name, for the message.
        array: What came.
        leading: The axes that must be there, in words such as ``n_theta, n_phi, C``.
        rank: How many of them there are.

    Raises:
        ValueError: If it is no array, there are fewer axes, or one of them is empty.
    """
    shape = shape_of(name, array)
    if len(shape) < rank or 0 in shape[len(shape) - rank :]:
        raise ValueError(f"{name} must have shape (..., {leading}); got {shape}.")


def check_vectors(name: str, array) -> None:
    """Refuse what is no array, or one whose last axis is not x, y, z.

    Raises:
        ValueError: If it is not.
    """
    shape = shape_of(name, array)
    if not shape or shape[-1] != 3:
        raise ValueError(f"{name} must have shape (..., 3); got {shape}.")


def check_samples(radiance, directions, weights, *, batch: bool = False) -> None:
    """Refuse samples of a light that do not fit each other.

    Args:
        radiance: ``(N, C)``, or ``(..., N, C)`` with ``batch``.
        directions: ``(N, 3)``.
        weights: ``(N,)``.
        batch: Whether axes in front are allowed.

    Raises:
        ValueError: If one is no array, or does not have that shape.
    """
    check_channels("radiance", radiance, "N, C", 2)
    if not batch and radiance.ndim != 2:
        raise ValueError(f"radiance must have shape (N, C); got {radiance.shape}.")
    n = radiance.shape[-2]
    fitting = {"directions": (directions, (n, 3)), "weights": (weights, (n,))}
    for name, (array, shape) in fitting.items():
        if shape_of(name, array) != shape:
            raise ValueError(
                f"{name} must have shape {shape} to fit radiance; got {array.shape}."
            )


def in_blocks(rows: jax.Array, size: int) -> jax.Array:
    """``(n, ...)`` as ``(blocks, size, ...)``, filled up with zeros."""
    padding = [(0, -rows.shape[0] % size)] + [(0, 0)] * (rows.ndim - 1)
    return jnp.pad(rows, padding).reshape(-1, size, *rows.shape[1:])
