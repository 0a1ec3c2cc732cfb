"""Normalised associated Legendre functions ``N_lm P_lm`` without Condon-Shortley phase.

Three-term recurrence in the degree, upwards, which is stable:
``P_l = a_lm (z P_(l-1) - b_lm P_(l-2))`` from ``P_mm = c_m sin^m t``; once for tables
(NumPy, float64) and once for a scan over the degree (JAX, any type).

The seeds underflow near the poles long before the functions do: ``sin^m t`` leaves
float32 at m = 38 for sin t = 0.1. From its seed ``P_lm`` may grow by
``sqrt(C(l + m, 2 m))``: 1e25 at l = 128, so that a seed lost to float32 (1e-38) never
mattered; 1e214 at l = 1024, where it does. Above l = 128 the float32 recurrence therefore
carries a power of 2^64 beside each value; float64 (1e-308) needs none.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

_SCALE = 2.0**64
_SAFE_IN_FLOAT32 = 128
_NEAR_POLE = 0.7  # in cos t; from 0.5 on, z - 1 is exact


def step_coefs(l: np.ndarray | int, m: np.ndarray | int) -> tuple:
    """Recurrence factors ``a_lm`` and ``b_lm`` to degree l > m; 0 elsewhere."""
    wide = np.longdouble  # differences of these factors are taken, and lose digits
    l, m = np.broadcast_arrays(np.asarray(l, wide), np.asarray(m, wide))
    above = l > m
    l, m = np.where(above, l, 1), np.where(above, m, 0)
    scale = np.sqrt((4 * l * l - 1) / (l * l - m * m))
    lag = np.sqrt(((l - 1) ** 2 - m * m).clip(0) / np.abs(4 * (l - 1) ** 2 - 1))
    return np.where(above, scale, 0), np.where(above, lag, 0)


def seed_norms(m_max: int) -> np.ndarray:
    """``c_m`` in ``N_mm P_mm = c_m sin^m t``, ``(m_max + 1,)``."""
    m = np.arange(1, m_max + 1)
    factors = np.concatenate([[1.0], np.sqrt((2 * m + 1) / (2 * m))])
    return np.cumprod(factors) / np.sqrt(4 * np.pi)


def legendre(l_max: int, m: int, z: np.ndarray, sine: np.ndarray) -> np.ndarray:
    """Associated Legendre functions of one order and all degrees, float64.

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
    values[m] = seed_norms(m)[m] * sine**m
    scales, lags = (k.astype(float) for k in step_coefs(np.arange(l_max + 1), m))
    for l in range(m + 1, l_max + 1):
        values[l] = scales[l] * (z * values[l - 1] - lags[l] * values[l - 2])
    return values


class Seeds(NamedTuple):
    """Seeds ``P_mm`` of the recurrence, ``value * 2^(64 power)``, each ``(m, n)``."""

    value: jax.Array
    power: jax.Array | None


class State(NamedTuple):
    """State of the recurrence: a degree of all orders, the one before, their power.

    ``before`` is the degree below, or near the poles the difference to it.
    """

    last: jax.Array
    before: jax.Array
    power: jax.Array | None


class Heights(NamedTuple):
    """Heights cos t of points, ``(1, n)``, as the recurrence takes them.

    The recurrence runs on the northern hemisphere; ``P_lm(-z) = (-1)^(l + m) P_lm(z)``.

    Attributes:
        absolute: ``|cos t|``.
        rest: What rounding left out of it.
        fall: ``|cos t| - 1``.
        south: Whether cos t < 0.
        near_pole: Where the recurrence for differences is used.
    """

    absolute: jax.Array
    rest: jax.Array
    fall: jax.Array
    south: jax.Array
    near_pole: jax.Array


def heights_of_points(z: jax.Array) -> Heights:
    """Heights as given, ``(n,)``; differentiable on the equator too."""
    south = (z < 0)[None]
    absolute = z[None] * jnp.where(south, -1, 1).astype(z.dtype)
    near = absolute > _NEAR_POLE
    return Heights(absolute, jnp.zeros_like(absolute), absolute - 1, south, near)


def heights_of_rings(theta: np.ndarray, dtype) -> Heights:
    """Heights of known polar angles, ``(n,)``, to more digits than the type holds."""
    exact = np.abs(np.cos(theta))[None]
    rounded = exact.astype(dtype)
    fall = -2 * np.sin(np.minimum(theta, np.pi - theta) / 2)[None] ** 2
    return Heights(
        jnp.asarray(rounded),
        jnp.asarray(exact - rounded, dtype),
        jnp.asarray(fall, dtype),
        jnp.asarray((theta > np.pi / 2)[None]),
        jnp.asarray(exact > _NEAR_POLE),
    )


