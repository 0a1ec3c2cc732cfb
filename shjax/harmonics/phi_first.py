"""Transforms by FFT along phi and Legendre functions scanned over the degree.

Slower than ``theta_first`` up to degree ~128, but nothing grows faster than the map: the
functions of one degree, all orders and rings at once, are all that is held.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from shjax.arrays import einsum
from shjax.harmonics import legendre, tables
from shjax.harmonics.degrees import cosine_sine_slots
from shjax.harmonics.grid import Grid


class Tables(NamedTuple):
    """Tables of a transform, in its data's type.

    Attributes:
        gains: Of the orders, with the rings' weights in analysis, ``(H | 1, F + 1)``.
        phases: Of the first column, ``(1, F + 1, 1)``.
        seeds: Of the Legendre functions (:func:`.legendre.seeds_of_rings`).
        heights: Of the rings (:func:`.legendre.heights_of_rings`).
        steps: From degree to degree (:func:`.legendre.scan_steps`).
    """

    gains: jax.Array
    phases: jax.Array
    seeds: Any
    heights: Any
    steps: Any


@functools.lru_cache(maxsize=4)  # they may be large
def analysis_tables(grid: Grid, l_max: int, dtype) -> Tables:
    """Tables of :func:`analyze` for a grid and a degree."""
    m = np.arange(l_max + 1)
    theta, weights = grid.rings(l_max)
    gains = weights.reshape(-1, 1) * _gains(m)
    if grid.rule.integrates_pixels:
        gains = gains * tables.pixel_gains(grid, m)
    return _tables(gains, theta.ravel(), grid.n_phi, dtype)


@functools.lru_cache(maxsize=4)  # they may be large
def synthesis_tables(grid: Grid, l_max: int, dtype) -> Tables:
    """Tables of :func:`synthesize` for a grid and a degree."""
    return _tables(_gains(np.arange(l_max + 1))[None], grid.theta, grid.n_phi, dtype)


def _gains(m: np.ndarray) -> np.ndarray:
    return np.where(m == 0, 1, np.sqrt(2.0))


def _tables(gains: np.ndarray, theta: np.ndarray, n_phi: int, dtype) -> Tables:
    l_max = gains.shape[1] - 1
    with jax.ensure_compile_time_eval():  # inside a trace, too, the arrays are known
        return Tables(
            jnp.asarray(gains, dtype),
            jnp.asarray(_phases(n_phi, l_max), np.result_type(dtype, np.complex64)),
            legendre.seeds_of_rings(theta, l_max, l_max, dtype),
            legendre.heights_of_rings(theta, dtype),
            legendre.scan_steps(l_max, dtype),
        )


def analyze(radiance: jax.Array, by: Tables, *, grid: Grid, l_max: int) -> jax.Array:
    """Analyze a panorama ``(n_theta, n_phi, C)``: coefficients ``(K, C)``."""
    m = np.arange(l_max + 1)
    # Orders above n_phi / 2 are the conjugates of lower ones on these columns.
    spectrum = jnp.fft.fft(radiance, axis=1)
    spectrum = jnp.take(spectrum, m % grid.n_phi, axis=1)  # [h, m, c]
    # sum L e^(i m phi): phi falls along the columns, as the transform's exponent does.
    waves = spectrum * by.phases
    parts = jnp.stack([waves.real, waves.imag], axis=2)  # [h, m, s, c]
    in_each = by.gains.shape[0] // grid.n_theta
    parts = jnp.repeat(parts, in_each, axis=0) * by.gains[:, :, None, None]

    def degree(state, step):
        state, values = legendre.next_degree(state, step, by.heights, by.seeds)
        return state, einsum("mh,hmsc->msc", values, parts)

    start = legendre.start(by.seeds)
    _, by_degree = jax.lax.scan(degree, start, by.steps)  # [l, m, s, c]
    flat = by_degree.reshape(-1, radiance.shape[-1])
    return jnp.take(flat, cosine_sine_slots(l_max), axis=0)


def synthesize(coefs: jax.Array, by: Tables, *, grid: Grid, l_max: int) -> jax.Array:
    """Synthesize a panorama ``(n_theta, n_phi, C)`` from coefficients ``(K, C)``."""
    dtype, channels, m = coefs.dtype, coefs.shape[-1], np.arange(l_max + 1)
    flat = jnp.zeros(((l_max + 1) ** 2 * 2, channels), dtype)
    flat = flat.at[cosine_sine_slots(l_max)].set(coefs, unique_indices=True)
    by_degree = flat.reshape(l_max + 1, l_max + 1, 2, channels)  # [l, m, s, c]

    def degree(carry, inputs):
        state, total = carry
        step, row = inputs
        state, values = legendre.next_degree(state, step, by.heights, by.seeds)
        return (state, total + einsum("mh,msc->hmsc", values, row)), None

    zero = jnp.zeros((grid.n_theta, l_max + 1, 2, channels), dtype)
    carry = (legendre.start(by.seeds), zero)
    (_, total), _ = jax.lax.scan(degree, carry, (by.steps, by_degree))
    # Re of (cos - i sin) parts times e^(i m phi); the first column's phase; a column
    # cannot tell m from m + n_phi, so the orders are added up over one period.
    waves = jax.lax.complex(total[:, :, 0], -total[:, :, 1])
    waves = waves * (by.phases * by.gains[..., None].astype(by.phases.dtype))
    period = jnp.zeros((grid.n_theta, grid.n_phi, channels), waves.dtype)
    period = period.at[:, m % grid.n_phi].add(waves)
    # phi falls along the columns: e^(-2 pi i m j / n), the forward transform.
    return jnp.fft.fft(period, axis=1).real


def _phases(n_phi: int, l_max: int) -> np.ndarray:
    """``e^(i m phi_0)`` of the first column, ``(1, m, 1)``: phi_j = phi_0 - 2 pi j / n."""
    first = np.pi - np.pi / n_phi
    return np.exp(1j * np.arange(l_max + 1) * first)[None, :, None]
