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
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Bool, Float

from shjax.arrays import Array, shape_of
from shjax.brdf import Brdf
from shjax.estimate import Estimate
from shjax.harmonics.degrees import check_l_max, degrees
from shjax.inverse import priors
from shjax.inverse.albedos import side_by_side, unknown_albedo
from shjax.inverse.compression import Compressed, compress
from shjax.inverse.exposures import balanced
from shjax.inverse.pictures import fit
from shjax.inverse.positive import without_negative_light
from shjax.inverse.reporting import Fit, report
from shjax.inverse.reweighting import Loss, make_loss, reweighted
from shjax.inverse.solving import solve_compressed, widened
from shjax.inverse.surfaces import (
    Surface,
    beyond_seen_by,
    design_of,
    highest_degree,
    make_surface,
    unknowns_of,
)


def estimate_lighting(
    image: Float[Array, "*points C"],
    normals: Float[Array, ...] | None,
    *,
    mask: Float[Array, ...] | Bool[Array, ...] | None = None,
    albedo: Float[Array, ...] | float | None = 1.0,
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
    nonnegative: bool = False,
    balance: bool = False,
) -> Estimate:
    """Lighting coefficients from one picture or several, and how far to trust them.

    By default degrees up to ``fit_l_max`` are estimated under a Gaussian prior whose scale
    and slope come from the picture (:mod:`.priors`), and those up to ``l_max`` returned:
    light of degree 4, 6, ... looks like degrees 0 to 2 on the visible half of the normals,
    and left out it is an error of 6 to 36 % of them on real places, almost without noise.
    What degrees above ``fit_l_max`` may do to the answer is in its covariance.

    Args:
        image: Linear radiance of the pixels, any leading shape; several pictures of
            objects under one light are stacked in front.
        normals: Their unit normals ``(*points, 3)``, zero for pixels that show nothing;
            or those of each pixel's parts, ``(*points, S, 3)``, zero for parts that show
            nothing (:func:`shjax.render.footprints`): then pixels on an outline serve
            too. None where ``rows`` are given.
        mask: Weights >= 0 of the squared residuals ``(*points)``; default 1 wherever
            there is a normal. With one normal a pixel leave out those on an outline.
        albedo: A number, or an array that broadcasts to ``image``. None: not known;
            ``image`` is then ``(V, *points, C)``, V lights on a matte surface of
            ``normals`` ``(*points, 3)``, and the answer has a channel for each light and
            colour, ``(K, V C)``, up to one scale a colour, with the albedos, of mean 1,
            in ``details["albedo"]``.
        l_max: Highest degree returned, inclusive. Static. What a matte surface cannot
            show (odd degrees above 1) is 0 and in ``null_space``.
        noise: Standard deviation of a pixel of weight 1, a number or ``(C,)``; None:
            estimated from the residual.
        prior: ``"picture"``; None, plain least squares to ``l_max``; or standard
            deviations over L_00 of one's own, one a degree, ``(fit_l_max + 1,)``.
        fit_l_max: Highest degree under the prior. Of real places without noise, 10 left
            the nine off by 15 % in the median and 20 by 6 %, in fifteen times the time;
            from 2 % noise on they are alike. Static.
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
        nonnegative: Whether the light, seen through a non-negative kernel of the fit's
            degree, may be nowhere negative; its covariance is not narrower for it. It
            steadies noisy pictures (a lamp, noise 6 % of the brightest pixel: 19 to 16 %,
            medians of 12), and costs accuracy in clean ones (at 0.6 %: 3 to 5 %). Static.
        balance: Whether each of several pictures (the first axis of ``image``) has an
            exposure and white balance of its own, relative to the first:
            ``details["gains"]``, ``(V, C)``. Static.

    Returns:
        An :class:`Estimate` with ``value`` ``((l_max + 1)^2, C)``, radiance; its
        ``full_value`` holds the degrees above. Its derivatives need at least as many
        pixels as fitted unknowns (69 for a matte surface and degree 10).

    Raises:
        ValueError: If shapes do not fit, a choice is unknown, an unmasked pixel is not
            finite, or a vector is not of unit length.
    """
    check_l_max(l_max)
    check_l_max(fit_l_max, "fit_l_max")
    found_albedo = None
    if albedo is None:
        found_albedo = unknown_albedo(image, normals, mask, brdf, rows, l_max)
        image, albedo = side_by_side(image, found_albedo)
        if clipped is not None:
            clipped = jnp.moveaxis(jnp.asarray(clipped), 0, -2).reshape(image.shape)
    if balance and (
        len(shape_of("image", image)) < 3 or loss != "squares" or clipped is not None
    ):
        raise ValueError(
            "balance needs pictures (V, *points, C), loss 'squares' and clipped None; got "
            f"shape {image.shape}, {loss!r}."
        )
    highest = l_max if prior is None else max(l_max, fit_l_max)
    surface = make_surface(
        image, normals, mask, albedo, brdf, views, least_cosine, rows
    )
    highest = highest_degree(surface, highest, l_max)
    channels = surface.pixels.image.shape[-1]
    dtype = surface.pixels.image.dtype
    sigma = None if noise is None else fit("noise", noise, (channels,), dtype)
    if sigma is not None and not isinstance(sigma, Tracer) and not jnp.all(sigma >= 0):
        raise ValueError(f"noise must be a number >= 0; got {noise}.")
    if clipped is not None:
        if clipped.shape != image.shape:
            raise ValueError(
                f"clipped must have the shape of image {image.shape}; got "
                f"{clipped.shape}."
            )
        clipped = jnp.asarray(clipped).reshape(surface.pixels.image.shape)
    found = _estimate_lighting(
        surface,
        sigma,
        _deviations(prior, highest),
        clipped,
        l_max=l_max,
        highest=highest,
        loss=make_loss(loss),
        least_cosine=least_cosine,
        nonnegative=nonnegative,
        pictures=image.shape[0] if balance else 1,
    )
    if found_albedo is None:
        return found
    return dataclasses.replace(found, details=found.details | {"albedo": found_albedo})


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
    if np.shape(prior) != (highest + 1,):
        raise ValueError(
            f"prior must have one standard deviation a degree, ({highest + 1},); got "
            f"{np.shape(prior)}."
        )
    if not isinstance(prior, Tracer) and not np.all(np.asarray(prior) > 0):
        raise ValueError(f"prior must be positive; got {prior}.")
    return jnp.asarray(prior)[None]


