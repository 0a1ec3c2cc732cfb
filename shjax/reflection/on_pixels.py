"""Convolution on pixels: reflection maps on a lat-long grid or a cube map.

References:
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from shjax.arrays import (
    common_channels,
    map_blocks,
)
from shjax.harmonics.degrees import degree_of_coefs
from shjax.harmonics.orientations import (
    maps_at,
    maps_on_grid,
)
from shjax.reflection.view_basis import HarmonicViews, ViewBasis
from shjax.sphere import cube_directions, latlong_phi, latlong_theta

_POINTS_AT_ONCE = 2048


@functools.partial(jax.jit, static_argnames=("size", "frame"))
def on_grid(
    views: ViewBasis,
    lighting,
    kernels,
    tables,
    *,
    size: tuple[int, int],
    frame: str,
) -> jax.Array:
    """Convolve on the pixels of a lat-long grid: ``(..., n_theta, n_phi, Q, C)``."""
    rows, columns = size
    theta, phi = latlong_theta(rows), latlong_phi(columns)

    def one(light, own):
        maps = maps_on_grid(light, own, views.orders, theta, columns, tables)
        if frame == "local":
            return maps
        assert isinstance(views, HarmonicViews)  # only they rotate
        azimuth = jnp.asarray(np.broadcast_to(phi, size), maps.dtype)
        return views.to_world(maps, jnp.asarray(theta, maps.dtype), azimuth)

    return _over_batch(one, lighting, kernels)


@functools.partial(jax.jit, static_argnames=("size", "frame"))
def on_cube(
    views: ViewBasis, lighting, kernels, tables, *, size: int, frame: str
) -> jax.Array:
    """Convolve on the pixels of a cube map: ``(..., 6, size, size, Q, C)``."""
    directions = cube_directions(size).reshape(-1, 3)
    theta, phi = (jnp.asarray(a, lighting.dtype) for a in _angles(directions))

    def one(light, own):
        maps = maps_at(light, own, views.orders, theta, phi, tables)
        if frame == "global":
            assert isinstance(views, HarmonicViews)
            maps = _rotate_points(views, maps, theta, phi)
        return maps.reshape(6, size, size, *maps.shape[1:])

    return _over_batch(one, lighting, kernels)


def _angles(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x, y, z = np.moveaxis(directions, -1, 0)
    return np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)


def _rotate_points(views: HarmonicViews, maps: jax.Array, theta, phi) -> jax.Array:
    """Coefficients ``(n, Q, C)`` at single directions over the world's view."""

    def block(some):
        values, a, b = some
        return views.to_world(values[:, None], a, b[:, None])[:, 0]

    return map_blocks(block, (maps, theta, phi), _POINTS_AT_ONCE)


def _over_batch(one: Callable, lighting, kernels) -> jax.Array:
    """Each light and BRDF in turn; a loop holds one map's temporaries at a time."""
    l_max = min(degree_of_coefs(lighting), kernels.shape[-3] - 1)
    channels = common_channels(lighting.shape[-1], kernels.shape[-1], "rho")
    lighting = lighting[..., : (l_max + 1) ** 2, :]
    lighting = jnp.broadcast_to(lighting, (*lighting.shape[:-1], channels))
    kernels = kernels[..., : l_max + 1, :, :]
    kernels = jnp.broadcast_to(kernels, (*kernels.shape[:-1], channels))
    batch = jnp.broadcast_shapes(lighting.shape[:-2], kernels.shape[:-3])
    if not batch:
        return one(lighting, kernels)
    pairs = tuple(
        jnp.broadcast_to(a, (*batch, *a.shape[-rank:])).reshape(-1, *a.shape[-rank:])
        for a, rank in ((lighting, 2), (kernels, 3))
    )
    many = jax.vmap(one) if pairs[0].shape[0] <= 1 else None
    maps = many(*pairs) if many else jax.lax.map(lambda pair: one(*pair), pairs)
    return maps.reshape(*batch, *maps.shape[1:])
