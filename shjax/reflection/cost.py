"""What a model costs: the bytes that hold it, and the time that a point takes to be read.

Times are in units of one more coefficient of a small map, and were fitted to what
``experiments/speed_vs_error.py`` measures: their order counts, not their size.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from shjax.brdf.core import Brdf
from shjax.reflection.prefiltering import default_size
from shjax.reflection.view_basis import ViewBasis

_ANY_MAP = 1.5  # to find a point's texels
_CACHED = 2**24  # bytes; a map as large takes twice as long
_NORMAL = 0.02  # a coefficient over the normal
_ANY_LIGHTS, _LIGHT = 1.5, 0.75  # light sources, for each part and channel of the BRDF
_DIRECTIONS = 18  # over a light, when that was measured


def map_bytes(bases: Sequence[ViewBasis], degrees: int, item: int) -> np.ndarray:
    """Bytes of the map of each light's degree F and view basis, ``(F, bases)``.

    Args:
        bases: One per column.
        degrees: How many F, from 0.
        item: Bytes of a pixel's coefficient, all channels.
    """
    pixels = [math.prod(default_size(f)) for f in range(degrees)]
    counts = [len(basis.orders) for basis in bases]
    tables = np.array([basis.bytes for basis in bases])
    return np.outer(pixels, counts) * item + tables[None]


def map_time(bases: Sequence[ViewBasis], size: np.ndarray) -> np.ndarray:
    """Time to read a point of maps of so many bytes, ``(F, bases)``."""
    counts = np.array([len(basis.orders) for basis in bases])
    start = np.array([_ANY_MAP + basis.lookup_time for basis in bases])
    return (start + counts)[None] * (1 + size / _CACHED)


def normal_time(degree: int) -> float:
    """Time of coefficients over the normal, to a degree."""
    return 1 + _NORMAL * (degree + 1) ** 2 if degree >= 0 else 0.0


def lights_time(brdf: Brdf, lights: int, directions: int) -> float:
    """Time to shade light sources exactly, by so many directions over each."""
    terms = sum(part.weight.shape[-1] for part in brdf.parts)
    each = _LIGHT * directions / _DIRECTIONS
    return terms * (_ANY_LIGHTS + each * lights) if lights else 0.0
