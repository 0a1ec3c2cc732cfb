"""Functions of orientation: ``M_j(a, b) = sum_lm k_lj L_lm D^l_m,q_j(a, b)``.

A light seen in the frame of every direction (a, b), filtered by a kernel for each map:
the heart of reflection maps [T5, Eq. 5.9]. ``D^l(a, b) = Z(b) d^l(a)``, and d^l is a sum
of eigenvectors times cosines or sines of whole multiples of a (``wigner``); so each map is
a Fourier series on a torus, ``sum_km x_km trig(k a) trig(m b)``, whose coefficients cost
``O(F^3)`` and which is summed theta first, then phi [T5, Eq. 5.24].

The maps with q_j != 0 are fields in the frame (e_theta, e_phi) of each direction, and turn
with it: going over a pole they change their sign by ``(-1)^q``.

References:
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from shjax.arrays import einsum, map_blocks
from shjax.harmonics import wigner
from shjax.harmonics.tables import cached
from shjax.sphere import latlong_phi

_MIN_TRANSFORM = 64  # orders from which an FFT is faster than a product
MAX_DEGREE = 128  # above, the eigenvectors of all degrees are too large to hold


@cached
def half_series(l_max: int) -> np.ndarray:
    """Eigenvectors of the frequencies k >= 0: ``(block, l, m, k)``.

    Those of -k differ by the sign of odd m, so that the pair counts once.
    """
    size = l_max + 1
    half = np.zeros((2, size, size, size))
    for l in range(size):
        vectors, frequencies = wigner.eigenvectors(l, size), wigner.frequencies(l, size)
        for block, count in ((0, l + 1), (1, l)):
            for j in range(count):
                k = round(frequencies[block, j])
                if k >= 0:
                    half[block, l, :, k] = vectors[block, :, j]
    return half


def _sign(order: np.ndarray | int) -> np.ndarray:
    """The factor in front of ``i^m`` when it is taken out: 1, 1, -1, -1, ..."""
    return np.where(np.asarray(order) % 4 < 2, 1.0, -1.0)


def series_tables(l_max: int, orders: tuple[int, ...]) -> tuple[np.ndarray, ...]:
    """What :func:`torus_series` multiplies by, for each block and order of its maps.

    ``d_mq(a) = s_m s_q sum_k 2 V_mk V_qk (cos | sin | -sin) k a``: the factors before the
    waves, ``(m, k, l)``.
    """
    half, m = half_series(l_max), np.arange(l_max + 1)
    tables = []
    for block, order, _ in _groups(orders):
        out = half[block] * _sign(m)[:, None]  # [l, m, k]
        into = half[block][:, min(order, l_max)] * _sign(order) * np.where(m == 0, 1, 2)
        into = into * (order <= l_max)  # no degree has higher orders
        if order % 2:
            out = out * np.where(m % 2 == 0, -1, 1)[:, None]
        tables.append((out * into[:, None]).transpose(1, 2, 0))
    return tuple(tables)


def _groups(orders: tuple[int, ...]) -> list[tuple[int, int, np.ndarray]]:
    """Block, |q| and which of the maps, for all that share a table."""
    q = np.array(orders)
    return [
        (block, order, np.flatnonzero((np.abs(q) == order) & ((q < 0) == bool(block))))
        for block in (0, 1)
        for order in sorted({abs(k) for k in orders if (k < 0) == bool(block)})
    ]


def torus_series(
    lighting: jax.Array,
    kernels: jax.Array,
    orders: tuple[int, ...],
    tables: tuple[jax.Array, ...],
) -> jax.Array:
    """Fourier coefficients of all maps.

    Args:
        lighting: ``(K, C)``, to the kernels' degree.
        kernels: ``(F + 1, J, C)``; the lighting's channels.
        orders: Signed q of each map; cosine for q >= 0, sine for q < 0. Static.
        tables: :func:`series_tables` in the kernels' type.

    Returns:
        ``(k, m, t, J, C)``: frequency in a, order in b, (cos, sin) of m b. In a the
        function is ``cos k a`` where m + q is even, ``sin k a`` where it is odd.
    """
    size = kernels.shape[0]
    waves = _by_order(lighting, size)  # [l, m, t, c]
    # For the sines (cos mb, sin mb) go with (L_-m, -L_m).
    turned = (waves, jnp.stack([waves[:, :, 1], -waves[:, :, 0]], axis=2))
    series, places = [], []
    for (block, _, maps), table in zip(_groups(orders), tables, strict=True):
        some = jnp.take(kernels, maps, axis=1)
        lit = einsum("lmtc,ljc->mltjc", turned[block], some)
        series.append(einsum("mkl,mltjc->mktjc", table, lit))
        places.append(maps)
    whole = series[0] if len(series) == 1 else jnp.concatenate(series, axis=3)
    back = np.argsort(np.concatenate(places))
    if np.any(back != np.arange(back.size)):
        whole = jnp.take(whole, back, axis=3)
    return jnp.moveaxis(whole, 0, 1)


def _by_order(lighting: jax.Array, size: int) -> jax.Array:
    """``(K, C)`` to ``(l, m, (cos, sin), C)``, zero where there is no such order."""
    l, m = np.meshgrid(np.arange(size), np.arange(size), indexing="ij")
    centre, outside = l * (l + 1), size * size
    cosine = np.where(m <= l, centre + m, outside)
    sine = np.where((m <= l) & (m > 0), centre - m, outside)
    slots = np.stack([cosine, sine], axis=-1)
    return jnp.take(lighting, slots, axis=0, mode="fill", fill_value=0)


def over_theta(
    series: jax.Array,
    orders: tuple[int, ...],
    cosine: jax.Array,
    sine: jax.Array,
) -> jax.Array:
    """Sum a series over k at polar angles.

    Args:
        series: From :func:`torus_series`.
        orders: As there. Static.
        cosine: ``cos k a``, ``(n, F + 1)``.
        sine: ``sin k a``, the same.

    Returns:
        ``(n, m, t, J, C)``.
    """
    odd_q = np.array(orders) % 2 == 1
    groups, places = [], []
    for parity in (False, True):
        maps = np.flatnonzero(odd_q == parity)
        if not maps.size:
            continue
        some = jnp.take(series, maps, axis=3) if maps.size < len(orders) else series
        wave = (cosine, sine) if not parity else (sine, cosine)
        even = einsum("nk,kmtjc->nmtjc", wave[0], some[:, 0::2])
        odd = einsum("nk,kmtjc->nmtjc", wave[1], some[:, 1::2])
        groups.append(_interleave(even, odd))
        places.append(maps)
    if len(groups) == 1:
        return groups[0]
    back = np.argsort(np.concatenate(places))
    return jnp.take(jnp.concatenate(groups, axis=3), back, axis=3)


def _interleave(even: jax.Array, odd: jax.Array) -> jax.Array:
    """Orders 0, 2, ... and 1, 3, ... back in their order on axis 1."""
    count = even.shape[1] + odd.shape[1]
    if even.shape[1] > odd.shape[1]:
        odd = jnp.pad(odd, [(0, 0), (0, 1), *[(0, 0)] * (odd.ndim - 2)])
    both = jnp.stack([even, odd], axis=2)
    return both.reshape(even.shape[0], -1, *even.shape[2:])[:, :count]


def maps_on_grid(
    lighting: jax.Array,
    kernels: jax.Array,
    orders: tuple[int, ...],
    theta: np.ndarray,
    columns: int,
    tables: tuple[jax.Array, ...],
) -> jax.Array:
    """All maps on rings and a lat-long map's columns: ``(n_theta, n_phi, J, C)``.

    Args:
        lighting: ``(K, C)``.
        kernels: ``(F + 1, J, C)``.
        orders: Signed q of each map. Static.
        theta: Polar angles of the rings, known when tracing.
        columns: How many (:func:`shjax.sphere.latlong_phi`).
        tables: As of :func:`torus_series`.
    """
    size, dtype = kernels.shape[0], kernels.dtype
    series = torus_series(lighting, kernels, orders, tables)
    angle = theta[:, None] * np.arange(size)
    rows = over_theta(
        series, orders, *(jnp.asarray(f(angle), dtype) for f in (np.cos, np.sin))
    )
    maps, channels = len(orders), kernels.shape[-1]
    rows = rows.reshape(theta.size, size, 2, maps * channels)
    around = _by_transform if _MIN_TRANSFORM <= size <= columns // 2 else _by_product
    return around(rows, columns).reshape(theta.size, columns, maps, channels)


def _by_product(rows: jax.Array, columns: int) -> jax.Array:
    """Sum ``(n, m, t, x)`` over m and t at the columns of a map: ``(n, columns, x)``."""
    count, size = rows.shape[:2]
    angle = latlong_phi(columns)[:, None] * np.arange(size)
    waves = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    waves = jnp.asarray(waves.reshape(columns, 2 * size), rows.dtype)
    return einsum("bm,amx->abx", waves, rows.reshape(count, 2 * size, -1))


def _by_transform(rows: jax.Array, columns: int) -> jax.Array:
    """The same by a real FFT: the columns run from pi - pi / n down by 2 pi / n."""
    m = np.arange(rows.shape[1])
    shift = np.exp(-1j * m * latlong_phi(columns)[0])
    shift = shift * np.where(m == 0, 1, 0.5)
    kind = np.result_type(rows.dtype, np.complex64)
    cosine, sine = (jnp.moveaxis(rows[:, :, t], 1, 2) for t in (0, 1))
    shape = cosine.shape
    turned = jnp.broadcast_to(jnp.asarray(shift, kind)[None, None], shape)
    values = jnp.fft.irfft(
        jax.lax.complex(cosine, sine) * turned, n=columns, norm="forward"
    )
    return jnp.moveaxis(values, 2, 1)


_POINTS_AT_ONCE = 256


def maps_at(
    lighting: jax.Array,
    kernels: jax.Array,
    orders: tuple[int, ...],
    theta: jax.Array,
    phi: jax.Array,
    tables: tuple[jax.Array, ...],
) -> jax.Array:
    """All maps at directions of any kind: ``(n, J, C)``; angles are data, ``(n,)``."""
    size, dtype = kernels.shape[0], kernels.dtype
    series = torus_series(lighting, kernels, orders, tables)
    k = np.arange(size)

    def block(angles):
        a, b = angles
        across, up = (jax.vmap(wigner.waves, (0, None))(angle, k) for angle in (b, a))
        rows = over_theta(series, orders, *up)
        return einsum("nmtjc,nmt->njc", rows, jnp.stack(across, axis=-1))

    angles = (theta.astype(dtype), phi.astype(dtype))
    return map_blocks(block, angles, _POINTS_AT_ONCE)
