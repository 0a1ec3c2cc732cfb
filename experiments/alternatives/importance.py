"""Filtered importance sampling of a panorama [Krivanek and Colbert 2008].

Directions are drawn from the BRDF's own lobe, and each reads a mip level whose texels are
as large as the solid angle that the sample stands for.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from shjax.brdf.core import Brdf, transfer
from shjax.sphere import pixel_coordinates
from shjax.vectors import frames

_POINTS_AT_ONCE = 256


class Drawn(NamedTuple):
    """Light directions ``(n, k, 3)`` and their densities per steradian, ``(n, k)``."""

    lights: jax.Array
    density: jax.Array


def hammersley(n: int) -> np.ndarray:
    """``n`` points in the unit square, ``(n, 2)``: index over n, radical inverse."""
    index = np.arange(n)
    inverse, base = np.zeros(n), 0.5
    left = index.copy()
    while np.any(left):
        inverse += base * (left % 2)
        left //= 2
        base /= 2
    return np.stack([(index + 0.5) / n, inverse + 0.5 / n], axis=-1)


def draw_phong(exponent: float, n: int, reflected: jax.Array) -> Drawn:
    """Directions with density ``(s + 1) / 2 pi cos^s`` about R, ``(p, 3)``."""
    u = hammersley(n)
    cosine = (1 - u[:, 1]) ** (1 / (exponent + 1))
    local = _local(cosine, 2 * np.pi * u[:, 0])
    density = (exponent + 1) / (2 * np.pi) * cosine**exponent
    return _turned(local, density, reflected)


def draw_microfacet(
    sigma: float, n: int, normals: jax.Array, views: jax.Array
) -> Drawn:
    """Mirrored about normals with density ``~ exp(-(theta / sigma)^2)``."""
    u = hammersley(n)
    cut = 1 - np.exp(-((np.pi / 2 / sigma) ** 2))
    theta = sigma * np.sqrt(-np.log1p(-u[:, 1] * cut))
    local = _local(np.cos(theta), 2 * np.pi * u[:, 0])
    density = np.exp(-((theta / sigma) ** 2)) / (np.pi * sigma**2 * cut)
    density = density * theta / np.maximum(np.sin(theta), 1e-9)
    half, of_half = _turned(local, density, normals)
    cosine = jnp.sum(half * views[:, None], axis=-1)
    lights = 2 * cosine[..., None] * half - views[:, None]
    return Drawn(lights, of_half / jnp.maximum(4 * jnp.abs(cosine), 1e-6))


def draw_ggx(alpha: float, n: int, normals: jax.Array, views: jax.Array) -> Drawn:
    """Mirrored about normals with density ``D(h) n.h`` of GGX."""
    u = hammersley(n)
    squared = (1 - u[:, 1]) / (1 + (alpha**2 - 1) * u[:, 1])  # of n.h
    local = _local(np.sqrt(squared), 2 * np.pi * u[:, 0])
    spread = alpha**2 / (np.pi * (squared * (alpha**2 - 1) + 1) ** 2)
    half, of_half = _turned(local, spread * np.sqrt(squared), normals)
    cosine = jnp.sum(half * views[:, None], axis=-1)
    lights = 2 * cosine[..., None] * half - views[:, None]
    return Drawn(lights, of_half / jnp.maximum(4 * jnp.abs(cosine), 1e-6))


def draw_uniform(n: int, normals: jax.Array) -> Drawn:
    """Independent directions over the sphere, other ones at each point."""
    seed = jax.lax.bitcast_convert_type(normals[0, 0].astype(jnp.float32), jnp.uint32)
    key = jax.random.fold_in(jax.random.key(0), seed)  # blocks differ
    u = jax.random.uniform(key, (normals.shape[0], n, 2), normals.dtype)
    z, phi = 1 - 2 * u[..., 0], 2 * np.float32(np.pi) * u[..., 1]
    sine = jnp.sqrt(jnp.maximum(1 - z * z, 0))
    lights = jnp.stack([sine * jnp.cos(phi), sine * jnp.sin(phi), z], axis=-1)
    return Drawn(lights, jnp.full(u.shape[:2], 1 / (4 * np.pi), normals.dtype))


def draw_both(
    exponent: float, n: int, normals: jax.Array, reflected: jax.Array
) -> Drawn:
    """Half by the cosine about the normal, half by a Phong lobe about R.

    For reflectances with no lobe of their own to draw from; each direction has the
    density of the mixture.
    """
    first, second = (
        draw_phong(1.0, n // 2, normals),
        draw_phong(exponent, n // 2, reflected),
    )
    lights = jnp.concatenate([first.lights, second.lights], axis=1)

    def density(axes, power):
        cosine = jnp.maximum(jnp.einsum("pi,pki->pk", axes, lights), 0)
        return (power + 1) / (2 * np.pi) * cosine**power

    mixed = 0.5 * density(normals, 1.0) + 0.5 * density(reflected, exponent)
    return Drawn(lights, jnp.maximum(mixed, 1e-6))


def _local(cosine: np.ndarray, phi: np.ndarray) -> np.ndarray:
    sine = np.sqrt(np.maximum(1 - cosine**2, 0))
    return np.stack([sine * np.cos(phi), sine * np.sin(phi), cosine], axis=-1)


def _turned(local: np.ndarray, density: np.ndarray, axes: jax.Array) -> Drawn:
    frame = frames(axes)
    lights = jnp.einsum("pij,ki->pkj", frame, jnp.asarray(local, axes.dtype))
    shape = (axes.shape[0], local.shape[0])
    return Drawn(
        lights, jnp.broadcast_to(jnp.asarray(density, axes.dtype)[None], shape)
    )


def pyramid(radiance: jax.Array) -> tuple[jax.Array, ...]:
    """Mip levels of a lat-long map, averages of 2 x 2 by solid angle."""
    levels = [radiance]
    while min(levels[-1].shape[:2]) >= 2 and all(
        s % 2 == 0 for s in levels[-1].shape[:2]
    ):
        image = levels[-1]
        rows, columns, channels = image.shape
        theta = np.pi * (np.arange(rows) + 0.5) / rows
        area = jnp.asarray(np.sin(theta), image.dtype)[:, None, None]
        blocks = (image * area).reshape(rows // 2, 2, columns // 2, 2, channels)
        weight = area.reshape(rows // 2, 2, 1, 1, 1)
        levels.append(jnp.sum(blocks, axis=(1, 3)) / (2 * jnp.sum(weight, axis=(1, 3))))
    return tuple(levels)


class _Atlas(NamedTuple):
    """All levels one after the other: texels ``(t, C)``, and each level's place."""

    texels: jax.Array
    start: np.ndarray
    rows: np.ndarray
    columns: np.ndarray


