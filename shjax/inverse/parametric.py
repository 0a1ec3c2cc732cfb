"""Parametric reflectances fitted to pictures under known light."""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from shjax.brdf import Brdf
from shjax.estimate import Estimate
from shjax.inverse.compression import compress
from shjax.inverse.families import AMPLITUDE_VARIANCE, Family, family
from shjax.inverse.glossy import Lit, ViewTable, light_up, reflected, table_to
from shjax.inverse.nonlinear import Found, approach, refine, search
from shjax.inverse.pictures import Pixels
from shjax.inverse.predicting import predict_parametric
from shjax.kernels import radial_gains

_SEARCHED = 500  # pixels of the search from many starts
_ROUGH = 0.01  # of the picture: the search's standard deviation of a pixel
_LEAST_NOISE = 1e-4  # of the picture: no better is the forward model


class Shown(NamedTuple):
    """What a reflectance is compared with: lit pixels, or radial ones compressed.

    Attributes:
        lit: Of each pixel; None where compressed.
        albedo: ``(N, 1)`` or ``(N, C)``.
        root: Roots of the weights, ``(N,)``.
        image: Times the roots, ``(N, C)``; compressed right sides ``(J, C)``.
        r: Triangles over the gains about the normal and about R, ``(C, J, J)``, or None.
    """

    lit: Lit | None
    albedo: jax.Array
    root: jax.Array
    image: jax.Array
    r: jax.Array | None = None


@functools.partial(jax.jit, static_argnames=("model", "least_cosine"))
def estimate_parameters(
    pixels: Pixels,
    normals: jax.Array,
    views: jax.Array,
    lighting: jax.Array,
    sigma: jax.Array | None,
    starts: jax.Array,
    *,
    model: str,
    least_cosine: float,
) -> Estimate:
    """Search from all starts on a part of the pixels, refine the best on all."""
    kind, table = family(model), table_to(least_cosine)
    channels, wide = pixels.image.shape[-1], starts.dtype
    brdfs, _ = kind.split(starts[0], channels)
    radial = all(p.model.radial is not None for brdf in brdfs for p in brdf.parts)
    lit = light_up(lighting, normals, views, table, radial=radial)
    lit = jax.tree.map(lambda a: a.astype(wide), lit)
    root = jnp.sqrt(pixels.weights).astype(wide)
    used = jnp.maximum(jnp.sum(root > 0), 1).astype(wide)
    image = jnp.where(root[:, None] > 0, pixels.image.astype(wide), 0) * root[:, None]
    power = jnp.sum(image * image, axis=0)
    level = jnp.maximum(jnp.sqrt(power / used), jnp.finfo(wide).tiny ** 0.5)
    shown = Shown(lit, pixels.albedo.astype(wide), root, image)
    rest = jnp.zeros(channels, wide)
    if radial:
        shown, rest = _compressed(shown)
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
    sigma = jnp.maximum(sigma.astype(wide), _LEAST_NOISE * level)
    found = refine(compare, (shown, sigma), start, prior)
    residual = jnp.sqrt(squares(found.value, jnp.ones(channels, wide)))
    forward = jax.tree_util.Partial(functools.partial(_predict, model), lighting)
    return report(kind, found, sigma, residual, forward, pixels.image.dtype)


def _compressed(shown: Shown) -> tuple[Shown, jax.Array]:
    """A radial problem in its gains, and what no gains explain of the squares, ``(C,)``."""
    assert shown.lit is not None
    both = jnp.concatenate([shown.lit.normal, shown.lit.mirror], axis=1)  # [n, 2 l, c]
    both = both * jnp.broadcast_to(shown.albedo[:, None], both.shape)
    weights = shown.root**2
    safe = jnp.where(shown.root > 0, shown.root, 1)[:, None]
    problem = compress(jnp.transpose(both, (2, 0, 1)), shown.image / safe, weights)
    return shown._replace(lit=None, image=problem.z.T, r=problem.r), problem.rest


def _compare(kind: Family, table: ViewTable, value: jax.Array, args: Any) -> jax.Array:
    """Residuals in standard deviations, flat."""
    shown, sigma = args
    channels = shown.image.shape[1]
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


def _of_gains(brdf: Brdf, r: jax.Array) -> jax.Array:
    """Right sides of a compressed radial problem, ``(J, C)``."""
    size = r.shape[-1] // 2
    (part,) = brdf.parts
    gains = radial_gains(part, size - 1)[:, 0]
    columns = r[..., :size] if part.model.centre == "normal" else r[..., size:]
    return jnp.einsum("cij,j->ic", columns, gains, precision=jax.lax.Precision.HIGHEST)


def _predict(model: str, lighting, free: jax.Array, gbuffer) -> jax.Array:
    return predict_parametric(family(model).brdf(free), lighting, gbuffer)


def report(
    kind: Family,
    found: Found,
    sigma: jax.Array,
    residual_norm: jax.Array,
    forward: Any,
    dtype,
) -> Estimate:
    """The parameters as a person knows them, channel by channel.

    ``full_value`` keeps the unconstrained ones, in which errors are nearly Gaussian.
    """
    channels = sigma.shape[0]
    places = kind.places(channels)
    free = found.value[places].T  # [p, c]
    each = jnp.stack([found.covariance[p[:, None], p] for p in places])
    slopes = jax.vmap(jax.jacfwd(lambda u: kind.natural(u[:, None])[:, 0]))(free.T)
    precise = jax.lax.Precision.HIGHEST
    covariance = jnp.einsum("cij,cjk,clk->cil", slopes, each, slopes, precision=precise)
    stacked = jnp.concatenate([found.jacobian[:, p] for p in places])
    gram = jnp.matmul(stacked.T, stacked, precision=precise) / channels
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
        details={"brdf": kind.brdf(cast(free))},
        tolerance=math.sqrt(float(jnp.finfo(dtype).eps)),
        names=kind.names,
    )
