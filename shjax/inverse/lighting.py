"""Lighting from pictures of known objects.

The picture is linear in the lighting, whatever the surface: see :mod:`.shown`. The rows
are compressed by QR once; plain least squares, or the average over priors that
marginalises higher degrees, then work on as many rows as there are unknowns.

References:
    [RH01] R. Ramamoorthi and P. Hanrahan, On the relationship between radiance and
    irradiance: determining the illumination from images of a convex Lambertian object,
    JOSA A, 2001.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Bool, Float

from shjax.arrays import Array
from shjax.harmonics.degrees import check_l_max, degrees
from shjax.inverse.estimate import Estimate
from shjax.inverse.linear import priors
from shjax.inverse.linear.balancing import balanced
from shjax.inverse.linear.compression import Compressed, compress
from shjax.inverse.linear.posterior import Fit, solve_compressed, widened
from shjax.inverse.linear.priors import PicturePrior
from shjax.inverse.linear.reporting import lighting_estimate
from shjax.inverse.linear.reweighting import Loss, make_loss, reweighted
from shjax.inverse.shown.pixels import fit
from shjax.inverse.shown.surface import (
    Picture,
    Surface,
    beyond_seen_by,
    flat_picture,
)


def estimate_lighting(
    image: Float[Array, "*points C"],
    normals_or_surface: Surface | Float[Array, ...],
    *,
    mask: Float[Array, ...] | Bool[Array, ...] | None = None,
    albedo: Float[Array, ...] | float = 1.0,
    l_max: int = 2,
    noise: Float[Array, ...] | float | None = None,
    prior: str | PicturePrior | Float[Array, ...] | None = "picture",
    loss: str = "squares",
    clipped: Bool[Array, ...] | None = None,
) -> Estimate:
    """Estimate lighting from pictures of known shape: inverse lighting with error bars.

    By default higher degrees too are estimated under a Gaussian prior whose scale and
    slope come from the picture (:mod:`.linear.priors`), and those up to ``l_max``
    returned: light of degree 4, 6, ... looks like degrees 0 to 2 on the visible half of
    the normals, and left out it is an error of 6 to 36 % of them on real places, almost
    without noise. What degrees above the fit may do to the answer is in its covariance.

    See also :func:`shjax.inverse.estimate_albedo` where albedos are not known,
    :func:`shjax.inverse.estimate_exposure` for pictures of unknown exposures, and
    :func:`shjax.inverse.nonnegative` for light that is nowhere negative.

    Args:
        image: Linear radiance of the pixels, any leading shape; several pictures of
            objects under one light are stacked in front.
        normals_or_surface: Unit normals ``(*points, 3)`` of a Lambertian surface, zero
            for pixels that show nothing, or a :class:`Surface`: glossy, or of given rows.
        mask: Weights >= 0 of the squared residuals ``(*points)``; default 1 wherever
            there is a normal. With one normal per pixel leave out those on an outline.
        albedo: Scales the reflected radiance: a number, or an array that broadcasts to
            ``image``.
        l_max: Highest degree returned, inclusive. Static. What a Lambertian surface cannot
            show (odd degrees above 1) is 0 and in ``null_space``.
        noise: Standard deviation of a pixel of weight 1, a number or ``(C,)``; None:
            estimated from the residual.
        prior: ``"picture"``; a :class:`shjax.inverse.PicturePrior` of another degree;
            None, plain least squares to ``l_max``; or standard deviations over L_00 of
            one's own, one per degree, ``(l + 1,)``, l >= l_max.
        loss: ``"squares"``, ``"huber"`` (outliers count by their distance) or
            ``"cauchy"`` (they count ever less). Static.
        clipped: Channels at their largest value ``(*points, C)``: the light may be more,
            never less (:func:`shjax.inverse.decode`).

    Returns:
        An :class:`Estimate` with ``value`` ``((l_max + 1)^2, C)``, radiance; its
        ``full_value`` holds the degrees above. Its derivatives need at least as many
        pixels as fitted unknowns (69 for a Lambertian surface and degree 10).

    Raises:
        ValueError: If shapes do not fit, a choice is unknown, an unmasked pixel is not
            finite, or a vector is not of unit length.
    """
    picture = flat_picture(image, normals_or_surface, mask, albedo)
    given = fit_settings(picture, l_max, noise, prior)
    if clipped is not None:
        if clipped.shape != image.shape:
            raise ValueError(
                f"clipped must have the shape of image {image.shape}; got "
                f"{clipped.shape}."
            )
        clipped = jnp.asarray(clipped).reshape(picture.pixels.image.shape)
    return fit_lighting(
        picture,
        given.noise,
        given.deviations,
        clipped,
        l_max=l_max,
        highest=given.highest,
        loss=make_loss(loss),
        pictures=1,
    )[0]


class FitSettings(NamedTuple):
    """Noise, the prior's deviations ``(G, L)``, and the highest degree of the fit."""

    noise: jax.Array | None
    deviations: Array | None
    highest: int


def fit_settings(picture: Picture, l_max: int, noise, prior) -> FitSettings:
    """Check and convert what a fit of a picture is given."""
    check_l_max(l_max)
    channels, dtype = picture.pixels.image.shape[-1], picture.pixels.image.dtype
    highest = priors.highest_degree(prior, l_max)
    highest = picture.surface.highest_degree(highest, l_max)
    sigma = None if noise is None else fit("noise", noise, (channels,), dtype)
    if sigma is not None and not isinstance(sigma, Tracer) and not np.all(sigma >= 0):
        raise ValueError(f"noise must be a number >= 0; got {noise}.")
    return FitSettings(sigma, priors.deviations_of(prior, highest), highest)


@functools.partial(jax.jit, static_argnames=("l_max", "highest", "loss", "pictures"))
def fit_lighting(
    picture: Picture,
    sigma: jax.Array | None,
    deviations,
    clipped: jax.Array | None,
    *,
    l_max: int,
    highest: int,
    loss: Loss,
    pictures: int,
) -> tuple[Estimate, jax.Array]:
    """Fit the light of flat pixels: the estimate, and the gains of several pictures."""
    family = deviations is not None and deviations.shape[0] > 1
    surface, (image, weights, _) = picture.surface, picture.pixels
    above = highest
    if family:
        above = surface.highest_degree(highest + priors.BEYOND, l_max)
    seen = surface.unknowns(highest)
    design = picture.design(highest)  # [d, n, j]
    degree = degrees(highest)[seen]
    sd = None if deviations is None else jnp.asarray(deviations, image.dtype)[:, degree]
    few = image.shape[0] < 2 * len(degree)

    def solve(problem: Compressed) -> Fit:
        return solve_compressed(problem, sigma, sd, degree, few)

    gains = jnp.ones((1, image.shape[1]), image.dtype)
    if pictures > 1:
        answer, gains = balanced(design, image, weights, pictures, solve)
    elif loss.name == "squares" and clipped is None:
        answer = solve(compress(design, image, weights))
    else:
        answer = reweighted(design, image, weights, clipped, loss, sigma, solve)
    if above > highest:
        left_out = surface.unknowns(above)[len(seen) :]
        overlap = beyond_seen_by(answer.problem, picture, above)
        answer = widened(answer, overlap, degrees(above)[left_out])
    found = lighting_estimate(
        answer, picture, design, seen, deviations, gains, l_max=l_max, highest=highest
    )
    return found, gains
