"""Energies of a light and of a BRDF, from which the error of a model is predicted."""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array, as_float, as_type
from shjax.brdf.core import Brdf
from shjax.brdf.expansion import brdf_coefs, expand, radial_coefs
from shjax.envmap import EnvironmentMap
from shjax.harmonics.degrees import degree_of_coefs
from shjax.light import Light, as_light
from shjax.lights import CapLights, cap_coefs, split_lights
from shjax.reflection.low_rank import LowRankBrdf, fit_low_rank, project
from shjax.reflection.ranks import RANKS, signed_functions
from shjax.reflection.view_basis import LowRankViews

_LIGHT_DEGREE = 100


class PreparedLight(NamedTuple):
    """Light prepared for :func:`choose_model`, whatever the material.

    Attributes:
        coefs: All of it, ``(K, C)``.
        lights: Its light sources split off, the strongest first; or None.
        rest: Coefficients without the first, the first two, ... and all of them,
            ``(n, K, C)``; or None.
    """

    coefs: jax.Array
    lights: CapLights | None
    rest: jax.Array | None


class Energies(NamedTuple):
    """Energy of a BRDF by degree, for the prediction of errors; float64 NumPy.

    Attributes:
        diffuse: Energy of the radial parts about the normal, ``(L, C)``.
        specular: Energy of the rest, ``(L, C)``.
        both: Energy of their sum, ``(L, C)``.
        rho: Coefficients of the rest, ``(L, P, P, C)``.
        cross: Their products with the diffuse part's, ``(L, P, P, C)``.
        low_rank: Low-rank approximations of the rest, from few maps to many.
        low_rank_cross: Products of the last with the diffuse part, ``(L, maps, C)``.
        error: Relative error of the quadrature.
    """

    diffuse: np.ndarray
    specular: np.ndarray
    both: np.ndarray
    rho: np.ndarray
    cross: np.ndarray
    low_rank: tuple[LowRankBrdf, ...]
    low_rank_cross: np.ndarray
    error: float


def prepare_light(
    light_or_lighting: Light | Float[Array, "K C"],
) -> PreparedLight:
    """Prepare a light for :func:`choose_model`: coefficients with and without its suns.

    Args:
        light_or_lighting: An environment map, a lat-long panorama, or radiance
            coefficients ``(K, C)``.
    """
    light = as_light(light_or_lighting)
    coefs = light_coefs(light)
    if not isinstance(light, EnvironmentMap) or light.layout != "latlong":
        return PreparedLight(coefs, None, None)
    lights, rest = split_lights(light)
    if not len(lights.heights):
        return PreparedLight(coefs, None, None)
    strongest = np.argsort(-np.sum(np.asarray(lights.flux), axis=-1), stable=True)
    dtype = coefs.dtype
    lights = jax.tree.map(lambda a: as_type(np.asarray(a)[strongest], dtype), lights)
    one_by_one = jax.tree.map(lambda a: np.asarray(a)[:, None], lights)
    degree = degree_of_coefs(coefs)
    each = jax.vmap(lambda one: cap_coefs(one, l_max=degree))(one_by_one)
    later = jnp.cumsum(each[::-1], axis=0)[::-1] - each
    return PreparedLight(coefs, lights, light_coefs(rest)[None] + later)


def light_coefs(light: EnvironmentMap | Float[Array, "K C"]) -> jax.Array:
    """Radiance coefficients of a light as far as they matter: to degree 100 for a map.

    Args:
        light: An environment map, or radiance coefficients.
    """
    if isinstance(light, EnvironmentMap):
        return jnp.asarray(light.lighting(l_max=_LIGHT_DEGREE))
    return as_float("light_or_lighting", light)


