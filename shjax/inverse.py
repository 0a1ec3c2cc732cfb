"""Lighting from pictures, and what the pictures could not determine.

The picture of a matte object is linear in the lighting: ``albedo / pi * Ahat_l Y_lm(n)``
is the design. It is compressed by QR once; optimistix then works on K rows.

References:
    [RH01] R. Ramamoorthi and P. Hanrahan, On the relationship between radiance and
    irradiance: determining the illumination from images of a convex Lambertian object,
    JOSA A, 2001.
"""

from __future__ import annotations

import functools
import math

import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jax.core import Tracer
from jaxtyping import Bool, Float

from shjax.arrays import Array, as_float, check_channels, in_blocks
from shjax.estimate import Estimate
from shjax.harmonics import basis
from shjax.harmonics.degrees import check_l_max, degrees
from shjax.irradiance import cosine_kernel_table

_matmul = functools.partial(jnp.matmul, precision=jax.lax.Precision.HIGHEST)


def estimate_lighting(
    image: Float[Array, "*points C"],
    normals: Float[Array, "*points 3"],
    *,
    mask: Float[Array, "*points"] | Bool[Array, "*points"] | None = None,
    albedo: Float[Array, ...] | float = 1.0,
    l_max: int = 2,
    noise: Float[Array, ...] | float | None = None,
) -> Estimate:
    """Lighting coefficients from a picture of a matte object, by least squares.

    From one view the answer is limited by bias more than by noise: light of degree 4, 6,
    ... looks like degrees 0 to 2 on the visible half of the normals.

    Args:
        image: Radiance of the pixels, any leading shape.
        normals: Their unit normals; zero for pixels that show nothing.
        mask: Weights >= 0 of the squared residuals; default 1 wherever there is a normal.
            Leave out pixels on an outline: their light is not that of their normal.
        albedo: A number, or an array that broadcasts to ``image``.
        l_max: Highest degree, inclusive. Odd degrees above 1 cannot be seen through a
            matte surface; they are left at 0 and appear in ``null_space``.
        noise: Standard deviation of a pixel of weight 1, a number or ``(C,)``; None:
            estimated from the residual.

    Returns:
        An :class:`Estimate` with ``value`` ``((l_max + 1)^2, C)``, radiance.

    Raises:
        ValueError: If shapes do not fit, an unmasked pixel is not finite, or a normal is
            not of unit length.
    """
    check_channels("image", image.shape, "C", 1)
    check_l_max(l_max)
    image = as_float("image", image)
    points, dtype = image.shape[:-1], image.dtype
    if normals.shape != (*points, 3):
        raise ValueError(
            f"normals must have shape {(*points, 3)} to fit image; got {normals.shape}."
        )
    normals = as_float("normals", normals).astype(dtype)
    weights = jnp.any(normals != 0, axis=-1).astype(dtype)
    if mask is not None:
        if mask.shape != points:
            raise ValueError(f"mask must have shape {points}; got {mask.shape}.")
        weights = weights * jnp.asarray(mask, dtype)
    albedo = _fit("albedo", albedo, image.shape, dtype)
    sigma = None if noise is None else _fit("noise", noise, image.shape[-1:], dtype)
    if sigma is not None and not isinstance(sigma, Tracer) and bool(jnp.any(sigma < 0)):
        raise ValueError(f"noise must not be negative; got {noise}.")
    _check_data(image, normals, weights)
    channels = image.shape[-1]
    return _estimate_lighting(
        image.reshape(-1, channels),
        normals.reshape(-1, 3),
        weights.reshape(-1),
        albedo.reshape(-1, channels),
        sigma,
        l_max=l_max,
    )


def _fit(name: str, value, shape: tuple[int, ...], dtype) -> jax.Array:
    try:
        return jnp.broadcast_to(jnp.asarray(value, dtype), shape)
    except ValueError as error:
        raise ValueError(
            f"{name} must be a number or broadcast to {shape}; got {jnp.shape(value)}."
        ) from error


def _check_data(image: jax.Array, normals: jax.Array, weights: jax.Array) -> None:
    if any(isinstance(a, Tracer) for a in (image, normals, weights)):
        return
    used = np.asarray(weights) > 0
    if np.any(np.asarray(weights) < 0):
        raise ValueError("mask must not be negative.")
    bad = ~np.isfinite(np.asarray(image)[used])
    if bad.any():
        raise ValueError(
            f"image must be finite where mask > 0; {int(bad.sum())} values are not."
        )
    lengths = np.linalg.norm(np.asarray(normals)[used], axis=-1)
    if lengths.size and not np.all(np.abs(lengths - 1) < 1e-2):
        raise ValueError(
            "normals must have unit length where mask > 0; got lengths from "
            f"{lengths.min():.3g} to {lengths.max():.3g}."
        )


