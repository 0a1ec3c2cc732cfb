"""Lighting from pictures whose exposure or white balance is not known."""

from __future__ import annotations

from typing import NamedTuple

import jax
from jaxtyping import Bool, Float

from shjax.arrays import Array
from shjax.inverse.estimate import Estimate
from shjax.inverse.lighting import fit_lighting, fit_settings
from shjax.inverse.linear.priors import PicturePrior
from shjax.inverse.linear.reweighting import make_loss
from shjax.inverse.shown.surface import Surface, flat_picture


class ExposureEstimate(NamedTuple):
    """Light and exposures from pictures, :func:`estimate_exposure`.

    Attributes:
        lighting: The light, given the exposures.
        gains: Exposure and white balance of each picture over the first's, ``(V, C)``.
    """

    lighting: Estimate
    gains: Float[jax.Array, "V C"]


def estimate_exposure(
    images: Float[Array, "V *points C"],
    normals_or_surface: Surface | Float[Array, ...],
    *,
    mask: Float[Array, ...] | Bool[Array, ...] | None = None,
    albedo: Float[Array, ...] | float = 1.0,
    l_max: int = 2,
    noise: Float[Array, ...] | float | None = None,
    prior: str | PicturePrior | Float[Array, ...] | None = "picture",
) -> ExposureEstimate:
    """Estimate lighting together with the exposure and white balance of each picture.

    Args:
        images: Linear radiance of V >= 2 pictures under one light.
        normals_or_surface: Of each picture, as in :func:`shjax.estimate_lighting`.
        mask: As there.
        albedo: As there.
        l_max: As there. Static.
        noise: As there.
        prior: As there.

    Raises:
        ValueError: As there, or if there are not several pictures.
    """
    picture = flat_picture(images, normals_or_surface, mask, albedo)
    if images.ndim < 3:
        raise ValueError(f"images must have shape (V, *points, C); got {images.shape}.")
    given = fit_settings(picture, l_max, noise, prior)
    found, gains = fit_lighting(
        picture,
        given.noise,
        given.deviations,
        None,
        l_max=l_max,
        highest=given.highest,
        loss=make_loss("squares"),
        pictures=images.shape[0],
    )
    return ExposureEstimate(found, gains)