def brdf_energies(
    brdf: Brdf, *, l_max: int = _LIGHT_DEGREE, p_max: int = 16
) -> Energies:
    """Energies of a BRDF by degree for :func:`choose_model`, whatever the light.

    The first call of a kind of BRDF compiles for seconds.

    Args:
        brdf: The reflectance; concrete.
        l_max: Degree of the light's coefficients, 100 for a panorama.
        p_max: Highest degree of the view that is considered.
    """
    lambertian, rest = split_parts(brdf)
    shape = (l_max + 1, p_max + 1, p_max + 1, brdf.channels)
    zero, flat = np.zeros(shape), np.zeros((l_max + 1, brdf.channels))
    none = np.zeros((l_max + 1, 0, brdf.channels))
    diffuse, about_r, error = flat, zero, 0.0
    if lambertian is not None:
        l = np.arange(l_max + 1)[:, None]
        gains = np.asarray(radial_coefs(lambertian, l_max=l_max), np.float64)
        diffuse = np.broadcast_to((2 * l + 1) * gains**2, flat.shape)
        about_r = np.asarray(
            brdf_coefs(lambertian, l_max=l_max, p_max=p_max), np.float64
        )
    if rest is None:
        return Energies(diffuse, flat, diffuse, zero, zero, (), none, error)
    settings = {"l_max": l_max, "p_max": p_max, "accuracy": 1e-4, "check": 1.25}
    sharp = expand(rest, **settings)
    rho = np.broadcast_to(np.asarray(sharp.rho, np.float64), shape)
    specular = np.broadcast_to(np.asarray(sharp.degree_energy, np.float64), flat.shape)
    both = specular
    if lambertian is not None:
        whole = expand(brdf, **settings)
        both = np.asarray(whole.degree_energy, np.float64)
    own = fit_low_rank(rest, maps=max(RANKS), l_max=l_max)
    held = np.asarray(own.kernels, np.float64)
    crossed = (
        np.zeros_like(held) if lambertian is None else held * project(own, lambertian)
    )
    fewer = tuple(own.fewer(maps) for maps in RANKS)
    error = float(sharp.error)
    return Energies(diffuse, specular, both, rho, about_r * rho, fewer, crossed, error)


def energies_as_arrays(energies: Energies) -> dict[str, np.ndarray]:
    """Energies as named arrays, to be stored; :func:`energies_from_arrays` undoes it."""
    names = [n for n in Energies._fields if n not in ("low_rank", "error")]
    arrays = {name: np.asarray(getattr(energies, name)) for name in names}
    arrays["error"] = np.asarray(energies.error)
    if energies.low_rank:
        largest = energies.low_rank[-1]
        arrays |= {
            "kernels": np.asarray(largest.kernels),
            "table": np.asarray(largest.views.table),
            "lost_of": np.asarray(largest.energy),
        }
        arrays |= {f"test{q}": np.asarray(t) for q, t in enumerate(largest.tests)}
    return arrays


def energies_from_arrays(arrays: dict[str, np.ndarray], brdf: Brdf) -> Energies:
    """Energies of a BRDF from what :func:`energies_as_arrays` made of them.

    Args:
        arrays: By name.
        brdf: The BRDF that they are of.
    """
    names = [n for n in Energies._fields if n not in ("low_rank", "error")]
    given = {name: arrays[name] for name in names}
    low_rank: tuple[LowRankBrdf, ...] = ()
    _, rest = split_parts(brdf)
    if "kernels" in arrays and rest is not None:
        tests = [jnp.asarray(arrays[f"test{q}"]) for q in range(len(RANKS[max(RANKS)]))]
        views = LowRankViews(
            jnp.asarray(arrays["table"]), *signed_functions(RANKS[max(RANKS)])
        )
        largest = LowRankBrdf(
            jnp.asarray(arrays["kernels"]),
            views,
            jnp.asarray(arrays["lost_of"]),
            tuple(tests),
            rest,
        )
        low_rank = tuple(largest.fewer(maps) for maps in RANKS)
    return Energies(**given, low_rank=low_rank, error=float(arrays["error"]))


def split_parts(brdf: Brdf) -> tuple[Brdf | None, Brdf | None]:
    """Split a BRDF into its radial parts about the normal (diffuse), and the rest."""
    lambertian = [
        p for p in brdf.parts if p.model.centre == "normal" and p.model.radial
    ]
    rest = [p for p in brdf.parts if not any(p is one for one in lambertian)]
    return (Brdf(tuple(lambertian)) if lambertian else None), (
        Brdf(tuple(rest)) if rest else None
    )
