"""Reflection maps that tabulate the view: Cabral's twelve maps, and Kautz and McCool's.

Both are built here from a spherical harmonic reflection map of high order, the fastest
way there is; what is measured is what their tables lose.

References:
    [CON99] Cabral, Olano, Nemec. Reflection space image based rendering: twelve maps seen
        from an icosahedron's vertices, blended over its faces.
    [KM00] Kautz, McCool. Approximation of glossy reflection with prefiltered environment
        maps: a lobe symmetric about R for each elevation of the view.
"""

from __future__ import annotations

import functools
import itertools

import jax
import jax.numpy as jnp
import numpy as np

from shjax.reflection import ReflectionMap, azimuthal_texture, icosahedral_maps
from shjax.sphere import icosahedron, pixel_coordinates
from shjax.vectors import mirror

ELEVATIONS = 16


@functools.lru_cache
def _faces() -> tuple[np.ndarray, np.ndarray]:
    """Vertices of the twenty faces, and the inverse of each face's three vectors."""
    points = icosahedron()
    near = points @ points.T > 0.4  # neighbours are 63 degrees apart
    faces = [
        t
        for t in itertools.combinations(range(12), 3)
        if all(near[a, b] for a, b in itertools.combinations(t, 2))
    ]
    return np.array(faces), np.linalg.inv(points[np.array(faces)].swapaxes(1, 2))


@jax.jit
def cabral_maps(maps: ReflectionMap) -> jax.Array:
    """Twelve maps over R from a global SHRM: ``(12, n_theta, n_phi, C)``."""
    return icosahedral_maps(maps)


@jax.jit
def cabral(maps: jax.Array, normals: jax.Array, views: jax.Array) -> jax.Array:
    """Radiance at R blended between the three maps about the view [CON99]."""
    corners, inverse = _faces()
    shares = jnp.einsum(
        "fij,nj->nfi",
        jnp.asarray(inverse, views.dtype),
        views,
        precision=jax.lax.Precision.HIGHEST,
    )
    face = jnp.argmax(jnp.min(shares, axis=-1), axis=-1)
    share = jnp.maximum(
        jnp.take_along_axis(shares, face[:, None, None], axis=1)[:, 0], 0
    )
    share = share / jnp.sum(share, axis=-1, keepdims=True)
    chosen = jnp.asarray(corners, jnp.int32)[face]
    return _read(maps, chosen, share, mirror(normals, views))


@jax.jit
def elevation_maps(maps: ReflectionMap) -> jax.Array:
    """A map for each elevation of the view, from a local SHRM: ``(T, ..., C)``."""
    angles = jnp.linspace(0, np.pi, ELEVATIONS).astype(maps.coefs.dtype)
    return jnp.moveaxis(azimuthal_texture(maps, angles), -2, 0)


@jax.jit
def kautz_mccool(maps: jax.Array, normals: jax.Array, views: jax.Array) -> jax.Array:
    """Radiance at R, linear between the elevations on both sides of the view's [KM00]."""
    towards = mirror(normals, views)
    cosine = jnp.clip(jnp.sum(towards * views, axis=-1), -1, 1)
    place = jnp.arccos(cosine) * np.float32((ELEVATIONS - 1) / np.pi)
    low = jnp.clip(jnp.floor(place), 0, ELEVATIONS - 2).astype(jnp.int32)
    share = place - low.astype(place.dtype)
    chosen = jnp.stack([low, low + 1], axis=-1)
    return _read(maps, chosen, jnp.stack([1 - share, share], axis=-1), towards)


def _read(maps, chosen, shares, towards) -> jax.Array:
    """Bilinear reading of lat-long maps: ``chosen`` and ``shares`` are ``(n, k)``."""
    _, rows, columns, channels = maps.shape
    x, y, z = towards[:, 0], towards[:, 1], towards[:, 2]
    theta, phi = jnp.arctan2(jnp.hypot(x, y), z), jnp.arctan2(y, x)
    row, column = pixel_coordinates(theta, phi, rows, columns)
    row = jnp.clip(row, 0, rows - 1)
    top, left = jnp.floor(row).astype(jnp.int32), jnp.floor(column).astype(jnp.int32)
    flat = maps.reshape(-1, channels)
    total = jnp.zeros((towards.shape[0], channels), maps.dtype)
    rise, run = row - top.astype(row.dtype), column - left.astype(row.dtype)
    for down in (0, 1):
        r = jnp.minimum(top + down, rows - 1)
        for right in (0, 1):
            c = jnp.mod(left + right, columns)
            part = jnp.abs(1 - down - rise) * jnp.abs(1 - right - run)
            place = (chosen * rows + r[:, None]) * columns + c[:, None]
            read = jnp.sum(flat[place] * shares[..., None], axis=1)
            total = total + read * part[:, None]
    return total
