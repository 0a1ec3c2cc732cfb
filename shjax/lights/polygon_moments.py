"""Axial moments of polygons by recurrence, and coefficients from them at many points.

``S_l(z) = integral of P_l(w . z)`` over a spherical polygon needs a handful of operations
for each edge and degree. The coefficients of one degree follow from the moments about
``2 l + 1`` axes or more; and a lobe that is radial about R needs the moments about R alone.

References:
    [WR18] J. Wang and R. Ramamoorthi, Analytic Spherical Harmonic Coefficients for
    Polygonal Area Lights, ACM TOG 37 (4), 2018.
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np

from shjax.arrays import einsum
from shjax.harmonics.legendre import legendre
from shjax.lights.outlines import Outline, great_arcs, solid_angle

MAX_DEGREE = 16  # beyond it, moments about few axes lose too many digits


def moments(outline: Outline, axes: jax.Array, l_max: int) -> jax.Array:
    """Integrals of ``P_l(w . z)`` over a polygon, about axes ``(D, 3)``: ``(L, D)``.

    Edge by edge, C_k and D_k are the integrals of P_k and its derivative along it [WR18].
    """
    arcs = great_arcs(outline.edges)
    a, b, c = (
        einsum("ei,di->ed", one, axes) for one in (arcs.start, arcs.along, arcs.inward)
    )
    g = jnp.broadcast_to(arcs.length[:, None], a.shape)
    cosine, sine = jnp.cos(g), jnp.sin(g)
    last = a * cosine + b * sine
    slope, short = a * sine - b * cosine, a * a + b * b - 1

    def degree(carry, k):
        (p0, q0), (p1, q1), (c1, c2), (d1, d2), (s1, s2) = carry  # of k - 1 and k - 2
        s = (2 * k - 1) * jnp.sum(c * c1, axis=0) + (k - 2) * (k - 1) * s2
        s = s / (k * (k + 1))
        inner = slope * p1 + b * p0 + short * d1 + (k - 1) * c2
        line = ((2 * k - 1) / k * inner - (k - 1) * c2) / k
        ends = (
            (((2 * k - 1) * x * p - (k - 1) * q) / k, p)
            for x, p, q in ((a, p0, q0), (last, p1, q1))
        )
        return (*ends, (line, c1), ((2 * k - 1) * c1 + d2, d1), (s, s1)), s

    one, none = jnp.ones_like(a), jnp.zeros_like(a)
    zeroth = jnp.broadcast_to(solid_angle(outline)[None], axes.shape[:1])
    first = jnp.sum(c * g, axis=0) / 2
    start = (
        (a, one),
        (last, one),
        (a * sine + b * (1 - cosine), g),
        (g, none),
        (first, zeroth),
    )
    k = jnp.arange(2, l_max + 1).astype(a.dtype)
    rest = jax.lax.scan(degree, start, k)[1]
    return jnp.concatenate([zeroth[None], first[None], rest])[: l_max + 1]


def coefs(outline: Outline, l_max: int) -> jax.Array:
    """Coefficients of a polygon of unit radiance by its moments, ``(K,)``."""
    axes, solvers = _axes(l_max)
    values = moments(outline, jnp.asarray(axes, outline.inside.dtype), l_max)
    return jnp.concatenate(
        [
            einsum("md,d->m", jnp.asarray(solvers[l], values.dtype), values[l])
            for l in range(l_max + 1)
        ]
    )


@functools.lru_cache(maxsize=32)
def _axes(l_max: int) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """Axes ``(D, 3)``, and for each degree what takes moments about them to coefficients.

    On half the sphere, since an axis and its opposite say the same; half as many again as
    the highest degree needs, which keeps every condition number below 9.
    """
    count = 3 * l_max + 1
    z = (np.arange(count) + 0.5) / count
    across, phi = np.sqrt(1 - z * z), np.pi * (3 - np.sqrt(5)) * np.arange(count)
    rows = np.zeros((count, l_max + 1, 2 * l_max + 1))
    for m in range(l_max + 1):
        values = legendre(l_max, m, z, across).T * (np.sqrt(2) if m else 1)
        rows[:, :, l_max + m] = values * np.cos(m * phi)[:, None]
        if m:
            rows[:, :, l_max - m] = values * np.sin(m * phi)[:, None]
    own = [rows[:, l, l_max - l : l_max + l + 1] for l in range(l_max + 1)]
    solvers = tuple(
        (2 * l + 1) / (4 * np.pi) * np.linalg.pinv(a) for l, a in enumerate(own)
    )
    return np.stack([across * np.cos(phi), across * np.sin(phi), z], axis=-1), solvers
