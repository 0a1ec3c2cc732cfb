"""Flat area lights: polygons and disks, which emit to one side or to both.

A polygon or disk emits to the side from which its vertices, or its two axes, turn
counter-clockwise. A point in its plane sees nothing.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import STATIC, Array, matmul, safe_sqrt
from shjax.lights import horizons, outlines, polygon_moments
from shjax.lights.area_light import AreaLight
from shjax.lights.outlines import (
    Edges,
    Outline,
    Rims,
    dot,
    length,
    no_edges,
    no_rims,
    whole_turn,
)
from shjax.vectors import normalize


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class PolygonLight(AreaLight):
    """Polygonal area light. Made by :func:`polygon`.

    Attributes:
        vertices: In order, in one plane, ``(V, 3)``.
        radiance: ``(C,)``.
        two_sided: Whether it emits to both sides.
    """

    vertices: Float[Array, "*batch V 3"]
    radiance: Float[Array, "*batch C"]
    two_sided: bool = dataclasses.field(default=False, metadata=STATIC)

    def seen(self, point: jax.Array) -> tuple[jax.Array, Outline]:
        """Test whether the light shines on a point, 1 or 0, and give its outline there."""
        corners = self.corners(point)
        edges = Edges(corners, jnp.roll(corners, -1, axis=0))
        lit = self._side(point)
        outline = Outline(edges, no_rims(corners.dtype), corners[0])
        return _shines(lit, self.two_sided), outline

    def above(self, point: jax.Array, normal: jax.Array) -> tuple[jax.Array, Outline]:
        """Test whether the light shines on a point; its outline above the horizon there."""
        corners = horizons.polygon_above(self.corners(point), normal)
        edges = Edges(corners, jnp.roll(corners, -1, axis=0))
        lit = _shines(self._side(point), self.two_sided)
        return lit, Outline(edges, no_rims(corners.dtype), corners[0])

    def zonal_moments(self, point: jax.Array, axis: jax.Array, l_max: int) -> jax.Array:
        """Integrals of the Legendre polynomials about an axis, ``(L,)``."""
        lit, outline = self.seen(point)
        return lit * polygon_moments.moments(outline, axis[None], l_max)[:, 0]

    def coefs_by_recurrence(self, point: jax.Array, l_max: int) -> jax.Array:
        """Lighting coefficients by moments about a few axes, ``(K,)``."""
        lit, outline = self.seen(point)
        return lit * polygon_moments.coefs(outline, l_max)

    def transformed(self, matrix: jax.Array, point: jax.Array) -> PolygonLight:
        """Apply a matrix to the polygon about a point, which becomes the origin."""
        vertices = jnp.asarray(self.vertices, point.dtype) - point[None]
        return dataclasses.replace(self, vertices=matmul(vertices, matrix.T))

    def corners(self, point: jax.Array) -> jax.Array:
        """Vectors from a point to the vertices, counter-clockwise as it sees them."""
        corners = jnp.asarray(self.vertices, point.dtype) - point[None]
        return jnp.where(self._side(point) > 0, corners[::-1], corners)

    def _side(self, point: jax.Array) -> jax.Array:
        """Height of a point over the front, times twice the area."""
        vertices = jnp.asarray(self.vertices, point.dtype)
        rest = vertices[1:] - vertices[:1]
        normal = jnp.sum(jnp.cross(rest[:-1], rest[1:]), axis=0)
        return dot(normal, point - vertices[0])


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class DiskLight(AreaLight):
    """Disk or ellipse as an area light. Made by :func:`disk` or :func:`ellipse`.

    Attributes:
        centre: ``(3,)``.
        axes: Half axes u and v, ``(2, 3)``; it emits towards ``u x v``.
        radiance: ``(C,)``.
        two_sided: Whether it emits to both sides.
        circular: Whether the axes are as long and perpendicular, as of a disk.
    """

    centre: Float[Array, "*batch 3"]
    axes: Float[Array, "*batch 2 3"]
    radiance: Float[Array, "*batch C"]
    two_sided: bool = dataclasses.field(default=False, metadata=STATIC)
    circular: bool = dataclasses.field(default=False, metadata=STATIC)

    def vector_irradiance(self, point: jax.Array) -> jax.Array:
        """Vector irradiance, ``(3,)``; of a disk in closed form.

        With height h over its axis, distance d from it along u, ``A = h^2 + d^2 + r^2``
        and ``S = sqrt(A^2 - 4 r^2 d^2)``: ``pi r / S [(r - 2 r d^2 / (S + A)) axis +
        2 r h d / (S + A) u]``.
        """
        lit, outline = self.seen(point)
        if not self.circular:
            return lit * outlines.vector_irradiance(outline)
        centre, first, second = (a[0] for a in outline.rims[:3])
        radius, axis = length(first), normalize(jnp.cross(first, second))
        h = dot(centre, axis)
        beside = centre - h * axis  # d u
        d2, r2 = dot(beside, beside), radius**2
        a = h * h + d2 + r2
        # A^2 - 4 r^2 d^2, whose digits cancel near the rim.
        s = jnp.sqrt((h * h + (d2 - r2)) ** 2 + 4 * r2 * h * h)
        there = s > 0
        own = (1 - 2 * d2 / (s + a)) * axis + 2 * h / (s + a) * beside
        return lit * jnp.where(there, np.pi * r2, 0) / jnp.where(there, s, 1) * own

    def transformed(self, matrix: jax.Array, point: jax.Array) -> DiskLight:
        """Apply a matrix to the disk about a point, which becomes the origin."""
        centre = jnp.asarray(self.centre, point.dtype) - point
        return dataclasses.replace(
            self,
            centre=matmul(matrix, centre),
            axes=matmul(jnp.asarray(self.axes, point.dtype), matrix.T),
            circular=False,
        )

    def irradiance(self, point: jax.Array, normal: jax.Array) -> jax.Array:
        """Irradiance of what is above the horizon, ``()``."""
        _, outline = self.seen(point)
        centre, first, second = (dot(a[0], normal) for a in outline.rims[:3])
        whole = centre > safe_sqrt(first**2 + second**2)
        cut = super().irradiance(point, normal)
        return jnp.where(whole, dot(normal, self.vector_irradiance(point)), cut)

    def seen(self, point: jax.Array) -> tuple[jax.Array, Outline]:
        """Test whether the light shines on a point, 1 or 0, and give its outline there."""
        dtype = point.dtype
        centre = jnp.asarray(self.centre, dtype) - point
        u, v = jnp.asarray(self.axes, dtype)
        side = -dot(jnp.cross(u, v), centre)
        v = jnp.where(side > 0, -v, v)
        rims = Rims(centre[None], u[None], v[None], *whole_turn(dtype))
        return (
            _shines(side, self.two_sided),
            Outline(no_edges(dtype), rims, centre),
        )


def _shines(side: jax.Array, two_sided: bool) -> jax.Array:
    there = side != 0 if two_sided else side > 0
    return there.astype(side.dtype)
