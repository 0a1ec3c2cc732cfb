"""Directions over caps of the sphere, dense where a lobe is.

Polar coordinates about the reflected direction: along each great circle through it the
cap is one interval, known in closed form, and the distance is graded by asinh, so that one
rule serves lobes of every width. The circles are spaced as the lobe is stretched: towards
grazing views it is narrower across the plane of incidence by the cosine to the normal.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from shjax.arrays import safe_sqrt
from shjax.brdf.core import Local

_GRADED = 0.01  # radians; distances are uniform below it and logarithmic above
_NARROWEST = 0.02  # of the stretch across the plane of incidence


def lobe_nodes(
    centre: jax.Array,
    height: jax.Array,
    normals: jax.Array,
    views: jax.Array,
    frame: jax.Array,
    *,
    rings: int,
    spokes: int,
    horizon: bool,
) -> tuple[Local, jax.Array]:
    """Quadrature directions that follow a lobe over one cap, and their solid angles.

    Args:
        centre: Of the cap, ``(3,)``.
        height: ``1 - cos`` of its half angle, at most 1, or 2 for the whole sphere.
        normals: Unit normals, ``(T, 3)``.
        views: Unit vectors to the viewer, ``(T, 3)``.
        frame: In whose axes the directions come, ``(T, 3, 3)``.
        rings: Distances on each half circle. Static.
        spokes: Half circles, an even number. Static.
        horizon: Whether directions below the surface are left out. Static.

    Returns:
        Unit vectors and solid angles, each ``(T, rings * spokes)``.
    """
    facing = jnp.sum(normals * views, axis=-1)
    lobe = 2 * facing[:, None] * normals - views
    along, across, side = _frame(lobe, normals)
    axes = jnp.stack([along, across, lobe])
    # The cap's centre in that frame: its distance from the lobe and its azimuth.
    centre = jnp.broadcast_to(centre[None], lobe.shape)
    x, y, z = (jnp.sum(centre * axis, axis=-1) for axis in (along, across, lobe))
    cap = _Cap(x, y, z, height, height > 1.5)
    fall = 0.5 * jnp.sum((lobe - centre) ** 2, axis=-1)  # 1 - cos d, with its digits
    stretch = jnp.sqrt(jnp.maximum(side, _NARROWEST))
    circles = _half_circles(cap, fall, stretch, spokes)
    low, high = _interval(circles, cap)
    if horizon:
        edge = _angle(
            jnp.broadcast_to(side[:, None], low.shape),
            -circles.cosine
            * jnp.broadcast_to(safe_sqrt(1 - side**2)[:, None], low.shape),
        )
        high = jnp.minimum(high, edge)
        low = jnp.minimum(low, high)
    local, solid = _along(circles, low, high, rings)
    # By sums of products, which fuse; a product of matrices for each point does not.
    turned = jnp.sum(frame[:, :, None] * jnp.moveaxis(axes, 0, 1)[:, None], axis=-1)

    def component(i: int) -> jax.Array:
        one, *others = (
            jnp.broadcast_to(turned[:, i, k, None], solid.shape) * local[k]
            for k in range(3)
        )
        return one + others[0] + others[1]

    return Local(component(0), component(1), component(2)), solid


class _Cap(NamedTuple):
    """A cap in the frame of each point's lobe, the first three ``(T,)``."""

    in_plane: jax.Array
    out_of_plane: jax.Array
    forward: jax.Array
    height: jax.Array
    whole: jax.Array


class _Circles(NamedTuple):
    """Half circles from the lobe, each ``(T, spokes)``.

    Attributes:
        cosine: Of the azimuth.
        sine: Of the azimuth.
        width: Where distances begin to be graded.
        share: Of the azimuth's whole turn, radians.
    """

    cosine: jax.Array
    sine: jax.Array
    width: jax.Array
    share: jax.Array


