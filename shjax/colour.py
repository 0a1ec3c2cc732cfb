"""Luminance, and the curve between linear light and sRGB display values.

References:
    [IEC] IEC 61966-2-1, Default RGB colour space sRGB.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array, matmul

LUMINANCE = (0.2126, 0.7152, 0.0722)  # Rec. 709


def luminance(values: Float[Array, "*batch C"]) -> Float[jax.Array, "*batch"]:
    """Rec. 709 luminance of linear RGB, or the mean of any other number of channels."""
    channels = values.shape[-1]
    weights = LUMINANCE if channels == 3 else (1 / channels,) * channels
    return matmul(values, jnp.asarray(weights, values.dtype))


def encode_srgb(linear: np.ndarray) -> np.ndarray:
    """Linear light in [0, 1] to sRGB display values [IEC]."""
    curve = 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, 12.92 * linear, curve)


def decode_srgb(encoded: np.ndarray) -> np.ndarray:
    """SRGB display values in [0, 1] to linear light, the inverse of :func:`encode_srgb`."""
    curve = ((np.maximum(encoded, 0.04045) + 0.055) / 1.055) ** 2.4
    return np.where(encoded <= 0.04045, encoded / 12.92, curve)
