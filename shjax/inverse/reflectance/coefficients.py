"""A reflectance's free coefficients: linear in the picture, so as the lighting goes.

References:
    [RH01] R. Ramamoorthi and P. Hanrahan, A signal-processing framework for inverse
    rendering, SIGGRAPH 2001, sections 4 and 5.
    [T5] R. Ramamoorthi, PhD thesis, Stanford, 2002, chapters 5 and 6.
"""

from __future__ import annotations

import functools
import math

import jax
import jax.numpy as jnp

from shjax.brdf.transfer_rows import table_to, view_frames
from shjax.harmonics import basis
from shjax.inverse.estimate import Estimate
from shjax.inverse.linear.compression import compress, noise_variance, predicted
from shjax.inverse.linear.least_squares import diagnose, least_squares, tolerance_of
from shjax.inverse.shown.glossy import light_up
from shjax.inverse.shown.pixels import Pixels
from shjax.render import GBuffer
from shjax.render.pictures import covered

_FORGIVEN = 1e-3  # share of an unknown in the null space, below which it is determined


def indices(l_max: int, p_max: int | None) -> list[tuple[int, int, int]]:
    """Indices ``(l, p, q)`` with ``q <= min(l, p)``, by l; ``p_max`` None: radial."""
    if p_max is None:
        return [(l, 0, 0) for l in range(l_max + 1)]
    return [
        (l, p, q)
        for l in range(l_max + 1)
        for p in range(p_max + 1)
        for q in range(min(l, p) + 1)
    ]


def columns(
    lighting: jax.Array, normals: jax.Array, views: jax.Array, p_max: int | None
) -> jax.Array:
    """Derivatives of the picture in each BRDF coefficient, ``(C, N, J)``.

    Radial about R, the gain of degree l multiplies ``sum_m L_lm Y_lm(R)``; in general
    ``rho_lpq`` multiplies the light's ``(l, q)`` in R's frame with the view at azimuth 0,
    and the view's ``Y_pq`` in it [T5, Eq. 5.8].
    """
    radial = p_max is None
    lit = light_up(lighting, normals, views, table_to(0.0), radial=radial)
    if radial:
        return jnp.transpose(lit.mirror, (2, 0, 1))
    assert lit.turned is not None  # lit for parts that are not radial
    angles = view_frames(normals, views).angles
    local = jnp.stack([jnp.sin(angles), jnp.zeros_like(angles), jnp.cos(angles)], -1)
    of_view = basis(local, l_max=p_max)[..., None]  # [n, q, 1]
    shape = lit.turned[:, 0, 0].shape
    made = [
        lit.turned[:, l, q] * jnp.broadcast_to(of_view[:, p * (p + 1) + q], shape)
        for l, p, q in indices(lit.turned.shape[1] - 1, p_max)
    ]
    return jnp.transpose(jnp.stack(made, axis=-1), (1, 0, 2))


@functools.partial(jax.jit, static_argnames=("l_max", "p_max"))
def estimate_coefficients(
    pixels: Pixels,
    normals: jax.Array,
    views: jax.Array,
    lighting: jax.Array,
    sigma: jax.Array | None,
    *,
    l_max: int,
    p_max: int | None,
) -> Estimate:
    """Estimate free BRDF coefficients by linear least squares."""
    design = columns(lighting, normals, views, p_max)
    design = design * jnp.broadcast_to(pixels.albedo.T[..., None], design.shape)
    problem = compress(design, pixels.image, pixels.weights)
    tolerance = tolerance_of(problem.r)
    # One channel at a time: see inverse_and_log_det for what batches may do.
    solved = [
        least_squares(r, z, tolerance=tolerance)
        for r, z in zip(problem.r, problem.z, strict=True)
    ]
    value, steps, ended = (jnp.stack(a) for a in zip(*solved, strict=True))
    known = [diagnose(r, tolerance=tolerance) for r in problem.r]
    covariance, _, missing = (jnp.stack(a) for a in zip(*known, strict=True))
    variance = noise_variance(problem, sigma)
    open_ended = jnp.where(missing > _FORGIVEN, jnp.inf, 0).astype(value.dtype)
    covariance = covariance * variance[:, None, None] + jax.vmap(jnp.diag)(open_ended)
    left = jnp.where(
        pixels.weights[:, None] > 0, pixels.image - predicted(design, value.T), 0
    )
    asked = indices(l_max, p_max)
    size = len(asked)
    # The first rows and columns of a triangle are the triangle of the first unknowns.
    small = problem.r[:, :size, :size]
    ranks = [diagnose(one, tolerance=tolerance)[1] for one in small]
    stacked = small.reshape(-1, size) / math.sqrt(small.shape[0])
    _, singular, vectors = jnp.linalg.svd(stacked, full_matrices=False)
    return Estimate(
        value=value[:, :size].T,
        covariance=covariance[:, :size, :size],
        singular_values=singular,
        singular_vectors=vectors,
        rank=jnp.stack(ranks),
        prior_fraction=missing[:, :size].T,
        residual_norm=jnp.sqrt(jnp.sum(pixels.weights[:, None] * left**2, axis=0)),
        noise=jnp.sqrt(variance),
        steps=jnp.max(steps),
        converged=jnp.all(ended),
        full_value=value.T,
        full_covariance=covariance,
        forward=jax.tree_util.Partial(
            functools.partial(predict_coefficients, p_max), lighting
        ),
        tolerance=tolerance,
        names=tuple(
            f"a_{l}" if p_max is None else f"rho_{l}{p}{q}" for l, p, q in asked
        ),
    )


def predict_coefficients(
    p_max: int | None, lighting: jax.Array, value: jax.Array, gbuffer: GBuffer
) -> jax.Array:
    """Predict a picture of the estimated reflectance under its light."""
    normals, views = (a.reshape(-1, 3) for a in (gbuffer.normals, gbuffer.views))
    normals, views = (jnp.asarray(a, lighting.dtype) for a in (normals, views))
    values = predicted(columns(lighting, normals, views, p_max), value)
    return covered(gbuffer, values.reshape(*gbuffer.mask.shape, -1))
