"""Colours of files: the sRGB curve, and primaries other than those of Rec. 709.

Whites that differ are adapted (Bradford); XYZ is taken as the tristimulus values that it
is, without adaptation.

References:
    [Lindbloom] RGB/XYZ matrices; chromatic adaptation (brucelindbloom.com).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

Chromaticities = Sequence[float] | np.ndarray

REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
XYZ = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1 / 3, 1 / 3)
_SPACES = {
    "CIE XYZ": XYZ,
    "ACEScg": (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767),
    "ACES2065-1": (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.0770, 0.32168, 0.33767),
    "Rec. 2020": (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290),
    "P3-D65": (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290),
}
_BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)
_SAME = 2e-3  # chromaticities are often written with three digits


def _xyz_of(x: float, y: float) -> np.ndarray:
    return np.array([x / y, 1, (1 - x - y) / y])


def rgb_to_xyz(chromaticities: Chromaticities) -> Float[np.ndarray, "3 3"]:
    """Matrix from RGB to XYZ of a space given by its chromaticities.

    Raises:
        ValueError: If the primaries do not span a colour space.
    """
    numbers = np.asarray(chromaticities, np.float64)
    if numbers.shape != (8,) or not np.all(np.isfinite(numbers)) or numbers[7] <= 0:
        raise ValueError(f"chromaticities {numbers.tolist()} are not a colour space")
    x, y = numbers[0:6:2], numbers[1:6:2]
    primaries = np.stack([x, y, 1 - x - y])
    if abs(np.linalg.det(primaries)) < 1e-6:
        raise ValueError(f"chromaticities {numbers.tolist()} are not a colour space")
    return primaries * np.linalg.solve(primaries, _xyz_of(*numbers[6:]))


def luminance_weights(chromaticities: Chromaticities) -> np.ndarray:
    """Share of red, green and blue in the luminance, ``(3,)``."""
    weights = rgb_to_xyz(chromaticities)[1]
    return weights / weights.sum()


def to_rec709(
    chromaticities: Chromaticities,
) -> tuple[Float[np.ndarray, "3 3"] | None, str]:
    """Matrix from a space to linear Rec. 709, None for none, and its name.

    Raises:
        ValueError: If the primaries do not span a colour space.
    """
    source = rgb_to_xyz(chromaticities)
    numbers = np.asarray(chromaticities, np.float64)
    name = "other primaries"
    for known, values in _SPACES.items():
        if np.max(np.abs(numbers - values)) < _SAME:
            name = known
    back = np.linalg.inv(rgb_to_xyz(REC709))
    if name == "CIE XYZ":
        return back, name
    old, new = (_BRADFORD @ _xyz_of(*white) for white in (numbers[6:], REC709[6:]))
    if np.any(old <= 0):
        raise ValueError(f"chromaticities {numbers.tolist()} have no usable white")
    adapted = np.linalg.solve(_BRADFORD, (new / old)[:, None] * _BRADFORD)
    matrix = back @ adapted @ source
    # As Photoshop writes it, Rec. 709 is given by its colours under a D50 white.
    if np.max(np.abs(matrix - np.eye(3))) < _SAME:
        return None, "Rec. 709"
    return matrix, name


def divided_by_alpha(values: np.ndarray, alpha: np.ndarray) -> np.ndarray:
    """Divide colours ``(..., C)`` by their alpha ``(...)``, where that is not 0."""
    alpha = alpha[..., None]
    return np.where(alpha > 0, values / np.where(alpha > 0, alpha, 1), values)
