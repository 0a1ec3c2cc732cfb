"""Reflectance from pictures of known objects under known light.

Free coefficients are linear in the picture (:mod:`.coefficients`); parametric models go
through :mod:`.parametric`.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Bool, Float

from shjax.arrays import Array, as_float, check_channels, check_vectors, shape_of
from shjax.harmonics.degrees import check_l_max, degree_of_coefs
from shjax.inverse.estimate import Estimate
from shjax.inverse.reflectance.coefficients import estimate_coefficients
from shjax.inverse.reflectance.families import LobeFamily
from shjax.inverse.reflectance.lobes import AnyLobe, General, as_search
from shjax.inverse.reflectance.parametric import estimate_parameters
from shjax.inverse.shown.pixels import Pixels, check_unit, fit, flatten

_MARGIN = 8  # degrees fitted beyond those asked for: what lies above leaks into them


def estimate_brdf(
    image: Float[Array, "*points C"],
    normals: Float[Array, "*points 3"],
    views: Float[Array, "*points 3"],
    lighting: Float[Array, "K C"],
    *,
    lobe: AnyLobe = "radial",
    mask: Float[Array, "*points"] | Bool[Array, "*points"] | None = None,
    albedo: Float[Array, ...] | float = 1.0,
    noise: Float[Array, ...] | float | None = None,
    min_cosine: float = 0.3,
) -> Estimate:
    """Estimate reflectance (a BRDF) from pictures under known light.

    Args:
        image: Linear radiance; several pictures are stacked in front.
        normals: Unit normals, zero where nothing is seen.
        views: Unit vectors to the viewer.
        lighting: The light's coefficients, to as high a degree as the surface can show
            (a lobe of exponent s shows about ``3 sqrt(s)``).
        lobe: ``"radial"``: gains ``a_l`` about R, ``(l_max + 1, C)``
            (:func:`shjax.brdf.radial_coefs`); ``"general"``: coefficients ``rho_lpq``
            (:func:`shjax.brdf_coefs`), one row for each l, p and q <= min(l, p), named; a
            parametric lobe by name, as ``"diffuse + ggx"``, of which the shape is one for
            all channels, and ``kd``, ``ks`` of each with ``kd + ks <= 1``; or what
            :func:`shjax.inverse.lobe` or its classes make of a degree, starts, a lobe of
            one's own.
        mask: Weights >= 0 of the squared residuals.
        albedo: Scales the reflectance; a number, or what broadcasts to ``image``.
        noise: Standard deviation of a pixel of weight 1, a number or ``(C,)``; None: from
            the residual.
        min_cosine: Pixels with ``n.v`` below are left out. Static.

    Returns:
        An :class:`Estimate` with named rows. A parametric lobe's ``prior_fraction`` is
        near 1 for what the picture does not determine (any exponent under uniform light);
        ``message`` names it, and ``ok`` is false. ``brdf`` is the reflectance.

    Raises:
        ValueError: If shapes do not fit, the lobe is unknown, or an unmasked pixel is
            not finite.
    """
    search = as_search(lobe)
    pixels, normals, views = check_pictures(
        image, normals, views, mask, albedo, min_cosine
    )
    dtype, channels = pixels.image.dtype, pixels.image.shape[-1]
    check_channels("lighting", lighting, "K, C", 2, batch=False)
    highest = degree_of_coefs(lighting, "lighting")
    if lighting.shape[-1] not in (1, channels):
        raise ValueError(
            f"lighting must have one channel or image's {channels}; got "
            f"{lighting.shape[-1]}."
        )
    lighting = jnp.broadcast_to(
        as_float("lighting", lighting).astype(dtype), (lighting.shape[0], channels)
    )
    sigma = None if noise is None else fit("noise", noise, (channels,), dtype)
    kind = search.kind
    if isinstance(kind, LobeFamily):
        begin = kind.starts(channels, search.starts)
        return estimate_parameters(
            pixels,
            normals,
            views,
            lighting,
            sigma,
            jnp.asarray(begin, jnp.result_type(float)),
            kind=kind,
            min_cosine=min_cosine,
        )
    l_max, p_max = check_l_max(kind.l_max), None
    if isinstance(kind, General):
        p_max = check_l_max(kind.p_max, "p_max")
    fitted = min(highest, l_max + _MARGIN if kind.fit_l_max is None else kind.fit_l_max)
    if fitted < l_max:
        raise ValueError(
            f"lighting and fit_l_max must reach l_max = {l_max}; got {fitted}."
        )
    known = lighting[: (fitted + 1) ** 2]
    return estimate_coefficients(
        pixels, normals, views, known, sigma, l_max=l_max, p_max=p_max
    )


def check_pictures(
    image, normals, views, mask, albedo, min_cosine
) -> tuple[Pixels, Array, Array]:
    """Check and flatten pictures, normals and views of pixels that face the viewer."""
    points = shape_of("image", image)[:-1]
    for name, vectors in (("normals", normals), ("views", views)):
        if shape_of(name, vectors) != (*points, 3):
            raise ValueError(
                f"{name} must have shape {(*points, 3)} to fit image; got "
                f"{vectors.shape}."
            )
    for name, vectors in (("normals", normals), ("views", views)):
        check_vectors(name, vectors)
    pixels = flatten(image, jnp.any(jnp.asarray(normals) != 0, axis=-1), mask, albedo)
    used = (pixels.weights > 0).reshape(points)
    for name, vectors in (("normals", normals), ("views", views)):
        check_unit(name, vectors, used)
    dtype = pixels.image.dtype
    normals, views = (
        as_float("normals", a).astype(dtype).reshape(-1, 3) for a in (normals, views)
    )
    facing = jnp.sum(normals * views, axis=-1) >= min_cosine
    return (
        pixels._replace(weights=pixels.weights * facing.astype(dtype)),
        normals,
        views,
    )
