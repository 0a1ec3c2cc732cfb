"""The octahedral map: the sphere unfolded on a square by way of an octahedron.

Up (+z) is at the middle, down at the four corners; the panorama's centre (+x) is in the
middle of the lower edge's half, its right (-y) to the right: what one sees who lies on
the back with the feet towards +x.

References:
    [CDE*14] Cigolle et al. A survey of efficient representations for unit vectors.
"""

from __future__ import annotations

import numpy as np

from shjax.layouts.layout import Layout, Place, unit_square


def _charts(height: int, width: int) -> np.ndarray:
    return np.zeros((height, width), np.int32)


def _folded(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Between the inner diamond and the four corners, in both directions."""
    return (
        (1 - np.abs(b)) * np.where(a < 0, -1, 1),
        (1 - np.abs(a)) * np.where(b < 0, -1, 1),
    )


def _on_octahedron(right: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Points ``(..., 3)`` with ``|x| + |y| + |z| = 1``, not of unit length."""
    # Beyond an edge the map goes on mirrored about the edge's middle.
    for _ in range(2):
        over = np.abs(right) > 1
        right, up = (
            np.where(over, np.sign(right) * 2 - right, right),
            np.where(over, -up, up),
        )
        right, up = up, right
    height = 1 - np.abs(right) - np.abs(up)
    a, b = _folded(right, up)
    below = height < 0
    a, b = np.where(below, a, right), np.where(below, b, up)
    return np.stack([-b, -a, height], axis=-1) + 0.0  # no -0


def _towards(chart, row, column, height: int, width: int) -> np.ndarray:
    right, up = unit_square(np.asarray(row), np.asarray(column), height)
    vectors = _on_octahedron(right, up)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def _locate(directions: np.ndarray, height: int, width: int) -> Place:
    directions = np.asarray(directions, np.float64)
    x, y, z = np.moveaxis(
        directions / np.sum(np.abs(directions), axis=-1, keepdims=True), -1, 0
    )
    right, up = -y, -x
    a, b = _folded(right, up)
    right, up = np.where(z < 0, a, right), np.where(z < 0, b, up)
    row, column = (1 - up) * (height / 2) - 0.5, (1 + right) * (height / 2) - 0.5
    return np.zeros(row.shape, np.int32), row, column


def _solid_angles(height: int, width: int) -> np.ndarray:
    """A pixel is a quadrilateral whose sides are straight on the octahedron."""
    lattice = np.arange(height + 1) - 0.5
    corners = _on_octahedron(*unit_square(lattice[:, None], lattice, height))
    corners /= np.linalg.norm(corners, axis=-1, keepdims=True)
    a, b = corners[:-1, :-1], corners[:-1, 1:]
    c, d = corners[1:, :-1], corners[1:, 1:]
    return _triangle(a, b, c) + _triangle(b, c, d)


def _triangle(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Solid angle of a triangle of unit vectors [van Oosterom and Strackee 1983]."""
    volume = np.abs(np.sum(a * np.cross(b, c), axis=-1))
    ab, bc, ca = (np.sum(p * q, axis=-1) for p, q in ((a, b), (b, c), (c, a)))
    return 2 * np.arctan2(volume, 1 + ab + bc + ca)


OCTAHEDRAL = Layout((1, 1), _charts, _towards, _locate, _solid_angles, even=True)
