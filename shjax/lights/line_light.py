"""Thin tubes as area lights, by integrals over the angle along them.

The strip that a point sees at angle a from the foot of its perpendicular has the solid
angle ``2 radius / distance cos a da``.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array, matmul
from shjax.harmonics import basis
from shjax.lights.area_light import AreaLight
from shjax.lights.outlines import angle, dot, gauss, length, scaled
from shjax.vectors import normalize

_GRADED = 0.02  # radians; distances from a lobe are logarithmic beyond it


class _Strip(NamedTuple):
    """A line as a point sees it: unit vectors to its foot and along, two angles, width."""

    foot: jax.Array
    along: jax.Array
    start: jax.Array
    end: jax.Array
    width: jax.Array


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class LineLight(AreaLight):
    """Thin tube as an area light, without ends. Made by :func:`shjax.lights.line`.

    Attributes:
        ends: ``(2, 3)``.
        radius: ``()``; what it gives is proportional to it.
        radiance: ``(C,)``.
    """

    ends: Float[Array, "*batch 2 3"]
    radius: Float[Array, "*batch"]
    radiance: Float[Array, "*batch C"]

    def transformed(self, matrix: jax.Array, point: jax.Array) -> LineLight:
        """Apply a matrix to the line about a point, which becomes the origin.

        Its radius is that of the transformed strip across the line as the point sees it.
        """
        ends = self._about(point)
        moved = matmul(ends, matrix.T)
        across, there = (normalize(jnp.cross(a[0], a[1])) for a in (ends, moved))
        radius = jnp.abs(dot(matmul(matrix, across), there))
        radius = radius * jnp.asarray(self.radius, point.dtype)
        return dataclasses.replace(self, ends=moved, radius=radius)

    def coefs(self, point: jax.Array, l_max: int) -> jax.Array:
        """Lighting coefficients, ``(K,)``."""
        towards, solid = self._nodes(point, l_max)
        return jnp.sum(scaled(solid, basis(towards, l_max=l_max)), axis=0)

    def zonal_moments(self, point: jax.Array, axis: jax.Array, l_max: int) -> jax.Array:
        """Integrals of the Legendre polynomials about an axis, ``(L,)``."""
        towards, solid = self._nodes(point, l_max)
        z = jnp.sum(towards * axis[None], axis=-1)

        def degree(carry, l):
            value, last = carry
            following = ((2 * l + 1) * z * value - l * last) / (l + 1)
            return (following, value), jnp.sum(solid * value)

        start = (jnp.ones_like(z), jnp.zeros_like(z))
        return jax.lax.scan(degree, start, jnp.arange(l_max + 1).astype(z.dtype))[1]

    def vector_irradiance(self, point: jax.Array) -> jax.Array:
        """Vector irradiance, ``(3,)``."""
        return _vector(self._strip(self._about(point)))

    def irradiance(self, point: jax.Array, normal: jax.Array) -> jax.Array:
        """Irradiance of what is above the horizon, ``()``."""
        ends = _segment_above(self._about(point), normal)
        return dot(normal, _vector(self._strip(ends)))

    def lobe_nodes(
        self,
        point: jax.Array,
        normal: jax.Array,
        lobe: jax.Array,
        count: int,
        horizon: bool,
    ) -> tuple[jax.Array, jax.Array]:
        """Directions over the light, dense about a lobe, and their solid angles."""
        ends = self._about(point)
        strip = self._strip(_segment_above(ends, normal) if horizon else ends)
        fixed, lobe = jax.lax.stop_gradient((strip, lobe))
        near = angle(dot(fixed.along, lobe), dot(fixed.foot, lobe))
        apart = length(_towards(fixed, near[None])[0] - lobe)
        width = jnp.sqrt(apart**2 + _GRADED**2)
        low, high = (jnp.arcsinh((a - near) / width) for a in (strip.start, strip.end))
        x, w = gauss(count * count, point.dtype)
        graded = low + (high - low) * x
        at = near + width * jnp.sinh(graded)
        step = width * jnp.cosh(graded) * (high - low) * w
        return _towards(strip, at), strip.width * jnp.cos(at) * step

    def _about(self, point: jax.Array) -> jax.Array:
        return jnp.asarray(self.ends, point.dtype) - point[None]

    def _strip(self, ends: jax.Array) -> _Strip:
        along = normalize(ends[1] - ends[0])
        foot = ends[0] - dot(ends[0], along) * along
        distance = length(foot)
        there = distance > 0
        a, b = (
            jnp.arctan2(dot(end, along), jnp.where(there, distance, 1)) for end in ends
        )
        radius = jnp.asarray(self.radius, ends.dtype)
        width = jnp.where(there, 2 * radius, 0) / jnp.where(there, distance, 1)
        return _Strip(normalize(foot), along, a, b, width)

    def _nodes(self, point: jax.Array, l_max: int) -> tuple[jax.Array, jax.Array]:
        strip = self._strip(self._about(point))
        x, w = gauss(int(np.ceil((l_max + 1) * np.pi / 2)) + 8, point.dtype)
        at = strip.start + (strip.end - strip.start) * x
        solid = strip.width * jnp.cos(at) * (strip.end - strip.start) * w
        return _towards(strip, at), solid


def _towards(strip: _Strip, at: jax.Array) -> jax.Array:
    return scaled(jnp.cos(at), strip.foot[None]) + scaled(
        jnp.sin(at), strip.along[None]
    )


def _vector(strip: _Strip) -> jax.Array:
    """Vector irradiance: the integral of ``w cos a`` over the angle, in closed form."""

    def integrals(a):
        return (a + jnp.sin(a) * jnp.cos(a)) / 2, jnp.sin(a) ** 2 / 2

    first, last = integrals(strip.start), integrals(strip.end)
    total = (last[0] - first[0]) * strip.foot + (last[1] - first[1]) * strip.along
    return strip.width * total


def _segment_above(ends: jax.Array, normal: jax.Array) -> jax.Array:
    """Part of a segment above a horizon; of length zero where there is none."""
    heights = jnp.sum(ends * normal[None], axis=-1)
    up = heights > 0
    crossing = up[0] != up[1]
    drop = heights[0] - heights[1]
    share = jnp.where(crossing, heights[0], 0) / jnp.where(crossing, drop, 1)
    cut = ends[0] + share * (ends[1] - ends[0])
    kept = jnp.where((crossing & ~up)[:, None], cut[None], ends)
    # One point of the line where nothing is seen: its foot and direction stay defined.
    return jnp.where(up[0] | up[1], kept, 0)
