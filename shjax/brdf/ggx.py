"""GGX with Smith's masking and Schlick's Fresnel term, and its lost energy given back.

References:
    [W07] B. Walter et al., Microfacet Models for Refraction through Rough Surfaces, 2007.
    [H14] E. Heitz, Understanding the Masking-Shadowing Function, JCGT 2014.
    [T19] E. Turquin, Practical Multiple Scattering Compensation for Microfacet Models.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from shjax.arrays import matmul, safe_sqrt
from shjax.brdf.core import Brdf, Local, Parameters, Part, ReflectanceModel, make_brdf
from shjax.brdf.flux import outgoing_flux
from shjax.brdf.models import half_vector, lambertian
from shjax.brdf.ranges import check_range

_TERMS = 16  # Chebyshev coefficients of the directional albedo
_NODES = (64, 32)  # of its integral, in each piece of theta_i and in phi


class Half(NamedTuple):
    """Half vector ``h = l + v``, not normalised: ``|h_xy|^2``, ``h_z`` and ``|h|^2``."""

    across: jax.Array
    z: jax.Array
    squared: jax.Array


def distribution_masking(
    alpha: jax.Array, light_z: jax.Array, view_z: jax.Array, half: Half
) -> jax.Array:
    """GGX distribution and Smith masking, ``D G2 / (4 n.l n.v)`` [H14, Eq. 99]."""
    slope = alpha * alpha * half.z * half.z + half.across
    tiny = jnp.asarray(jnp.finfo(half.z.dtype).tiny, half.z.dtype)
    density = (alpha * half.squared / jnp.maximum(slope, tiny)) ** 2 / math.pi
    shadow = light_z * _masking(alpha, view_z) + view_z * _masking(alpha, light_z)
    return density / (2 * jnp.maximum(shadow, tiny))


def _masking(alpha: jax.Array, cosine: jax.Array) -> jax.Array:
    return jnp.sqrt(alpha * alpha + (1 - alpha * alpha) * cosine * cosine)


def schlick(half: Half) -> jax.Array:
    """Schlick's Fresnel factor ``(1 - v.h)^5``."""
    return jnp.maximum(1 - safe_sqrt(half.squared) / 2, 0) ** 5  # 2 v.h = |l + v|


def _single(parameters: Parameters, light: Local, view: Local) -> jax.Array:
    f0 = parameters["f0"]
    above = (light.z > 0) & (view.z > 0)
    light, view = (Local(d.x, d.y, jnp.where(above, d.z, 1)) for d in (light, view))
    half = Half(*half_vector(light, view))
    fresnel = f0 + (1 - f0) * schlick(half)
    lobe = distribution_masking(parameters["alpha"], light.z, view.z, half)
    return jnp.where(above, lobe * fresnel * light.z, 0)


def _compensated(parameters: Parameters, light: Local, view: Local) -> jax.Array:
    albedo = albedo_at(parameters["albedo_terms"], parameters["alpha"], view.z)
    gain = multiple_scattering(albedo, parameters["f0"])
    return _single(parameters, light, view) * gain


def multiple_scattering(white, f0):
    """Multiple-scattering compensation ``1 + f0 (1 - E) / E`` [T19, Eq. 16]."""
    return 1 + f0 * ((1 - white) / white)


def _with_albedo(parameters: Parameters) -> Parameters:
    return {**parameters, "albedo_terms": albedo_terms(parameters["alpha"])}


GGX = ReflectanceModel("ggx", _single)
GGX_MULTISCATTER = ReflectanceModel(
    "ggx with multiple scattering", _compensated, prepare=_with_albedo
)


