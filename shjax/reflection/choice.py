"""Choice of a reflection model: candidates, their predicted errors, the fastest one.

From few numbers to many: coefficients of the irradiance about the normal; a radial map
about R (P = 0); a map without azimuth (q = 0); the spherical harmonic reflection map; a
low-rank map. A diffuse part stays about the normal, where it needs a handful of numbers,
and is no part of the map. Each candidate's error is predicted from the light's spectrum
(docs/math.md, section 5), the cross terms of diffuse and specular included.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array, common_channels, known_values
from shjax.brdf.core import Brdf, select
from shjax.brdf.expansion import radial_coefs
from shjax.brdf.ranges import check_brdf
from shjax.harmonics import power_spectrum
from shjax.harmonics.degrees import degree_of_coefs
from shjax.light import Light
from shjax.lights import CapLights
from shjax.lights.cap_shading import directions_per_light
from shjax.reflection.candidates import candidate_maps
from shjax.reflection.convolution import convolve
from shjax.reflection.cost import lights_time, map_bytes, map_time, normal_time
from shjax.reflection.diffuse import DiffuseReflection
from shjax.reflection.energies import (
    Energies,
    PreparedLight,
    brdf_energies,
    prepare_light,
    split_parts,
)
from shjax.reflection.model import ReflectionModel
from shjax.reflection.prefiltering import default_size, map_of_kernels
from shjax.reflection.view_basis import ViewBasis

_DIFFUSE_DEGREES = (0, 2, 4, 6, 8, 12, 16, 24, 32)
_VIEW_DEGREES = (16, 32)


def choose_model(
    light_or_lighting: Light | PreparedLight | Float[Array, "K C"],
    brdf: Brdf,
    *,
    rms_error: float,
    max_bytes: int = 2**28,
    energies: Energies | Callable[..., Energies] | None = None,
) -> ReflectionModel:
    """Choose the fastest reflection model whose predicted error is small enough.

    The first call of a kind of BRDF compiles for seconds; so does
    :func:`shjax.reflection.brdf_energies`, once for many lights.

    Args:
        light_or_lighting: An environment map or a lat-long panorama; what
            :func:`shjax.reflection.prepare_light` made of one, where one light meets
            several BRDFs; or radiance coefficients (what lies beyond their degree is
            taken as zero).
        brdf: The reflectance; concrete (this runs eagerly).
        rms_error: Error over all orientations and views, relative to the rms radiance;
            its square is the error in energy.
        max_bytes: Larger models are not considered; of maps beyond 16 MB, the size
            counts as time too.
        energies: From :func:`shjax.reflection.brdf_energies`, where one BRDF meets
            several lights; or a function that is called in its place, and may keep what
            it finds.

    Returns:
        The model, a reflector; ``met`` is False where none is good enough, and it is then
        the one with the smallest predicted error.

    Raises:
        ValueError: If the light is no single finite one, ``rms_error`` not positive,
            ``max_bytes`` too small for any model, ``energies`` too short, or the channels
            do not fit.
    """
    check_brdf("brdf", brdf)
    light = light_or_lighting
    if not isinstance(light, PreparedLight):
        light = prepare_light(light)
    given = None if callable(energies) else energies
    find = energies if callable(energies) else brdf_energies
    l_light = _check(light, rms_error, given)
    channels = common_channels(light.coefs.shape[-1], brdf.channels, "brdf")
    coefs, rest = (
        None if a is None else jnp.broadcast_to(a, (*a.shape[:-1], channels))
        for a in (light.coefs, light.rest)
    )
    assert coefs is not None
    without = [coefs, *(() if rest is None else rest)]  # the first 0, 1, ... lights
    directions = 0
    if light.lights is not None:
        directions = directions_per_light(light.lights, brdf)
    degrees = _VIEW_DEGREES if given is None else (given.rho.shape[1] - 1,)
    best, known = None, given
    for p_max in degrees:
        known = given or find(brdf, l_max=l_light, p_max=p_max)
        goal = _Goal(rms_error, max_bytes, directions)
        every = [
            _cheapest(coefs, brdf, known, goal, kept, n)
            for n, kept in enumerate(without)
        ]
        best = _best([one for one in every if one is not None], rms_error)
        if best is not None and best.error <= rms_error:
            break
    if best is None or known is None:
        raise ValueError(f"max_bytes must be enough for a model; got {max_bytes}.")
    lights = None
    if best.lights and light.lights is not None:
        lights = jax.tree.map(lambda a: a[: best.lights], light.lights)
    kept = without[best.lights]
    return _built(coefs, kept, lights, brdf, best, rms_error)


def _check(light: PreparedLight, rms_error: float, energies: Energies | None) -> int:
    """Refuse what :func:`choose_model` cannot take; returns the light's degree."""
    if not rms_error > 0:
        raise ValueError(f"rms_error must be positive; got {rms_error}.")
    if light.coefs.ndim != 2 or not np.all(
        np.isfinite(known_values("light_or_lighting", light.coefs))
    ):
        raise ValueError(
            "light_or_lighting must be an environment map or finite coefficients (K, C); "
            f"got shape {light.coefs.shape}."
        )
    l_light = degree_of_coefs(light.coefs, "light_or_lighting")
    if energies is not None and energies.rho.shape[0] <= l_light:
        raise ValueError(
            f"energies must reach the light's degree {l_light}; they end at "
            f"l_max={energies.rho.shape[0] - 1}."
        )
    return l_light


