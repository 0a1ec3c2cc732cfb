"""Reflected radiance of area lights: the integral itself, and by their coefficients.

Three ways. The integral over each light by quadrature dense at the lobe, for any BRDF:
the reference. The light's coefficients times the transfer function's. And for lobes that
are radial about R or the normal, moments about that direction alone, without harmonics.

References:
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
    [WR18] J. Wang and R. Ramamoorthi, Analytic Spherical Harmonic Coefficients for
    Polygonal Area Lights, ACM TOG 37 (4), 2018.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array, check_count, common_channels, map_blocks, matmul
from shjax.brdf.core import Brdf, Local, prepared, select, transfer_local
from shjax.brdf.expansion import radial_gains
from shjax.brdf.ranges import check_brdf
from shjax.brdf.transfer_rows import glossy_rows, table_to
from shjax.harmonics.degrees import check_l_max
from shjax.lights.area import CoefsOf, add_channels, as_lights, check_points
from shjax.lights.area_light import AreaLight
from shjax.vectors import frames, mirror

_NUMBERS = 2**22  # of directions in one block of points
_MIN_COSINE = 0.05  # of the tabulated views; beyond, the lobe stays as it is there


def area_reflection(
    light: AreaLight | Sequence[AreaLight],
    brdf: Brdf,
    points: Float[Array, "*points 3"],
    normals: Float[Array, "*points 3"],
    views: Float[Array, "*points 3"],
    *,
    nodes: int = 32,
) -> Float[jax.Array, "*points C"]:
    """Reflected radiance of area lights by quadrature over each: the reference.

    Polar coordinates about the reflected direction, graded towards it, over what is above
    the horizon; for lobes of alpha 0.05 and more. With 12 nodes the error was below 0.3 %
    rms, under disks from alpha 0.2 on (experiments/results/area_lights.md).

    Args:
        light: One light, or several, which add up.
        brdf: The reflectance, without parts about the tangent.
        points: Shading points, in the lights' units.
        normals: Unit normals.
        views: Unit vectors to the viewer.
        nodes: Along each edge, and from the lobe out to it. Static.

    Raises:
        ValueError: If a shape is wrong or a part of the BRDF is about the tangent.
    """
    check_count("nodes", nodes)
    lights, arrays = _checked(light, brdf, points, normals, views)
    found = _by_quadrature(lights, brdf, arrays, nodes=nodes)
    return found.reshape(*points.shape[:-1], found.shape[-1])


def area_shade(
    light: AreaLight | Sequence[AreaLight],
    brdf: Brdf,
    points: Float[Array, "*points 3"],
    normals: Float[Array, "*points 3"],
    views: Float[Array, "*points 3"],
    *,
    l_max: int = 24,
) -> Float[jax.Array, "*points C"]:
    """Reflected radiance of area lights by spherical harmonics [T5, Eq. 5.35].

    Parts that are radial about the reflected direction or the normal need the moments of
    the light about that direction alone [WR18]; for others the light's coefficients meet
    those of the transfer function. Only what lies above degree ``l_max`` is lost: 3 to
    10 % of GGX at alpha 0.1 and degree 24, 0.2 and 16, 0.4 and 8. Parts that end at the
    horizon are zero where the view is below it.

    Args:
        light: One light, or several, which add up.
        brdf: The reflectance, without parts about the tangent.
        points: Shading points, in the lights' units.
        normals: Unit normals.
        views: Unit vectors to the viewer; below a cosine of 0.05 to the normal the
            transfer function is that of 0.05.
        l_max: Highest degree, inclusive. Static.

    Raises:
        ValueError: If a shape is wrong or a part of the BRDF is about the tangent.
    """
    l_max = check_l_max(l_max)
    lights, arrays = _checked(light, brdf, points, normals, views)
    found = _by_harmonics(lights, brdf, arrays, l_max=l_max)
    return found.reshape(*points.shape[:-1], found.shape[-1])


def _checked(light, brdf: Brdf, points, normals, views):
    lights = as_lights(light)
    check_brdf("brdf", brdf)
    if select(brdf, "tangent") is not None:
        raise ValueError("brdf must have no parts about the tangent.")
    named = {"points": points, "normals": normals, "views": views}
    arrays = [a.reshape(-1, 3) for a in check_points(named)]
    for one in lights:
        common_channels(one.radiance.shape[0], brdf.channels, "brdf")
    return lights, arrays


@functools.partial(jax.jit, static_argnames="nodes")
def _by_quadrature(lights, brdf: Brdf, arrays, *, nodes: int) -> jax.Array:
    ready = prepared(brdf)
    horizon = all(part.model.horizon for part in brdf.parts)
    dtype, total = arrays[0].dtype, None

    def one(light: AreaLight, point, normal, view):
        lobe = mirror(normal, view)
        towards, solid = light.lobe_nodes(point, normal, lobe, nodes, horizon)
        frame = frames(normal)
        local = Local(*(jnp.sum(towards * axis[None], axis=-1) for axis in frame))
        seen = Local(*(jnp.broadcast_to(jnp.sum(view * a), solid.shape) for a in frame))
        values = transfer_local(ready, local, seen)
        return jnp.sum(values * jnp.broadcast_to(solid[None], values.shape), axis=-1)

    size = max(_NUMBERS // (64 * nodes**2), 1)
    for light in lights:
        own = jax.vmap(functools.partial(one, light))
        found = map_blocks(lambda some, own=own: own(*some), tuple(arrays), size)
        total = _colour(total, light, found, dtype)
    assert total is not None  # there is at least one light
    return total


def _colour(total, light: AreaLight, found: jax.Array, dtype) -> jax.Array:
    """Add a light's radiance times what unit radiance gives."""
    radiance = jnp.asarray(light.radiance, dtype)[None]
    shape = jnp.broadcast_shapes(found.shape, (found.shape[0], radiance.shape[1]))
    value = jnp.broadcast_to(found, shape) * jnp.broadcast_to(radiance, shape)
    return value if total is None else add_channels(total, value)