@functools.partial(jax.jit, static_argnames=("l_max",))
def _estimate_lighting(
    image: jax.Array,
    normals: jax.Array,
    weights: jax.Array,
    albedo: jax.Array,
    sigma: jax.Array | None,
    *,
    l_max: int,
) -> Estimate:
    dtype = image.dtype
    kernel = cosine_kernel_table(l_max)[degrees(l_max)] / math.pi
    seen = np.flatnonzero(kernel)  # odd degrees above 1 are invisible
    gains = jnp.asarray(kernel[seen], dtype)[None]
    functions = basis(normals, l_max=l_max)[:, seen] * gains
    root = jnp.sqrt(weights)[:, None]
    target = jnp.where(root > 0, image, 0) * root

    def compress(column, reflectance):
        design = functions * (reflectance[:, None] * root)
        q, r = jnp.linalg.qr(design)
        # In blocks, not as a product: its long float32 sum of like terms drifts by 2e-4.
        blocks = in_blocks(q * column[:, None], 256)
        return r, jnp.sum(jnp.sum(blocks, axis=1), axis=0)

    r, projected = jax.vmap(compress, in_axes=(1, 1))(target, albedo)
    tolerance = float(max(image.shape[0], len(seen)) ** 0.5 * jnp.finfo(dtype).eps)
    solve = functools.partial(_least_squares, tolerance=tolerance)
    value, steps, ended = jax.vmap(solve)(r, projected)  # (C, seen)

    predicted = _matmul(functions, value.T) * albedo * root
    residual_norm = jnp.linalg.norm(target - predicted, axis=0)
    channels = jax.vmap(functools.partial(_diagnose, tolerance=tolerance))
    covariance, rank, missing = channels(r)
    freedom = jnp.maximum(jnp.sum(weights > 0) - len(seen), 1).astype(dtype)
    variance = residual_norm**2 / freedom if sigma is None else sigma**2
    covariance = covariance * variance[:, None, None]

    # The rows of all channels, and enough rows of zeros that there are K values.
    rows = (r.shape[0] * r.shape[1] + kernel.size, kernel.size)
    stacked = (
        jnp.zeros(rows, dtype)
        .at[: rows[0] - kernel.size, seen]
        .set(r.reshape(-1, len(seen)) / math.sqrt(r.shape[0]))
    )
    _, singular_values, singular_vectors = jnp.linalg.svd(stacked, full_matrices=False)
    prior_fraction = jnp.ones((kernel.size, image.shape[1]), dtype)
    prior_fraction = prior_fraction.at[seen].set(missing.T)
    covariance = jax.vmap(lambda c: _embed(c, seen, kernel.size))(covariance)
    unknown = jnp.where(prior_fraction > 1e-3, jnp.inf, 0).astype(dtype)
    covariance = covariance + jax.vmap(jnp.diag, in_axes=1)(unknown)
    return Estimate(
        value=jnp.zeros((kernel.size, image.shape[1]), dtype).at[seen].set(value.T),
        covariance=covariance,
        singular_values=singular_values,
        singular_vectors=singular_vectors,
        rank=rank,
        prior_fraction=prior_fraction,
        residual_norm=residual_norm,
        steps=jnp.max(steps),
        converged=jnp.all(ended),
        tolerance=tolerance,
    )


def _embed(matrix: jax.Array, rows: np.ndarray, size: int) -> jax.Array:
    return jnp.zeros((size, size), matrix.dtype).at[rows[:, None], rows].set(matrix)


def _least_squares(r: jax.Array, target: jax.Array, *, tolerance: float):
    """Least-norm solution of ``min |r x - target|``: value, steps, and how it ended."""
    # In units in which both are of order one, so that the solver's tolerances mean
    # the same for a picture of any brightness.
    unit_r, unit_target = (_scale_of(a) for a in (r, target))
    tight = float(jnp.finfo(r.dtype).eps) ** 0.75
    solver = optx.GaussNewton(tight, tight, linear_solver=lx.SVD(rcond=tolerance))
    solution = optx.least_squares(
        lambda x, args: _matmul(args[0], x) - args[1],
        solver,
        jnp.zeros(r.shape[1], r.dtype),
        args=(r / unit_r, target / unit_target),
        max_steps=16,
        throw=False,
    )
    ended = solution.result == optx.RESULTS.successful
    value = solution.value * (unit_target / unit_r)
    return value, solution.stats["num_steps"], ended


def _scale_of(values: jax.Array) -> jax.Array:
    """The largest magnitude, 1 for zeros; a constant wherever it is differentiated."""
    largest = jnp.max(jnp.abs(jax.lax.stop_gradient(values)))
    return jnp.where(largest > 0, largest, 1)


def _diagnose(r: jax.Array, *, tolerance: float):
    """Pseudo-inverse of ``r^T r``, the rank, and each unknown's undetermined share."""
    _, values, vectors = jnp.linalg.svd(r, full_matrices=False)
    known = values > tolerance * values[0]
    inverse = jnp.where(known, 1 / jnp.where(known, values, 1), 0)
    half = vectors * inverse[:, None]
    share = 1 - jnp.sum(jnp.where(known[:, None], vectors**2, 0), axis=0)
    return _matmul(half.T, half), jnp.sum(known), jnp.clip(share, 0, 1)
