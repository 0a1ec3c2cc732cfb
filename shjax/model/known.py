"""What is known of a light and of a BRDF before a model is chosen."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.adapted import RANKS, Adapted, adapt, project
from shjax.arrays import Array, as_float
from shjax.brdf.core import Brdf
from shjax.envmap import EnvironmentMap
from shjax.harmonics import project_samples, sum_pixels
from shjax.harmonics.degrees import degree_of_coefs
from shjax.kernels import brdf_coefs, expand_brdf, radial_coefs
from shjax.lights import CapLights, cap_coefs, split_lights

_LIGHT_DEGREE = 100


class Light(NamedTuple):
    """What :func:`choose_model` needs to know of a light, whatever the material.

    Attributes:
        coefs: All of it, ``(K, C)``.
        lights: Its small lights, the strongest first; or None.
        rest: Coefficients without the first, the first two, ... and all of them,
            ``(n, K, C)``; or None.
    """

    coefs: jax.Array
    lights: CapLights | None
    rest: jax.Array | None


class Energies(NamedTuple):
    """What a BRDF holds of each degree, for the prediction of errors; float64 NumPy.

    Attributes:
        diffuse: Energy of the radial parts about the normal, ``(L, C)``.
        specular: Energy of the rest, ``(L, C)``.
        both: Energy of their sum, ``(L, C)``.
        rho: Coefficients of the rest, ``(L, P, P, C)``.
        cross: Their products with the diffuse part's, ``(L, P, P, C)``.
        adapted: The rest in its own view basis, of the most maps; or None.
        adapted_cross: Its products with the diffuse part's, ``(L, maps, C)``.
        error: Relative error of the quadrature.
    """

    diffuse: np.ndarray
    specular: np.ndarray
    both: np.ndarray
    rho: np.ndarray
    cross: np.ndarray
    adapted: Adapted | None
    adapted_cross: np.ndarray
    error: float


def prepare_light(lighting: EnvironmentMap | Float[Array, "K C"]) -> Light:
    """Coefficients of a light, and of what is left when its small lights are taken out.

    Args:
        lighting: An environment map, or radiance coefficients.
    """
    coefs = light_coefs(lighting)
    if not isinstance(lighting, EnvironmentMap) or lighting.layout != "latlong":
        return Light(coefs, None, None)
    lights, rest = split_lights(lighting)
    if not len(lights.heights):
        return Light(coefs, None, None)
    strongest = np.argsort(-np.sum(np.asarray(lights.flux), axis=-1), stable=True)
    lights = jax.tree.map(lambda a: jnp.asarray(a, coefs.dtype)[strongest], lights)
    one_by_one = jax.tree.map(lambda a: a[:, None], lights)
    degree = degree_of_coefs(coefs)
    each = jax.vmap(lambda one: cap_coefs(one, l_max=degree))(one_by_one)
    later = jnp.cumsum(each[::-1], axis=0)[::-1] - each
    return Light(coefs, lights, light_coefs(rest)[None] + later)


def light_coefs(lighting: EnvironmentMap | Float[Array, "K C"]) -> jax.Array:
    """Coefficients of a light as far as they matter: to degree 100 for a panorama."""
    if not isinstance(lighting, EnvironmentMap):
        return as_float("lighting", lighting)
    if lighting.layout == "latlong":
        return sum_pixels(jnp.asarray(lighting.radiance), l_max=_LIGHT_DEGREE)
    samples = (jnp.asarray(a, jnp.float32) for a in lighting.samples())
    return project_samples(*samples, l_max=_LIGHT_DEGREE)


def brdf_energies(
    brdf: Brdf, *, l_max: int = _LIGHT_DEGREE, p_max: int = 16
) -> Energies:
    """What :func:`choose_model` needs to know of a BRDF, whatever the light.

    The first call of a kind of BRDF compiles for seconds.

    Args:
        brdf: The reflectance; concrete.
        l_max: Degree of the light's coefficients, 100 for a panorama.
        p_max: Highest degree of the view that is considered.
    """
    matte, rest = split_parts(brdf)
    shape = (l_max + 1, p_max + 1, p_max + 1, brdf.channels)
    zero, flat = np.zeros(shape), np.zeros((l_max + 1, brdf.channels))
    none = np.zeros((l_max + 1, 0, brdf.channels))
    diffuse, about_r, error = flat, zero, 0.0
    if matte is not None:
        l = np.arange(l_max + 1)[:, None]
        gains = np.asarray(radial_coefs(matte, l_max=l_max), np.float64)
        diffuse = np.broadcast_to((2 * l + 1) * gains**2, flat.shape)
        about_r = np.asarray(brdf_coefs(matte, l_max=l_max, p_max=p_max), np.float64)
    if rest is None:
        return Energies(diffuse, flat, diffuse, zero, zero, None, none, error)
    sharp = expand_brdf(rest, l_max=l_max, p_max=p_max, accuracy=1e-4)
    rho = np.broadcast_to(np.asarray(sharp.rho, np.float64), shape)
    specular = np.broadcast_to(np.asarray(sharp.degree_energy, np.float64), flat.shape)
    both = specular
    if matte is not None:
        whole = expand_brdf(brdf, l_max=l_max, p_max=p_max, accuracy=1e-4)
        both = np.asarray(whole.degree_energy, np.float64)
    own = adapt(rest, maps=max(RANKS), l_max=l_max)
    held = np.asarray(own.kernels, np.float64)
    crossed = np.zeros_like(held) if matte is None else held * project(own, matte)
    error = float(sharp.error)
    return Energies(
        diffuse, specular, both, rho, about_r * rho, own, crossed, error
    )  # fmt: skip


def split_parts(brdf: Brdf) -> tuple[Brdf | None, Brdf | None]:
    """The radial parts about the normal, and the rest."""
    matte = [p for p in brdf.parts if p.model.centre == "normal" and p.model.radial]
    rest = [p for p in brdf.parts if not any(p is one for one in matte)]
    return (Brdf(tuple(matte)) if matte else None), (
        Brdf(tuple(rest)) if rest else None
    )
