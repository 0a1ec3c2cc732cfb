"""How far an estimated light is from the true one.

References:
    [LeG19] C. LeGendre et al., DeepLight: Learning Illumination for Unconstrained Mobile
    Mixed Reality, CVPR 2019: mirror, matte silver and diffuse spheres; angular error.
    [GJAF09] R. Grosse, M. Johnson, E. Adelson, W. Freeman, Ground truth dataset and
    baseline evaluations for intrinsic image algorithms, ICCV 2009: scale invariance.
    [W22] G. Wang et al., StyleLight, ECCV 2022: the three numbers on three spheres.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

from shjax import render
from shjax.arrays import Array, as_float, as_number_or_float, safe_sqrt, shape_of
from shjax.brdf import ggx, lambertian
from shjax.clamped_cosine import irradiance
from shjax.harmonics.degrees import degree_of_coefs, degrees

MATTE_SILVER = 0.3  # the glossy sphere's GGX alpha, f0 = 1


class LightingError(NamedTuple):
    """Relative L2 error of lighting coefficients.

    Attributes:
        total: Over all degrees and channels.
        per_degree: Over each degree's own norm, ``(l_max + 1,)``; infinite where the true
            light has nothing and the predicted one something, 0 where both have nothing.
    """

    total: jax.Array
    per_degree: jax.Array


def lighting_error(
    predicted: Float[Array, "K C"], truth: Float[Array, "J C"], *, l_max: int = 2
) -> LightingError:
    """Error of lighting coefficients to ``l_max``, in total and for each degree.

    Args:
        predicted: Coefficients; what it does not reach counts as 0.
        truth: Coefficients.
        l_max: Highest degree compared. Static.

    Raises:
        ValueError: If a shape is wrong, or the truth ends below ``l_max``.
    """
    size = (l_max + 1) ** 2
    degree_of_coefs(predicted, "predicted")
    if degree_of_coefs(truth, "truth") < l_max:
        raise ValueError(f"truth must reach l_max = {l_max}; got {truth.shape}.")
    if predicted.shape[-1] != truth.shape[-1]:
        raise ValueError(
            "predicted and truth must have the same channels; got "
            f"{predicted.shape[-1]} and {truth.shape[-1]}."
        )
    missing = max(size - predicted.shape[0], 0)
    guess, exact = as_float("predicted", predicted), as_float("truth", truth)[:size]
    guess = jnp.pad(guess, ((0, missing), (0, 0)))[:size].astype(exact.dtype)
    apart, own = (
        jax.ops.segment_sum(
            jnp.sum(a * a, axis=1), degrees(l_max), num_segments=l_max + 1
        )
        for a in (guess - exact, exact)
    )
    return LightingError(_ratio(jnp.sum(apart), jnp.sum(own)), _ratio(apart, own))


def _ratio(apart: jax.Array, own: jax.Array) -> jax.Array:
    """The root of a quotient; 0 / 0 is 0."""
    nonzero = own > 0
    root = safe_sqrt(apart / jnp.where(nonzero, own, 1))
    return jnp.where(nonzero, root, jnp.where(apart > 0, jnp.inf, 0))


class IrradianceErrors(NamedTuple):
    """Irradiance error over normals, mean and maximum, relative to the true mean."""

    mean: jax.Array
    max: jax.Array


def irradiance_errors(
    predicted: Float[Array, "K C"],
    truth: Float[Array, "J C"],
    normals: Float[Array, "N 3"],
) -> IrradianceErrors:
    """Irradiance error of predicted lighting over normals.

    Args:
        predicted: Lighting coefficients.
        truth: The same, to degree 10 or so: irradiance hardly has more.
        normals: Unit normals.

    Raises:
        ValueError: If a shape is wrong.
    """
    exact = irradiance(truth, normals)
    apart = jnp.abs(irradiance(predicted, normals) - exact)
    mean = jnp.mean(exact)
    mean = jnp.where(mean == 0, 1, mean)
    return IrradianceErrors(jnp.mean(apart) / mean, jnp.max(apart) / mean)


class PictureErrors(NamedTuple):
    """Error of a picture against another, over its mask.

    Attributes:
        rmse: Root mean squared error, in the picture's units.
        si_rmse: The same after the scale of all channels that makes it least [GJAF09].
        angular: Mean angle between the colours, degrees [LeG19].
    """

    rmse: jax.Array
    si_rmse: jax.Array
    angular: jax.Array


def picture_errors(
    picture: Float[Array, "H W C"],
    truth: Float[Array, "H W C"],
    mask: Float[Array, "H W"] | Bool[Array, "H W"],
) -> PictureErrors:
    """RMSE, scale-invariant RMSE and angular error of a picture.

    Args:
        picture: Linear radiance.
        truth: Linear radiance.
        mask: Weights of the pixels.

    Raises:
        ValueError: If the shapes differ.
    """
    shapes = [
        shape_of(name, a)
        for name, a in (("picture", picture), ("truth", truth), ("mask", mask))
    ]
    if shapes[0] != shapes[1] or mask.shape != truth.shape[:-1]:
        raise ValueError(
            "picture and truth must have one shape and mask theirs without channels; "
            f"got {picture.shape}, {truth.shape} and {mask.shape}."
        )
    picture, truth = as_float("picture", picture), as_float("truth", truth)
    weights = as_number_or_float("mask", mask, truth.dtype)[..., None]
    shape = truth.shape
    wide = jnp.broadcast_to(weights, shape)

    def rmse(guess):
        total = jnp.sum(wide)
        return safe_sqrt(
            jnp.sum(wide * (guess - truth) ** 2) / jnp.where(total > 0, total, 1)
        )

    power = jnp.sum(wide * picture * picture)
    scale = jnp.sum(wide * picture * truth) / jnp.where(power > 0, power, 1)
    # Half the angle from the two unit vectors' difference and sum keeps its digits.
    one, two = (a / _length(a) for a in (picture, truth))
    across, along = (safe_sqrt(jnp.sum(a * a, axis=-1)) for a in (one - two, one + two))
    both = jnp.all(jnp.stack([_lit(a) for a in (picture, truth)]), axis=0)
    counted = weights[..., 0] * both.astype(truth.dtype)
    total = jnp.sum(counted)
    angle = jnp.sum(
        counted * 2 * jnp.arctan2(across, jnp.where(across + along > 0, along, 1))
    )
    angle = angle / jnp.where(total > 0, total, 1)
    return PictureErrors(rmse(picture), rmse(scale * picture), jnp.degrees(angle))


def _lit(picture: jax.Array) -> jax.Array:
    return jnp.any(picture != 0, axis=-1)


def _length(picture: jax.Array) -> jax.Array:
    length = safe_sqrt(jnp.sum(picture * picture, axis=-1, keepdims=True))
    return jnp.broadcast_to(jnp.where(length > 0, length, 1), picture.shape)


def three_spheres(
    radiance: Float[Array, "n_theta n_phi C"], *, size: int = 64
) -> dict[str, jax.Array]:
    """Render a mirror, a matte silver and a diffuse sphere under a light [LeG19, W22].

    Args:
        radiance: Panorama as it is stored, with an even number of columns.
        size: Side of each picture. Static.

    Returns:
        ``"mirror"``, ``"glossy"``, ``"diffuse"``: pictures ``(size, size, C)``.
    """
    ball = render.sphere(size)
    return {
        "mirror": render.mirrored(ball, radiance),
        "glossy": render.reference(ball, radiance, ggx(MATTE_SILVER, 1.0)),
        "diffuse": render.reference(ball, radiance, lambertian(1.0)),
    }


def three_sphere_errors(
    predicted: Float[Array, "rows columns C"],
    truth: Float[Array, "n_theta n_phi C"],
    *,
    size: int = 64,
) -> dict[str, PictureErrors]:
    """Score a predicted panorama on three spheres [W22, section 4].

    Args:
        predicted: Panorama as it is stored.
        truth: The same; the sizes may differ.
        size: Side of each picture. Static.
    """
    mask = render.sphere(size).mask
    pictures = [three_spheres(a, size=size) for a in (predicted, truth)]
    return {
        name: picture_errors(pictures[0][name], pictures[1][name], mask)
        for name in pictures[0]
    }
