"""Lighting from pictures of known objects.

The picture is linear in the lighting, whatever the surface: see :mod:`.rows`. The rows
are compressed by QR once; plain least squares, or the average over priors that
marginalises higher degrees, then work on as many rows as there are unknowns.

References:
    [RH01] R. Ramamoorthi and P. Hanrahan, On the relationship between radiance and
    irradiance: determining the illumination from images of a convex Lambertian object,
    JOSA A, 2001.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Bool, Float

from shjax.arrays import Array, as_float
from shjax.brdf import Brdf
from shjax.estimate import Estimate
from shjax.harmonics.degrees import check_l_max, degrees
from shjax.inverse import priors
from shjax.inverse.compression import (
    Compressed,
    compress,
    first_columns,
    noise_variance,
)
from shjax.inverse.linear import diagnose, embed, least_squares
from shjax.inverse.pictures import Pixels, check_unit, fit, flatten
from shjax.inverse.predicting import predict_lighting
from shjax.inverse.reweighting import Loss, make_loss, reweighted
from shjax.inverse.rows import (
    cosine_rows,
    footprint_rows,
    glossy_rows,
    seen_by_cosine,
    table_to,
)

_FORGIVEN = 1e-3  # share of an unknown in the null space, below which it is determined


def estimate_lighting(
    image: Float[Array, "*points C"],
    normals: Float[Array, ...] | None,
    *,
    mask: Float[Array, ...] | Bool[Array, ...] | None = None,
    albedo: Float[Array, ...] | float = 1.0,
    l_max: int = 2,
    noise: Float[Array, ...] | float | None = None,
    prior: Any = "picture",
    fit_l_max: int = priors.FIT_L_MAX,
    brdf: Brdf | None = None,
    views: Float[Array, ...] | None = None,
    least_cosine: float = 0.2,
    rows: Float[Array, ...] | None = None,
    loss: str = "squares",
    clipped: Bool[Array, ...] | None = None,
) -> Estimate:
    """Lighting coefficients from one picture or several, and how far to trust them.

    By default degrees up to ``fit_l_max`` are estimated under a Gaussian prior whose scale
    and slope come from the picture (:mod:`.priors`), and those up to ``l_max`` returned:
    light of degree 4, 6, ... looks like degrees 0 to 2 on the visible half of the normals,
    and left out, it is an error of a sixth of the light without any noise.

    Args:
        image: Linear radiance of the pixels, any leading shape; several pictures of
            objects under one light are stacked in front.
        normals: Their unit normals ``(*points, 3)``, zero for pixels that show nothing;
            or those of each pixel's parts, ``(*points, S, 3)``, zero for parts that show
            nothing (:func:`shjax.render.footprints`): then pixels on an outline serve
            too. None where ``rows`` are given.
        mask: Weights >= 0 of the squared residuals ``(*points)``; default 1 wherever
            there is a normal. With one normal a pixel leave out those on an outline.
        albedo: A number, or an array that broadcasts to ``image``.
        l_max: Highest degree returned, inclusive. Static. What a matte surface cannot
            show (odd degrees above 1) is 0 and in ``null_space``.
        noise: Standard deviation of a pixel of weight 1, a number or ``(C,)``; None:
            estimated from the residual.
        prior: ``"picture"``; None, plain least squares to ``l_max``; or standard
            deviations over L_00 of one's own, one a degree, ``(fit_l_max + 1,)``.
        fit_l_max: Highest degree under the prior. Static.
        brdf: A reflectance in place of the matte surface, about normal or reflected
            direction; ``albedo`` still scales it.
        views: Unit vectors to the viewer, ``(*points, 3)``; needed with ``brdf``.
        least_cosine: Pixels with ``n.v`` below are left out, with ``brdf``. Static.
        rows: What each pixel receives of each coefficient at albedo 1, ``(*points, K)``
            or ``(*points, K, C)``, in place of all that: a shadowed mesh
            (:func:`shjax.inverse.visible_cosine`), or a renderer of one's own.
        loss: ``"squares"``, ``"huber"`` (outliers count by their distance) or
            ``"cauchy"`` (they count ever less). Static.
        clipped: Channels at their largest value ``(*points, C)``: the light may be more,
            never less (:func:`shjax.inverse.decode`).

    Returns:
        An :class:`Estimate` with ``value`` ``((l_max + 1)^2, C)``, radiance; its
        ``full_value`` holds the degrees above.

    Raises:
        ValueError: If shapes do not fit, a choice is unknown, an unmasked pixel is not
            finite, or a vector is not of unit length.
    """
    check_l_max(l_max)
    check_l_max(fit_l_max, "fit_l_max")
    highest = l_max if prior is None else max(l_max, fit_l_max)
    surface = _surface(image, normals, mask, albedo, brdf, views, least_cosine, rows)
    highest = _highest(surface, highest, l_max)
    channels = surface.pixels.image.shape[-1]
    dtype = surface.pixels.image.dtype
    sigma = None if noise is None else fit("noise", noise, (channels,), dtype)
    if sigma is not None and not isinstance(sigma, Tracer) and bool(jnp.any(sigma < 0)):
        raise ValueError(f"noise must not be negative; got {noise}.")
    if clipped is not None:
        clipped = jnp.asarray(clipped).reshape(surface.pixels.image.shape)
    return _estimate_lighting(
        surface,
        sigma,
        _deviations(prior, highest),
        clipped,
        l_max=l_max,
        highest=highest,
        loss=make_loss(loss),
        least_cosine=least_cosine,
    )


@functools.partial(
    jax.tree_util.register_dataclass,
    data_fields=("pixels", "normals", "views", "brdf", "rows"),
    meta_fields=(),
)
@dataclasses.dataclass(frozen=True)
class Surface:
    """What the pixels show; one of normals, normals with views and brdf, rows."""

    pixels: Pixels
    normals: jax.Array | None = None
    views: jax.Array | None = None
    brdf: Brdf | None = None
    rows: jax.Array | None = None


def _surface(image, normals, mask, albedo, brdf, views, least_cosine, rows) -> Surface:
    """Check what a call describes, and flatten it."""
    points = image.shape[:-1]
    if rows is not None:
        if normals is not None or brdf is not None:
            raise ValueError("rows stand in place of normals and brdf; give only them.")
        seen = jnp.any(
            jnp.asarray(rows) != 0, axis=tuple(range(len(points), rows.ndim))
        )
        pixels = flatten(image, seen, mask, albedo)
        flat = as_float("rows", rows).astype(pixels.image.dtype)
        return Surface(pixels, rows=flat.reshape(-1, *rows.shape[len(points) :]))
    if normals is None:
        raise ValueError("normals must be given, or rows.")
    parts = normals.ndim == len(points) + 2
    if (
        normals.shape[: len(points)] != points
        or normals.shape[-1:] != (3,)
        or (not parts and normals.ndim != len(points) + 1)
    ):
        raise ValueError(
            f"normals must have shape {(*points, 3)} to fit image, or that of its pixels' "
            f"parts (..., S, 3); got {normals.shape}."
        )
    seen = jnp.any(
        jnp.asarray(normals) != 0, axis=tuple(range(len(points), normals.ndim))
    )
    pixels = flatten(image, seen, mask, albedo)
    used = (pixels.weights > 0).reshape(points)
    if parts:
        used = used[..., None] & jnp.any(jnp.asarray(normals) != 0, axis=-1)
    check_unit("normals", normals, used)
    flat = as_float("normals", normals).astype(pixels.image.dtype)
    flat = flat.reshape(-1, *normals.shape[len(points) :])
    if brdf is None:
        return Surface(pixels, normals=flat)
    if parts:
        raise ValueError("normals of parts serve matte surfaces only; got a brdf too.")
    if views is None or views.shape != (*points, 3):
        raise ValueError(
            f"views must have shape {(*points, 3)} with brdf; got "
            f"{None if views is None else views.shape}."
        )
    if any(part.model.centre == "tangent" for part in brdf.parts):
        raise ValueError("brdf must be about the normal or R; it has fibres.")
    if brdf.channels not in (1, image.shape[-1]):
        raise ValueError(
            f"brdf must have one channel or image's {image.shape[-1]}; got "
            f"{brdf.channels}."
        )
    check_unit("views", views, used)
    views = as_float("views", views).astype(pixels.image.dtype).reshape(-1, 3)
    facing = jnp.sum(flat * views, axis=-1) >= least_cosine
    pixels = pixels._replace(weights=pixels.weights * facing.astype(flat.dtype))
    return Surface(pixels, normals=flat, views=views, brdf=brdf)


def _highest(surface: Surface, highest: int, l_max: int) -> int:
    """The degree of given rows, which is that of the fit."""
    if surface.rows is None:
        return highest
    size = surface.rows.shape[1]
    own = math.isqrt(size) - 1
    if (own + 1) ** 2 != size or own < l_max:
        raise ValueError(
            f"rows must have shape (..., K) or (..., K, C), K = (l + 1)^2, l >= l_max = "
            f"{l_max}; got K = {size}."
        )
    return min(own, highest)


def _deviations(prior, highest: int):
    """Standard deviations over L_00 of a family of priors, ``(G, L)``, or None."""
    if prior is None:
        return None
    if isinstance(prior, str):
        if prior != "picture":
            raise ValueError(
                f"prior must be 'picture', None or numbers; got {prior!r}."
            )
        return priors.family(highest).deviations
    if prior.shape != (highest + 1,):
        raise ValueError(
            f"prior must have one standard deviation a degree, ({highest + 1},); got "
            f"{prior.shape}."
        )
    return jnp.asarray(prior)[None]


class _Fit(NamedTuple):
    """An answer in all fitted unknowns."""

    mean: jax.Array
    covariance: jax.Array
    share: jax.Array
    weights: jax.Array
    problem: Compressed
    variance: jax.Array
    steps: jax.Array
    converged: jax.Array


@functools.partial(
    jax.jit,
    static_argnames=("l_max", "highest", "loss", "least_cosine"),
)
def _estimate_lighting(
    surface: Surface,
    sigma: jax.Array | None,
    deviations,
    clipped: jax.Array | None,
    *,
    l_max: int,
    highest: int,
    loss: Loss,
    least_cosine: float,
) -> Estimate:
    design, seen = design_of(surface, highest, least_cosine)  # [d, n, j]
    image, weights = surface.pixels.image, surface.pixels.weights
    degree = degrees(highest)[seen]
    sd = None if deviations is None else jnp.asarray(deviations, image.dtype)[:, degree]

    few = image.shape[0] < 2 * len(degree)

    def solve(problem: Compressed) -> _Fit:
        return _solve(problem, sigma, sd, degree, few)

    if loss.name == "squares" and clipped is None:
        answer = solve(compress(design, image, weights))
    else:
        answer = reweighted(design, image, weights, clipped, loss, sigma, solve)
    return _report(answer, surface, design, seen, l_max, highest, sigma, deviations)


def design_of(
    surface: Surface, highest: int, least_cosine: float
) -> tuple[jax.Array, np.ndarray]:
    """The design with the albedo, ``(D, N, J)``, and its unknowns' positions in K."""
    if surface.rows is not None:
        seen = np.arange((highest + 1) ** 2)
        rows = surface.rows[:, seen]
    elif surface.brdf is not None:
        seen = np.arange((highest + 1) ** 2)
        table = table_to(least_cosine)
        assert surface.normals is not None
        assert surface.views is not None
        rows = glossy_rows(surface.brdf, surface.normals, surface.views, highest, table)
    else:
        seen, normals = seen_by_cosine(highest), surface.normals
        assert normals is not None
        make = footprint_rows if normals.ndim == 3 else cosine_rows
        rows = make(normals, highest)
    stacked = jnp.moveaxis(rows, -1, 0) if rows.ndim == 3 else rows[None]
    albedo = surface.pixels.albedo.T[..., None]  # [d, n, 1]
    shape = np.broadcast_shapes(stacked.shape, albedo.shape)
    return jnp.broadcast_to(stacked, shape) * jnp.broadcast_to(albedo, shape), seen


