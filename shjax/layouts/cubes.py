"""Cube maps: crosses, strips, and OpenEXR's strip.

Faces are those of the graphics interfaces (Direct3D, OpenGL, Vulkan): seen from inside,
+Z is the panorama's centre, +X is to its right, +Y is up. OpenEXR's strip has its own
order and turns, and its outermost pixels' centres lie on the edges [ImfEnvmap.h].
"""

from __future__ import annotations

import dataclasses

import numpy as np

from shjax.layouts.layout import Layout, Place, from_view_axes, to_view_axes

FACES = ("px", "nx", "py", "ny", "pz", "nz")
"""Names of the six faces, in the order of the strips."""

Axis = tuple[int, int, int]

# Centre, right and down of each face, as (right, up, forward) of the panorama's centre.
_AXES: dict[str, tuple[Axis, Axis, Axis]] = {
    "px": ((1, 0, 0), (0, 0, -1), (0, -1, 0)),
    "nx": ((-1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "py": ((0, 1, 0), (1, 0, 0), (0, 0, 1)),
    "ny": ((0, -1, 0), (1, 0, 0), (0, 0, -1)),
    "pz": ((0, 0, 1), (1, 0, 0), (0, -1, 0)),
    "nz": ((0, 0, -1), (-1, 0, 0), (0, -1, 0)),
}


def _turned(name: str) -> tuple[Axis, Axis, Axis]:
    """The same face stored upside down."""
    centre, (a, b, c), (d, e, f) = _AXES[name]
    return centre, (-a, -b, -c), (-d, -e, -f)


@dataclasses.dataclass(frozen=True)
class _Cube:
    """Tiles (row, column) of an image and the axes of the face on each."""

    tiles: tuple[tuple[int, int], ...]
    axes: tuple[tuple[Axis, Axis, Axis], ...]
    aspect: tuple[int, int]
    ends: bool = False  # whether the outermost centres lie on the face's edges

    def _side(self, height: int) -> int:
        return height // self.aspect[1]

    def _grid(self, side: int) -> tuple[float, float]:
        """Scale and first value of the centres along a face, from -1 to 1."""
        if self.ends:
            return 2 / max(side - 1, 1), -1.0
        return 2 / side, 1 / side - 1

    def charts(self, height: int, width: int) -> np.ndarray:
        """The face of each pixel."""
        side = self._side(height)
        found = np.full((height, width), -1, np.int32)
        for face, (row, column) in enumerate(self.tiles):
            rows = slice(row * side, (row + 1) * side)
            found[rows, column * side : (column + 1) * side] = face
        return found

    def towards(self, chart, row, column, height: int, width: int) -> np.ndarray:
        """Directions of places, beyond a face's edge on its plane."""
        side = self._side(height)
        scale, first = self._grid(side)
        corner = np.array(self.tiles)[chart] * side
        across = (np.asarray(column) - corner[..., 1]) * scale + first
        down = (np.asarray(row) - corner[..., 0]) * scale + first
        axes = np.array(self.axes, float)[chart]  # [..., 3 of centre, right, down, 3]
        vectors = (
            axes[..., 0, :]
            + across[..., None] * axes[..., 1, :]
            + down[..., None] * axes[..., 2, :]
        )
        vectors /= np.linalg.norm(vectors, axis=-1, keepdims=True)
        return from_view_axes(*np.moveaxis(vectors, -1, 0))

    def locate(self, directions: np.ndarray, height: int, width: int) -> Place:
        """Face, row and column of directions."""
        side = self._side(height)
        scale, first = self._grid(side)
        vectors = np.stack(to_view_axes(directions), axis=-1)
        axes = np.array(self.axes, float)
        chart = np.argmax(vectors @ axes[:, 0].T, axis=-1)
        depth, across, down = (
            np.sum(vectors * axes[chart][..., k, :], axis=-1) for k in range(3)
        )
        corner = np.array(self.tiles)[chart] * side
        row = corner[..., 0] + (down / depth - first) / scale
        column = corner[..., 1] + (across / depth - first) / scale
        return chart, row, column

    def solid_angles(self, height: int, width: int) -> np.ndarray:
        """Exact, from the corners of the texels."""
        side = self._side(height)
        scale, first = self._grid(side)
        edges = np.clip(first + scale * (np.arange(side + 1) - 0.5), -1, 1)
        corner = np.arctan2(
            edges * edges[:, None], np.sqrt(edges**2 + edges[:, None] ** 2 + 1)
        )
        tile = np.diff(np.diff(corner, axis=0), axis=1)
        whole = np.zeros((height, width))
        for row, column in self.tiles:
            rows = slice(row * side, (row + 1) * side)
            whole[rows, column * side : (column + 1) * side] = tile
        return whole

    def layout(self) -> Layout:
        """Layout of these cube faces."""
        return Layout(
            self.aspect, self.charts, self.towards, self.locate, self.solid_angles
        )


def _upright(*names: str) -> tuple[tuple[Axis, Axis, Axis], ...]:
    return tuple(_AXES[name] for name in names)


_DOWN = tuple((k, 0) for k in range(6))
_CROSS = ((0, 1), (1, 0), (1, 1), (1, 2), (2, 1))

VERTICAL_CROSS = _Cube(
    (*_CROSS, (3, 1)), (*_upright("py", "nx", "pz", "px", "ny"), _turned("nz")), (3, 4)
).layout()
HORIZONTAL_CROSS = _Cube(
    (*_CROSS, (1, 3)), _upright("py", "nx", "pz", "px", "ny", "nz"), (4, 3)
).layout()
VERTICAL_STRIP = _Cube(_DOWN, _upright(*FACES), (1, 6)).layout()
HORIZONTAL_STRIP = _Cube(
    tuple((0, k) for k in range(6)), _upright(*FACES), (6, 1)
).layout()
# OpenEXR's +X looks to the left of its +Z.
OPENEXR_CUBE = _Cube(
    _DOWN,
    (_AXES["nx"], _AXES["px"], _turned("py"), _turned("ny"), *_upright("pz", "nz")),
    (1, 6),
    ends=True,
).layout()
