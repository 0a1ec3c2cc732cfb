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
from jax.core import Tracer

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


def check_floating(name: str, array) -> None:
    """Refuse whole numbers and other kinds: an 8-bit picture is not linear light.

    Raises:
        ValueError: If an array does not hold real floating-point numbers.
    """
    if not jnp.issubdtype(array.dtype, jnp.floating):
        raise ValueError(f"{name} must hold floating-point numbers; got {array.dtype}.")


def check_channels(
    name: str, array, leading: str, rank: int, *, batch: bool = True
) -> None:
    """Refuse what is no array of floats, or lacks its channel axis or one in front of it.

    Args:
        name: The argument's name, for the message.
        array: What came.
        leading: The axes that must be there, in words such as ``n_theta, n_phi, C``.
        rank: How many of them there are.
        batch: Whether axes in front of them are allowed.

    Raises:
        ValueError: If it is no array, there are fewer axes, or one of them is empty.
    """
    shape = shape_of(name, array)
    few = len(shape) < rank or (not batch and len(shape) > rank)
    if few or 0 in shape[len(shape) - rank :]:
        front = "..., " if batch else ""
        raise ValueError(f"{name} must have shape ({front}{leading}); got {shape}.")
    check_floating(name, array)


def known_values(name: str, array) -> np.ndarray:
    """An argument's values, for functions that choose by them.

    Args:
        name: The argument's name, for the message.
        array: What came.

    Raises:
        ValueError: If it is being traced: by ``jit``, ``vmap`` or a derivative.
    """
    if isinstance(array, Tracer):
        raise ValueError(
            f"{name} must be known: what is chosen depends on its values, so call this "
            "outside jit, vmap and derivatives."
        )
    return np.asarray(array)


def check_vectors(name: str, array) -> None:
    """Refuse what is no array, or one whose last axis is not x, y, z.

    Raises:
        ValueError: If it is not.
    """
    shape = shape_of(name, array)
    if not shape or shape[-1] != 3:
        raise ValueError(f"{name} must have shape (..., 3); got {shape}.")
    check_floating(name, array)


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
        check_floating(name, array)


def check_count(name: str, value, *, least: int = 1) -> int:
    """A whole number of at least so much.

    Raises:
        ValueError: Naming it, if it is something else.
    """
    whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not whole or value < least:
        rule = "positive" if least == 1 else f">= {least}"
        raise ValueError(f"{name} must be a whole number, {rule}; got {value!r}.")
    return int(value)


def as_number_or_float(name: str, value, dtype) -> jax.Array:
    """A number of any kind, or an array of floating-point numbers, as a JAX array.

    Whole Python numbers are numbers; an array of integers is refused, since an 8-bit
    picture is no albedo, mask or light. An array of booleans is a mask, of 0 and 1.

    Raises:
        ValueError: If it is neither.
    """
    if isinstance(value, (bool, int, float)) or value is None:
        if value is None or isinstance(value, bool):
            raise ValueError(f"{name} must be a number or an array; got {value!r}.")
        return jnp.asarray(value, dtype)
    try:
        given = value.dtype if hasattr(value, "dtype") else np.asarray(value).dtype
    except ValueError:
        raise ValueError(
            f"{name} must be numbers of one shape; got {value!r}."
        ) from None
    listed = not hasattr(value, "dtype") or (np.ndim(value) == 0 and given != np.uint8)
    listed = listed and given.kind in "iuf"
    if not (listed or given == np.dtype(bool) or jnp.issubdtype(given, jnp.floating)):
        hint = " (8-bit values 0 to 255? divide by 255)" if given == np.uint8 else ""
        raise ValueError(f"{name} must hold floating-point numbers; got {given}{hint}.")
    return jnp.asarray(value, dtype)


def picture_size(size) -> tuple[int, int]:
    """Height and width of a picture from a whole number or two.

    Raises:
        ValueError: If they are not whole and positive.
    """
    whole = (int, np.integer)
    pair = (size, size) if isinstance(size, whole) else size
    try:
        height, width = pair
    except (TypeError, ValueError):
        height = width = None
    if not all(
        isinstance(n, whole) and not isinstance(n, bool) and n >= 1
        for n in (height, width)
    ):
        raise ValueError(f"size must be positive, a whole number or two; got {size!r}.")
    return int(height), int(width)  # pyright: ignore[reportArgumentType]


def safe_sqrt(values: jax.Array) -> jax.Array:
    """Square root with derivative 0 at 0, where every perfect fit ends."""
    positive = values > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, values, 1)), 0)


def in_blocks(rows: jax.Array, size: int) -> jax.Array:
    """``(n, ...)`` as ``(blocks, size, ...)``, filled up with zeros."""
    padding = [(0, -rows.shape[0] % size)] + [(0, 0)] * (rows.ndim - 1)
    return jnp.pad(rows, padding).reshape(-1, size, *rows.shape[1:])
