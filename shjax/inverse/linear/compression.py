"""A linear problem of many pixels as one of as many rows as unknowns, by QR.

``min |W^(1/2) (A x - y)|`` has the minimiser of ``min |R x - z|`` with ``A = Q R`` and
``z = Q^T y``: whatever is solved afterwards (plain, with a prior, nonlinear) works on J
rows for J unknowns, and no longer knows how many pixels there were.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from shjax.arrays import einsum, safe_sqrt


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
    factors = [jnp.linalg.qr(weighted[d]) for d in range(wide[1])]
    own, r = (jnp.stack(some) for some in zip(*factors, strict=True))
    q, r = (jnp.broadcast_to(a, (channels, *a.shape[1:])) for a in (own, r))

    # Twice: the second time takes what a long float32 sum lost the first time.
    z, left = jnp.zeros_like(r[..., 0]), target
    for _ in range(2):
        more = einsum("cnj,nc->cj", q, left)
        z, left = z + more, left - einsum("cnj,cj->nc", q, more)
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


def predicted(design: jax.Array, mean: jax.Array) -> jax.Array:
    """Predict the pixels ``(N, C)`` of an answer ``(J, C)``."""
    shape = (mean.shape[1], *design.shape[1:])
    every = jnp.broadcast_to(design, shape)
    return einsum("cnj,jc->nc", every, mean)


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
