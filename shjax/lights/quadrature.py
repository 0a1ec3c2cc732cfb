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

from shjax.angular import in_tiles
from shjax.arrays import safe_sqrt
from shjax.brdf.core import Brdf, Local, frames, prepared, transfer_local
from shjax.convolution import common_channels

_HIGH = jax.lax.Precision.HIGHEST
_POINT = 1e-6  # the height of a cap of 0.08 degrees, which is a point to any lobe
_GRADED = 0.01  # radians; distances are uniform below it and logarithmic above
_NARROWEST = 0.02  # of the stretch across the plane of incidence


def over_lobes(
    centres: jax.Array,
    heights: jax.Array,
    flux: jax.Array,
    brdf: Brdf,
    normals: jax.Array,
    views: jax.Array,
    *,
    rings: int,
    wide: bool,
) -> jax.Array:
    """Radiance reflected from caps, ``(*points, C)``.

    Args:
        centres: Unit vectors, ``(n, 3)``.
        heights: ``1 - cos`` of the half angles, ``(n,)``.
        flux: Radiance times solid angle, ``(n, C)``.
        brdf: Without parts about the tangent.
        normals: Unit normals.
        views: Unit vectors to the viewer.
        rings: Distances from the lobe, with twice as many half circles. Static.
        wide: Whether caps may be wider than 90 degrees. Static.
    """
    ready, spokes = prepared(brdf), 2 * rings
    horizon = all(part.model.horizon for part in brdf.parts)
    lights = _Lights(centres, heights, heights, flux)
    if wide:  # the whole sphere less the cap on the other side
        big = heights > 1
        signs = jnp.where(big & (2 - heights > _POINT), -1, 0).astype(flux.dtype)
        rest = _Lights(
            -centres,
            jnp.where(big, 2 - heights, 0),
            heights,
            flux * jnp.broadcast_to(signs[:, None], flux.shape),
        )
        lights = lights._replace(heights=jnp.where(big, 2, heights))
        lights = jax.tree.map(lambda a, b: jnp.concatenate([a, b]), lights, rest)
    channels = common_channels(flux.shape[-1], brdf.channels, "brdf")
    if not normals.size:
        return jnp.zeros((*normals.shape[:-1], channels), flux.dtype)
    flat = {"normals": normals, "views": views}
    flat = {name: jnp.asarray(a, flux.dtype).reshape(-1, 3) for name, a in flat.items()}

    def one_tile(tile):
        @jax.checkpoint
        def add(total, light):
            directions, shares = _nodes(light, tile, rings, spokes, horizon)
            frame = frames(tile["normals"])
            components = jnp.einsum("tij,tsj->its", frame, directions, precision=_HIGH)
            seen = jnp.sum(frame * tile["views"][:, None, :], axis=-1)
            spread = (
                jnp.broadcast_to(seen[:, i, None], shares.shape) for i in range(3)
            )
            rho = transfer_local(ready, Local(*components), Local(*spread))  # [c, t, s]
            value = jnp.einsum("cts,ts->tc", rho, shares, precision=_HIGH)
            shape = (value.shape[0], channels)
            amount = jnp.broadcast_to(light.flux[None], shape)
            return total + jnp.broadcast_to(value, shape) * amount, None

        zero = jnp.zeros((tile["normals"].shape[0], channels), flux.dtype)
        return jax.lax.scan(add, zero, lights)[0]

    made = in_tiles(one_tile, flat, rings * spokes)
    return made.reshape(*normals.shape[:-1], channels)


class _Lights(NamedTuple):
    centres: jax.Array
    heights: jax.Array
    own_heights: jax.Array  # of the light that a cap is a part of
    flux: jax.Array


def _nodes(light: _Lights, tile, rings: int, spokes: int, horizon: bool):
    """Directions for each point and their shares of the light's flux."""
    point = light.own_heights < _POINT
    directions, solid = lobe_nodes(
        light.centres, jnp.where(point, 1, light.heights), tile["normals"],
        tile["views"], rings=rings, spokes=spokes, horizon=horizon,
    )  # fmt: skip
    shares = solid / (2 * np.pi * jnp.where(point, 1, light.own_heights))
    empty = light.heights < _POINT  # a point, or no cap on the other side
    centre = jnp.broadcast_to(light.centres, directions.shape)
    even = jnp.asarray(1 / (rings * spokes), shares.dtype)
    return jnp.where(empty, centre, directions), jnp.where(empty, even, shares)


