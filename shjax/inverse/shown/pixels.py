"""What comes in: pictures of objects whose geometry is known, checked and flattened."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Bool, Float, UInt8

from shjax.arrays import (
    Array,
    as_float,
    as_number_or_float,
    check_channels,
    numpy_or_jax,
    shape_of,
)


class Decoded(NamedTuple):
    """Linear radiance of an 8-bit picture, and where it is clipped.

    Attributes:
        radiance: ``(..., C)``.
        clipped: Where a channel is at its largest value, and the light may be more.
    """

    radiance: Float[Array, "*points C"]
    clipped: Bool[Array, "*points C"]


def decode(
    image: UInt8[Array, "*points C"], *, exposure: float = 1.0, encoding: str = "srgb"
) -> Decoded:
    """Decode an 8-bit picture to linear radiance, and which values are clipped.

    Args:
        image: As it is stored, 0 to 255.
        exposure: What the picture was multiplied by before it was encoded.
        encoding: ``"srgb"`` (IEC 61966-2-1) or ``"linear"``.

    Raises:
        ValueError: If a choice is unknown, or the exposure not positive.
    """
    if encoding not in ("srgb", "linear"):
        raise ValueError(f"encoding must be srgb or linear; got {encoding!r}.")
    if not exposure > 0:
        raise ValueError(f"exposure must be positive; got {exposure}.")
    dtype = jnp.result_type(float)
    values = jnp.asarray(image).astype(dtype) / 255
    if encoding == "srgb":
        high = values > 0.04045
        safe = jnp.where(high, values, 1)
        values = jnp.where(high, ((safe + 0.055) / 1.055) ** 2.4, values / 12.92)
    return Decoded(values / exposure, jnp.asarray(image) == 255)


class Pixels(NamedTuple):
    """Flat pixels of pictures, their weights and albedo.

    Attributes:
        image: ``(N, C)``.
        weights: ``(N,)``, zero where nothing is seen.
        albedo: ``(N, 1)`` or ``(N, C)``.
    """

    image: jax.Array
    weights: jax.Array
    albedo: jax.Array


def flatten(image, seen, mask, albedo) -> Pixels:
    """Check pictures against each other and flatten them.

    Args:
        image: ``(*points, C)``.
        seen: Where there is a normal, ``(*points)``.
        mask: Weights, or None.
        albedo: A number, or what broadcasts to ``image``.

    Raises:
        ValueError: If shapes do not fit, or an unmasked pixel is not finite.
    """
    check_channels("image", image, "C", 1)
    image = as_float("image", image)
    points, dtype = image.shape[:-1], image.dtype
    numpy = numpy_or_jax(image, seen, mask)
    weights = numpy.asarray(seen, dtype)
    if mask is not None:
        if shape_of("mask", mask) != points:
            raise ValueError(f"mask must have shape {points}; got {mask.shape}.")
        weights = weights * numpy.asarray(as_number_or_float("mask", mask, dtype))
    shape = jnp.shape(albedo)
    last = 1 if not shape or shape[-1] == 1 else image.shape[-1]
    albedo = fit("albedo", albedo, (*points, last), dtype)
    concrete = not any(isinstance(a, Tracer) for a in (image, weights))
    if concrete and np.any(weights < 0):
        raise ValueError("mask must not be negative.")
    if not isinstance(albedo, Tracer) and np.any(np.asarray(albedo) < 0):
        raise ValueError("albedo must not be negative.")
    if concrete:
        bad = ~np.isfinite(np.asarray(image)[np.asarray(weights) > 0])
        if bad.any():
            raise ValueError(
                f"image must be finite where mask > 0; {int(bad.sum())} values are not."
            )
    return Pixels(
        image.reshape(-1, image.shape[-1]),
        jnp.asarray(weights.reshape(-1)),
        albedo.reshape(-1, last),
    )


def fit(name: str, value, shape: tuple[int, ...], dtype) -> jax.Array:
    """Broadcast a value to a shape.

    Raises:
        ValueError: If it does not.
    """
    array = as_number_or_float(name, value, dtype)
    numpy = numpy_or_jax(array)
    try:
        return jnp.asarray(numpy.broadcast_to(numpy.asarray(array), shape))
    except ValueError as error:
        raise ValueError(
            f"{name} must be a number or broadcast to {shape}; got {jnp.shape(value)}."
        ) from error


def check_unit(name: str, vectors, used) -> None:
    """Refuse concrete vectors that are not of unit length where they are used.

    Raises:
        ValueError: Naming the range of lengths.
    """
    if any(isinstance(a, Tracer) for a in (vectors, used)):
        return
    lengths = np.linalg.norm(np.asarray(vectors)[np.asarray(used)], axis=-1)
    if lengths.size and not np.all(np.abs(lengths - 1) < 1e-2):
        raise ValueError(
            f"{name} must have unit length where mask > 0; got lengths from "
            f"{lengths.min():.3g} to {lengths.max():.3g}."
        )
