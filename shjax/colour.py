"""Luminance of linear light."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Float

from shjax.arrays import Array, matmul

LUMINANCE = (0.2126, 0.7152, 0.0722)  # Rec. 709


def luminance(values: Float[Array, "*batch C"]) -> Float[jax.Array, "*batch"]:
    """Rec. 709 luminance of linear RGB, or the mean of any other number of channels."""
    channels = values.shape[-1]
    weights = LUMINANCE if channels == 3 else (1 / channels,) * channels
    return matmul(values, jnp.asarray(weights, values.dtype))
