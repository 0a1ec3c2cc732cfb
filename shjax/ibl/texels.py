"""Reading many maps at once, with a derivative that costs two more readings.

Left to itself, reverse mode keeps every texel that was read, or sums over the channels
once for each texel; both cost many times the value. The tangent rule below is linear in
what the two readings give, and transposes to products.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero


class Weights(NamedTuple):
    """Weights of the maps at each point: ``base + slope f0``; channels in front.

    Attributes:
        base: ``(Q, n)``.
        slope: ``(Q, n)``.
        f0: ``(C, n)``.
    """

    base: jax.Array
    slope: jax.Array
    f0: jax.Array


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def read_maps(
    parity: tuple[int, ...],
    texels: jax.Array,
    places: jax.Array,
    shares: jax.Array,
    weights: Weights,
) -> jax.Array:
    """Read many maps between texels and sum them with weights, ``(C, n)``.

    Args:
        parity: Which shares each map takes. Static.
        texels: ``(Q, T, C)``.
        places: ``(taps, n)``, all within T.
        shares: ``(taps, 2, n)``.
        weights: Of the maps.
    """
    rows = weights.f0.T  # as texels are stored
    total = jnp.zeros_like(rows)
    for which in (0, 1):
        maps = np.flatnonzero(np.array(parity) == which)

        def add(total, k, which=which):
            value = _interpolated(texels, k, places, shares[:, which])
            return total + value * _by_row(weights, k, rows), None

        total = jax.lax.scan(add, total, jnp.asarray(maps, jnp.int32))[0]
    return total.T


def _by_row(weights: Weights, k, rows: jax.Array) -> jax.Array:
    slope = jnp.broadcast_to(weights.slope[k][:, None], rows.shape)
    return weights.base[k][:, None] + slope * rows


def _interpolated(texels, k, places, shares) -> jax.Array:
    """One map between its texels, ``(n, C)``."""
    taps = [
        texels.at[k, place].get(mode="promise_in_bounds") * share[:, None]
        for place, share in zip(places, shares, strict=True)
    ]
    return functools.reduce(jnp.add, taps)


def _by_map(parity, texels, places, shares) -> jax.Array:
    """What each map gives, ``(Q, C, n)``."""
    chosen = jnp.asarray(parity, jnp.int32)

    def one(_, k):
        return None, _interpolated(texels, k, places, shares[:, chosen[k]]).T

    return jax.lax.scan(one, None, jnp.arange(len(parity), dtype=jnp.int32))[1]


def _by_tap(parity, texels, places, weights: Weights) -> jax.Array:
    """What each texel about a point gives, for either kind of shares: ``(t, 2, C, n)``."""
    rows = weights.f0.T
    sums = []
    for which in (0, 1):
        maps = np.flatnonzero(np.array(parity) == which)

        def add(total, k):
            row = _by_row(weights, k, rows)
            return tuple(
                so_far + texels.at[k, place].get(mode="promise_in_bounds") * row
                for so_far, place in zip(total, places, strict=True)
            ), None

        start = (jnp.zeros_like(rows),) * places.shape[0]
        total = jax.lax.scan(add, start, jnp.asarray(maps, jnp.int32))[0]
        sums.append(jnp.stack([one.T for one in total]))
    return jnp.stack(sums, axis=1)


def _contracted(gains: jax.Array, change: jax.Array) -> jax.Array:
    """``sum_k gains_kc change_k``, ``(C, n)``.

    Channel by channel: the transpose then adds three products, where a sum over a
    broadcast axis is many times slower on a CPU.
    """
    axes = tuple(range(change.ndim - 1))
    return jnp.stack(
        [jnp.sum(gains[..., c, :] * change, axis=axes) for c in range(gains.shape[-2])]
    )


def _tangent(parity, primals, tangents):
    texels, places, shares, weights = primals
    d_texels, _, d_shares, d_weights = tangents
    value = read_maps(parity, texels, places, shares, weights)
    tangent = jnp.zeros_like(value)
    if not isinstance(d_texels, SymbolicZero):
        tangent = tangent + read_maps(parity, d_texels, places, shares, weights)
    if not isinstance(d_shares, SymbolicZero):
        gains = _by_tap(parity, texels, places, weights)
        tangent = tangent + _contracted(gains, d_shares)
    if not all(isinstance(d, SymbolicZero) for d in d_weights):
        gains = _by_map(parity, texels, places, shares)
        if not isinstance(d_weights.base, SymbolicZero):
            tangent = tangent + _contracted(gains, d_weights.base)
        if not isinstance(d_weights.slope, SymbolicZero):
            tangent = tangent + _contracted(gains, d_weights.slope) * weights.f0
        if not isinstance(d_weights.f0, SymbolicZero):
            tangent = tangent + _contracted(gains, weights.slope) * d_weights.f0
    return value, tangent


read_maps.defjvp(_tangent, symbolic_zeros=True)
