"""A linear problem of many pixels as one of as many rows as unknowns, by QR.

``min |W^(1/2) (A x - y)|`` has the minimiser of ``min |R x - z|`` with ``A = Q R`` and
``z = Q^T y``: whatever is solved afterwards (plain, with a prior, nonlinear) works on J
rows for J unknowns, and no longer knows how many pixels there were.

References:
    [F14] T. Fukaya et al., CholeskyQR2: a simple and communication-avoiding algorithm for
    computing a tall-skinny QR factorization, ScalA 2014.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from shjax.arrays import einsum, matmul, safe_sqrt
from shjax.inverse.linear.least_squares import inverse_of_triangle

_ROUNDING = 8.0  # of a Gram matrix, over its trace, in units of the type's precision
_FEW_COLUMNS = 12  # of which reflections are as quick
_NO_PIVOT = 64.0  # over the largest, in units of the type's precision
_LEAST_PIVOT = 1e-3  # squared, of nearly orthonormal columns


class Compressed(NamedTuple):
    """Least-squares problem compressed by QR to J rows, channels in front.

    Attributes:
        r: Upper triangles, ``(C, J, J)``.
        z: Right sides, ``(C, J)``.
        rest: Squared norm of what no unknown can explain, ``(C,)``.
        power: Squared norm of the data, ``(C,)``.
        used: How many pixels have weight, ``(C,)``.
        q: What ``r`` came with, ``W^(1/2) A = Q R``, ``(D, N, J)``; D = 1 for all channels.
        root: ``W^(1/2)``, ``(D, N)``.
    """

    r: jax.Array
    z: jax.Array
    rest: jax.Array
    power: jax.Array
    used: jax.Array
    q: jax.Array
    root: jax.Array

    @property
    def own(self) -> jax.Array:
        """The triangles without copies, ``(D, J, J)``."""
        return self.r[: len(self.q)]


def compress(design: jax.Array, target: jax.Array, weights: jax.Array) -> Compressed:
    """Compress a least-squares problem ``design x = target`` by QR.

    Args:
        design: ``(D, N, J)``; D = 1 serves all channels, and costs one factorisation.
        target: ``(N, C)``.
        weights: Of the squared residuals, ``(N,)``, or ``(N, C)`` where D = C.
    """
    pixels, channels = target.shape
    missing = design.shape[-1] - pixels
    if missing > 0:  # fewer pixels than unknowns: pixels of weight 0 make a square
        design = jnp.pad(design, ((0, 0), (0, missing), (0, 0)))
        target = jnp.pad(target, ((0, missing), (0, 0)))
        weights = jnp.pad(weights, ((0, missing),) + ((0, 0),) * (weights.ndim - 1))
    weights = weights if weights.ndim == 2 else weights[:, None]
    root = safe_sqrt(weights)
    wide = (target.shape[0], max(weights.shape[1], design.shape[0]))
    root = jnp.broadcast_to(root, wide)
    if wide[1] > design.shape[0]:
        design = jnp.broadcast_to(design, (wide[1], *design.shape[1:]))
    target = jnp.where(root > 0, target, 0) * root
    weighted = design * root.T[..., None]  # [d, n, j]
    # One by one: see inverse_and_log_det for what batches may do.
    factors = [tall_qr(weighted[d]) for d in range(wide[1])]
    own, r = (jnp.stack(some) for some in zip(*factors, strict=True))
    r = jnp.broadcast_to(r, (channels, *r.shape[1:]))

    # Twice: the second time takes what a long float32 sum lost the first time.
    z, left = jnp.zeros_like(r[..., 0]), target
    for _ in range(2):
        more = _onto(own, left)
        z, left = z + more, left - predicted(own, more.T)
    count = jnp.broadcast_to(jnp.sum(root > 0, axis=0), (channels,))
    rest, power = (jnp.sum(a * a, axis=0) for a in (left, target))
    return Compressed(
        r,
        z,
        rest,
        power,
        count.astype(target.dtype),
        own[:, :pixels],
        root.T[:, :pixels],
    )


@jax.custom_jvp
def tall_qr(a: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Thin QR factorisation of many rows, by Cholesky factors where that is as exact.

    ``A^T A = R^T R``, twice [F14]: four products, two to three times faster than
    reflections on a CPU, and made of what a GPU does well. The first factor, of a Gram
    matrix lifted by its rounding, leaves columns that are nearly orthonormal; where they
    are not (few normals, a box), Householder reflections do it. One at a time under
    ``vmap``, as :func:`inverse_and_log_det`, and for its reason.

    Args:
        a: ``(N, J)``, N >= J.
    """
    return _tall_qr(a)


