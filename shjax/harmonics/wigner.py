"""Wigner d: the rotation about y in the real basis, by eigenvectors of its generator.

In the real basis the rotation about y leaves cosines (m = 0..l) and sines (m = 1..l)
apart. In each block its generator is tridiagonal and antisymmetric; with the factors
``i^m`` taken out it is ``i S`` with S real and symmetric, whose eigenvalues are whole
numbers (l, l - 2, ... for cosines, l - 1, l - 3, ... for sines) and whose orthonormal
eigenvectors V do not depend on the angle. So ``d(a) = V exp(i a k) V^T`` with plain
cosines and sines of ``k a``: 1e-14 at any angle, where the usual recurrences lose digits
near pi [F15]; the matrices are those of [T5, section 5.2].

References:
    [F15] X. M. Feng, P. Wang, W. Yang, G. R. Jin, High-precision evaluation of Wigner's d
    matrix by exact diagonalization, Physical Review E 92, 043307, 2015.
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array, as_float, einsum, in_blocks
from shjax.harmonics.degrees import check_l_max
from shjax.harmonics.tables import cached


def couplings(l: int) -> np.ndarray:
    """Ladder coefficients between m and m + 1, times sqrt2 at m = 0."""
    m = np.arange(l)
    return np.sqrt((l - m) * (l + m + 1.0)) / 2 * np.where(m == 0, np.sqrt(2), 1)


def eigenvectors(l: int, size: int) -> np.ndarray:
    """V of the cosine and of the sine block, filled up with zeros: ``(2, size, size)``.

    ``[block, m, j]``; column j belongs to the eigenvalue of :func:`frequencies`.
    """
    blocks = np.zeros((2, size, size))
    coupling = couplings(l)
    for block, first in enumerate((0, 1)):
        count = l + 1 - first
        if count:
            off = coupling[first:]
            _, vectors = np.linalg.eigh(np.diag(off, 1) + np.diag(off, -1))
            blocks[block, first : l + 1, :count] = vectors
    return blocks


def frequencies(l: int, size: int) -> np.ndarray:
    """Frequencies, the integer eigenvalues in rising order: ``(2, size)``."""
    values = np.zeros((2, size))
    values[0, : l + 1] = np.arange(-l, l + 1, 2)
    values[1, :l] = np.arange(-l + 1, l, 2)
    return values


@cached
def tables(l_max: int) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvectors ``(F + 1, 2, F + 1, F + 1)`` and frequencies of all degrees."""
    vectors = np.stack([eigenvectors(l, l_max + 1) for l in range(l_max + 1)])
    return vectors, np.stack([frequencies(l, l_max + 1) for l in range(l_max + 1)])


def waves(angle: jax.Array, multiples: Array) -> tuple[jax.Array, jax.Array]:
    """Cos and sin of ``k a`` for whole k up to 2^11, without the rounding of ``k a``.

    In float32 ``k a`` would be off by 1e-4 at k = 1024. The angle is split into a part of
    12 bits, whose multiples are exact, and a rest; whole turns go in three steps [Cody and
    Waite 1980].
    """
    k = jnp.asarray(multiples, angle.dtype)
    if angle.dtype == jnp.float64:
        return jnp.cos(k * angle), jnp.sin(k * angle)
    high = jax.lax.reduce_precision(angle, exponent_bits=8, mantissa_bits=11)
    product = k * high  # exact
    turns = jnp.round(product * np.float32(1 / (2 * np.pi)))
    for part in _TWO_PI_PARTS:
        product = product - turns * part
    rest = product + k * (angle - high)
    return jnp.cos(rest), jnp.sin(rest)


def _split_two_pi() -> tuple[np.float32, ...]:
    """2 pi as a sum of float32 numbers of 12 bits, and the rest."""
    parts, rest = [], 2 * np.pi
    for _ in range(2):
        step = 2.0 ** (np.floor(np.log2(abs(rest))) - 11)
        part = np.float32(np.floor(rest / step) * step)
        parts.append(part)
        rest -= float(part)
    return (*parts, np.float32(rest))


