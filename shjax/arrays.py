"""Array types and the checks that every entry point shares.

An argument may be a JAX or a NumPy array; a result is always a JAX array. Arithmetic is
done in float32 or float64, whichever the argument has; half precision is widened to
float32, and integers are refused, since an 8-bit picture is not linear light.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

Array: TypeAlias = jax.Array | np.ndarray

# Products in full precision: a GPU's or TPU's default rounds the factors to 10 bits or 8.
einsum = functools.partial(jnp.einsum, precision=jax.lax.Precision.HIGHEST)
matmul = functools.partial(jnp.matmul, precision=jax.lax.Precision.HIGHEST)
STATIC = {"static": True}  # marks a field of a pytree's dataclass that is no array


def as_float(name: str, value) -> jax.Array:
    """Return ``value`` as a float32 or float64 JAX array.

    Raises:
        ValueError: If ``value`` does not hold real floating-point numbers.
    """
    return as_type(value, float_type(name, value))


def as_type(value, dtype) -> jax.Array:
    """JAX array of a type; what NumPy holds is converted by NumPy: nothing is compiled."""
    if not isinstance(value, jax.Array):
        value = np.asarray(value, dtype)
    return jnp.asarray(value, dtype)


def numpy_or_jax(*arrays) -> Any:
    """The module for eager arithmetic: NumPy, or JAX where something is being traced.

    JAX compiles each operation outside ``jit``, for each shape; NumPy does not.
    """
    return jnp if any(isinstance(a, Tracer) for a in arrays) else np


def float_type(name: str, value) -> np.dtype:
    """Type in which arithmetic on an argument is done: float32 or float64.

    Raises:
        ValueError: If ``value`` does not hold real floating-point numbers.
    """
    given = value.dtype if hasattr(value, "dtype") else np.asarray(value).dtype
    if not jnp.issubdtype(given, jnp.floating):
        raise ValueError(f"{name} must hold floating-point numbers; got {given}.")
    widened = jnp.float32 if jnp.finfo(given).bits < 32 else given
    return jax.dtypes.canonicalize_dtype(widened)


def shape_of(name: str, array) -> tuple[int, ...]:
    """Shape of an argument that must be an array, traced or not.

    Raises:
        ValueError: If it is a list, a number, another library's tensor, ...
    """
    if not isinstance(array, jax.Array | np.ndarray):
        kind = f"{type(array).__module__}.{type(array).__name__}"
        hint = getattr(type(array), "in_place_of_array", "")
        raise ValueError(
            f"{name} must be a JAX or NumPy array; got "
            f"{kind.removeprefix('builtins.')}{hint and f': {hint}'}."
        )
    return array.shape


def check_floating(name: str, array) -> None:
    """Refuse integers and other types: an 8-bit picture is not linear light.

    Raises:
        ValueError: If an array does not hold real floating-point numbers.
    """
    if not jnp.issubdtype(array.dtype, jnp.floating):
        raise ValueError(f"{name} must hold floating-point numbers; got {array.dtype}.")


def check_channels(
    name: str, array, leading: str, rank: int, *, batch: bool = True
) -> None:
    """Refuse what is no floating-point array, or lacks a channel axis or one before it.

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
    """Values of an argument, for functions that choose by them.

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


def check_samples(
    radiance, directions, weights, *, batch: bool = False, weights_name: str = "weights"
) -> None:
    """Refuse light samples whose shapes do not fit each other.

    Args:
        radiance: ``(N, C)``, or ``(..., N, C)`` with ``batch``.
        directions: ``(N, 3)``.
        weights: ``(N,)``.
        batch: Whether axes in front are allowed.
        weights_name: What the weights are called.

    Raises:
        ValueError: If one is no array, or does not have that shape.
    """
    check_channels("radiance", radiance, "N, C", 2)
    if not batch and radiance.ndim != 2:
        raise ValueError(f"radiance must have shape (N, C); got {radiance.shape}.")
    n = radiance.shape[-2]
    fitting = {"directions": (directions, (n, 3)), weights_name: (weights, (n,))}
    for name, (array, shape) in fitting.items():
        if shape_of(name, array) != shape:
            raise ValueError(
                f"{name} must have shape {shape} to fit radiance; got {array.shape}."
            )
        check_floating(name, array)


def check_count(name: str, value, *, minimum: int = 1) -> int:
    """Check an integer against its minimum.

    Raises:
        ValueError: Naming it, if it is something else.
    """
    whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not whole or value < minimum:
        rule = "positive" if minimum == 1 else f">= {minimum}"
        raise ValueError(f"{name} must be an integer, {rule}; got {value!r}.")
    return int(value)


def as_number_or_float(name: str, value, dtype) -> jax.Array:
    """Convert a number, or a floating-point array, to a JAX array.

    Whole Python numbers are numbers; an array of integers is refused, since an 8-bit
    picture is no albedo, mask or light. An array of booleans is a mask, of 0 and 1.

    Raises:
        ValueError: If it is neither.
    """
    if isinstance(value, (bool, int, float)) or value is None:
        if value is None or isinstance(value, bool):
            raise ValueError(f"{name} must be a number or an array; got {value!r}.")
        return as_type(value, dtype)
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
    return as_type(value, dtype)


def picture_size(size) -> tuple[int, int]:
    """Height and width of a picture from an integer or two.

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
        raise ValueError(f"size must be positive, an integer or two; got {size!r}.")
    return int(height), int(width)  # pyright: ignore[reportArgumentType]


def safe_sqrt(values: jax.Array) -> jax.Array:
    """Square root with derivative 0 at 0, where every perfect fit ends."""
    positive = values > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, values, 1)), 0)


def in_blocks(rows: jax.Array, size: int) -> jax.Array:
    """Split rows ``(n, ...)`` into blocks ``(blocks, size, ...)``, padded with zeros."""
    padding = [(0, -rows.shape[0] % size)] + [(0, 0)] * (rows.ndim - 1)
    return jnp.pad(rows, padding).reshape(-1, size, *rows.shape[1:])


def map_blocks(function: Callable[..., Any], rows: Any, size: int) -> Any:
    """Apply a function to blocks of rows, one block at a time, and join the results.

    Args:
        function: From a block of ``rows`` to arrays of as many rows.
        rows: Arrays ``(n, ...)``, a pytree; the last block is filled up with copies of
            the first row: a unit vector of zeros has no derivative.
        size: Rows of a block. Static.
    """
    n = jax.tree.leaves(rows)[0].shape[0]
    size = min(size, max(n, 1))
    count = -(-n // size)

    def blocks(a: jax.Array) -> jax.Array:
        filling = jnp.broadcast_to(a[:1], (count * size - n, *a.shape[1:]))
        return jnp.concatenate([a, filling]).reshape(count, size, *a.shape[1:])

    found = jax.lax.map(function, jax.tree.map(blocks, rows))
    return jax.tree.map(lambda a: a.reshape(count * size, *a.shape[2:])[:n], found)


def common_channels(light: int, material: int, name: str) -> int:
    """Number of channels of a product; one channel of either serves all.

    Raises:
        ValueError: If both have several and they differ.
    """
    if light != material and 1 not in (light, material):
        raise ValueError(
            f"lighting and {name} must have the same number of channels, or one; got "
            f"{light} and {material}."
        )
    return max(light, material)
