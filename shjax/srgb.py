"""The curve between linear light and sRGB display values.

References:
    [IEC] IEC 61966-2-1, Default RGB colour space sRGB.
"""

from __future__ import annotations

import numpy as np


def encode_srgb(linear: np.ndarray) -> np.ndarray:
    """Linear light in [0, 1] to sRGB display values [IEC]."""
    curve = 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, 12.92 * linear, curve)


def decode_srgb(encoded: np.ndarray) -> np.ndarray:
    """SRGB display values in [0, 1] to linear light, the inverse of :func:`encode_srgb`."""
    curve = ((np.maximum(encoded, 0.04045) + 0.055) / 1.055) ** 2.4
    return np.where(encoded <= 0.04045, encoded / 12.92, curve)
