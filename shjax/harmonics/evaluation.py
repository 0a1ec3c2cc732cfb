"""Harmonics at given directions, from Cartesian components: no angles, no poles.

``Y_lm = Q_lm(z) Re or Im (x + i y)^|m|`` with ``Q_lm = N_lm P_lm / sin^m``, a polynomial
in z; so values and derivatives of any order are finite everywhere. The expressions are
also defined off the unit sphere (``3 z^2 - 1`` stays as it is, as in [RH01, Eq. 3]).

Up to degree 8 the sum is one fused polynomial that never stores the basis; above, a scan
over the degree on blocks of points, which compiles in the same time for any degree.

References:
    [RH01] R. Ramamoorthi and P. Hanrahan, An Efficient Representation for Irradiance
    Environment Maps, SIGGRAPH 2001.
    [T4] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 4.
"""

from __future__ import annotations

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array, as_float, check_vectors, einsum, map_blocks, matmul
from shjax.harmonics import legendre
from shjax.harmonics.degrees import check_l_max, cosine_sine_slots, degree_of_coefs

_UNROLLED_TO = 8
_BLOCK = 2048  # points at a time in the scan
_IN_CACHE = 512  # points whose recurrence stays in the second-level cache


@functools.partial(jax.jit, static_argnames=("l_max",))
def basis(
    directions: Float[Array, "*batch 3"], *, l_max: int
) -> Float[jax.Array, "*batch K"]:
    """Real spherical harmonics up to ``l_max`` at directions [T4, Eq. 4.5].

    Args:
        directions: Unit vectors.
        l_max: Highest degree, inclusive. Static.

    Returns:
        ``(..., (l_max + 1)^2)``, steradian^-1/2.

    Raises:
        ValueError: If the last axis of ``directions`` is not 3.

    >>> [f"{y:.6f}" for y in basis(jnp.array([0.0, 0.0, 1.0]), l_max=1)]
    ['0.282095', '0.000000', '0.488603', '0.000000']
    """
    check_vectors("directions", directions)
    l_max = check_l_max(l_max)
    directions = as_float("directions", directions)
    points = directions.reshape(-1, 3)
    if l_max <= _UNROLLED_TO:
        by_order = {(l, m): value for l, m, value in _harmonics(points, l_max)}
        values = jnp.stack([by_order[key] for key in sorted(by_order)], axis=-1)
    else:
        values = _scanned_basis(points, l_max)
    return values.reshape(*directions.shape[:-1], (l_max + 1) ** 2)


def evaluate(
    coefs: Float[Array, "*batch K C"], directions: Float[Array, "*points 3"]
) -> Float[jax.Array, "*batch_points C"]:
    """Evaluate a spherical harmonic expansion at directions: ``sum_lm c_lm Y_lm(d)``.

    Args:
        coefs: Coefficients, ``(*batch, K, C)``.
        directions: Unit vectors, ``(*points, 3)``, the same for the whole batch; use
            ``jax.vmap`` for directions of each item's own.

    Returns:
        ``(*batch, *points, C)``, in the coefficients' type.

    Raises:
        ValueError: If a shape is wrong.
    """
    l_max = degree_of_coefs(coefs)
    check_vectors("directions", directions)
    return _evaluate(
        as_float("coefs", coefs), as_float("directions", directions), l_max=l_max
    )


@functools.partial(jax.jit, static_argnames=("l_max",))
def _evaluate(coefs: jax.Array, directions: jax.Array, *, l_max: int) -> jax.Array:
    points = directions.reshape(-1, 3).astype(coefs.dtype)
    # The batch joins the channels: the functions are computed once for all.
    batch, channels = coefs.shape[:-2], coefs.shape[-1]
    columns = jnp.moveaxis(coefs, -2, 0).reshape(coefs.shape[-2], -1)
    values = _sum_at(columns, points, l_max)
    values = values.reshape(points.shape[0], *batch, channels)
    values = jnp.moveaxis(values, 0, -2)
    return values.reshape(*batch, *directions.shape[:-1], channels)


def _sum_at(columns: jax.Array, points: jax.Array, l_max: int) -> jax.Array:
    """``(K, C)`` and ``(N, 3)`` to ``(N, C)``."""
    if l_max > _UNROLLED_TO or columns.shape[1] > 16:
        return _scanned_sum(columns, points, l_max)
    return _fused_sum(columns, points)


def _harmonics(points: jax.Array, l_max: int):
    """Yield ``(l, m, Y_lm(points))``, order by order, as unrolled polynomials."""
    x, y, z = points[:, 0], points[:, 1], points[:, 2]
    norms = legendre.seed_norms(l_max)
    cosine, sine = jnp.ones_like(z), jnp.zeros_like(z)  # (x + i y)^m
    for m in range(l_max + 1):
        if m:
            cosine, sine = x * cosine - y * sine, x * sine + y * cosine
        norm = float(norms[m]) * (math.sqrt(2) if m else 1)
        last, value = jnp.zeros_like(z), jnp.full_like(z, norm)
        for l in range(m, l_max + 1):
            if l > m:
                scale, lag = (float(k) for k in legendre.step_coefs(l, m))
                last, value = value, scale * (z * value - lag * last)
            yield l, m, value * cosine
            if m:
                yield l, -m, value * sine