_TWO_PI_PARTS = _split_two_pi()


def rotate_about_y(
    by_order: jax.Array, vectors: jax.Array, wave: tuple[jax.Array, jax.Array]
) -> jax.Array:
    """Rotate coefficients about y.

    Args:
        by_order: Coefficients ``(..., block, m, C)``: cosines, sines.
        vectors: Eigenvectors ``(..., block, m, j)``.
        wave: cos and sin of the angle times the frequencies, ``(..., block, j)``.

    Returns:
        The same shape.
    """
    size = by_order.shape[-2]
    m = np.arange(size)
    # i^m c = p + i q, with p from even orders and q from odd ones.
    signs = jnp.asarray(np.where(m % 4 < 2, 1, -1), by_order.dtype)[:, None]
    even = jnp.asarray(m % 2 == 0)[:, None]
    shape = by_order.shape
    signs, even = (jnp.broadcast_to(a, shape) for a in (signs, even))
    signed = by_order * signs
    p = einsum("...mj,...mc->...jc", vectors, jnp.where(even, signed, 0))
    q = einsum("...mj,...mc->...jc", vectors, jnp.where(even, 0, signed))
    cosine, sine = (jnp.broadcast_to(w[..., None], p.shape) for w in wave)
    u = einsum("...mj,...jc->...mc", vectors, p * cosine - q * sine)
    v = einsum("...mj,...jc->...mc", vectors, p * sine + q * cosine)
    return jnp.where(even, u, v) * signs


def wigner_d(
    l: int, angle: Float[Array, ""] | np.floating | float
) -> Float[jax.Array, "M M"]:
    """Wigner d matrix: rotation about y of one degree, in the real basis.

    ``Y_lm(R_y(angle) w) = sum_q d[m + l, q + l] Y_lq(w)``.

    Args:
        l: Degree, to 1024. Static.
        angle: Radians.

    Returns:
        ``(2 l + 1, 2 l + 1)``, in the angle's type.

    Raises:
        ValueError: If ``l`` is not an integer from 0 to 1024, or ``angle`` no number.

    >>> [f"{x:.3f}" for x in wigner_d(1, np.float32(0.5))[2]]  # x of a turned vector
    ['0.000', '0.479', '0.878']
    """
    l = check_l_max(l, "l")
    angle = as_float("angle", float(angle) if isinstance(angle, int) else angle)
    if angle.shape != ():
        raise ValueError(f"angle must be a number; got shape {angle.shape}.")
    return _wigner_d(angle, jnp.asarray(eigenvectors(l, l + 1), angle.dtype), l=l)


_ADDED_AT_ONCE = 64  # eigenvectors; a longer float32 sum keeps fewer digits


@functools.partial(jax.jit, static_argnames=("l",))
def _wigner_d(angle: jax.Array, vectors: jax.Array, *, l: int) -> jax.Array:
    unit = jnp.broadcast_to(jnp.eye(l + 1, dtype=angle.dtype), vectors.shape)

    def add(so_far, some):
        columns, *wave = (jnp.moveaxis(a, 0, -1) for a in some)
        return so_far + rotate_about_y(unit, columns, (wave[0], wave[1])), None

    every = (vectors, *waves(angle, frequencies(l, l + 1)))
    groups = [in_blocks(jnp.moveaxis(a, -1, 0), _ADDED_AT_ONCE) for a in every]
    (cosines, sines), _ = jax.lax.scan(add, jnp.zeros_like(unit), groups)
    matrix = jnp.zeros((2 * l + 1, 2 * l + 1), angle.dtype)
    matrix = matrix.at[l:, l:].set(cosines)
    down = np.arange(l - 1, -1, -1)  # rows and columns of the orders -1, -2, ...
    return matrix.at[down[:, None], down].set(sines[1:, 1:])
