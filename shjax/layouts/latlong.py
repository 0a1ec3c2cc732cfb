"""Lat-long maps: pixel-centred, as nearly everything writes them, and OpenEXR's own.

OpenEXR's specification puts pixel centres on both ends: row 0 is the pole, and the first
and last columns are one meridian [ImfEnvmap.h].
"""

from __future__ import annotations

import numpy as np

from shjax.layouts.layout import Layout, Place
from shjax.sphere import latlong_pixels, latlong_solid_angles, spherical_directions


def _one_chart(height: int, width: int) -> np.ndarray:
    return np.zeros((height, width), np.int32)


def _towards(chart, row, column, height: int, width: int) -> np.ndarray:
    # Beyond a pole the sine is negative: the other side of the sphere, as it should be.
    theta = np.pi * (np.asarray(row) + 0.5) / height
    return spherical_directions(
        theta, np.pi - 2 * np.pi * (np.asarray(column) + 0.5) / width
    )


def _locate(directions: np.ndarray, height: int, width: int) -> Place:
    row, column = latlong_pixels(directions, height, width)
    return np.zeros(row.shape, np.int32), row, column


def _solid_angles(height: int, width: int) -> np.ndarray:
    rows = latlong_solid_angles(height, width)[:, None]
    return np.broadcast_to(rows, (height, width))


def _towards_ends(chart, row, column, height: int, width: int) -> np.ndarray:
    theta = np.pi * np.asarray(row) / (height - 1)
    phi = np.pi - 2 * np.pi * np.asarray(column) / (width - 1)
    return spherical_directions(theta, phi)


def _locate_ends(directions: np.ndarray, height: int, width: int) -> Place:
    row, column = latlong_pixels(directions, height - 1, width - 1)
    return np.zeros(row.shape, np.int32), row + 0.5, column + 0.5


def _solid_angles_ends(height: int, width: int) -> np.ndarray:
    edges = np.clip(np.arange(height + 1) - 0.5, 0, height - 1) * np.pi / (height - 1)
    across = np.full(width, 2 * np.pi / (width - 1))
    across[[0, -1]] /= 2
    return -np.diff(np.cos(edges))[:, None] * across


LATLONG = Layout((2, 1), _one_chart, _towards, _locate, _solid_angles)
OPENEXR_LATLONG = Layout(
    (2, 1), _one_chart, _towards_ends, _locate_ends, _solid_angles_ends
)
