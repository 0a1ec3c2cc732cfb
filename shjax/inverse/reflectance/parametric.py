"""Parametric reflectances fitted to pictures under known light."""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from shjax.arrays import Array, einsum, matmul
from shjax.brdf import Brdf
from shjax.brdf.expansion import radial_gains
from shjax.brdf.models import lambertian
from shjax.brdf.transfer_rows import ViewTable, table_to
from shjax.inverse.estimate import Estimate
from shjax.inverse.linear.compression import compress
from shjax.inverse.reflectance.families import AMPLITUDE_VARIANCE, LobeFamily
from shjax.inverse.reflectance.kernel_basis import (
    KernelBasis,
    has_basis,
    kernel_basis,
)
from shjax.inverse.reflectance.nonlinear import Found, approach, refine, search
from shjax.inverse.shown.glossy import Lit, light_up, reflected
from shjax.inverse.shown.pixels import Pixels
from shjax.inverse.shown.predicting import predict_parametric

_SEARCHED = 500  # pixels of the search from many starts
_ROUGH = 0.01  # of the picture: the search's standard deviation of a pixel
_MIN_NOISE = 1e-4  # of the picture: no better is the forward model


class Shown(NamedTuple):
    """Pixels that a reflectance is compared with: lit ones, or radial ones compressed.

    Attributes:
        lit: Of each pixel; None where compressed.
        albedo: ``(N, 1)`` or ``(N, C)``.
        root: Roots of the weights, ``(N,)``.
        image: Times the roots, ``(N, C)``; compressed right sides ``(J, C)``.
        r: Triangles ``(C, J, J)`` over the gains about the normal and about R, or over the
            diffuse part and a basis of kernels; None where nothing is compressed.
        basis: Of the lobe's kernels, or None.
    """

    lit: Lit | None
    albedo: jax.Array
    root: jax.Array
    image: jax.Array
    r: jax.Array | None = None
    basis: KernelBasis | None = None


def estimate_parameters(
    pixels: Pixels,
    normals: Array,
    views: Array,
    lighting: jax.Array,
    sigma: jax.Array | None,
    starts: jax.Array,
    *,
    kind: LobeFamily,
    min_cosine: float,
) -> Estimate:
    """Estimate a parametric lobe: search from many starts, refine the best."""
    basis = None
    if has_basis(kind) and not _radial(kind, starts, pixels):
        l_max = math.isqrt(lighting.shape[0]) - 1
        basis = kernel_basis(kind, table_to(min_cosine), l_max, starts.dtype)
    return _estimate(
        pixels,
        normals,
        views,
        lighting,
        sigma,
        starts,
        basis,
        kind=kind,
        min_cosine=min_cosine,
    )


def _radial(kind: LobeFamily, starts: jax.Array, pixels: Pixels) -> bool:
    """Whether all parts of a lobe have closed gains."""
    with jax.ensure_compile_time_eval():
        start = jnp.zeros(starts.shape[1], starts.dtype)
        brdfs, _ = kind.split(start, pixels.image.shape[-1])
    return all(p.model.radial is not None for brdf in brdfs for p in brdf.parts)