@tall_qr.defjvp
def _tall_qr_jvp(primals, tangents):
    (a,), (moved,) = primals, tangents
    q, r = tall_qr(a)
    # A column that the others explain has no direction of its own to turn.
    pivots = jnp.abs(jnp.diagonal(r))
    own = pivots > _NO_PIVOT * jnp.finfo(a.dtype).eps * jnp.max(pivots)
    known = jnp.where(own[:, None], r, jnp.eye(len(r), dtype=r.dtype))
    inverse = jnp.where(own[None], inverse_of_triangle(known), 0)
    change = matmul(moved, inverse)
    within = matmul(q.T, change)
    below = jnp.tril(within, -1)
    turned = below - below.T
    return (q, r), (
        matmul(q, turned - within) + change,
        matmul(within - turned, r),
    )


@jax.custom_batching.sequential_vmap
def _tall_qr(a: jax.Array) -> tuple[jax.Array, jax.Array]:
    size, dtype = a.shape[1], a.dtype
    if size < _FEW_COLUMNS:
        q, r = jnp.linalg.qr(a)
        return q, r
    identity = jnp.eye(size, dtype=dtype)
    rounding = _ROUNDING * jnp.finfo(dtype).eps
    gram = matmul(a.T, a)
    power = jnp.trace(gram)
    lift = rounding * jnp.where(power > 0, power, 1)
    first = jnp.linalg.cholesky(gram + lift * identity).T
    nearly = matmul(a, inverse_of_triangle(first))
    second = matmul(nearly.T, nearly)
    pivots = jnp.diagonal(jnp.linalg.cholesky(second + rounding * size * identity))

    def by_cholesky() -> tuple[jax.Array, jax.Array]:
        factor = jnp.linalg.cholesky(second).T
        return matmul(nearly, inverse_of_triangle(factor)), matmul(factor, first)

    regular = jnp.min(pivots) ** 2 > _LEAST_PIVOT
    return jax.lax.cond(regular, by_cholesky, lambda: tuple(jnp.linalg.qr(a)))


def _onto(q: jax.Array, target: jax.Array) -> jax.Array:
    """``Q^T y`` of each channel, ``(C, J)``, by one product where Q is that of all."""
    if len(q) == 1:
        return matmul(target.T, q[0])
    return einsum("cnj,nc->cj", q, target)


def predicted(design: jax.Array, mean: jax.Array) -> jax.Array:
    """Predict the pixels ``(N, C)`` of an answer ``(J, C)``."""
    if len(design) == 1:
        return matmul(design[0], mean)
    return einsum("cnj,jc->nc", design, mean)


def first_columns(problem: Compressed, size: int) -> Compressed:
    """Restrict a problem to its first unknowns; the others are 0."""
    left = problem.z[:, size:]
    return problem._replace(
        r=problem.r[:, :size, :size],
        z=problem.z[:, :size],
        q=problem.q[..., :size],
        rest=problem.rest + jnp.sum(left * left, axis=-1),
    )


def noise_variance(problem: Compressed, sigma: jax.Array | None) -> jax.Array:
    """Noise variance of a pixel of weight 1, ``(C,)``: given, or from the residual.

    Never below the rounding of the data.
    """
    if sigma is None:
        freedom = jnp.maximum(problem.used - problem.z.shape[-1], 1)
        variance = problem.rest / freedom
    else:
        variance = sigma**2
    mean = problem.power / jnp.maximum(problem.used, 1)
    eps = jnp.finfo(mean.dtype).eps
    tiny = jnp.finfo(mean.dtype).tiny
    return jnp.maximum(variance, jnp.maximum(eps * mean, tiny / eps))