@functools.partial(
    jax.jit,
    static_argnames=(
        "l_max",
        "highest",
        "loss",
        "least_cosine",
        "nonnegative",
        "pictures",
    ),
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
    nonnegative: bool,
    pictures: int,
) -> Estimate:
    family = deviations is not None and deviations.shape[0] > 1
    above = (
        highest_degree(surface, highest + priors.BEYOND, l_max) if family else highest
    )
    seen = unknowns_of(surface, highest)
    design = design_of(surface, highest, least_cosine)  # [d, n, j]
    image, weights = surface.pixels.image, surface.pixels.weights
    degree = degrees(highest)[seen]
    sd = None if deviations is None else jnp.asarray(deviations, image.dtype)[:, degree]

    few = image.shape[0] < 2 * len(degree)

    def solve(problem: Compressed) -> Fit:
        return solve_compressed(problem, sigma, sd, degree, few)

    gains = None
    if pictures > 1:
        answer, gains = balanced(design, image, weights, pictures, solve)
    elif loss.name == "squares" and clipped is None:
        answer = solve(compress(design, image, weights))
    else:
        answer = reweighted(design, image, weights, clipped, loss, sigma, solve)
    if above > highest:
        left_out = unknowns_of(surface, above)[len(seen) :]
        overlap = beyond_seen_by(answer.problem, surface, above, least_cosine)
        answer = widened(answer, overlap, degrees(above)[left_out])
    found = report(
        answer, surface, design, seen, deviations, gains, l_max=l_max, highest=highest
    )
    return without_negative_light(found) if nonnegative else found
