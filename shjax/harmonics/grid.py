"""The pixel grid and the quadrature that belongs to it."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np

from shjax.sphere import latlong_theta


@dataclasses.dataclass(frozen=True)
class Grid:
    """Rings of equally spaced pixels: the lat-long panorama as it is stored.

    Attributes:
        n_theta: Rows.
        n_phi: Columns.
    """

    n_theta: int
    n_phi: int

    @property
    def theta(self) -> np.ndarray:
        """Polar angles of the rows, ``(n_theta,)``."""
        return latlong_theta(self.n_theta)

    @property
    def weights(self) -> np.ndarray:
        """Weight of a pixel in each row, ``(n_theta,)``; all pixels add up to 4 pi."""
        return fejer_weights(self.n_theta) * (2 * np.pi / self.n_phi)


@functools.lru_cache(maxsize=64)
def fejer_weights(n: int) -> np.ndarray:
    """Fejer's first rule on ``theta = pi (i + 1/2) / n``, ``(n,)``; the sum is 2.

    Integrates polynomials in cos(theta) of degree < n over [-1, 1] exactly, where
    sin(theta) d theta is off by O(1/n^2) [Waldvogel 2006, Eq. 2.6].

    >>> fejer_weights(3).round(6).tolist()
    [0.444444, 1.111111, 0.444444]
    """
    theta = latlong_theta(n)
    k = np.arange(1, n // 2 + 1)
    weights = (2 / n) * (1 - 2 * np.cos(2 * np.outer(theta, k)) @ (1 / (4 * k**2 - 1)))
    weights.setflags(write=False)
    return weights
