"""Transforms by matrix products, theta first: the fastest way up to degree ~128.

``tables`` says why theta goes first. Above a small degree the map is folded about the
equator, where every function of theta is even or odd, which halves the largest product.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from shjax.arrays import einsum
from shjax.harmonics import tables
from shjax.harmonics.grid import Grid

_FOLD_ABOVE = 12  # below it, adding the halves costs more than the product saves
_PHI_BLOCK = 64


class Tables(NamedTuple):
    """Tables of a transform, in its data's type."""

    rings: tuple[jax.Array, ...]  # whole, or of the even and the odd functions
    azimuth: tuple[jax.Array, jax.Array]
    degrees: tuple[jax.Array, jax.Array]


def analysis_tables(grid: Grid, l_max: int, dtype) -> Tables:
    """Tables of :func:`analyze` for a grid and a degree."""
    return Tables(
        tables.on_device(_folded, tables.ring_weights, grid, l_max, dtype=dtype),
        tables.on_device(tables.azimuth_weights, grid, l_max, dtype=dtype),
        tables.on_device(tables.degree_tables, l_max, dtype=dtype),
    )


def synthesis_tables(grid: Grid, l_max: int, dtype) -> Tables:
    """Tables of :func:`synthesize` for a grid and a degree."""
    return Tables(
        tables.on_device(_folded, tables.ring_values, grid, l_max, dtype=dtype),
        tables.on_device(tables.azimuth_values, grid.n_phi, l_max, dtype=dtype),
        tables.on_device(tables.degree_tables, l_max, dtype=dtype),
    )


def analyze(radiance: jax.Array, by: Tables, *, grid: Grid, l_max: int) -> jax.Array:
    """Analyze a panorama ``(n_theta, n_phi, C)``: coefficients ``(K, C)``."""
    channels = radiance.shape[-1]
    rings = _to_rings(by.rings, radiance.reshape(grid.n_theta, -1), l_max)
    rings = rings.reshape(2 * l_max + 1, grid.n_phi, channels)
    by_order = []
    for rows, azimuth, degree in zip(
        jnp.split(rings, [l_max + 1]),  # of P_k0, of P_k1
        by.azimuth,
        by.degrees,
        strict=True,
    ):
        waves = _to_waves(rows, azimuth)
        by_order.append(einsum("mlk,mksc->mlsc", degree, waves))
    flat = jnp.concatenate(by_order).reshape(-1, channels)
    return jnp.take(flat, tables.flat_positions(l_max), axis=0)


def synthesize(coefs: jax.Array, by: Tables, *, grid: Grid, l_max: int) -> jax.Array:
    """Synthesize a panorama ``(n_theta, n_phi, C)`` from coefficients ``(K, C)``."""
    dtype, channels = coefs.dtype, coefs.shape[-1]
    flat = jnp.zeros(((l_max + 1) * (l_max + 1) * 2, channels), dtype)
    flat = flat.at[tables.flat_positions(l_max)].set(coefs, unique_indices=True)
    by_order = flat.reshape(l_max + 1, l_max + 1, 2, channels)
    rings = []
    for rows, azimuth, degree in zip(
        jnp.split(by_order, [l_max // 2 + 1]),  # of even m, of odd m
        by.azimuth,
        by.degrees,
        strict=True,
    ):
        waves = einsum("mlk,mlsc->mksc", degree, rows)
        rings.append(einsum("mksc,wms->kwc", waves, azimuth))
    stacked = jnp.concatenate(rings).reshape(2 * l_max + 1, -1)
    image = _from_rings(by.rings, stacked, l_max)
    return image.reshape(grid.n_theta, grid.n_phi, channels)


def _symmetry(l_max: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the ring tables that are even and odd about the equator."""
    parity = np.concatenate([np.arange(l_max + 1), np.arange(l_max)]) % 2
    return np.flatnonzero(parity == 0), np.flatnonzero(parity == 1)


def _folded(table, grid: Grid, l_max: int) -> tuple[np.ndarray, ...]:
    """A table over the rings; where folding is quicker, its halves north of the equator."""
    rings = table(grid, l_max)
    if l_max <= _FOLD_ABOVE or grid.n_theta % 2:
        return (rings,)
    return tuple(rings[which, : grid.n_theta // 2] for which in _symmetry(l_max))


def _to_rings(rings: tuple[jax.Array, ...], rows: jax.Array, l_max: int) -> jax.Array:
    """The table times the rows, by halves where it is folded."""
    if len(rings) == 1:
        return einsum("kh,hx->kx", rings[0], rows)
    half = rows.shape[0] // 2
    north, south = rows[:half], rows[half:][::-1]
    parts = [
        einsum("kh,hx->kx", ring, folded)
        for ring, folded in zip(rings, (north + south, north - south), strict=True)
    ]
    back = np.argsort(np.concatenate(_symmetry(l_max)))
    return jnp.take(jnp.concatenate(parts), back, axis=0)


def _to_waves(rows: jax.Array, azimuth: jax.Array) -> jax.Array:
    """``sum_w rows[k, w, c] azimuth[w, m, s]`` as ``[m, k, s, c]``, summed in blocks.

    One long sum of like terms, a bright sky's, drifts by 4e-6 in float32; blocks of it
    stay below 3e-7.
    """
    columns = rows.shape[1]
    # Many orders make the blocks' own results large: fewer blocks then.
    largest = _PHI_BLOCK if rows.shape[0] <= 65 else 4 * _PHI_BLOCK
    size = next(b for b in range(min(columns, largest), 0, -1) if columns % b == 0)
    if size < _PHI_BLOCK // 4:  # a prime number of columns, or few of them
        size = columns
    count = columns // size
    blocks = rows.reshape(rows.shape[0], count, size, rows.shape[2])
    waves = azimuth.reshape(count, size, *azimuth.shape[1:])
    return jnp.sum(einsum("kawc,awms->amksc", blocks, waves), axis=0)


def _from_rings(rings: tuple[jax.Array, ...], rows: jax.Array, l_max: int) -> jax.Array:
    """The transposed table times the rows, by halves where it is folded."""
    if len(rings) == 1:
        return einsum("kh,kx->hx", rings[0], rows)
    even, odd = (
        einsum("kh,kx->hx", ring, jnp.take(rows, which, axis=0))
        for ring, which in zip(rings, _symmetry(l_max), strict=True)
    )
    return jnp.concatenate([even + odd, (even - odd)[::-1]])