def ggx(alpha: Any, f0: Any = 1.0, multiscatter: bool = False) -> Brdf:
    """GGX microfacet BRDF with Smith masking and Schlick's Fresnel term.

    Args:
        alpha: Roughness in (0, 1], the slope scale itself (glTF's roughness squared); a
            number or one per channel.
        f0: Reflectance at normal incidence in [0, 1]; a number or one per channel.
        multiscatter: Scale each view by ``1 + f0 (1 - E) / E`` with E the directional
            albedo of the same surface at f0 = 1 [T19, Eq. 16], so that a white metal
            returns what it receives. Not reciprocal at grazing views then. Static.

    Raises:
        ValueError: If a parameter is outside its range.
    """
    check_range("alpha", alpha, 0, 1, open_low=True)
    check_range("f0", f0, 0, 1)
    return make_brdf(GGX_MULTISCATTER if multiscatter else GGX, alpha=alpha, f0=f0)


def directional_albedo(alpha: jax.Array, cosine: jax.Array) -> jax.Array:
    """Directional albedo of a white single-scattering GGX surface at some n.v.

    Args:
        alpha: A number.
        cosine: n.v in (0, 1), ``(n,)``.
    """
    parameters = {"alpha": alpha[None], "f0": jnp.ones_like(alpha)[None]}
    white = Brdf((Part(GGX, parameters, jnp.ones_like(alpha)[None]),))
    half = jnp.arctan2(jnp.sqrt(1 - cosine * cosine), cosine)
    return outgoing_flux(white, 2 * half, *_NODES)[:, 0]


def albedo_terms(alpha: jax.Array) -> jax.Array:
    """Chebyshev coefficients of the directional albedo in a stretched cosine, ``(16,)``."""
    k = np.arange(_TERMS)
    angle = (k + 0.5) * np.pi / _TERMS
    s = jnp.asarray(((1 + np.cos(angle)) / 2) ** 2, alpha.dtype)
    values = directional_albedo(alpha, alpha * s / (1 + alpha - s))
    to_terms = np.cos(k[:, None] * angle) * np.where(k == 0, 1, 2)[:, None] / _TERMS
    matrix = jnp.asarray(to_terms, alpha.dtype)
    return matmul(matrix, values)


def albedo_at(terms: jax.Array, alpha: jax.Array, cosine: jax.Array) -> jax.Array:
    """Directional albedo at cosines, from :func:`albedo_terms`; below 0 that at 0."""
    mu = jnp.where(cosine > 0, cosine, 0)
    x = 2 * safe_sqrt(mu * (1 + alpha) / (mu + alpha)) - 1
    last, before = jnp.zeros_like(x), jnp.zeros_like(x)
    for k in range(_TERMS - 1, 0, -1):  # Clenshaw
        last, before = terms[k] + 2 * x * last - before, last
    return terms[0] + x * last - before


def metallic_roughness(albedo, roughness, metallic=0.0, f0=0.04) -> Brdf:
    """Metallic-roughness material of glTF: a diffuse part and multiple-scattering GGX.

    ``albedo (1 - metallic) / pi``, and GGX with ``alpha = roughness^2`` and reflectance
    ``f0 (1 - metallic) + albedo metallic`` at normal incidence [glTF 2.0, appendix B],
    with multiple scattering. The two are added: what the upper layer reflects is not
    taken from the lower one.

    Args:
        albedo: Base colour in [0, 1]; a number or one per channel.
        roughness: A number in (0, 1].
        metallic: A number in [0, 1].
        f0: Reflectance of the dielectric in [0, 1]; a number or one per channel.

    Raises:
        ValueError: If a parameter is outside its range.
    """
    check_range("albedo", albedo, 0, 1)
    check_range("roughness", roughness, 0, 1, open_low=True)
    check_range("metallic", metallic, 0, 1)
    check_range("f0", f0, 0, 1)
    dtype = jnp.result_type(float)
    albedo, f0 = jnp.broadcast_arrays(
        *(jnp.atleast_1d(jnp.asarray(a, dtype)) for a in (albedo, f0))
    )
    roughness, metallic = (jnp.asarray(a, dtype) for a in (roughness, metallic))
    specular = f0 * (1 - metallic) + albedo * metallic
    glossy = make_brdf(GGX_MULTISCATTER, alpha=roughness**2, f0=specular)
    return lambertian(albedo * (1 - metallic)) + glossy
