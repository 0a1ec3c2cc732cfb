"""Rotation and change of frame of an expansion, by any orthogonal matrix.

A rotation is ``R_z(a) R_y(b) R_z(c)``: turns about z multiply pairs of coefficients, the
turn about y is in ``wigner``. The angles come from the unit quaternion, which is well
conditioned everywhere; their derivatives would not be (at the identity a and c are not
determined), so the derivative in the matrix is taken from the generators instead:
``d/dt D(exp(t [w]) R) = (w . G) D(R)``, exact at every rotation.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Float

from shjax.arrays import Array, as_float, matmul, shape_of
from shjax.harmonics import wigner
from shjax.harmonics.degrees import degree_of_coefs, degrees, orders
from shjax.harmonics.tables import on_device

_TABLES_TO = 128  # above, the eigenvectors of one degree at a time


class _Tables(NamedTuple):
    """Eigenvectors ``(l, 2, m, j)``, frequencies ``(l, 2, j)`` and degrees ``(l,)``."""

    vectors: jax.Array
    frequencies: jax.Array
    degrees: jax.Array


def rotate(
    coefs: Float[Array, "*batch K C"], rotation: Float[Array, "*turns 3 3"]
) -> Float[jax.Array, "*all K C"]:
    """Rotate spherical harmonic coefficients: ``f'(R w) = f(w)``.

    To read the same light in another frame whose axes are the rows of ``R``, pass that
    ``R``. Differentiable in both arguments, at the identity too; a change of ``rotation``
    that leads out of the orthogonal matrices counts by its part along them. Above degree
    128 call it eagerly: one degree's table is held at a time, where ``jit`` would unroll
    all of them into one program.

    Args:
        coefs: Coefficients, ``(..., K, C)``.
        rotation: Orthogonal matrices, ``(..., 3, 3)``; mirrors are allowed. Batch axes
            broadcast against those of ``coefs``.

    Returns:
        Coefficients ``(..., K, C)``, in the type of ``coefs``.

    Raises:
        ValueError: If a shape is wrong, or a matrix is not orthogonal to 1e-4.
    """
    l_max = degree_of_coefs(coefs)
    if shape_of("rotation", rotation)[-2:] != (3, 3):
        raise ValueError(f"rotation must have shape (..., 3, 3); got {rotation.shape}.")
    coefs = as_float("coefs", coefs)
    matrix = as_float("rotation", rotation)
    _check_orthogonal(matrix)
    batch = jnp.broadcast_shapes(coefs.shape[:-2], matrix.shape[:-2])
    coefs = jnp.broadcast_to(coefs, (*batch, *coefs.shape[-2:]))
    matrix = jnp.broadcast_to(matrix.astype(coefs.dtype), (*batch, 3, 3))
    turn = _rotate_by_degree
    if l_max <= _TABLES_TO:
        vectors, multiples = on_device(wigner.tables, l_max, dtype=coefs.dtype)
        tables = _Tables(vectors, multiples, jnp.arange(l_max + 1))
        turn = functools.partial(_rotate, tables=tables)
    for _ in batch:
        turn = jax.vmap(turn)
    return turn(coefs, matrix)


def _check_orthogonal(matrix: jax.Array) -> None:
    if isinstance(matrix, Tracer):
        return
    values = np.asarray(matrix, np.float64)
    off = np.swapaxes(values, -1, -2) @ values - np.eye(3)
    worst = float(np.max(np.abs(off), initial=0))
    if not worst < 1e-4:
        raise ValueError(
            f"rotation must be orthogonal; R^T R differs from 1 by {worst:.2g}."
        )


@jax.jit
def _rotate(coefs: jax.Array, matrix: jax.Array, *, tables: _Tables) -> jax.Array:
    l_max = degree_of_coefs(coefs)
    l, m = degrees(l_max), orders(l_max)
    slots = (l * 2 + (m < 0)) * (l_max + 1) + np.abs(m)
    shape = (l_max + 1, 2, l_max + 1, coefs.shape[-1])
    flat = jnp.zeros((2 * (l_max + 1) ** 2, coefs.shape[-1]), coefs.dtype)
    blocks = flat.at[slots].set(coefs, unique_indices=True).reshape(shape)
    turned = _turn(blocks, matrix, tables)
    return jnp.take(turned.reshape(-1, coefs.shape[-1]), slots, axis=0)


def _rotate_by_degree(coefs: jax.Array, matrix: jax.Array) -> jax.Array:
    """One degree after the other, so that one degree's table is all that is held."""
    size = degree_of_coefs(coefs) + 1
    turned = jnp.zeros_like(coefs)
    for l in range(size):
        tables = _Tables(
            jnp.asarray(wigner.eigenvectors(l, size)[None], coefs.dtype),
            jnp.asarray(wigner.frequencies(l, size)[None], coefs.dtype),
            jnp.asarray([l]),
        )
        turned = _rotate_degree(turned, coefs, matrix, tables)
    return turned