class _Goal(NamedTuple):
    """What is asked for, and the directions over each light split off."""

    rms_error: float
    max_bytes: int
    directions: int


class _Candidate(NamedTuple):
    time: float
    bytes: int
    error: float
    l_max: int
    diffuse_l_max: int | None
    lights: int
    view_basis: ViewBasis | None = None
    kernels: Callable[[], jax.Array | np.ndarray] | None = None


def _best(found: list[_Candidate], rms_error: float) -> _Candidate | None:
    """The one that is read the fastest among the good enough, else the most accurate."""
    enough = [one for one in found if one.error <= rms_error]
    if enough:
        return min(enough, key=lambda one: (one.time, one.bytes))
    return min(found, key=lambda one: (one.error, one.time), default=None)


def _cheapest(
    whole_light: jax.Array,
    brdf: Brdf,
    known: Energies,
    goal: _Goal,
    coefs: jax.Array,
    lights: int,
) -> _Candidate | None:
    """The fastest candidate that is good enough, else the best one that fits.

    Errors are those of the light in ``coefs``, which is without so many light sources,
    relative to what the whole one gives.
    """
    l_light = degree_of_coefs(coefs)

    def weights(light: jax.Array) -> np.ndarray:
        spectrum = np.asarray(power_spectrum(light), np.float64)
        return 4 * np.pi * spectrum / (2 * np.arange(l_light + 1)[:, None] + 1)

    weight = weights(coefs)
    whole = np.sum(weights(whole_light) * known.both[: l_light + 1])
    lambertian, rest = split_parts(brdf)
    item = coefs.dtype.itemsize * coefs.shape[-1]
    degrees = [d for d in _DIFFUSE_DEGREES if d < l_light] + [l_light]
    if lambertian is None:
        degrees = [-1]
    found: list[_Candidate] = []
    for d in degrees:
        own = (d + 1) ** 2 * item
        start = normal_time(d) + lights_time(brdf, lights, goal.directions)
        order = d if lambertian is not None else None
        if rest is None:
            lost = np.sum((weight * known.both[: l_light + 1])[d + 1 :])
            error = math.sqrt(lost / whole) if whole else 0.0
            found.append(_Candidate(start, own, error, d, order, lights))
            continue
        for maps in candidate_maps(weight, known, d):
            error = np.sqrt(np.maximum(maps.lost, 0) / (whole or 1.0))
            size = own + map_bytes(maps.bases, len(error), item)
            time = start + map_time(maps.bases, size)
            for f, p in _best_of(error, time, size, goal):
                cost = (float(time[f, p]), int(size[f, p]), float(error[f, p]))
                view = (maps.bases[p], functools.partial(maps.kernels, p))
                found.append(_Candidate(*cost, f, order, lights, *view))
    return _best([one for one in found if one.bytes <= goal.max_bytes], goal.rms_error)


def _best_of(
    error: np.ndarray, time: np.ndarray, size: np.ndarray, goal: _Goal
) -> list[tuple[int, int]]:
    """The fastest ``(F, P)`` that is good enough and the best one that fits, if any."""
    fits = size <= goal.max_bytes
    chosen = []
    for allowed, cost in ((fits & (error <= goal.rms_error), time), (fits, error)):
        if np.any(allowed):
            place = int(np.argmin(np.where(allowed, cost, np.inf)))
            chosen.append((place // error.shape[1], place % error.shape[1]))
    return chosen


def _built(
    lighting: jax.Array,
    coefs: jax.Array,
    lights: CapLights | None,
    brdf: Brdf,
    chosen: _Candidate,
    rms_error: float,
) -> ReflectionModel:
    """The model itself, of the light in ``coefs`` and of ``lights``."""
    lambertian, rest = split_parts(brdf)
    diffuse = specular = None
    if lambertian is not None and chosen.diffuse_l_max is not None:
        d = chosen.diffuse_l_max
        gains = radial_coefs(lambertian, l_max=d).astype(coefs.dtype)
        own = convolve(coefs[: (d + 1) ** 2], gains)
        diffuse = DiffuseReflection(own, coefs, lambertian)
    if rest is not None and chosen.view_basis is not None:
        f = chosen.l_max
        assert chosen.kernels is not None
        kernels = jnp.asarray(chosen.kernels()[: f + 1], coefs.dtype)
        specular = map_of_kernels(
            coefs[: (f + 1) ** 2],
            kernels,
            chosen.view_basis,
            rest,
            size=default_size(f),
            centre="reflection" if select(rest, "tangent") is None else "tangent",
        )
    met = chosen.error <= rms_error
    return ReflectionModel(
        brdf, lighting, diffuse, specular, lights, rms_error, chosen.error, met
    )
