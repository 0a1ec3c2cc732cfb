"""Where the pixels of an environment image lie on the sphere, for each layout.

A layout knows two things: the direction and exact solid angle of every pixel (zero for
pixels that are not part of the map), and where in the image a direction falls. A new
layout is a new entry in :data:`LAYOUTS`.

Every layout is read so that the image's centre looks along +x, its right side along -y
and its top along +z: the same world as the lat-long panorama.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from shjax.sphere import latlong_directions, latlong_pixels, latlong_solid_angles

Pixels = tuple[np.ndarray, np.ndarray]


@dataclasses.dataclass(frozen=True)
class Layout:
    """Geometry of one kind of environment image.

    Attributes:
        aspect: Width and height in smallest terms, from which the kind is guessed.
        pixels: ``(height, width)`` to directions ``(H, W, 3)`` and solid angles ``(H, W)``.
        lookup: ``(directions, height, width)`` to fractional row and column, kept within
            the part of the image that is continuous there.
    """

    aspect: tuple[int, int]
    pixels: Callable[[int, int], Pixels]
    lookup: Callable[[np.ndarray, int, int], Pixels]


def guess_layout(height: int, width: int) -> str:
    """Name of the layout with this image's aspect.

    Raises:
        ValueError: If no layout has it.

    >>> guess_layout(512, 1024)
    'latlong'
    """
    for name, layout in LAYOUTS.items():
        if width * layout.aspect[1] == height * layout.aspect[0]:
            return name
    known = ", ".join(f"{name} {w}:{h}" for name, w, h in _aspects())
    raise ValueError(
        f"layout cannot be told from {width} x {height} pixels ({known}); name it."
    )


def _aspects():
    return ((name, *layout.aspect) for name, layout in LAYOUTS.items())


def _latlong(height: int, width: int) -> Pixels:
    rows = latlong_solid_angles(height, width)[:, None]
    return latlong_directions(height, width), np.broadcast_to(rows, (height, width))


def _from_probe_axes(right, up, forward) -> np.ndarray:
    """Axes of the light probes (right, up, forward) to the library's frame."""
    return np.stack([forward, -right, up], axis=-1)


def _angular(height: int, width: int) -> Pixels:
    right, up = _unit_square(height, width, 0.0, 0.0)
    radius = np.minimum(np.hypot(right, up), 1)
    scale = np.pi * np.sinc(radius)  # sin(theta) / r, theta = pi r
    directions = _from_probe_axes(right * scale, up * scale, np.cos(np.pi * radius))
    inside = np.hypot(right, up) < 1
    return directions, np.where(inside, _angular_solid_angles(height, width), 0)


def _angular_solid_angles(height: int, width: int) -> np.ndarray:
    """Integral of sin(theta) / theta over each pixel, cut off at the circle."""
    nodes, weights = np.polynomial.legendre.leggauss(3)
    total = np.zeros((height, width))
    for dv, wv in zip(nodes, weights, strict=True):
        for du, wu in zip(nodes, weights, strict=True):
            right, up = _unit_square(height, width, du / 2, dv / 2)
            total += wu * wv / 4 * np.maximum(np.sinc(np.hypot(right, up)), 0)
    return total * (2 * np.pi / width) * (2 * np.pi / height)


def _unit_square(height: int, width: int, du: float, dv: float) -> Pixels:
    """Right and up coordinates in [-1, 1] of pixel centres moved by (du, dv) pixels."""
    right = (np.arange(width) + 0.5 + du) * (2 / width) - 1
    up = 1 - (np.arange(height) + 0.5 + dv) * (2 / height)
    right, up = np.broadcast_arrays(right, up[:, None])
    return right, up


def _angular_lookup(directions: np.ndarray, height: int, width: int) -> Pixels:
    forward, left, up = np.moveaxis(directions, -1, 0)
    across = np.hypot(left, up)
    radius = np.arctan2(across, forward) / np.pi
    scale = radius / np.where(across == 0, 1, across)
    column = (1 - left * scale) * (width / 2) - 0.5
    row = (1 - up * scale) * (height / 2) - 0.5
    return row, column


@dataclasses.dataclass(frozen=True)
class _Face:
    """One tile of a cube: its place and the axes of its centre, right and down."""

    tile: tuple[int, int]
    centre: tuple[int, int, int]
    right: tuple[int, int, int]
    down: tuple[int, int, int]


# Debevec's vertical cross in the probes' axes (x right, y up, z forward).
_VERTICAL_CROSS = (
    _Face((0, 1), (0, 1, 0), (1, 0, 0), (0, 0, 1)),
    _Face((1, 0), (-1, 0, 0), (0, 0, 1), (0, -1, 0)),
    _Face((1, 1), (0, 0, 1), (1, 0, 0), (0, -1, 0)),
    _Face((1, 2), (1, 0, 0), (0, 0, -1), (0, -1, 0)),
    _Face((2, 1), (0, -1, 0), (1, 0, 0), (0, 0, -1)),
    _Face((3, 1), (0, 0, -1), (1, 0, 0), (0, 1, 0)),  # stored upside down
)


def _cross(height: int, width: int) -> Pixels:
    size = width // 3
    directions, solid_angles = np.zeros((height, width, 3)), np.zeros((height, width))
    across = (np.arange(size) + 0.5) * (2 / size) - 1
    edges = np.arange(size + 1) * (2 / size) - 1
    corner = np.arctan2(
        edges * edges[:, None], np.sqrt(edges**2 + edges[:, None] ** 2 + 1)
    )
    tile_angles = np.diff(np.diff(corner, axis=0), axis=1)
    for face in _VERTICAL_CROSS:
        where = _tile(face, size)
        centre, right, down = (
            np.array(v, float) for v in (face.centre, face.right, face.down)
        )
        vectors = centre + across[:, None] * right + across[:, None, None] * down
        vectors /= np.linalg.norm(vectors, axis=-1, keepdims=True)
        directions[where] = _from_probe_axes(*np.moveaxis(vectors, -1, 0))
        solid_angles[where] = tile_angles
    return directions, solid_angles


def _tile(face: _Face, size: int) -> tuple[slice, slice]:
    row, column = (size * k for k in face.tile)
    return slice(row, row + size), slice(column, column + size)


def _cross_lookup(directions: np.ndarray, height: int, width: int) -> Pixels:
    size = width // 3
    forward, left, up = np.moveaxis(directions, -1, 0)
    probe = np.stack([-left, up, forward], axis=-1)
    centres = np.array([face.centre for face in _VERTICAL_CROSS], float)
    which = np.argmax(probe @ centres.T, axis=-1)

    def component(name: str) -> np.ndarray:
        axes = np.array([getattr(face, name) for face in _VERTICAL_CROSS], float)
        return np.sum(probe * axes[which], axis=-1)

    depth = component("centre")
    tiles = np.array([face.tile for face in _VERTICAL_CROSS])[which] * size
    inside = [
        np.clip((component(axis) / depth + 1) * (size / 2) - 0.5, 0, size - 1)
        for axis in ("down", "right")
    ]
    return tiles[..., 0] + inside[0], tiles[..., 1] + inside[1]


LAYOUTS = {
    "latlong": Layout((2, 1), _latlong, latlong_pixels),
    "angular": Layout((1, 1), _angular, _angular_lookup),
    "vertical_cross": Layout((3, 4), _cross, _cross_lookup),
}
