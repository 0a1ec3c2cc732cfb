"""Analytic models.

Each transfer function takes one channel's parameters and local directions. Angles between
nearly equal directions come from their difference, never from an arccosine, so that
float32 keeps its digits in the peak of a narrow lobe, and derivatives exist there.

References:
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
    [LW94] E. Lafortune, Y. Willems, Using the Modified Phong Reflectance Model for
    Physically Based Rendering, 1994.
    [L97] E. Lafortune et al., Non-Linear Approximation of Reflectance Functions, 1997.
    [EK17] A. Estevez, C. Kulla, Production Friendly Microfacet Sheen BRDF, SIGGRAPH 2017
    course: Physically Based Shading in Theory and Practice.
    [KK89] J. Kajiya, T. Kay, Rendering Fur with Three Dimensional Textures, 1989.
"""

from __future__ import annotations

import math
from typing import Any

import jax
import jax.numpy as jnp

from shjax.brdf.core import Brdf, Local, Parameters, ReflectanceModel, make_brdf
from shjax.brdf.ranges import check_range
from shjax.clamped_cosine import cosine_kernel_table


def power(base: jax.Array, exponent: jax.Array) -> jax.Array:
    """Power ``base^exponent``, 0 for base <= 0, with finite derivatives in both."""
    positive = base > 0
    return jnp.where(positive, jnp.where(positive, base, 1) ** exponent, 0)


def lobe_power(light: Local, view: Local, exponent: jax.Array) -> jax.Array:
    """Cosine lobe ``(R.l)^s``, 0 where R.l <= 0; R.l by way of ``|l - R|^2``."""
    x, y, z = light.x + view.x, light.y + view.y, light.z - view.z
    fall = (x * x + y * y + z * z) / 2  # 1 - R.l
    positive = fall < 1
    rise = jnp.log1p(-jnp.where(positive, fall, 0))
    return jnp.where(positive, jnp.exp(exponent * rise), 0)


def _lambertian(parameters: Parameters, light: Local, view: Local) -> jax.Array:
    del view
    return parameters["albedo"] / math.pi * light.z


def _lambertian_gains(parameters: Parameters, l_max: int) -> jax.Array:
    albedo = parameters["albedo"]
    return albedo / math.pi * jnp.asarray(cosine_kernel_table(l_max), albedo.dtype)


LAMBERTIAN = ReflectanceModel(
    "lambertian", _lambertian, "normal", radial=_lambertian_gains
)


def lambertian(albedo: Any = 1.0) -> Brdf:
    """Lambertian (diffuse) BRDF: ``albedo / pi`` times the cosine.

    Args:
        albedo: A number or one per channel, ``(C,)``, in [0, 1].

    Raises:
        ValueError: If the albedo is outside [0, 1].
    """
    check_range("albedo", albedo, 0, 1)
    return make_brdf(LAMBERTIAN, albedo=albedo)


def _phong(parameters: Parameters, light: Local, view: Local) -> jax.Array:
    s = parameters["exponent"]
    return (s + 1) / (2 * math.pi) * lobe_power(light, view, s)


def phong_gains(exponent: jax.Array, l_max: int) -> jax.Array:
    """Convolution gains ``a_l`` of a normalised Phong lobe of exponent s.

    ``a_l = a_(l-2) (s - l + 2) / (s + l + 1)``; exact for every real s >= 0.
    """

    def step(carry, l):
        before, last = carry
        value = before * (exponent - l + 2) / (exponent + l + 1)
        return (last, value), value

    first = jnp.ones_like(exponent)
    second = (exponent + 1) / (exponent + 2)
    degrees = jnp.arange(2, max(l_max, 1) + 1).astype(exponent.dtype)
    _, rest = jax.lax.scan(step, (first, second), degrees)
    return jnp.concatenate([jnp.stack([first, second]), rest])[: l_max + 1]


def _phong_gains(parameters: Parameters, l_max: int) -> jax.Array:
    return phong_gains(parameters["exponent"], l_max)


PHONG = ReflectanceModel("phong", _phong, horizon=False, radial=_phong_gains)
PHONG_HORIZON = ReflectanceModel("phong with horizon", _phong)


def phong(exponent, horizon: bool = False) -> Brdf:
    """Phong lobe of the thesis, ``(s + 1) / 2 pi (R.l)^s`` [T5, Eq. 5.26].

    It is a transfer function, without a cosine; without ``horizon`` it reaches below the
    surface, and is radial about R.

    Args:
        exponent: s >= 0, real; a number or one per channel.
        horizon: Whether it ends at the horizon. Static.

    Raises:
        ValueError: If the exponent is negative or not finite.
    """
    check_range("exponent", exponent, 0, 1e7)
    return make_brdf(PHONG_HORIZON if horizon else PHONG, exponent=exponent)