def _half_circles(
    cap: _Cap, fall: jax.Array, stretch: jax.Array, spokes: int
) -> _Circles:
    """Half circles that meet the cap: before and behind the lobe, or two halves of them."""
    sin_d = safe_sqrt(cap.in_plane**2 + cap.out_of_plane**2)
    sin_s = safe_sqrt(cap.height * (2 - cap.height))
    holds = (
        cap.whole | (fall < cap.height) | (2 - fall < cap.height)
    )  # it or its opposite
    reach = jnp.minimum(sin_s / jnp.maximum(sin_d, 1e-12), 1 - 1e-6)
    reach = jnp.where(holds, np.pi / 2, jnp.arcsin(reach))
    towards = _angle(cap.out_of_plane, cap.in_plane)
    ends = [
        towards - reach,
        jnp.where(holds, towards + reach, towards),
        jnp.where(holds, towards + 3 * reach, towards + reach),
    ]
    ends = jnp.stack([_spread(end, stretch) for end in ends], axis=-1)
    x, w = np.polynomial.legendre.leggauss(spokes // 2)
    # Dense at the ends, where the circles cut the cap's edge.
    place = jnp.asarray((1 + np.sin(np.pi / 2 * x)) / 2, fall.dtype)
    weight = jnp.asarray(np.pi / 4 * np.cos(np.pi / 2 * x) * w, fall.dtype)
    shape = (fall.shape[0], 2, spokes // 2)
    start, length, place, weight = (
        jnp.broadcast_to(a, shape)
        for a in (ends[:, :-1, None], jnp.diff(ends, axis=-1)[..., None], place, weight)
    )
    turn = (start + length * place).reshape(shape[0], spokes)
    share = (length * weight).reshape(shape[0], spokes)
    # From turns of the stretched circle to azimuths; the lobe's width along each.
    stretch = jnp.broadcast_to(stretch[:, None], turn.shape)
    a, b = jnp.cos(turn), stretch * jnp.sin(turn)
    size = jnp.sqrt(a**2 + b**2)
    return _Circles(a / size, b / size, _GRADED * size, share * stretch / size**2)


def _interval(circles: _Circles, cap: _Cap) -> tuple[jax.Array, jax.Array]:
    """Where half circles from the lobe enter and leave the cap."""
    cosine, sine = circles.cosine, circles.sine
    x, y, z = (jnp.broadcast_to(a[:, None], cosine.shape) for a in cap[:3])
    middle = _angle(cosine * x + sine * y, z)
    middle = jnp.where(middle < -np.pi / 2, middle + 2 * np.pi, middle)
    # How far each circle passes from the centre: sin^2 of it, with its digits.
    missed = (cosine * y - sine * x) ** 2
    half = _angle(safe_sqrt(cap.height * (2 - cap.height) - missed), 1 - cap.height)
    low = jnp.where(cap.whole, 0, jnp.clip(middle - half, 0, np.pi))
    high = jnp.where(cap.whole, np.pi, jnp.clip(middle + half, 0, np.pi))
    return low, high


def _along(circles: _Circles, low: jax.Array, high: jax.Array, rings: int):
    """Three components and the solid angle of nodes on each half circle, ``(T, S)``."""
    low, high = (jnp.arcsinh(end / circles.width) for end in (low, high))
    x, w = np.polynomial.legendre.leggauss(rings)
    shape = (*low.shape, rings)

    def spread(a: jax.Array) -> jax.Array:
        """One number for each half circle, for all its nodes."""
        return jnp.broadcast_to(a[..., None], shape)

    nodes, weights = (
        jnp.broadcast_to(jnp.asarray(a, low.dtype), shape) for a in ((1 + x) / 2, w / 2)
    )
    length, width = spread(jnp.maximum(high - low, 0)), spread(circles.width)
    graded = spread(low) + length * nodes
    growth = jnp.exp(graded)
    distance = width * (growth - 1 / growth) / 2  # sinh
    solid = length * weights * width * (growth + 1 / growth) / 2
    away = jnp.sin(distance)
    solid = solid * away * spread(circles.share)
    parts = (away * spread(circles.cosine), away * spread(circles.sine))
    local = [a.reshape(shape[0], -1) for a in (*parts, jnp.cos(distance))]
    return local, solid.reshape(shape[0], -1)


def _frame(lobe: jax.Array, normals: jax.Array):
    """Axes at the lobe, along and across the plane of incidence, and lobe . normal."""
    side = jnp.sum(lobe * normals, axis=-1)
    along = normals - side[:, None] * lobe
    # Where lobe and normal are one, any axis serves.
    helper = jnp.where(
        jnp.abs(lobe[:, 2:]) < 0.7,
        jnp.asarray([[0.0, 0, 1]], lobe.dtype),
        jnp.asarray([[1.0, 0, 0]], lobe.dtype),
    )
    other = helper - jnp.sum(helper * lobe, axis=-1, keepdims=True) * lobe
    known = jnp.sum(along**2, axis=-1, keepdims=True) > 1e-8
    along = jnp.where(known, along, other)
    along = along / jnp.sqrt(jnp.sum(along**2, axis=-1, keepdims=True))
    return along, jnp.cross(lobe, along), side


def _angle(y: jax.Array, x: jax.Array) -> jax.Array:
    """``arctan2`` with a derivative of zero at the origin."""
    there = (x != 0) | (y != 0)
    return jnp.arctan2(jnp.where(there, y, 0), jnp.where(there, x, 1))


def _spread(azimuth: jax.Array, stretch: jax.Array) -> jax.Array:
    """The turn of the stretched circle at an azimuth, continuous in it."""
    c, s = jnp.cos(azimuth), jnp.sin(azimuth)
    return azimuth + jnp.arctan2(s * c * (1 - stretch), stretch * c**2 + s**2)