def _solve(problem: Compressed, sigma, sd, degree: np.ndarray, few: bool) -> _Fit:
    """Plain least squares, or the average over priors.

    With few pixels nothing is left over by all degrees, and the noise is taken from what
    the first two leave.
    """
    speaks = problem
    if few and sd is not None:
        speaks = first_columns(problem, int(np.sum(degree <= 2)))
    variance = noise_variance(speaks, sigma)
    if sd is not None:
        found = priors.posterior(problem, sd, _unit(problem, degree), variance)
        return _Fit(
            *found, problem, variance, jnp.asarray(1), jnp.all(jnp.isfinite(found.mean))
        )
    tolerance = _tolerance(problem)
    value, steps, ended = jax.vmap(
        functools.partial(least_squares, tolerance=tolerance)
    )(problem.r, problem.z)
    covariance, _, missing = jax.vmap(functools.partial(diagnose, tolerance=tolerance))(
        problem.r
    )
    covariance = covariance * variance[:, None, None]
    none = jnp.ones(1, problem.r.dtype)
    return _Fit(
        value.T, covariance, missing.T, none, problem, variance,
        jnp.max(steps), jnp.all(ended),
    )  # fmt: skip


def _tolerance(problem: Compressed) -> float:
    """Singular values below this share of the largest are rounding."""
    size = problem.r.shape[-1]
    return float(128 * size**0.5 * jnp.finfo(problem.r.dtype).eps)


