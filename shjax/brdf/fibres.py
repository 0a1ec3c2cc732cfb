"""Cloth and hair: Charlie sheen and Kajiya-Kay fibres.

References:
    [EK17] A. Estevez, C. Kulla, Production Friendly Microfacet Sheen BRDF, SIGGRAPH 2017
    course: Physically Based Shading in Theory and Practice.
    [KK89] J. Kajiya, T. Kay, Rendering Fur with Three Dimensional Textures, 1989.
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
"""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp

from shjax.arrays import safe_sqrt
from shjax.brdf.core import Brdf, Local, Parameters, ReflectanceModel, make_brdf
from shjax.brdf.models import half_vector, power
from shjax.brdf.ranges import check_range


def _sheen_masking(cosine: jax.Array, alpha: jax.Array) -> jax.Array:
    """Smith's Lambda of the sheen distribution, as [EK17, section 3] fits it."""
    share = (1 - alpha) ** 2
    a, b, c, d, e = (
        rough + (smooth - rough) * share
        for rough, smooth in (
            (21.5473, 25.3245),
            (3.82987, 3.32435),
            (0.19823, 0.16801),
            (-1.97760, -1.27393),
            (-4.32054, -4.85967),
        )
    )

    def curve(x: jax.Array) -> jax.Array:
        return a / (1 + b * power(x, c)) + d * x + e

    middle = curve(jnp.full_like(cosine, 0.5))
    low, high = curve(jnp.minimum(cosine, 0.5)), curve(1 - jnp.maximum(cosine, 0.5))
    return jnp.exp(jnp.where(cosine < 0.5, low, 2 * middle - high))


def _charlie(parameters: Parameters, light: Local, view: Local) -> jax.Array:
    alpha = parameters["alpha"]
    above = (light.z > 0) & (view.z > 0)
    light, view = (Local(d.x, d.y, jnp.where(above, d.z, 1)) for d in (light, view))
    across, _, squared = half_vector(light, view)
    density = (2 + 1 / alpha) / (2 * math.pi) * power(across / squared, 1 / (2 * alpha))
    hidden = 1 + _sheen_masking(light.z, alpha) + _sheen_masking(view.z, alpha)
    # V = 1 / (4 n.l n.v (1 + Lambda_l + Lambda_v)), times the cosine n.l.
    return jnp.where(above, density / (4 * view.z * hidden), 0)


CHARLIE = ReflectanceModel("charlie sheen", _charlie)


def charlie(alpha) -> Brdf:
    """Sheen of cloth: glTF's Charlie distribution of inverted Gaussians [EK17, Eq. 2].

    White; scale it by glTF's ``sheenColorFactor``. What it returns lies towards grazing
    views, where ``n.h`` is small.

    Args:
        alpha: Roughness in (0, 1], glTF's ``sheenRoughnessFactor`` squared; a number or
            one per channel.

    Raises:
        ValueError: If alpha is outside its range.
    """
    check_range("alpha", alpha, 0, 1, open_low=True)
    return make_brdf(CHARLIE, alpha=alpha)


def _kajiya_kay(parameters: Parameters, light: Local, view: Local) -> jax.Array:
    # cos(ti - to): about the tangent, sin ti is the part across it.
    return power(
        light.z * view.z + _across(light) * _across(view), parameters["exponent"]
    )


def _across(direction: Local) -> jax.Array:
    return safe_sqrt(direction.x * direction.x + direction.y * direction.y)


KAJIYA_KAY = ReflectanceModel("kajiya-kay", _kajiya_kay, "tangent", horizon=False)


def kajiya_kay(exponent) -> Brdf:
    """Kajiya-Kay hair and fibre reflection about the tangent [KK89; T5, section 5.3.1].

    Where the cosine is positive; zero elsewhere. A transfer function without horizon.

    Args:
        exponent: s >= 0, real; a number or one per channel.

    Raises:
        ValueError: If the exponent is negative or not finite.
    """
    check_range("exponent", exponent, 0, 1e7)
    return make_brdf(KAJIYA_KAY, exponent=exponent)
