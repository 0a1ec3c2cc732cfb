"""Transforms by FFT along phi and Legendre functions scanned over the degree.

Slower than ``theta_first`` up to degree ~128, but nothing grows faster than the map: the
functions of one degree, all orders and rings at once, are all that is held.
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np

from shjax.harmonics import legendre, tables
from shjax.harmonics.degrees import cosine_sine_slots
from shjax.harmonics.grid import Grid

einsum = functools.partial(jnp.einsum, precision=jax.lax.Precision.HIGHEST)


def analyze(radiance: jax.Array, grid: Grid, l_max: int) -> jax.Array:
    """``(n_theta, n_phi, C)`` to ``(K, C)``."""
    dtype, m = radiance.dtype, np.arange(l_max + 1)
    # Orders above n_phi / 2 are the conjugates of lower ones on these columns.
    spectrum = jnp.fft.fft(radiance, axis=1)
    spectrum = jnp.take(spectrum, m % grid.n_phi, axis=1)  # [h, m, c]
    # sum L e^(i m phi): phi falls along the columns, as the transform's exponent does.
    waves = spectrum * jnp.asarray(_phases(grid.n_phi, l_max), spectrum.dtype)
    gains = np.where(m == 0, 1, np.sqrt(2.0))
    if grid.rule.integrates_pixels:
        gains = gains * tables.pixel_gains(grid, m)
    theta, weights = grid.rings(l_max)
    gains = jnp.asarray(gains * weights.reshape(-1, 1), dtype)[:, :, None, None]
    parts = jnp.stack([waves.real, waves.imag], axis=2)  # [h, m, s, c]
    parts = jnp.repeat(parts, theta.shape[1], axis=0) * gains
    theta = theta.ravel()
    seeds = legendre.seeds_of_rings(theta, l_max, l_max, dtype)
    z = legendre.heights_of_rings(theta, dtype)

    def degree(state, step):
        state, values = legendre.next_degree(state, step, z, seeds)
        return state, einsum("mh,hmsc->msc", values, parts)

    steps = legendre.scan_steps(l_max, dtype)
    _, by_degree = jax.lax.scan(degree, legendre.start(seeds), steps)  # [l, m, s, c]
    flat = by_degree.reshape(-1, radiance.shape[-1])
    return jnp.take(flat, cosine_sine_slots(l_max), axis=0)


def synthesize(coefs: jax.Array, grid: Grid, l_max: int) -> jax.Array:
    """``(K, C)`` to ``(n_theta, n_phi, C)``."""
    dtype, channels, m = coefs.dtype, coefs.shape[-1], np.arange(l_max + 1)
    flat = jnp.zeros(((l_max + 1) ** 2 * 2, channels), dtype)
    flat = flat.at[cosine_sine_slots(l_max)].set(coefs, unique_indices=True)
    by_degree = flat.reshape(l_max + 1, l_max + 1, 2, channels)  # [l, m, s, c]
    seeds = legendre.seeds_of_rings(grid.theta, l_max, l_max, dtype)
    z = legendre.heights_of_rings(grid.theta, dtype)

    def degree(carry, inputs):
        state, total = carry
        step, row = inputs
        state, values = legendre.next_degree(state, step, z, seeds)
        return (state, total + einsum("mh,msc->hmsc", values, row)), None

    zero = jnp.zeros((grid.n_theta, l_max + 1, 2, channels), dtype)
    carry = (legendre.start(seeds), zero)
    steps = legendre.scan_steps(l_max, dtype)
    (_, total), _ = jax.lax.scan(degree, carry, (steps, by_degree))
    gains = np.where(m == 0, 1, np.sqrt(2.0))[None, :, None]
    # Re of (cos - i sin) parts times e^(i m phi); the first column's phase; a column
    # cannot tell m from m + n_phi, so the orders are added up over one period.
    waves = jax.lax.complex(total[:, :, 0], -total[:, :, 1])
    waves = waves * jnp.asarray(gains * _phases(grid.n_phi, l_max), waves.dtype)
    period = jnp.zeros((grid.n_theta, grid.n_phi, channels), waves.dtype)
    period = period.at[:, m % grid.n_phi].add(waves)
    # phi falls along the columns: e^(-2 pi i m j / n), the forward transform.
    return jnp.fft.fft(period, axis=1).real


def _phases(n_phi: int, l_max: int) -> np.ndarray:
    """``e^(i m phi_0)`` of the first column, ``(1, m, 1)``: phi_j = phi_0 - 2 pi j / n."""
    first = np.pi - np.pi / n_phi
    return np.exp(1j * np.arange(l_max + 1) * first)[None, :, None]