def lobe_nodes(
    centre: jax.Array,
    height: jax.Array,
    normals: jax.Array,
    views: jax.Array,
    *,
    rings: int,
    spokes: int,
    horizon: bool,
) -> tuple[jax.Array, jax.Array]:
    """Directions over one cap for each point, and their solid angles.

    Args:
        centre: Of the cap, ``(3,)``.
        height: ``1 - cos`` of its half angle, at most 1, or 2 for the whole sphere.
        normals: Unit normals, ``(T, 3)``.
        views: Unit vectors to the viewer, ``(T, 3)``.
        rings: Distances on each half circle. Static.
        spokes: Half circles, an even number. Static.
        horizon: Whether directions below the surface are left out. Static.

    Returns:
        Unit vectors ``(T, rings * spokes, 3)``, solid angles ``(T, rings * spokes)``.
    """
    dtype = normals.dtype
    facing = jnp.sum(normals * views, axis=-1)
    lobe = 2 * facing[:, None] * normals - views
    along, across, side = _frame(lobe, normals)
    whole = height > 1.5
    # The cap in polar coordinates about the lobe: distance d, azimuth of its centre.
    centre = jnp.broadcast_to(centre[None], lobe.shape)
    cos_d, in_plane, out_of_plane = (
        jnp.sum(centre * axis, axis=-1) for axis in (lobe, along, across)
    )
    sin_d = safe_sqrt(in_plane**2 + out_of_plane**2)
    towards = _angle(out_of_plane, in_plane)
    sin_s = safe_sqrt(height * (2 - height))
    fall = 0.5 * jnp.sum((lobe - centre) ** 2, axis=-1)  # 1 - cos d, with its digits
    holds = whole | (fall < height) | (2 - fall < height)  # the lobe or its opposite
    reach = jnp.minimum(sin_s / jnp.maximum(sin_d, 1e-12), 1 - 1e-6)
    reach = jnp.where(holds, np.pi / 2, jnp.arcsin(reach))
    # Two panels of half circles: before and behind, or the halves of what is met.
    stretch = jnp.sqrt(jnp.maximum(side, _NARROWEST))
    first, second = towards - reach, jnp.where(holds, towards + reach, towards)
    third = jnp.where(holds, towards + 3 * reach, towards + reach)
    first, second, third = (_spread(a, stretch) for a in (first, second, third))
    x, w = np.polynomial.legendre.leggauss(spokes // 2)
    place = jnp.asarray((1 + np.sin(np.pi / 2 * x)) / 2, dtype)
    share = jnp.asarray(np.pi / 4 * np.cos(np.pi / 2 * x) * w, dtype)
    widths = jnp.stack([second - first, third - second], axis=-1)[..., None]
    starts = jnp.stack([first, second], axis=-1)[..., None]
    shape = (*widths.shape[:-1], spokes // 2)
    wide, begin = jnp.broadcast_to(widths, shape), jnp.broadcast_to(starts, shape)
    place, share = jnp.broadcast_to(place, shape), jnp.broadcast_to(share, shape)
    turn = (begin + wide * place).reshape(shape[0], spokes)
    share = (wide * share).reshape(shape[0], spokes)
    # From turns of the stretched circle to azimuths; the lobe's width along each.
    stretch = jnp.broadcast_to(stretch[:, None], turn.shape)
    a, b = jnp.cos(turn), stretch * jnp.sin(turn)
    squared = a**2 + b**2
    width = _GRADED * jnp.sqrt(squared)
    cosine, sine = a / jnp.sqrt(squared), b / jnp.sqrt(squared)
    share = share * stretch / squared
    cap = [
        jnp.broadcast_to(component[:, None], turn.shape)
        for component in (cos_d, in_plane, out_of_plane)
    ]
    low, high = _interval(cosine, sine, cap[0], cap[1], cap[2], height, whole)
    if horizon:
        edge = _angle(
            jnp.broadcast_to(side[:, None], turn.shape),
            -cosine * jnp.broadcast_to(safe_sqrt(1 - side**2)[:, None], turn.shape),
        )
        high = jnp.minimum(high, edge)
        low = jnp.minimum(low, high)
    low, high = jnp.arcsinh(low / width), jnp.arcsinh(high / width)
    x, w = np.polynomial.legendre.leggauss(rings)
    nodes = jnp.asarray((1 + x) / 2, dtype)
    shape = (*turn.shape, rings)

    def spread(a: jax.Array) -> jax.Array:
        """One number for each half circle, for all its nodes."""
        return jnp.broadcast_to(a[..., None], shape)

    length, width = spread(jnp.maximum(high - low, 0)), spread(width)
    graded = spread(low) + length * jnp.broadcast_to(nodes, shape)
    distance = width * jnp.sinh(graded)
    solid = length * jnp.broadcast_to(jnp.asarray(w / 2, dtype), shape) * width
    solid = solid * jnp.cosh(graded) * jnp.sin(distance) * spread(share)
    out = [jnp.sin(distance) * spread(c) for c in (cosine, sine)]
    local = jnp.stack([*out, jnp.cos(distance)]).reshape(3, shape[0], -1)
    axes = jnp.stack([along, across, lobe])
    directions = jnp.einsum("kts,kti->tsi", local, axes, precision=_HIGH)
    return directions, solid.reshape(shape[0], -1)


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


def _interval(cosine, sine, cos_d, in_plane, out_of_plane, height, whole):
    """Where half circles from the lobe enter and leave the cap."""
    forward = cosine * in_plane + sine * out_of_plane
    middle = _angle(forward, cos_d)
    middle = jnp.where(middle < -np.pi / 2, middle + 2 * np.pi, middle)
    # How far each circle passes from the centre: sin^2 of it, with its digits.
    missed = (cosine * out_of_plane - sine * in_plane) ** 2
    half = _angle(safe_sqrt(height * (2 - height) - missed), 1 - height)
    low = jnp.where(whole, 0, jnp.clip(middle - half, 0, np.pi))
    high = jnp.where(whole, np.pi, jnp.clip(middle + half, 0, np.pi))
    return low, high