def _atlas(levels: tuple[jax.Array, ...]) -> _Atlas:
    rows, columns = (np.array([x.shape[k] for x in levels]) for k in (0, 1))
    start = np.concatenate([[0], np.cumsum(rows * columns)[:-1]])
    channels = levels[0].shape[-1]
    texels = jnp.concatenate([level.reshape(-1, channels) for level in levels])
    return _Atlas(texels, start, rows, columns)


def _bilinear(atlas: _Atlas, level: jax.Array, theta: jax.Array, phi: jax.Array):
    """One level, a sample's own, read at its direction."""
    start, rows, columns = (jnp.asarray(a, jnp.int32)[level] for a in atlas[1:])
    height, width = rows.astype(theta.dtype), columns.astype(theta.dtype)
    row, column = pixel_coordinates(theta, phi, height, width)
    row = jnp.clip(row, 0, height - 1)
    top, left = (jnp.floor(a).astype(jnp.int32) for a in (row, column))
    total = 0.0
    for down in (0, 1):
        line = jnp.minimum(top + down, rows - 1)
        share = jnp.abs(1 - down - (row - top.astype(row.dtype)))
        for right in (0, 1):
            across = jnp.abs(1 - right - (column - left.astype(row.dtype)))
            place = start + line * columns + jnp.mod(left + right, columns)
            total = total + (share * across)[..., None] * atlas.texels[place]
    return jnp.asarray(total)


@functools.partial(jax.jit, static_argnames=("draw", "filtered"))
def reflect(
    levels: tuple[jax.Array, ...],
    brdf: Brdf,
    normals: jax.Array,
    views: jax.Array,
    *,
    draw,
    filtered: bool = True,
) -> jax.Array:
    """Reflected radiance ``(p, C)`` from samples drawn by ``draw(normals, views)``."""
    rows, columns, channels = levels[0].shape
    atlas = _atlas(levels)

    def block(pair):
        normal, view = pair
        lights, density = draw(normal, view)
        shape = lights.shape
        spread = [jnp.broadcast_to(a[:, None], shape) for a in (normal, view)]
        weight = transfer(brdf, spread[0], lights, spread[1])
        weight = weight / jnp.maximum(density, 1e-9)[..., None]
        x, y, z = lights[..., 0], lights[..., 1], lights[..., 2]
        theta, phi = jnp.arctan2(jnp.hypot(x, y), z), jnp.arctan2(y, x)
        if filtered:
            texel = 2 * np.pi**2 / (rows * columns) * jnp.maximum(jnp.sin(theta), 1e-3)
            own = 1 / jnp.maximum(density * shape[1], 1e-9)
            level = 0.5 * jnp.log2(jnp.maximum(own / texel, 1e-6)) + 0.5
            level = jnp.clip(level, 0, len(levels) - 1)
            low = jnp.minimum(level.astype(jnp.int32), len(levels) - 1)
            high = jnp.minimum(low + 1, len(levels) - 1)
            rest = (level - low.astype(level.dtype))[..., None]
            light = (1 - rest) * _bilinear(atlas, low, theta, phi)
            light = light + rest * _bilinear(atlas, high, theta, phi)
        else:
            light = _bilinear(atlas, jnp.zeros(theta.shape, jnp.int32), theta, phi)
        return jnp.mean(light * weight, axis=1)

    n = normals.shape[0]
    padding = [(0, -n % _POINTS_AT_ONCE), (0, 0)]
    tiles = tuple(
        jnp.pad(a, padding, mode="edge").reshape(-1, _POINTS_AT_ONCE, 3)
        for a in (normals, views)
    )
    return jax.lax.map(block, tiles).reshape(-1, channels)[:n]
