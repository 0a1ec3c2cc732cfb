"""Candidates, their predicted errors, and the choice among them."""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.adapted import RANKS
from shjax.adapted.ranks import within
from shjax.arrays import Array, known_values
from shjax.brdf.core import Brdf
from shjax.convolution import common_channels, convolve
from shjax.envmap import EnvironmentMap
from shjax.harmonics import power_spectrum
from shjax.harmonics.degrees import degree_of_coefs
from shjax.kernels import order_counts, radial_coefs
from shjax.lights import CapLights
from shjax.lights.shading import directions_per_light
from shjax.model.cost import (
    lights_time,
    map_bytes,
    map_time,
    normal_time,
    table_bytes,
)
from shjax.model.known import Energies, Light, brdf_energies, prepare_light, split_parts
from shjax.model.representation import Model, coefficient_views
from shjax.shrm import default_size, prefilter_in, prefilter_kernels

_DIFFUSE_DEGREES = (0, 2, 4, 6, 8, 12, 16, 24, 32)
_VIEW_DEGREES = (16, 32)


def choose_model(
    lighting: EnvironmentMap | Light | Float[Array, "K C"],
    brdf: Brdf,
    *,
    rms_error: float,
    max_bytes: int = 2**28,
    energies: Energies | None = None,
) -> Model:
    """The model that is read the fastest among those whose predicted error is small enough.

    The first call of a kind of BRDF compiles for seconds; so does :func:`brdf_energies`,
    once for many lights.

    Args:
        lighting: An environment map; what :func:`prepare_light` made of one, where one
            light meets several BRDFs; or radiance coefficients (what lies beyond their
            degree is taken as zero).
        brdf: The reflectance; concrete (this runs eagerly).
        rms_error: Error over all orientations and views, relative to the rms radiance;
            its square is the error in energy.
        max_bytes: Larger models are not considered; of maps beyond 16 MB, the size
            counts as time too.
        energies: From :func:`brdf_energies`, where one BRDF meets several lights.

    Returns:
        The model; ``met`` is False where none is good enough, and it is then the one with
        the smallest predicted error.

    Raises:
        ValueError: If ``lighting`` is no single finite light, ``rms_error`` not positive,
            ``max_bytes`` too small for any model, ``energies`` too short, or the channels
            do not fit.
    """
    light = lighting if isinstance(lighting, Light) else prepare_light(lighting)
    l_light = _check(light, rms_error, energies)
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
    degrees = _VIEW_DEGREES if energies is None else (energies.rho.shape[1] - 1,)
    best, known = None, energies
    for p_max in degrees:
        known = energies or brdf_energies(brdf, l_max=l_light, p_max=p_max)
        every = [
            _cheapest(coefs, brdf, known, rms_error, max_bytes, kept, n, directions)
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
    return _built(coefs, kept, lights, brdf, known, best, rms_error)


def _check(light: Light, rms_error: float, energies: Energies | None) -> int:
    """Refuse what :func:`choose_model` cannot take; returns the light's degree."""
    if not rms_error > 0:
        raise ValueError(f"rms_error must be positive; got {rms_error}.")
    if light.coefs.ndim != 2 or not np.all(
        np.isfinite(known_values("lighting", light.coefs))
    ):
        raise ValueError(
            "lighting must be an environment map or finite coefficients (K, C); got "
            f"shape {light.coefs.shape}."
        )
    l_light = degree_of_coefs(light.coefs, "lighting")
    if energies is not None and energies.rho.shape[0] <= l_light:
        raise ValueError(
            f"energies must reach the light's degree {l_light}; they end at "
            f"l_max={energies.rho.shape[0] - 1}."
        )
    return l_light


class _Candidate(NamedTuple):
    time: float
    bytes: int
    error: float
    kind: str
    l_max: int
    p_max: int
    diffuse_l_max: int | None
    lights: int


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
    rms_error: float,
    max_bytes: int,
    coefs: jax.Array,
    lights: int,
    directions: int,
) -> _Candidate | None:
    """The fastest candidate that is good enough, else the best one that fits.

    Errors are those of the light in ``coefs``, which is without so many small lights,
    relative to what the whole one gives.
    """
    l_light = degree_of_coefs(coefs)

    def weights(light: jax.Array) -> np.ndarray:
        spectrum = np.asarray(power_spectrum(light), np.float64)
        return 4 * np.pi * spectrum / (2 * np.arange(l_light + 1)[:, None] + 1)

    weight = weights(coefs)
    whole = np.sum(weights(whole_light) * known.both[: l_light + 1])
    matte, rest = split_parts(brdf)
    item = coefs.dtype.itemsize * coefs.shape[-1]
    degrees = [d for d in _DIFFUSE_DEGREES if d < l_light] + [l_light]
    if matte is None:
        degrees = [-1]
    found: list[_Candidate] = []
    for d in degrees:
        own = (d + 1) ** 2 * item
        start = normal_time(d) + lights_time(brdf, lights, directions)
        order = d if matte is not None else None
        if rest is None:
            lost = np.sum((weight * known.both[: l_light + 1])[d + 1 :])
            error = math.sqrt(lost / whole) if whole else 0.0
            found.append(
                _Candidate(start, own, error, "irradiance", d, 0, order, lights)
            )
            continue
        for kind, lost in _lost(weight, known, d).items():
            error = np.sqrt(np.maximum(lost, 0) / (whole or 1.0))
            size = own + map_bytes(kind, error.shape, item)
            if kind == "adapted":
                size = size + table_bytes(known)
            time = start + map_time(kind, size)
            for f, p in _best_of(error, time, size, rms_error, max_bytes):
                name = "radial" if p == 0 and kind != "adapted" else kind
                found.append(
                    _Candidate(
                        float(time[f, p]), int(size[f, p]), float(error[f, p]), name,
                        f, p, order, lights,
                    )
                )  # fmt: skip
    return _best([one for one in found if one.bytes <= max_bytes], rms_error)


