"""Float64 tables behind the transforms: rings, azimuth, degrees.

All are NumPy, computed once, cached and read-only. Compiled programs take them as
arguments (:func:`on_device`): as constants, large ones would be in each program anew, and
XLA would compute with them while it compiles.

Theta first: the functions ``P_lm(cos t)`` with l <= F span only 2F + 1 functions of t.
Those with even m are polynomials in z = cos t, combinations of ``P_k0``; those with odd m
are sin t times polynomials, combinations of ``P_k1``. So a panorama is first reduced to
2F + 1 rows (one matrix product on the map as it is stored), then along phi, and last a
small matrix for each m turns (k, m) into (l, m). Both families are orthonormal, so these
matrices have orthonormal rows, and nothing is lost.

References:
    [T4] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 4.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from shjax.arrays import as_type
from shjax.harmonics.degrees import degrees, orders
from shjax.harmonics.grid import Grid
from shjax.harmonics.legendre import legendre
from shjax.sphere import latlong_phi


def cached(function):
    """Cache a function of hashable arguments that returns arrays; make them read-only."""

    @functools.lru_cache(maxsize=64)
    @functools.wraps(function)
    def wrapper(*args):
        tables = function(*args)
        for table in tables if isinstance(tables, tuple) else (tables,):
            table.setflags(write=False)
        return tables

    return wrapper


@functools.lru_cache(maxsize=32)
def on_device(table: Callable[..., Any], *args, dtype) -> Any:
    """Device arrays of what a cached function returns, in a given type.

    Args:
        table: A function from here, such as :func:`degree_tables`.
        *args: Its arguments.
        dtype: Of the arrays.

    Returns:
        An array, or a tuple of them, as the function does.
    """
    with jax.ensure_compile_time_eval():  # inside a trace, too, the arrays are known
        return jax.tree.map(lambda a: as_type(a, dtype), table(*args))


def _two_families(l_max: int, theta: np.ndarray) -> np.ndarray:
    """``P_00 .. P_F0, P_11 .. P_F1`` at polar angles, ``(2F + 1, n)``."""
    z, sine = np.cos(theta), np.sin(theta)
    even, odd = legendre(l_max, 0, z, sine), legendre(l_max, 1, z, sine)
    return np.concatenate([even, odd[1:]])


@cached
def ring_values(grid: Grid, l_max: int) -> np.ndarray:
    """``P_00 .. P_F0, P_11 .. P_F1`` at the grid's rings, ``(2F + 1, n_theta)``."""
    return _two_families(l_max, grid.theta)


@cached
def ring_weights(grid: Grid, l_max: int) -> np.ndarray:
    """Values of :func:`ring_values` times the weight of a pixel, for analysis.

    By the pixel rule, their integrals over each row.
    """
    theta, weights = grid.rings(l_max)
    values = _two_families(l_max, theta.ravel()) * weights.ravel()
    return values.reshape(2 * l_max + 1, *theta.shape).sum(axis=-1)


def orders_of_parity(l_max: int, parity: int) -> np.ndarray:
    """Orders 0 <= m <= l_max that are even (parity 0) or odd (parity 1)."""
    return np.arange(parity, l_max + 1, 2)


@cached
def azimuth_values(n_phi: int, l_max: int) -> tuple[np.ndarray, np.ndarray]:
    """``az_m`` and ``az_-m`` at the columns, for even m and for odd m [T4, Eq. 4.4].

    Each ``(n_phi, M, 2)``; the sine of m = 0 is zero.
    """
    phi = latlong_phi(n_phi)

    def columns(parity: int) -> np.ndarray:
        m = orders_of_parity(l_max, parity)
        angle = phi[:, None] * m
        waves = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return waves * np.where(m == 0, 1, np.sqrt(2.0))[:, None]

    return columns(0), columns(1)


@cached
def azimuth_weights(grid: Grid, l_max: int) -> tuple[np.ndarray, np.ndarray]:
    """Values of :func:`azimuth_values` for analysis; by the pixel rule, averaged."""
    even, odd = azimuth_values(grid.n_phi, l_max)
    if not grid.rule.integrates_pixels:
        return even, odd
    gains = pixel_gains(grid, np.arange(l_max + 1))
    return even * gains[0::2, None], odd * gains[1::2, None]


def pixel_gains(grid: Grid, m: np.ndarray) -> np.ndarray:
    """Attenuation of order m by averaging over a pixel, sin(x) / x with x = m pi / n."""
    return np.sinc(m / grid.n_phi)


@cached
def degree_tables(l_max: int) -> tuple[np.ndarray, np.ndarray]:
    """Matrices from (k, m) to (l, m), ``(M, F + 1, F + 1)`` even and ``(M, F + 1, F)``.

    ``T[m, l, k] = 2 pi int N_lm P_lm N_k0 P_k0 dz`` (``P_k1`` for odd m), exact by
    Fejer's rule on 2 F + 1 nodes, whose sine and cosine are known to the last digit.
    """
    grid = Grid(2 * l_max + 1, 1)
    z, sine, weights = np.cos(grid.theta), np.sin(grid.theta), grid.weights

    def convert(parity: int) -> np.ndarray:
        ring = legendre(l_max, parity, z, sine)[parity:]
        ring = (weights * ring).T
        m = orders_of_parity(l_max, parity)
        tables = [legendre(l_max, int(k), z, sine) @ ring for k in m]
        return np.stack(tables) if tables else np.zeros((0, l_max + 1, l_max))

    return convert(0), convert(1)


@cached
def flat_positions(l_max: int) -> np.ndarray:
    """Position of each flat coefficient in (even m, then odd m) x l x (cos, sin)."""
    l, m = degrees(l_max), orders(l_max)
    size, evens = np.abs(m), l_max // 2 + 1
    slot = size // 2 + np.where(size % 2, evens, 0)
    return (slot * (l_max + 1) + l) * 2 + (m < 0)
