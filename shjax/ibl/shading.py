"""Shading points by a prefiltered light: roughness and reflectance per point."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import (
    Array,
    as_float,
    as_number_or_float,
    check_vectors,
    float_type,
    map_blocks,
)
from shjax.brdf.ggx import Half, distribution_masking, multiple_scattering, schlick
from shjax.harmonics import evaluate
from shjax.ibl.ggx_tables import (
    LEVELS,
    MIN_ALPHA,
    Roughness,
    ggx_tables,
    locate,
    uniform_response,
    view_functions,
)
from shjax.ibl.prefiltered_light import PrefilteredLight, level_shape, level_starts
from shjax.ibl.texels import Weights, read_maps
from shjax.lights import CapLights, cap_nodes
from shjax.reflection.view_basis import halfway
from shjax.sphere import pixel_coordinates
from shjax.vectors import in_spherical_frame, mirror, polar_angles

Parameter = float | Array | Sequence[float]


def shade(
    light: PrefilteredLight,
    normals: Float[Array, "*points 3"],
    views: Float[Array, "*others 3"],
    *,
    albedo: Parameter,
    roughness: Parameter,
    metallic: Parameter = 0.0,
    f0: Parameter = 0.04,
) -> Float[jax.Array, "*all C"]:
    """Shade points by image-based lighting: a metallic-roughness material per point.

    ``albedo (1 - metallic) / pi E(n)`` plus GGX with ``alpha = roughness^2``, Smith
    masking, Schlick's term from ``f0 (1 - metallic) + albedo metallic``, and its lost
    energy given back. Differentiable in everything; not smooth on the lines between
    texels, between roughnesses of the table, and at the lights' horizons. The maps end at
    alpha = 1/16 (roughness 0.25): a smoother surface looks like that one.

    Args:
        light: From :func:`shjax.prefilter_light`. Each of several lights shades every
            point (pairs: ``jax.vmap``).
        normals: Unit normals.
        views: Unit vectors to the viewer.
        albedo: A number, or an array that broadcasts to ``(*points, C)``.
        roughness: A number, ``(*points,)`` or ``(*points, 1)``, in [0, 1]. No value is
            checked here, where it may be traced.
        metallic: A number, ``(*points,)`` or ``(*points, 1)``, in [0, 1].
        f0: Reflectance of the dielectric at normal incidence, in the form of ``albedo``.

    Returns:
        ``(*lights, *points, C)``.

    Raises:
        ValueError: If a shape does not fit, or ``light`` is not prefiltered.
    """
    if not isinstance(light, PrefilteredLight):
        raise ValueError("light must be what prefilter_light made of a light.")
    for name, vectors in (("normals", normals), ("views", views)):
        check_vectors(name, vectors)
    if normals.shape != views.shape:
        raise ValueError(
            f"views must have the shape of normals {normals.shape}; got {views.shape}."
        )
    dtype = float_type("light", light.texels)
    # Before jit, which would take a list of numbers apart.
    material = {
        "albedo": albedo,
        "roughness": roughness,
        "metallic": metallic,
        "f0": f0,
    }
    material = {k: as_number_or_float(k, v, dtype) for k, v in material.items()}
    return _shade(light, normals, views, material)


@jax.jit
def _shade(
    light: PrefilteredLight, normals, views, material: dict[str, jax.Array]
) -> jax.Array:
    texels = as_float("light", light.texels)
    channels, dtype, points = texels.shape[-1], texels.dtype, normals.shape[:-1]
    flat = {
        "normals": as_float("normals", normals).astype(dtype).reshape(-1, 3),
        "views": as_float("views", views).astype(dtype).reshape(-1, 3),
        "albedo": _per_point("albedo", material["albedo"], (*points, channels)),
        "roughness": _per_point("roughness", material["roughness"], points),
        "metallic": _per_point("metallic", material["metallic"], points),
        "f0": _per_point("f0", material["f0"], (*points, channels)),
    }
    front = texels.shape[:-3]
    if not front:
        return _in_blocks(light, flat).reshape(*points, channels)
    count = math.prod(front)
    many = jax.tree.map(lambda a: a.reshape(count, *a.shape[len(front) :]), light)
    shaded = jax.lax.map(lambda one: _in_blocks(one, flat), many)
    return shaded.reshape(*front, *points, channels)


def _per_point(name: str, array: jax.Array, shape: tuple[int, ...]) -> jax.Array:
    if array.shape == (*shape, 1) and name in ("roughness", "metallic"):
        array = array[..., 0]  # as a texture is read
    try:
        spread = jnp.broadcast_to(array, shape)
    except ValueError:
        raise ValueError(
            f"{name} must broadcast to {shape}; got shape {array.shape}."
        ) from None
    size = math.prod(shape)
    return (
        spread.reshape(-1, shape[-1])
        if name in ("albedo", "f0")
        else spread.reshape(size)
    )


_POINTS_AT_ONCE = 16384


def _in_blocks(light: PrefilteredLight, points: dict[str, jax.Array]) -> jax.Array:
    """Some points at a time, which a cache holds; the gradient shades them again."""
    count = points["normals"].shape[0]
    if count <= _POINTS_AT_ONCE:
        return _shade_points(light, **points)
    some = jax.checkpoint(lambda some: _shade_points(light, **some))
    return map_blocks(some, points, _POINTS_AT_ONCE)


def _shade_points(
    light: PrefilteredLight, normals, views, albedo, roughness, metallic, f0
) -> jax.Array:
    """Points ``(n, 3)``, one light; colours have the channel in front inside."""
    albedo, f0, metal = albedo.T, f0.T, metallic[None]
    diffuse = albedo * (1 - metal)
    specular = f0 * (1 - metal) + albedo * metal
    alpha = jnp.maximum(roughness, math.sqrt(MIN_ALPHA)) ** 2
    cosine = jnp.sum(normals * views, axis=-1)
    rough, fit = locate(alpha), ggx_tables(light.maps)
    functions = view_functions(fit, rough, cosine)
    white, slope = uniform_response(fit, rough, functions)
    gain = multiple_scattering((white + slope)[None], specular)
    glossy = _read(light.texels, rough, normals, views, functions, specular)
    received = evaluate(light.irradiance, normals).T
    if light.lights.heights.shape[-1]:
        from_caps = _caps(light.lights, normals, views, alpha)
        received = received + from_caps.irradiance
        glossy = glossy + from_caps.base + specular * from_caps.slope
    return (received * diffuse * (1 / math.pi) + gain * glossy).T


def _read(texels, rough: Roughness, normals, views, functions, f0) -> jax.Array:
    """Sum of all maps at the reflected directions, in their functions of the view."""
    fit = ggx_tables(texels.shape[0])
    towards = mirror(normals, views)
    x, y, _ = jnp.moveaxis(in_spherical_frame(towards, normals), -1, 0)
    places, shares = taps(rough, towards)
    waves = jnp.stack(halfway(x, y, fit.orders))
    base, slope = (
        jnp.take(part, np.array(fit.functions), axis=0) * waves for part in functions
    )
    parity = tuple(abs(q) % 2 for q in fit.orders)
    return read_maps(parity, texels, places, shares, Weights(base, slope, f0))


def taps(rough: Roughness, towards: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Texels about reflected directions, eight each, and their shares.

    Returns:
        Places ``(8, n)``, and shares for maps of even and odd order, ``(8, 2, n)``.
    """
    theta, phi = polar_angles(towards)
    heights = np.array([level_shape(level)[0] for level in range(LEVELS)], np.int32)
    starts = np.array(level_starts()[:-1], np.int32)
    places, even, odd = [], [], []
    for step in (0, 1):
        level = rough.level + step
        rows = jnp.take(jnp.asarray(heights), level)
        start = jnp.take(jnp.asarray(starts), level)
        columns, height = 2 * rows, rows.astype(theta.dtype)
        row, column = pixel_coordinates(theta, phi, height, 2 * height)
        top, left = (jnp.floor(a).astype(jnp.int32) for a in (row, column))
        down, right = row - top.astype(row.dtype), column - left.astype(row.dtype)
        own = rough.share if step else 1 - rough.share
        for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
            line = top + i
            # Across a pole the neighbour is half a turn on, in a frame turned by pi.
            over = (line < 0) | (line >= rows)
            line = jnp.clip(line, 0, rows - 1)
            at = jnp.mod(left + j + jnp.where(over, rows, 0), columns)
            share = own * (down if i else 1 - down) * (right if j else 1 - right)
            places.append(start + line * columns + at)
            even.append(share)
            odd.append(jnp.where(over, -share, share))
    return jnp.stack(places), jnp.stack([jnp.stack(even), jnp.stack(odd)], axis=1)


