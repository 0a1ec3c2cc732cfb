"""Round area lights: spheres and capsules, inside which there is no light.

References:
    [S96] J. Snyder, Area Light Sources for Real-Time Graphics, Microsoft Research
    MSR-TR-96-11, 1996.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array
from shjax.harmonics import basis
from shjax.harmonics.degrees import degrees
from shjax.lights.area_light import AreaLight
from shjax.lights.caps import cap_gains
from shjax.lights.flat_lights import DiskLight
from shjax.lights.outlines import (
    Edges,
    Outline,
    Rims,
    angle,
    dot,
    length,
    no_edges,
    scaled,
    whole_turn,
)
from shjax.vectors import frames, normalize


class _Cap(NamedTuple):
    """Directions of a sphere: a cap's axis, and sine and cosine of its half angle."""

    axis: jax.Array
    sine: jax.Array
    cosine: jax.Array


def _cap(centre: jax.Array, radius: jax.Array) -> _Cap:
    distance = length(centre)
    outside = distance > radius
    sine = jnp.where(outside, radius, 1) / jnp.where(outside, distance, 1)
    cosine = jnp.sqrt(jnp.where(outside, 1 - sine**2, 1))
    return _Cap(normalize(centre), sine, jnp.where(outside, cosine, 0))


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class SphereLight(AreaLight):
    """Spherical area light. Made by :func:`sphere`.

    Attributes:
        centre: ``(3,)``.
        radius: ``()``.
        radiance: ``(C,)``.
    """

    centre: Float[Array, "*batch 3"]
    radius: Float[Array, "*batch"]
    radiance: Float[Array, "*batch C"]

    def seen(self, point: jax.Array) -> tuple[jax.Array, Outline]:
        """Test whether the light shines on a point, 1 or 0, and give its outline there."""
        dtype = point.dtype
        centre, cap = jnp.asarray(self.centre, dtype) - point, self._cap(point)
        frame = frames(cap.axis)
        rims = Rims(
            (cap.axis * cap.cosine)[None],
            (cap.sine * frame[0])[None],
            (cap.sine * frame[1])[None],
            *whole_turn(dtype),
        )
        outside = length(centre) >= jnp.asarray(self.radius, dtype)
        return outside.astype(dtype), Outline(no_edges(dtype), rims, centre)

    def transformed(self, matrix: jax.Array, point: jax.Array) -> DiskLight:
        """Apply a matrix, about a point, to the disk that the sphere seems to be there."""
        lit, _ = self.seen(point)
        cap = self._cap(point)
        centre = jnp.asarray(self.centre, point.dtype) - point
        flat = cap.cosine > 0
        radius = length(centre) * cap.sine / jnp.where(flat, cap.cosine, 1)
        axes = radius * frames(-cap.axis)[:2]
        radiance = jnp.asarray(self.radiance, point.dtype)
        disk = DiskLight(centre, lit * axes, radiance, two_sided=True)
        return disk.transformed(matrix, jnp.zeros_like(point))

    def coefs(self, point: jax.Array, l_max: int) -> jax.Array:
        """Lighting coefficients, ``(K,)``: those of a cap."""
        lit, _ = self.seen(point)
        cap = self._cap(point)
        gains = cap_gains(_height(cap)[None], l_max=l_max)[0]
        solid = 2 * np.pi * _height(cap) * gains
        return lit * jnp.take(solid, degrees(l_max)) * basis(cap.axis, l_max=l_max)

    def zonal_moments(self, point: jax.Array, axis: jax.Array, l_max: int) -> jax.Array:
        """Integrals of the Legendre polynomials about an axis, ``(L,)``."""
        by_degree = self.coefs(point, l_max) * basis(axis, l_max=l_max)
        sums = jax.ops.segment_sum(by_degree, degrees(l_max), num_segments=l_max + 1)
        return sums * jnp.asarray(
            4 * np.pi / (2 * np.arange(l_max + 1) + 1), sums.dtype
        )

    def vector_irradiance(self, point: jax.Array) -> jax.Array:
        """Vector irradiance, ``(3,)``: ``pi sin^2`` of the half angle along the axis."""
        lit, _ = self.seen(point)
        cap = self._cap(point)
        return lit * np.pi * cap.sine**2 * cap.axis

    def irradiance(self, point: jax.Array, normal: jax.Array) -> jax.Array:
        """Irradiance of what is above the horizon, ``()`` [S96].

        Snyder's four cases in one: the rim above the horizon between azimuths -t and t,
        and the horizon's arc inside the cap between -a and a.
        """
        lit, _ = self.seen(point)
        cap = self._cap(point)
        cosine = dot(cap.axis, normal)
        across = length(jnp.cross(cap.axis, normal))
        whole = jnp.where(cosine > 0, np.pi, 0)
        t = _arccos(-cap.cosine * cosine, cap.sine * across, whole)
        a = _arccos(cap.cosine, across, 0)
        own = t * cap.sine**2 * cosine
        own = own - cap.sine * cap.cosine * across * jnp.sin(t)
        return lit * (own + a)

    def _cap(self, point: jax.Array) -> _Cap:
        dtype = point.dtype
        centre = jnp.asarray(self.centre, dtype) - point
        return _cap(centre, jnp.asarray(self.radius, dtype))


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class CapsuleLight(AreaLight):
    """Tube with round ends as an area light. Made by :func:`capsule`.

    Attributes:
        ends: Of its axis, ``(2, 3)``.
        radius: ``()``.
        radiance: ``(C,)``.
    """

    ends: Float[Array, "*batch 2 3"]
    radius: Float[Array, "*batch"]
    radiance: Float[Array, "*batch C"]

    def seen(self, point: jax.Array) -> tuple[jax.Array, Outline]:
        """Test whether the light shines on a point, 1 or 0, and give its outline there.

        The directions of a tube are the convex hull of those of its two ends: two small
        circles, joined by the great circles of the planes that touch both.
        """
        dtype = point.dtype
        ends = jnp.asarray(self.ends, dtype) - point[None]
        radius = jnp.asarray(self.radius, dtype)
        caps = jax.vmap(_cap, in_axes=(0, None))(ends, radius)
        part = ends[1] - ends[0]
        across = jnp.cross(ends[0], part)
        size = length(across)
        b = normalize(across)
        # A touching plane's normal n has n . ends = radius: A, and beside it b.
        level = jnp.where(size > 0, radius * length(part), 2) / jnp.where(
            size > 0, size, 1
        )
        joined = level < 1  # else one end hides the other
        a = jnp.cross(part, b)
        a = jnp.where(joined, level, 0) * normalize(a)
        a = jnp.where(dot(a, ends[0]) < 0, -a, a)
        beside = jnp.sqrt(jnp.where(joined, 1 - level**2, 1))
        planes = jnp.stack([a + beside * b, a - beside * b])
        touch = ends[None] - radius * planes[:, None]  # [plane, end, 3]
        starts = jnp.stack([touch[0, 0], touch[1, 1]])
        stops = jnp.stack([touch[0, 1], touch[1, 0]])
        edges = Edges(*(jnp.where(joined, c, 0) for c in (starts, stops)))
        # Frames of the ends whose first axis points away from the other end.
        spare = jax.vmap(frames)(caps.axis)[:, 0]
        flat = jnp.stack([-jnp.cross(b, caps.axis[0]), jnp.cross(b, caps.axis[1])])
        first = jnp.where(joined, flat, spare)
        second = jnp.cross(caps.axis, first)
        turn = angle(
            jnp.abs(jnp.sum(touch[0] * second, axis=-1)),
            jnp.sum(touch[0] * first, axis=-1),
        )
        near = jnp.argmin(jnp.sum(jax.lax.stop_gradient(ends) ** 2, axis=-1))
        alone = jnp.where(jnp.arange(2) == near, np.pi, 0).astype(dtype)
        turn = jnp.where(joined, turn, alone)
        rims = Rims(
            scaled(caps.cosine, caps.axis),
            scaled(caps.sine, first),
            scaled(caps.sine, second),
            -turn,
            turn,
        )
        closest = closest_to_origin(ends)
        inside = jnp.where(joined, closest, ends[near])
        outside = length(closest) >= radius
        return outside.astype(dtype), Outline(edges, rims, inside)


def _height(cap: _Cap) -> jax.Array:
    """``1 - cos`` of the half angle, with its digits."""
    return cap.sine**2 / (1 + cap.cosine)


def _arccos(numerator: jax.Array, denominator: jax.Array, beyond) -> jax.Array:
    """``arccos`` of a ratio, or another value where there is no such angle."""
    inside = jnp.abs(numerator) < denominator
    ratio = jnp.where(inside, numerator, 0) / jnp.where(inside, denominator, 1)
    return jnp.where(inside, jnp.arccos(ratio), jnp.asarray(beyond, ratio.dtype))


def closest_to_origin(ends: jax.Array) -> jax.Array:
    """Nearest point of a segment ``(2, 3)`` to the origin."""
    part = ends[1] - ends[0]
    squared = dot(part, part)
    share = -dot(ends[0], part) / jnp.where(squared > 0, squared, 1)
    return ends[0] + jnp.clip(share, 0, 1) * part
