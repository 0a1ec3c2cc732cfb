"""What a layout is: charts that cover the sphere, and the pixels of each."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

Pixels = tuple[np.ndarray, np.ndarray]
Place = tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclasses.dataclass(frozen=True)
class Layout:
    """Layout of an environment image: how its pixels cover the sphere.

    A chart is a part of the image on which directions vary smoothly: the whole of a
    lat-long map, one face of a cube. Rows and columns are those of the whole image,
    fractional, a pixel's centre at an integer.

    Attributes:
        aspect: Width and height in sides of a face, disc or square (of a lat-long map:
            in rows).
        charts: ``(height, width)`` to the chart of each pixel ``(H, W)``; -1 where a
            pixel is not part of the map.
        towards: ``(chart, row, column, height, width)`` to unit vectors; also right a
            pixel or two beyond the chart's edge.
        locate: ``(directions, height, width)`` to chart, row and column.
        solid_angles: ``(height, width)`` to exact solid angles ``(H, W)``, steradians,
            zero where a pixel is not part of the map.
        even: Whether the side must be even.
    """

    aspect: tuple[int, int]
    charts: Callable[[int, int], np.ndarray]
    towards: Callable[..., np.ndarray]
    locate: Callable[[np.ndarray, int, int], Place]
    solid_angles: Callable[[int, int], np.ndarray]
    even: bool = False

    def pixels(self, height: int, width: int) -> Pixels:
        """Directions ``(H, W, 3)`` and solid angles ``(H, W)`` of an image's pixels."""
        charts = np.maximum(self.charts(height, width), 0)
        row, column = np.indices((height, width))
        directions = self.towards(charts, row, column, height, width)
        return directions, self.solid_angles(height, width)

    def rotated(self, rotation: np.ndarray) -> Layout:
        """Pixels of the same light rotated by ``(3, 3)``."""

        def towards(*place) -> np.ndarray:
            return self.towards(*place) @ rotation.T

        def locate(directions: np.ndarray, height: int, width: int) -> Place:
            return self.locate(directions @ rotation, height, width)

        return dataclasses.replace(self, towards=towards, locate=locate)

    def shape(self, side: int) -> tuple[int, int]:
        """Height and width of the image whose faces, discs or rows number ``side``."""
        return side * self.aspect[1], side * self.aspect[0]

    def fits(self, height: int, width: int) -> bool:
        """Whether an image of this size can be of this layout."""
        across, down = self.aspect
        whole = width * down == height * across and height % down == 0
        return whole and not (self.even and (height // down) % 2)


def unit_square(row, column, side: int, corner: tuple[int, int] = (0, 0)) -> Pixels:
    """Coordinates right and up in [-1, 1] within a square tile."""
    right = (column - corner[1] + 0.5) * (2 / side) - 1
    up = 1 - (row - corner[0] + 0.5) * (2 / side)
    right, up = np.broadcast_arrays(right, up)
    return right, up


def from_view_axes(right, up, forward) -> np.ndarray:
    """Convert vectors from (right, up, forward) of the image's centre."""
    return np.stack(np.broadcast_arrays(forward, -right, up), axis=-1)


def to_view_axes(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Convert vectors to right, up and forward of the image's centre."""
    forward, left, up = np.moveaxis(np.asarray(directions, np.float64), -1, 0)
    return -left, up, forward