@functools.partial(jax.jit, static_argnames=("kind", "min_cosine"))
def _estimate(
    pixels: Pixels,
    normals: Array,
    views: Array,
    lighting: jax.Array,
    sigma: jax.Array | None,
    starts: jax.Array,
    basis: KernelBasis | None,
    *,
    kind: LobeFamily,
    min_cosine: float,
) -> Estimate:
    table = table_to(min_cosine)
    channels, wide = pixels.image.shape[-1], starts.dtype
    radial = _radial(kind, starts, pixels)
    lit = light_up(lighting, normals, views, table, radial=radial)
    lit = jax.tree.map(lambda a: a.astype(wide), lit)
    root = jnp.sqrt(pixels.weights).astype(wide)
    used = jnp.maximum(jnp.sum(root > 0), 1).astype(wide)
    image = jnp.where(root[:, None] > 0, pixels.image.astype(wide), 0) * root[:, None]
    power = jnp.sum(image * image, axis=0)
    level = jnp.maximum(jnp.sqrt(power / used), jnp.finfo(wide).tiny ** 0.5)
    shown = Shown(lit, pixels.albedo.astype(wide), root, image)
    rest = jnp.zeros(channels, wide)
    if radial or basis is not None:
        shown, rest = _compressed(shown, basis, diffuse=kind.diffuse)
        few = shown
    else:
        step = -(-image.shape[0] // _SEARCHED)
        few = jax.tree.map(lambda a: a[::step], shown)
    prior = tuple(jnp.asarray(a, wide) for a in kind.prior(channels))
    compare = functools.partial(_compare, kind, table)

    def squares(value, sd):
        left = compare(value, (shown, sd)).reshape(-1, channels) * sd[None]
        return jnp.sum(left * left, axis=0) + rest

    start = search(compare, (few, _ROUGH * level), starts, prior)
    if sigma is None:
        start = approach(compare, (shown, _ROUGH * level), start, prior)
        freedom = jnp.maximum(used - len(prior[0]) / channels, 1)
        sigma = jnp.sqrt(squares(start, jnp.ones(channels, wide)) / freedom)
    sigma = jnp.maximum(sigma.astype(wide), _MIN_NOISE * level)
    found = refine(compare, (shown, sigma), start, prior)
    residual = jnp.sqrt(squares(found.value, jnp.ones(channels, wide)))
    forward = jax.tree_util.Partial(functools.partial(_predict, kind), lighting)
    return parametric_estimate(
        kind, found, sigma, residual, forward, pixels.image.dtype
    )


def _compressed(
    shown: Shown, basis: KernelBasis | None, *, diffuse: bool
) -> tuple[Shown, jax.Array]:
    """A problem in its gains or kernels, and what none explain of the squares, ``(C,)``."""
    lit = shown.lit
    assert lit is not None
    if basis is None:
        both = jnp.concatenate([lit.normal, lit.mirror], axis=1)  # [n, 2 l, c]
    else:
        both = basis.columns(lit)
        if diffuse:
            white = lambertian(jnp.ones(1, both.dtype))
            gains = radial_gains(white.parts[0], lit.normal.shape[1] - 1)[:, 0]
            matte = einsum("nlc,l->nc", lit.normal, gains.astype(both.dtype))
            both = jnp.concatenate([matte[:, None], both], axis=1)
    both = both * jnp.broadcast_to(shown.albedo[:, None], both.shape)
    weights = shown.root**2
    safe = jnp.where(shown.root > 0, shown.root, 1)[:, None]
    problem = compress(jnp.transpose(both, (2, 0, 1)), shown.image / safe, weights)
    small = shown._replace(lit=None, image=problem.z.T, r=problem.r, basis=basis)
    return small, problem.rest


def _compare(
    kind: LobeFamily, table: ViewTable, value: jax.Array, args: Any
) -> jax.Array:
    """Residuals in standard deviations, flat."""
    shown, sigma = args
    channels = shown.image.shape[1]
    if shown.basis is not None:
        made = _of_kernels(kind, shown, value)
        return ((made - shown.image) / sigma[None]).ravel()
    brdfs, shares = kind.split(value, channels)
    made = jnp.zeros_like(shown.image)
    for brdf, share in zip(brdfs, shares, strict=True):
        if shown.r is None:
            part = reflected(brdf, shown.lit, table) * shown.root[:, None]
            part = part * jnp.broadcast_to(shown.albedo, part.shape)
        else:
            part = _of_gains(brdf, shown.r)
        made = made + part * share[None]
    return ((made - shown.image) / sigma[None]).ravel()


def _of_kernels(kind: LobeFamily, shown: Shown, value: jax.Array) -> jax.Array:
    """Right sides of a problem compressed over a basis of kernels, ``(J, C)``."""
    assert shown.r is not None
    assert shown.basis is not None
    channels = shown.image.shape[1]
    amplitudes = kind.shares(value[1:].reshape(-1, channels))
    parts = amplitudes[-1:] * shown.basis.shares(value[0])[:, None]
    if kind.diffuse:
        parts = jnp.concatenate([amplitudes[:1], parts])
    return einsum("cij,jc->ic", shown.r, parts)


def _of_gains(brdf: Brdf, r: jax.Array) -> jax.Array:
    """Right sides of a compressed radial problem, ``(J, C)``."""
    size = r.shape[-1] // 2
    (part,) = brdf.parts
    gains = radial_gains(part, size - 1)[:, 0]
    columns = r[..., :size] if part.model.centre == "normal" else r[..., size:]
    return einsum("cij,j->ic", columns, gains)


def _predict(kind: LobeFamily, lighting, free: jax.Array, gbuffer) -> jax.Array:
    return predict_parametric(kind.brdf(free), lighting, gbuffer)


def parametric_estimate(
    kind: LobeFamily,
    found: Found,
    sigma: jax.Array,
    residual_norm: jax.Array,
    forward: Any,
    dtype,
) -> Estimate:
    """Report the parameters in their natural form, channel by channel.

    ``full_value`` keeps the unconstrained ones, in which errors are nearly Gaussian.
    """
    channels = sigma.shape[0]
    places = kind.places(channels)
    free = found.value[places].T  # [p, c]
    each = jnp.stack([found.covariance[p[:, None], p] for p in places])
    slopes = jax.vmap(jax.jacfwd(lambda u: kind.natural(u[:, None])[:, 0]))(free.T)
    covariance = einsum("cij,cjk,clk->cil", slopes, each, slopes)
    stacked = jnp.concatenate([found.jacobian[:, p] for p in places])
    gram = matmul(stacked.T, stacked) / channels
    squares, vectors = jnp.linalg.eigh(gram)
    # Of a shape in its free form; of an albedo as it is: near 1 a logit is never known.
    shapes = len(kind.shapes)
    variance = jnp.diagonal(covariance, axis1=1, axis2=2)[:, shapes:].T
    albedos = jnp.clip(variance / AMPLITUDE_VARIANCE, 0, 1)
    share = jnp.concatenate([found.share[places].T[:shapes], albedos])
    cast = functools.partial(jnp.asarray, dtype=dtype)
    return Estimate(
        value=cast(kind.natural(free)),
        covariance=cast(covariance),
        singular_values=cast(jnp.sqrt(jnp.maximum(squares[::-1], 0))),
        singular_vectors=cast(vectors.T[::-1]),
        rank=jnp.sum(share < 0.5, axis=0),
        prior_fraction=cast(share),
        residual_norm=cast(residual_norm),
        noise=cast(sigma),
        steps=found.steps,
        converged=found.converged,
        full_value=cast(free),
        full_covariance=cast(each),
        forward=forward,
        brdf=kind.brdf(cast(free)),
        tolerance=math.sqrt(float(jnp.finfo(dtype).eps)),
        names=kind.names,
    )