def _phong_cosine(parameters: Parameters, light: Local, view: Local) -> jax.Array:
    s = parameters["exponent"]
    return (s + 2) / (2 * math.pi) * lobe_power(light, view, s) * light.z


PHONG_COSINE = ReflectanceModel("phong with cosine", _phong_cosine)


def phong_cosine(exponent) -> Brdf:
    """Modified Phong BRDF ``(s + 2) / 2 pi (R.l)^s``, times the cosine [LW94, Eq. 5].

    Args:
        exponent: s >= 0, real; a number or one per channel.

    Raises:
        ValueError: If the exponent is negative or not finite.
    """
    check_range("exponent", exponent, 0, 1e7)
    return make_brdf(PHONG_COSINE, exponent=exponent)


def half_vector(light: Local, view: Local) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Half vector ``h = l + v``, not normalised: ``|h_xy|^2``, ``h_z`` and ``|h|^2``."""
    x, y, z = light.x + view.x, light.y + view.y, light.z + view.z
    across = x * x + y * y
    return across, z, across + z * z


def squared_angle(across: jax.Array, z: jax.Array) -> jax.Array:
    """Squared polar angle of a vector with ``v_z > 0``, smooth at 0."""
    above = z > 0
    t = across / jnp.where(above, z, 1) ** 2
    small = t < 1e-3
    # arctan(x)^2 / x^2 in x^2, to 1e-17 below 1e-3.
    near = jnp.where(small, t, 0)
    series = 1 - near * (
        2 / 3 - near * (23 / 45 - near * (44 / 105 - near * 563 / 1575))
    )
    angle = jnp.arctan(jnp.sqrt(jnp.where(small, 1, t)))
    return jnp.where(above, jnp.where(small, near * series, angle * angle), jnp.inf)


def _gaussian_microfacet(parameters: Parameters, light: Local, view: Local):
    sigma = parameters["sigma"]
    across, z, _ = half_vector(light, view)
    above = z > 0
    angle = squared_angle(across, jnp.where(above, z, 1))
    value = jnp.exp(-angle / sigma**2) / (4 * math.pi * sigma**2)
    return jnp.where(above, value, 0)


GAUSSIAN_MICROFACET = ReflectanceModel("gaussian microfacet", _gaussian_microfacet)


def gaussian_microfacet(sigma) -> Brdf:
    """Gaussian microfacet lobe, simplified Torrance-Sparrow [T5, Eq. 5.34].

    The thesis's simplified Torrance-Sparrow transfer function: no cosine, no masking.

    Args:
        sigma: Roughness > 0, radians; a number or one per channel.

    Raises:
        ValueError: If sigma is not positive.
    """
    check_range("sigma", sigma, 0, 10, open_low=True)
    return make_brdf(GAUSSIAN_MICROFACET, sigma=sigma)


def _lafortune(parameters: Parameters, light: Local, view: Local) -> jax.Array:
    total = jnp.zeros_like(light.z + view.z)
    for j in range(parameters["exponent"].shape[0]):
        across = parameters["cxy"][j] * (light.x * view.x + light.y * view.y)
        base = across + parameters["cz"][j] * light.z * view.z
        total = total + power(base, parameters["exponent"][j])
    return total * light.z


LAFORTUNE = ReflectanceModel("lafortune", _lafortune)


def lafortune(cxy, cz, exponent, diffuse: Any = 0.0) -> Brdf:
    """Lafortune's generalised cosine lobes and a diffuse part [L97, Eq. 9].

    ``diffuse / pi + sum_j max(cxy_j (l_x v_x + l_y v_y) + cz_j l_z v_z, 0)^n_j``.

    Args:
        cxy: A number, one per lobe, ``(J,)``, or per lobe and channel, ``(J, C)``;
            negative: forwards.
        cz: The same.
        exponent: The same; n >= 0.
        diffuse: Albedo of the Lambertian part; a number or one per channel.

    Raises:
        ValueError: If the shapes do not fit each other or an exponent is negative.
    """
    check_range("exponent", exponent, 0, 1e6)
    lobes = [jnp.asarray(a, jnp.result_type(float)) for a in (cxy, cz, exponent)]
    lobes = [jnp.atleast_1d(a) for a in lobes]
    lobes = [a[:, None] if a.ndim == 1 else a for a in lobes]
    shapes = [a.shape for a in lobes]
    if any(len(s) != 2 or s[0] != shapes[0][0] or s[0] == 0 for s in shapes):
        raise ValueError(
            "cxy, cz and exponent must have shape (J,) or (J, C), the same J >= 1; got "
            f"{', '.join(map(str, shapes))}."
        )
    names = dict(zip(("cxy", "cz", "exponent"), lobes, strict=True))
    lobe = make_brdf(LAFORTUNE, **names)
    if isinstance(diffuse, float) and diffuse == 0:
        return lobe
    return lambertian(diffuse) + lobe