@jax.jit
def _rotate_degree(
    turned: jax.Array, coefs: jax.Array, matrix: jax.Array, tables: _Tables
) -> jax.Array:
    """Write one degree's rotated coefficients into ``turned``; one program for all."""
    l, m = tables.degrees[0], jnp.arange(tables.frequencies.shape[-1])
    centre, outside = l * (l + 1), coefs.shape[0]
    slots = jnp.stack([centre + m, jnp.where(m > 0, centre - m, outside)])
    slots = jnp.where((m > l)[None], outside, slots)
    blocks = jnp.take(coefs, slots, axis=0, mode="fill", fill_value=0)
    blocks = _turn(blocks[None], matrix, tables)[0]
    return turned.at[slots].set(blocks, mode="drop")


@jax.custom_jvp
def _turn(blocks: jax.Array, matrix: jax.Array, tables: _Tables) -> jax.Array:
    """Rotate coefficients stored as ``(l, cosines or sines, m, C)``."""
    matrix, mirrored = _nearest_rotation(matrix)
    first, second, third = _euler_angles(matrix)
    blocks = _turn_about_z(blocks, third)
    wave = wigner.waves(second, tables.frequencies)
    blocks = wigner.rotate_about_y(blocks, tables.vectors, wave)
    blocks = _turn_about_z(blocks, first)
    odd = (tables.degrees % 2 == 1)[:, None, None, None]
    flip = jnp.broadcast_to(odd & mirrored, blocks.shape)
    return jnp.where(flip, -blocks, blocks)


@_turn.defjvp
def _turn_jvp(primals, tangents):
    blocks, matrix, tables = primals
    block_tangents, matrix_tangents, _ = tangents
    value = _turn(blocks, matrix, tables)
    spin = matmul(matrix_tangents, matrix.T)
    spin = (spin - spin.T) / 2
    x, y, z = spin[2, 1], spin[0, 2], spin[1, 0]
    still = jnp.zeros_like(tables.frequencies)

    def about_y(some):
        return wigner.rotate_about_y(some, tables.vectors, (still, tables.frequencies))

    # R_x = R_z(-pi/2) R_y R_z(pi/2), and the same for their generators.
    right = jnp.asarray(np.pi / 2, blocks.dtype)
    about_x = _turn_about_z(about_y(_turn_about_z(value, right)), -right)
    m = jnp.asarray(np.arange(blocks.shape[-2])[:, None], blocks.dtype)
    m = jnp.broadcast_to(m, value[:, 0].shape)
    about_z = jnp.stack([-m * value[:, 1], m * value[:, 0]], axis=1)
    change = x * about_x + y * about_y(value) + z * about_z
    return value, _turn(block_tangents, matrix, tables) + change


def _turn_about_z(blocks: jax.Array, angle: jax.Array) -> jax.Array:
    cosine, sine = wigner.waves(angle, np.arange(blocks.shape[-2]))
    shape = blocks[:, 0].shape
    cosine, sine = (jnp.broadcast_to(w[None, :, None], shape) for w in (cosine, sine))
    c, s = blocks[:, 0], blocks[:, 1]
    return jnp.stack([c * cosine - s * sine, c * sine + s * cosine], axis=1)


def _nearest_rotation(matrix: jax.Array) -> tuple[jax.Array, jax.Array]:
    """The proper rotation beside an orthogonal matrix, and whether it was a mirror.

    Two Newton steps to the polar factor: fourth order in what rounding left.
    """
    three = 3 * jnp.eye(3, dtype=matrix.dtype)
    mirrored = jnp.dot(matrix[0], jnp.cross(matrix[1], matrix[2])) < 0
    matrix = jnp.where(mirrored, -matrix, matrix)
    for _ in range(2):
        matrix = matmul(matrix, three - matmul(matrix.T, matrix)) / 2
    return matrix, mirrored


def _euler_angles(matrix: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """a, b, c of ``R_z(a) R_y(b) R_z(c)``, by way of the unit quaternion."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = matrix
    # Four multiples of (w, x, y, z); the one with the largest norm has all its digits.
    candidates = jnp.stack(
        [
            jnp.stack([1 + xx + yy + zz, zy - yz, xz - zx, yx - xy]),
            jnp.stack([zy - yz, 1 + xx - yy - zz, xy + yx, xz + zx]),
            jnp.stack([xz - zx, xy + yx, 1 - xx + yy - zz, yz + zy]),
            jnp.stack([yx - xy, xz + zx, yz + zy, 1 - xx - yy + zz]),
        ]
    )
    w, x, y, z = candidates[jnp.argmax(jnp.diagonal(candidates))]
    total, difference = jnp.arctan2(z, w), jnp.arctan2(-x, y)
    polar = 2 * jnp.arctan2(jnp.hypot(x, y), jnp.hypot(w, z))
    return total + difference, polar, total - difference