def _unit(problem: Compressed, degree: np.ndarray) -> jax.Array:
    """About L_00: from degrees 0 and 1, lightly held together, ``(C,)``."""
    low = first_columns(problem, int(np.sum(degree <= 1)))
    gram = jnp.einsum("cji,cjk->cik", low.r, low.r)
    right = jnp.einsum("cji,cj->ci", low.r, low.z)
    tiny = jnp.finfo(gram.dtype).tiny
    held = 1e-3 * jnp.trace(gram, axis1=1, axis2=2) + tiny**0.5
    value = jnp.linalg.solve(
        gram + jax.vmap(jnp.diag)(jnp.broadcast_to(held[:, None], right.shape)),
        right[..., None],
    )
    level = jnp.abs(value[:, 0, 0])
    return jnp.where(level > 0, level, 1)


def _report(
    answer: _Fit, surface: Surface, design, seen, l_max, highest, sigma, deviations
) -> Estimate:
    """All unknowns back in their places, with what was determined."""
    size, kept = (l_max + 1) ** 2, int(np.sum(seen < (l_max + 1) ** 2))
    everything, dtype = (highest + 1) ** 2, design.dtype
    channels = answer.mean.shape[1]
    problem = answer.problem
    asked = first_columns(problem, kept)
    tolerance = _tolerance(asked)
    _, rank, missing = jax.vmap(functools.partial(diagnose, tolerance=tolerance))(
        asked.r
    )
    # The rows of all channels, and enough rows of zeros that there are K values.
    rows = channels * kept
    stacked = (
        jnp.zeros((rows + size, size), dtype)
        .at[:rows, seen[:kept]]
        .set(asked.r.reshape(-1, kept) / math.sqrt(channels))
    )
    _, singular_values, singular_vectors = jnp.linalg.svd(stacked, full_matrices=False)

    full = jnp.zeros((everything, channels), dtype).at[seen].set(answer.mean)
    covariance = jax.vmap(lambda c: embed(c, seen, everything))(answer.covariance)
    unseen = np.setdiff1d(np.arange(everything), seen)
    details: dict[str, Any] = {}
    if deviations is None:
        fraction = jnp.ones((size, channels), dtype).at[seen[:kept]].set(missing.T)
        # Unknowns are judged by the asked ones' own null space: here they are all.
        unknown = jnp.where(fraction > _FORGIVEN, jnp.inf, 0).astype(dtype)
        covariance = covariance + jax.vmap(jnp.diag, in_axes=1)(unknown)
    else:
        fraction = jnp.ones((everything, channels), dtype).at[seen].set(answer.share)
        fraction = fraction[:size]
        sd = jnp.asarray(deviations, dtype)[:, degrees(highest)[unseen]]
        unit = _unit(problem, degrees(highest)[seen])
        spread = jnp.einsum("g,gj->j", answer.weights, sd**2)
        own = (unit**2)[:, None] * spread[None]
        covariance = covariance.at[:, unseen, unseen].set(own)
        if answer.weights.shape[0] > 1:
            details = _prior_of(answer.weights, highest)
    return Estimate(
        value=full[:size],
        covariance=covariance[:, :size, :size],
        singular_values=singular_values,
        singular_vectors=singular_vectors,
        rank=rank,
        prior_fraction=fraction,
        residual_norm=_residual_norm(answer, surface, design),
        noise=jnp.sqrt(answer.variance),
        steps=answer.steps,
        converged=answer.converged,
        full_value=full,
        full_covariance=covariance,
        forward=jax.tree_util.Partial(predict_lighting, surface.brdf),
        details=details,
        tolerance=tolerance,
    )


def _residual_norm(answer: _Fit, surface: Surface, design: jax.Array) -> jax.Array:
    precise = jax.lax.Precision.HIGHEST
    shape = (answer.mean.shape[1], *design.shape[1:])
    predicted = jnp.einsum(
        "cnj,jc->nc", jnp.broadcast_to(design, shape), answer.mean, precision=precise
    )
    weights = surface.pixels.weights[:, None]
    left = jnp.where(weights > 0, surface.pixels.image - predicted, 0)
    return jnp.sqrt(jnp.sum(weights * left * left, axis=0))


def _prior_of(weights: jax.Array, highest: int) -> dict[str, jax.Array]:
    """The prior that the picture chose: means over the family."""
    family = priors.family(highest)
    columns = {
        "scale": np.log(family.scales),
        "slope": family.slopes,
        "free": family.free.astype(float),
    }
    means = {
        name: jnp.sum(weights * jnp.asarray(column, weights.dtype))
        for name, column in columns.items()
    }
    return {**means, "scale": jnp.exp(means["scale"])}