def carries_power(l_max: int, dtype) -> bool:
    """Whether the recurrence to this degree leaves the range of the type."""
    return l_max > _SAFE_IN_FLOAT32 and jnp.finfo(dtype).bits < 64


def start(seeds: Seeds) -> State:
    """State of the recurrence before degree 0."""
    nothing = jnp.zeros_like(seeds.value)
    return State(nothing, nothing, seeds.power)


class Step(NamedTuple):
    """Factors of one step of the recurrence, ``(m, 1)`` each, or with l in front."""

    scale: jax.Array
    lag: jax.Array
    product: jax.Array
    excess: jax.Array
    born: jax.Array
    odd: jax.Array


def scan_steps(l_max: int, dtype, m_max: int | None = None) -> Step:
    """Factors of all steps for a scan over degrees, ``(l, m, 1)`` each."""
    m_max = l_max if m_max is None else m_max
    degree, order = np.arange(l_max + 1)[:, None], np.arange(m_max + 1)
    scale, lag = step_coefs(degree, order)
    product = scale * lag
    born = np.eye(l_max + 1, m_max + 1)
    tables = (scale, lag, product, scale - product - 1, born)
    return Step(
        *(jnp.asarray(table[..., None].astype(float), dtype) for table in tables),
        odd=jnp.asarray(((degree - order) % 2 == 1)[..., None]),
    )


def next_degree(
    state: State, step: Step, z: Heights, seeds: Seeds
) -> tuple[State, jax.Array]:
    """Step the recurrence one degree up.

    Near a pole consecutive degrees hardly differ, and the plain recurrence loses digits
    as l^2; there the difference ``d_l = a b d_(l-1) + (a (z - 1) + (a - a b - 1)) P_(l-1)``
    is carried instead [Reinsch; see Gautschi 1967], in which z - 1 is exact.

    Args:
        state: What stands below.
        step: This degree's row of :func:`scan_steps`.
        z: Where.
        seeds: Where each order starts.

    Returns:
        The new state, and ``N_lm P_lm`` of all orders, ``(m, n)``, zero for m > l.
    """
    last, before = state.last, state.before
    difference = step.product * before + (step.scale * z.fall + step.excess) * last
    plain = step.scale * (z.absolute * last + (z.rest * last - step.lag * before))
    near = jnp.broadcast_to(z.near_pole, last.shape)
    value = jnp.where(near, last + difference, plain) + step.born * seeds.value
    before = jnp.where(near, difference, last)
    flip = jnp.broadcast_to(z.south, last.shape) & jnp.broadcast_to(
        step.odd, last.shape
    )
    if state.power is None:
        return State(value, before, None), jnp.where(flip, -value, value)
    grown = jnp.abs(value) > _SCALE**0.5
    shrink = jnp.where(grown, 1 / _SCALE, 1).astype(value.dtype)
    power = state.power + grown.astype(state.power.dtype)
    new = State(value * shrink, before * shrink, power)
    # Values below 2^-96 or so of their maximum do not count.
    actual = jnp.where(power == 0, new.last, new.last / _SCALE)
    actual = jnp.where(power < -1, 0, actual)
    return new, jnp.where(flip, -actual, actual)


def seeds_of_rings(theta: np.ndarray, l_max: int, m_max: int, dtype) -> Seeds:
    """``P_mm`` of the orders to ``m_max`` at known polar angles, ``(m, n)``."""
    m = np.arange(m_max + 1)[:, None]
    sine, norms = np.sin(theta), seed_norms(m_max)[:, None]
    if not carries_power(l_max, dtype):
        return Seeds(jnp.asarray(norms * sine**m, dtype), None)
    tiny = 1e-300  # the ring of a pole itself
    log = np.log2(norms) + m * np.log2(np.maximum(sine, tiny))
    power = np.minimum(np.ceil(log / 64), 0)
    value = jnp.asarray(np.exp2(log - 64 * power), dtype)
    return Seeds(value, jnp.asarray(power, jnp.int32))


def rescale_up(value: jax.Array, power: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Keep a shrinking pair ``(2, n)`` in range: at most one step of 2^64.

    The factor is a constant wherever it is differentiated, and so is exact.
    """
    small = jnp.max(jnp.abs(value), axis=0) < 1 / _SCALE**0.5
    grow = jnp.where(small, _SCALE, 1).astype(value.dtype)
    return value * grow[None], power - small.astype(power.dtype)