def _best_of(
    error: np.ndarray,
    time: np.ndarray,
    size: np.ndarray,
    rms_error: float,
    max_bytes: int,
) -> list[tuple[int, int]]:
    """The fastest ``(F, P)`` that is good enough and the best one that fits, if any."""
    fits = size <= max_bytes
    chosen = []
    for allowed, cost in ((fits & (error <= rms_error), time), (fits, error)):
        if np.any(allowed):
            place = int(np.argmin(np.where(allowed, cost, np.inf)))
            chosen.append((place // error.shape[1], place % error.shape[1]))
    return chosen


def _lost(weight: np.ndarray, known: Energies, d: int) -> dict[str, np.ndarray]:
    """Lost energy of each ``(F, P)`` for maps with all q and with q = 0 alone.

    Degrees to d of the diffuse part are kept about the normal; of the specular part those
    to F, and of them the coefficients to P. Where the diffuse part is lost too, so is
    twice its product with what the specular part loses.
    """
    count = weight.shape[0]
    diffuse, specular, both = (
        a[:count] for a in (known.diffuse, known.specular, known.both)
    )
    beyond = (np.arange(count) > d)[:, None]
    product = (both - diffuse - specular) / 2
    if d < 0:
        diffuse, product = np.zeros_like(diffuse), np.zeros_like(product)
    dropped = specular + np.where(beyond, diffuse + 2 * product, 0)
    times = order_counts(known.rho.shape[1] - 1)
    lost = {}
    for kind in ("shrm", "q=0"):
        chosen = times if kind == "shrm" else np.where(times == 1, 1, 0)
        squares, crossed = (
            np.cumsum(np.einsum("lpqc,q->lpc", a[:count], chosen), axis=1)
            for a in (known.rho**2, known.cross)
        )
        gain = squares + np.where(beyond[:, None], 2 * crossed, 0)
        kept = np.cumsum(np.einsum("lc,lpc->lp", weight, gain), axis=0)
        lost[kind] = np.sum(weight * dropped) - kept
    if known.adapted is not None:
        own, crossed = (
            np.asarray(a, np.float64)[:count]
            for a in (known.adapted.kernels, known.adapted_cross)
        )
        gain = own**2 + np.where(beyond[:, None], 2 * crossed, 0)
        each = np.cumsum(np.einsum("lc,lkc->lk", weight, gain), axis=0)
        sets = np.stack([within(maps) for maps in RANKS], axis=1)
        lost["adapted"] = np.sum(weight * dropped) - each @ sets
    return lost


def _built(
    lighting: jax.Array,
    coefs: jax.Array,
    lights: CapLights | None,
    brdf: Brdf,
    known: Energies,
    chosen: _Candidate,
    rms_error: float,
) -> Model:
    """The model itself, of the light in ``coefs`` and of small ``lights``."""
    matte, rest = split_parts(brdf)
    diffuse = maps = None
    if matte is not None and chosen.diffuse_l_max is not None:
        d = chosen.diffuse_l_max
        gains = radial_coefs(matte, l_max=d).astype(coefs.dtype)
        diffuse = convolve(coefs[: (d + 1) ** 2], gains)
    p_max, views = chosen.p_max, None
    if rest is not None:
        f = chosen.l_max
        rows, columns = default_size(f)
        light = coefs[: (f + 1) ** 2]
        if chosen.kind == "adapted":
            assert known.adapted is not None
            own = known.adapted.fewer(list(RANKS)[chosen.p_max])
            views, p_max = own.views, max(own.views.orders)
            kernels = own.kernels[: f + 1].astype(coefs.dtype)
            shape = (*kernels.shape[:2], coefs.shape[-1])
            maps = prefilter_kernels(
                light,
                jnp.broadcast_to(kernels, shape),
                views.orders,
                n_theta=rows,
                n_phi=columns,
            )
        else:
            rho = jnp.asarray(known.rho[: f + 1, : p_max + 1, : p_max + 1], coefs.dtype)
            basis = coefficient_views(chosen.kind, p_max)
            maps = prefilter_in(basis, light, rho, n_theta=rows, n_phi=columns)
    return Model(
        brdf, lighting, diffuse, maps, views, lights, chosen.kind, chosen.l_max, p_max,
        chosen.diffuse_l_max, rms_error, chosen.error, chosen.error <= rms_error,
    )  # fmt: skip