class _Caps(NamedTuple):
    """What caps give, each ``(C, n)``; reflected radiance is affine in f0."""

    irradiance: jax.Array
    base: jax.Array
    slope: jax.Array


def _caps(lights: CapLights, normals, views, alpha) -> _Caps:
    """Irradiance and reflection of caps: the model itself at eight directions of each.

    Args:
        lights: The caps.
        normals: ``(n, 3)``.
        views: The same.
        alpha: Roughness, ``(n,)``.
    """
    towards, shares = cap_nodes(lights, normals.dtype, 2, 4)
    amounts = lights.flux.astype(normals.dtype)[:, None] * shares[None, :, None]
    n, v = ([vectors[:, k] for k in range(3)] for vectors in (normals, views))
    cosine = _dot(n, v)
    seen = cosine > 0
    view_z = jnp.where(seen, cosine, 1)

    @jax.checkpoint
    def add(total, node):
        direction, amount = node
        light_z = _dot(n, direction)
        lit = light_z > 0
        light_z = jnp.where(lit, light_z, 1)
        towards_both = [a + b for a, b in zip(v, direction, strict=True)]
        # A light behind may face the view exactly: no half vector, no derivative.
        parts = _about_normal(n, towards_both)
        half = Half(*(jnp.where(lit, part, 1) for part in parts))
        lobe = distribution_masking(alpha, light_z, view_z, half) * light_z
        fresnel = schlick(half)
        given = (
            jnp.where(lit, light_z, 0),
            jnp.where(lit & seen, lobe * fresnel, 0),
            jnp.where(lit & seen, lobe * (1 - fresnel), 0),
        )
        added = (
            so_far + amount[:, None] * one[None]
            for so_far, one in zip(total, given, strict=True)
        )
        return tuple(added), None

    rows = (towards.reshape(-1, 3), amounts.reshape(-1, amounts.shape[-1]))
    zero = jnp.zeros((amounts.shape[-1], normals.shape[0]), normals.dtype)
    return _Caps(*jax.lax.scan(add, (zero, zero, zero), rows)[0])


def _dot(a, b) -> jax.Array:
    """Of vectors by their components."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _about_normal(n, h) -> tuple[jax.Array, jax.Array, jax.Array]:
    """``|n x h|^2``, ``n.h`` and ``|h|^2``: no digits are lost where h is near n."""
    x, y, z = (
        n[1] * h[2] - n[2] * h[1],
        n[2] * h[0] - n[0] * h[2],
        n[0] * h[1] - n[1] * h[0],
    )
    return x * x + y * y + z * z, _dot(n, h), _dot(h, h)
