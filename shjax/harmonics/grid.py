"""The pixel grid and the quadrature that belongs to it: one type for all of them."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable

import numpy as np

from shjax.sphere import latlong_theta


@dataclasses.dataclass(frozen=True)
class _Rule:
    """How rings are placed and weighted.

    Attributes:
        nodes: ``n`` to polar angles and weights in d(cos theta), each ``(n,)``.
        rows_needed: ``l_max`` to the rows from which products of two harmonics of that
            degree are integrated exactly.
        integrates_pixels: Whether radiance is constant over each pixel, rather than
            known at its centre.
    """

    nodes: Callable[[int], tuple[np.ndarray, np.ndarray]]
    rows_needed: Callable[[int], int]
    integrates_pixels: bool = False


def _fejer(n: int) -> tuple[np.ndarray, np.ndarray]:
    theta = latlong_theta(n)
    k = np.arange(1, n // 2 + 1)
    terms = np.cos(2 * np.outer(theta, k)) @ (1 / (4 * k**2 - 1))
    return theta, (2 / n) * (1 - 2 * terms)


def _gauss_legendre(n: int) -> tuple[np.ndarray, np.ndarray]:
    # Newton in theta from Tricomi's guess: no digits are lost in arccos near the poles.
    theta = np.pi * (np.arange(n) + 0.75) / (n + 0.5)
    for _ in range(6):
        value, slope = _legendre_polynomial(n, theta)
        theta = theta - value / slope
    _, slope = _legendre_polynomial(n, theta)
    return theta, 2 / slope**2


def _legendre_polynomial(n: int, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """P_n(cos theta) and its derivative in theta."""
    z, before, last = np.cos(theta), np.zeros_like(theta), np.ones_like(theta)
    for k in range(1, n + 1):
        before, last = last, ((2 * k - 1) * z * last - (k - 1) * before) / k
    return last, n * (z * last - before) / np.sin(theta)


def _clenshaw_curtis(n: int) -> tuple[np.ndarray, np.ndarray]:
    if n == 1:
        return np.array([np.pi / 2]), np.array([2.0])
    theta = np.pi * np.arange(n) / (n - 1)
    k = np.arange(1, (n - 1) // 2 + 1)
    last = np.where(2 * k == n - 1, 1, 2)  # the highest cosine counts once
    terms = np.cos(2 * np.outer(theta, k)) @ (last / (4 * k**2 - 1))
    weights = (2 / (n - 1)) * (1 - terms)
    weights[[0, -1]] /= 2
    return theta, weights


def _pixel(n: int) -> tuple[np.ndarray, np.ndarray]:
    theta = latlong_theta(n)
    return theta, 2 * np.sin(theta) * np.sin(np.pi / (2 * n))


QUADRATURES = {
    "fejer": _Rule(_fejer, lambda l_max: 2 * l_max + 1),
    "gauss-legendre": _Rule(_gauss_legendre, lambda l_max: l_max + 1),
    "clenshaw-curtis": _Rule(_clenshaw_curtis, lambda l_max: 2 * l_max + 1),
    "pixel": _Rule(_pixel, lambda l_max: 1, integrates_pixels=True),
}


@dataclasses.dataclass(frozen=True)
class Grid:
    """Grid of rings of equally spaced pixels, with its quadrature weights.

    The columns are those of the stored panorama. The rings are, from north to south,

    - ``"fejer"``: the panorama's own rows, Fejer's first rule [Waldvogel 2006, Eq. 2.6];
    - ``"gauss-legendre"``: the roots of P_n;
    - ``"clenshaw-curtis"``: ``theta = pi i / (n_theta - 1)``, both poles included;
    - ``"pixel"``: the panorama's own rows; radiance is constant over each pixel, and the
      harmonics are integrated over it exactly. Works at any size.

    Attributes:
        n_theta: Rows.
        n_phi: Columns.
        quadrature: One of the names above.
    """

    n_theta: int
    n_phi: int
    quadrature: str = "fejer"

    @property
    def rule(self) -> _Rule:
        """Quadrature rule over the rings."""
        return QUADRATURES[self.quadrature]

    @property
    def theta(self) -> np.ndarray:
        """Polar angles of the rows, ``(n_theta,)``, radians."""
        return _nodes(self.quadrature, self.n_theta)[0]

    @property
    def weights(self) -> np.ndarray:
        """Quadrature weight of a pixel in each row, ``(n_theta,)``; they add up to 4 pi."""
        return _nodes(self.quadrature, self.n_theta)[1] * (2 * np.pi / self.n_phi)

    def rings(self, l_max: int) -> tuple[np.ndarray, np.ndarray]:
        """Polar angles and pixel weights at which analysis samples the harmonics.

        One in each row; by the pixel rule several, over which the row's radiance is
        constant: Gauss-Legendre nodes enough for harmonics of degree ``l_max``.

        Returns:
            Angles and weights, each ``(n_theta, q)``.
        """
        if not self.rule.integrates_pixels:
            return self.theta[:, None], self.weights[:, None]
        height = np.pi / self.n_theta
        x, w = np.polynomial.legendre.leggauss(6 + math.ceil((l_max + 1) * height))
        theta = self.theta[:, None] + height / 2 * x
        return theta, np.sin(theta) * w * (height / 2) * (2 * np.pi / self.n_phi)


def make_grid(n_theta: int, n_phi: int, quadrature: str = "fejer") -> Grid:
    """Make a grid of rings and check it.

    Raises:
        ValueError: If a size is not positive or the quadrature unknown.
    """
    if n_theta < 1 or n_phi < 1:
        raise ValueError(f"n_theta, n_phi must be positive; got {n_theta}, {n_phi}.")
    if quadrature not in QUADRATURES:
        known = ", ".join(QUADRATURES)
        raise ValueError(f"quadrature must be one of {known}; got {quadrature!r}.")
    return Grid(n_theta, n_phi, quadrature)


def check_resolution(grid: Grid, l_max: int) -> None:
    """Refuse a grid that is too coarse for a degree.

    Raises:
        ValueError: Naming how many rows and columns are needed.
    """
    rows = grid.rule.rows_needed(l_max)
    columns = 1 if grid.rule.integrates_pixels else 2 * l_max + 1
    if grid.n_theta < rows or grid.n_phi < columns:
        needed = (
            f"2 l_max + 1 = {rows} rows and columns"
            if rows == columns
            else f"{rows} rows and {columns} columns"
        )
        raise ValueError(
            f"radiance must have at least {needed} for l_max={l_max} by "
            f"{grid.quadrature} quadrature; got {grid.n_theta} x {grid.n_phi}. "
            "quadrature='pixel' works at any size, at the accuracy of its pixels."
        )


@functools.lru_cache(maxsize=64)
def _nodes(quadrature: str, n: int) -> tuple[np.ndarray, np.ndarray]:
    theta, weights = QUADRATURES[quadrature].nodes(n)
    theta.setflags(write=False)
    weights.setflags(write=False)
    return theta, weights