@functools.partial(jax.jit, static_argnames="l_max")
def _by_harmonics(lights, brdf: Brdf, arrays, *, l_max: int) -> jax.Array:
    dtype = arrays[0].dtype
    radial = tuple(part for part in brdf.parts if part.model.radial is not None)
    others = tuple(part for part in brdf.parts if part.model.radial is None)

    def block(some):
        points, normals, views = some
        lobe, below = mirror(normals, views), None
        facing = jnp.sum(normals * views, axis=-1, keepdims=True) > 0
        for light in lights:
            for part in radial:
                about = normals if part.model.centre == "normal" else lobe
                gains = radial_gains(part, l_max).astype(dtype)  # [l, c]
                each = jnp.asarray((2 * np.arange(l_max + 1) + 1) / (4 * np.pi), dtype)
                moments = jax.vmap(
                    lambda p, a, light=light: light.zonal_moments(p, a, l_max)
                )(points, about)
                value = matmul(moments * each[None], gains)
                if part.model.horizon:
                    value = jnp.where(facing, value, 0)
                below = _colour(below, light, value, dtype)
        if others:
            rows = glossy_rows(
                Brdf(others), normals, views, l_max, table_to(_MIN_COSINE)
            )  # [n, k, c]
            for light in lights:
                unit = jax.vmap(functools.partial(CoefsOf(l_max), light))(points)[
                    ..., None
                ]
                value = jnp.sum(rows * jnp.broadcast_to(unit, rows.shape), axis=1)
                if all(part.model.horizon for part in others):
                    value = jnp.where(facing, value, 0)
                below = _colour(below, light, value, dtype)
        return below

    return map_blocks(block, tuple(arrays), max(_NUMBERS // (l_max + 1) ** 2 // 8, 1))
