"""Transforms by matrix products, theta first: the fastest way up to degree ~128.

``tables`` says why theta goes first. Above a small degree the map is folded twice. About
the equator every function of theta is even or odd. By half a turn ``phi -> phi + pi``
waves of even order m repeat, of odd order they change sign; and ``P_k0`` serve even m only,
``P_k1`` odd m only. So each product runs over half the rows, half the columns and half
the functions: a quarter of the operations, for one more pass over the map.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from shjax.arrays import einsum
from shjax.harmonics import tables
from shjax.harmonics.grid import Grid

# Degrees up to which maps are not folded. Adding the halves costs as much as the products
# save at 16 on one thread (with AVX-512), later on two and in synthesis; but shorter sums
# lose less: of a constant map of 512 rows 1e-7 in float32 where whole ones lose 2e-6.
_UNFOLDED_ANALYSIS, _UNFOLDED_SYNTHESIS = 12, 40
_PHI_BLOCK = 64


class Tables(NamedTuple):
    """Tables of a transform, in its data's type.

    Attributes:
        rings: Functions of theta: one table of all; folded, of even and of odd orders m,
            each a table of those even and one of those odd about the equator.
        azimuth: Waves of even and of odd m; folded, over half a turn.
        degrees: From the functions of theta to degrees, of even and of odd m.
    """

    rings: Any
    azimuth: tuple[jax.Array, jax.Array]
    degrees: tuple[jax.Array, jax.Array]


def analysis_tables(grid: Grid, l_max: int, dtype) -> Tables:
    """Tables of :func:`analyze` for a grid and a degree."""
    if _folds(grid, l_max, _UNFOLDED_ANALYSIS):
        rings, azimuth = _folded_rings, _half_turn
    else:
        rings, azimuth = _whole_rings, _whole_turn
    on_device = functools.partial(tables.on_device, dtype=dtype)
    return Tables(
        on_device(rings, tables.ring_weights, grid, l_max),
        on_device(azimuth, tables.azimuth_weights, grid, l_max),
        on_device(tables.degree_tables, l_max),
    )


def synthesis_tables(grid: Grid, l_max: int, dtype) -> Tables:
    """Tables of :func:`synthesize` for a grid and a degree."""
    if _folds(grid, l_max, _UNFOLDED_SYNTHESIS):
        rings, azimuth = _folded_rings, _half_turn
    else:
        rings, azimuth = _whole_rings, _whole_turn
    on_device = functools.partial(tables.on_device, dtype=dtype)
    return Tables(
        on_device(rings, tables.ring_values, grid, l_max),
        on_device(azimuth, tables.azimuth_values, grid.n_phi, l_max),
        on_device(tables.degree_tables, l_max),
    )


def analyze(radiance: jax.Array, by: Tables, *, grid: Grid, l_max: int) -> jax.Array:
    """Analyze a panorama ``(n_theta, n_phi, C)``: coefficients ``(K, C)``."""
    channels = radiance.shape[-1]
    if len(by.rings) == 2:
        rings = _to_folded_rings(by.rings, radiance, l_max)
    else:
        flat = radiance.reshape(grid.n_theta, -1)
        flat = einsum("kh,hx->kx", by.rings[0], flat)
        rings = jnp.split(flat.reshape(-1, grid.n_phi, channels), [l_max + 1])
    by_order = []
    for rows, azimuth, degree in zip(rings, by.azimuth, by.degrees, strict=True):
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
    if len(by.rings) == 2:
        return _from_folded_rings(by.rings, rings, l_max)
    stacked = jnp.concatenate(rings).reshape(2 * l_max + 1, -1)
    image = einsum("kh,kx->hx", by.rings[0], stacked)
    return image.reshape(grid.n_theta, grid.n_phi, channels)


def _folds(grid: Grid, l_max: int, above: int) -> bool:
    """Whether a map is folded about the equator and by half a turn."""
    return l_max > above and grid.n_theta % 2 == 0 and grid.n_phi % 2 == 0


def _symmetry(l_max: int, parity: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions of the functions of a parity of m, even and odd about the equator."""
    k = np.arange(parity, l_max + 1)  # P_k0, or P_k1 from k = 1 on
    return np.flatnonzero((k + parity) % 2 == 0), np.flatnonzero((k + parity) % 2)


def _whole_rings(table, grid: Grid, l_max: int) -> tuple[np.ndarray]:
    return (table(grid, l_max),)


def _folded_rings(table, grid: Grid, l_max: int) -> tuple[tuple[np.ndarray, ...], ...]:
    """Functions of even and of odd m, each even and odd about the equator, north of it."""
    by_parity = np.split(table(grid, l_max)[:, : grid.n_theta // 2], [l_max + 1])
    return tuple(
        tuple(own[which] for which in _symmetry(l_max, parity))
        for parity, own in enumerate(by_parity)
    )


def _whole_turn(table, place, l_max: int) -> tuple[np.ndarray, ...]:
    return table(place, l_max)


def _half_turn(table, place, l_max: int) -> tuple[np.ndarray, ...]:
    return tuple(waves[: len(waves) // 2] for waves in table(place, l_max))


def _to_folded_rings(rings: Any, radiance: jax.Array, l_max: int) -> list[jax.Array]:
    """Functions of theta times the map, of even and of odd m: ``(k, n_phi / 2, C)``."""
    half = radiance.shape[0] // 2
    north, south = radiance[:half], radiance[half:][::-1]
    products = ([], [])
    for symmetry, rows in enumerate((north + south, north - south)):
        west, east = jnp.split(rows, 2, axis=1)
        for parity, folded in enumerate((west + east, west - east)):
            flat = folded.reshape(half, -1)
            product = einsum("kh,hx->kx", rings[parity][symmetry], flat)
            products[parity].append(product.reshape(-1, *folded.shape[1:]))
    return [
        jnp.take(
            jnp.concatenate(products[parity]),
            np.argsort(np.concatenate(_symmetry(l_max, parity))),
            axis=0,
        )
        for parity in (0, 1)
    ]


def _from_folded_rings(rings: Any, rows: list[jax.Array], l_max: int) -> jax.Array:
    """The transpose of :func:`_to_folded_rings`: a panorama."""
    halves = []
    for symmetry in (0, 1):
        even, odd = (
            einsum(
                "kh,kwc->hwc",
                rings[parity][symmetry],
                jnp.take(rows[parity], _symmetry(l_max, parity)[symmetry], axis=0),
            )
            for parity in (0, 1)
        )
        halves.append(jnp.concatenate([even + odd, even - odd], axis=1))
    return jnp.concatenate([halves[0] + halves[1], (halves[0] - halves[1])[::-1]])


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
