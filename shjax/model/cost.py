"""What a model costs: the bytes that hold it, and the time that a point takes to be read.

Times are in units of one more coefficient of a small map, and were fitted to what
``experiments/speed_vs_error.py`` measures: their order counts, not their size.
"""

from __future__ import annotations

import math

import numpy as np

from shjax.adapted import RANKS
from shjax.brdf.core import Brdf
from shjax.model.known import Energies
from shjax.model.representation import coefficient_views
from shjax.shrm import default_size

_ANY_MAP = 1.5  # to find a point's texels
_ANY_ADAPTED = 1.5  # to look the functions of its view up
_CACHED = 2**24  # bytes; a map as large takes twice as long
_NORMAL = 0.02  # a coefficient over the normal
_ANY_LIGHTS, _LIGHT = 1.5, 0.75  # small lights, for each part and channel of the BRDF
_DIRECTIONS = 18  # over a light, when that was measured


def coefficient_counts(kind: str, count: int) -> np.ndarray:
    """Coefficients of a pixel for each of ``count`` degrees P, or of each adapted set."""
    if kind == "adapted":
        return np.array(list(RANKS))
    return np.array([len(coefficient_views(kind, p).orders) for p in range(count)])


def map_bytes(kind: str, shape: tuple[int, ...], item: int) -> np.ndarray:
    """Bytes of the map of each ``(F, P)``.

    Args:
        kind: Of the map.
        shape: How many F and P.
        item: Bytes of a pixel's coefficient, all channels.
    """
    pixels = [math.prod(default_size(f)) for f in range(shape[0])]
    return np.outer(pixels, coefficient_counts(kind, shape[1])) * item


def table_bytes(known: Energies) -> np.ndarray:
    """Bytes of the functions of the view of each adapted set, ``(sets,)``."""
    assert known.adapted is not None
    table = known.adapted.views.table
    line = table.nbytes // table.shape[0]
    return np.array([sum(ranks) * line for ranks in RANKS.values()])


def map_time(kind: str, size: np.ndarray) -> np.ndarray:
    """Time of a point, for maps of so many bytes ``(F, P)``."""
    counts = coefficient_counts(kind, size.shape[1])
    start = _ANY_MAP + (_ANY_ADAPTED if kind == "adapted" else 0)
    return (start + counts[None]) * (1 + size / _CACHED)


def normal_time(degree: int) -> float:
    """Time of coefficients over the normal, to a degree."""
    return 1 + _NORMAL * (degree + 1) ** 2 if degree >= 0 else 0.0


def lights_time(brdf: Brdf, lights: int, directions: int) -> float:
    """Time of shading small lights exactly, by so many directions over each."""
    terms = sum(part.weight.shape[-1] for part in brdf.parts)
    each = _LIGHT * directions / _DIRECTIONS
    return terms * (_ANY_LIGHTS + each * lights) if lights else 0.0