@jax.custom_jvp
def _fused_sum(columns: jax.Array, points: jax.Array) -> jax.Array:
    l_max = math.isqrt(columns.shape[0]) - 1
    total = jnp.zeros((points.shape[0], columns.shape[1]), columns.dtype)
    for l, m, value in _harmonics(points, l_max):
        total = total + value[:, None] * columns[l * (l + 1) + m][None]
    return total


def _fused_sum_jvp(primals, tangents):
    """The sum is linear in the coefficients: a product there, which also transposes well.

    Left to autodiff, the transpose of the fused sum is one reduction over all points for
    each coefficient, slow to compile and to run.
    """
    columns, points = primals
    l_max = math.isqrt(columns.shape[0]) - 1
    value = _fused_sum(columns, points)
    total = jnp.zeros_like(value)
    column_tangents, point_tangents = tangents
    if not isinstance(column_tangents, jax.custom_derivatives.SymbolicZero):
        total = total + matmul(basis(points, l_max=l_max), column_tangents)
    if not isinstance(point_tangents, jax.custom_derivatives.SymbolicZero):
        plain = functools.partial(_fused_sum.fun, columns)
        total = total + jax.jvp(plain, (points,), (point_tangents,))[1]
    return value, total


_fused_sum.defjvp(_fused_sum_jvp, symbolic_zeros=True)


def _scanned_sum(columns: jax.Array, points: jax.Array, l_max: int) -> jax.Array:
    slots = cosine_sine_slots(l_max)
    rows = jnp.zeros(((l_max + 1) ** 2 * 2, columns.shape[1]), columns.dtype)
    rows = rows.at[slots].set(columns, unique_indices=True)
    rows = rows.reshape(l_max + 1, l_max + 1, 2, columns.shape[1])

    @jax.checkpoint  # the gradient recomputes the functions of a block
    def block(some):
        start, step = _recurrence(some, l_max)

        def degree(carry, inputs):
            state, total = carry
            tables, row = inputs
            state, values = step(state, tables)  # [m, s, n]
            product = einsum("msn,msc->nc", values, row)
            return (state, total + product), None

        zero = jnp.zeros((some.shape[0], columns.shape[1]), columns.dtype)
        tables = legendre.scan_steps(l_max, columns.dtype)
        return jax.lax.scan(degree, (start, zero), (tables, rows))[0][1]

    return map_blocks(block, points, _BLOCK)


def some_harmonics(points: jax.Array, l_max: int, which: np.ndarray) -> jax.Array:
    """Values of some harmonics at unit vectors ``(N, 3)``, by position in K: ``(N, J)``."""
    slots = cosine_sine_slots(l_max)[which]
    some = functools.partial(_scanned_basis, l_max=l_max, slots=slots)
    return map_blocks(some, points, _IN_CACHE)


def _scanned_basis(
    points: jax.Array, l_max: int, slots: np.ndarray | None = None
) -> jax.Array:
    """``(N, 3)`` to ``(N, K)``, or to the harmonics in some slots."""
    if slots is None:
        slots = cosine_sine_slots(l_max)
    start, step = _recurrence(points, l_max)
    tables = legendre.scan_steps(l_max, points.dtype)
    _, values = jax.lax.scan(step, start, tables)  # [l, m, s, n]
    rows = math.prod(values.shape[:3])
    return jnp.take(values.reshape(rows, points.shape[0]), slots, axis=0).T


def _recurrence(points: jax.Array, l_max: int):
    """Start and step of a scan over the degree that gives ``Y_lm`` as ``(m, 2, n)``."""
    n = points.shape[0]
    seeds = _seeds(points, l_max)
    z = legendre.heights_of_points(jnp.tile(points[:, 2], 2))

    def step(state, tables):
        state, values = legendre.next_degree(state, tables, z, seeds)
        return state, values.reshape(l_max + 1, 2, n)

    return legendre.start(seeds), step


def _seeds(points: jax.Array, l_max: int) -> legendre.Seeds:
    """``c_m sqrt2 (x + i y)^m`` for all m, real parts then imaginary ones: ``(m, 2 n)``.

    Built by multiplication, not from angles, so that it differentiates at the poles.
    """
    dtype = points.dtype
    norms = legendre.seed_norms(l_max) * np.where(np.arange(l_max + 1), np.sqrt(2), 1)
    ratios = jnp.asarray(norms[1:] / norms[:-1], dtype)
    x, y = points[:, 0], points[:, 1]
    powers = legendre.carries_power(l_max, dtype)

    def multiply(carry, ratio):
        (cosine, sine), power = carry
        cosine, sine = x * cosine - y * sine, x * sine + y * cosine
        value = jnp.stack([cosine, sine]) * ratio
        if powers:
            value, power = legendre.rescale_up(value, power)
        return (value, power), (value, power)

    first = jnp.stack([jnp.ones_like(x), jnp.zeros_like(x)]) * float(norms[0])
    power = jnp.zeros(x.shape, jnp.int32) if powers else None
    _, (values, more) = jax.lax.scan(multiply, (first, power), ratios)
    values = jnp.concatenate([first[None], values]).reshape(l_max + 1, -1)
    if power is None:
        return legendre.Seeds(values, None)
    all_powers = jnp.concatenate([power[None], more])
    return legendre.Seeds(values, jnp.tile(all_powers, (1, 2)))
