"""Float64 tables behind the transforms: Legendre functions, rings, azimuth, degrees.

All are NumPy, computed once, cached and read-only; they are cast to the data's type at
the point of use.

Theta first: the functions ``P_lm(cos t)`` with l <= F span only 2F + 1 functions of t.
Those with even m are polynomials in z = cos t, combinations of ``P_k0``; those with odd m
are sin t times polynomials, combinations of ``P_k1``. So a panorama is first reduced to
2F + 1 rows (one matrix product on the map as it is stored), then along phi, and last a
small matrix for each m turns (k, m) into (l, m). Both families are orthonormal, so these
matrices have orthonormal rows, and nothing is lost.
"""

from __future__ import annotations

import functools

import numpy as np

from shjax.harmonics.degrees import degrees, orders
from shjax.harmonics.grid import Grid


def _cached(function):
    """Cache a function of hashable arguments that returns arrays; make them read-only."""

    @functools.lru_cache(maxsize=64)
    @functools.wraps(function)
    def wrapper(*args):
        tables = function(*args)
        for table in tables if isinstance(tables, tuple) else (tables,):
            table.setflags(write=False)
        return tables

    return wrapper


def legendre(l_max: int, m: int, z: np.ndarray, sine: np.ndarray) -> np.ndarray:
    """Normalised associated Legendre functions ``N_lm P_lm`` of one order.

    Three-term recurrence in l, stable upwards [T4, Eq. 4.3 for the norm]; no
    Condon-Shortley phase.

    Args:
        l_max: Highest degree.
        m: Order, 0 <= m.
        z: cos t, ``(n,)``.
        sine: sin t, ``(n,)``, given beside z since 1 - z^2 loses digits at the poles.

    Returns:
        ``(l_max + 1, n)``; rows below m are zero.
    """
    values = np.zeros((l_max + 1, *z.shape))
    if m > l_max:
        return values
    steps = np.arange(1, m + 1)
    norm = np.sqrt(np.prod((2 * steps + 1) / (2 * steps)) / (4 * np.pi))
    values[m] = norm * sine**m
    for l in range(m + 1, l_max + 1):
        scale = np.sqrt((4 * l * l - 1) / (l * l - m * m))
        lag = np.sqrt(((l - 1) ** 2 - m * m) / (4 * (l - 1) ** 2 - 1)) if l > 1 else 0
        values[l] = scale * (z * values[l - 1] - lag * values[l - 2])
    return values


@_cached
def ring_table(grid: Grid, l_max: int) -> np.ndarray:
    """Rows ``P_00 .. P_F0, P_11 .. P_F1`` at the grid's rings, ``(2F + 1, n_theta)``."""
    z, sine = np.cos(grid.theta), np.sin(grid.theta)
    even, odd = legendre(l_max, 0, z, sine), legendre(l_max, 1, z, sine)
    return np.concatenate([even, odd[1:]])


@_cached
def azimuth_tables(n_phi: int, l_max: int) -> tuple[np.ndarray, np.ndarray]:
    """Columns ``az_m(phi)`` for even m and for odd m, ``(n_phi, M)`` each.

    The order of m is that of :func:`azimuthal_orders`.
    """
    phi = np.pi - 2 * np.pi * (np.arange(n_phi) + 0.5) / n_phi

    def columns(parity: int) -> np.ndarray:
        m = azimuthal_orders(l_max, parity)
        angle = np.abs(m) * phi[:, None]
        wave = np.where(m < 0, np.sin(angle), np.cos(angle))
        return wave * np.where(m == 0, 1, np.sqrt(2.0))

    return columns(0), columns(1)


def azimuthal_orders(l_max: int, parity: int) -> np.ndarray:
    """Orders -l_max..l_max that are even (parity 0) or odd (parity 1)."""
    m = np.arange(-l_max, l_max + 1)
    return m[np.abs(m) % 2 == parity]


@_cached
def degree_tables(l_max: int) -> tuple[np.ndarray, np.ndarray]:
    """Matrices from (k, m) to (l, m), ``(M, F + 1, F + 1)`` even and ``(M, F + 1, F)``.

    ``T[m, l, k] = 2 pi int N_lm P_lm N_k0 P_k0 dz`` (``P_k1`` for odd m), exact by
    Gauss-Legendre quadrature on F + 1 nodes.
    """
    z, weights = np.polynomial.legendre.leggauss(l_max + 1)
    sine = np.sqrt((1 - z) * (1 + z))
    by_order = [legendre(l_max, m, z, sine) for m in range(l_max + 1)]

    def convert(parity: int) -> np.ndarray:
        ring = by_order[0] if parity == 0 else legendre(l_max, 1, z, sine)[1:]
        m = azimuthal_orders(l_max, parity)
        tables = [by_order[abs(k)] @ (2 * np.pi * weights * ring).T for k in m]
        return np.stack(tables) if tables else np.zeros((0, l_max + 1, l_max))

    return convert(0), convert(1)


@_cached
def flat_positions(l_max: int) -> np.ndarray:
    """Where each flat coefficient lies among (even m, then odd m) x l, ``(K,)``."""
    ordered = np.concatenate([azimuthal_orders(l_max, 0), azimuthal_orders(l_max, 1)])
    slot = np.argsort(ordered)  # slot[m + l_max]: where order m stands
    return slot[orders(l_max) + l_max] * (l_max + 1) + degrees(l_max)
