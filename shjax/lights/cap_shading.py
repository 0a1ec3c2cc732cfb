"""Radiance reflected from caps: the BRDF itself at directions over each.

Even directions where the cap is narrow beside the lobe, which is cheap; elsewhere
directions that follow the lobe (:mod:`.quadrature`).
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Float

from shjax.arrays import Array, as_float, check_count, check_vectors, common_channels
from shjax.brdf.core import (
    Brdf,
    Local,
    in_frame,
    part_values,
    prepared,
    select,
    transfer_local,
)
from shjax.lights.caps import CapLights, cap_nodes
from shjax.lights.lobe_nodes import lobe_nodes
from shjax.reference.reflection_integral import in_tiles, over_samples
from shjax.vectors import frames

_POINT = 1e-6  # the height of a cap of 0.08 degrees, which is a point to any lobe


class _Rule(NamedTuple):
    """Directions over caps of some widths.

    Attributes:
        angle: The widest half angle, degrees.
        rings: Of directions, each with twice as many spokes.
        lobes: The widest half angle over the lobe's half width; any where infinite.
        even: Whether the directions are even over the cap, not dense at the lobe.
    """

    angle: float
    rings: int
    lobes: float = math.inf
    even: bool = False


_RULES = (
    _Rule(5.0, 3, lobes=0.25, even=True),
    _Rule(5.0, 10, lobes=0.75, even=True),
    _Rule(5.0, 16),
    _Rule(90.0, 24),
    _Rule(180.0, 24),
)
# About the tangent a lobe is a cone, which no polar coordinates follow.
_FIBRES = tuple(
    _Rule(angle, rings, even=True)
    for angle, rings in ((5.0, 3), (15.0, 10), (30.0, 20), (90.0, 60), (180.0, 120))
)


def cap_reflection(
    lights: CapLights,
    brdf: Brdf,
    normals: Float[Array, "*points 3"],
    views: Float[Array, "*points 3"],
    tangents: Float[Array, "*points 3"] | None = None,
    *,
    rings: int | None = None,
) -> Float[jax.Array, "*points C"]:
    """Reflected radiance of cap lights, by quadrature of the BRDF over each.

    Args:
        lights: The caps.
        brdf: The reflectance.
        normals: Unit normals.
        views: Unit vectors to the viewer.
        tangents: Unit tangents, for fibres.
        rings: Of directions that follow the lobe (for fibres: even over the cap), each
            with twice as many spokes; default: as many as the widest of the caps and
            the narrowest of the lobes need, to microfacet lobes of alpha 0.02. That is a
            choice by value, and the same inside ``jit`` and ``vmap``. Static.

    Raises:
        ValueError: If ``rings`` is not positive or a shape is wrong.
    """
    for name, vectors in (("normals", normals), ("views", views)):
        check_vectors(name, vectors)
    if views.shape != normals.shape:
        raise ValueError(
            f"views must have the shape of normals {normals.shape}; got {views.shape}."
        )
    normals, views = as_float("normals", normals), as_float("views", views)
    rules = _rules_for(brdf)
    if rings is not None:
        check_count("rings", rings)
        rule = rules[-1]._replace(rings=rings)
    elif _known(lights, brdf):
        rule = rules[_place(lights, brdf)]
    else:
        return _by_value(lights, brdf, normals, views, tangents)
    return _cap_reflection(lights, brdf, normals, views, tangents, rule=rule)


def directions_per_light(lights: CapLights, brdf: Brdf) -> int:
    """Number of directions that :func:`cap_reflection` visits for each light."""
    return 2 * _rules_for(brdf)[_place(lights, brdf)].rings ** 2


def _rules_for(brdf: Brdf) -> tuple[_Rule, ...]:
    return _RULES if select(brdf, "tangent") is None else _FIBRES


def _known(lights: CapLights, brdf: Brdf) -> bool:
    leaves = jax.tree.leaves((lights.heights, brdf))
    return not any(isinstance(leaf, Tracer) for leaf in leaves)


def _place(lights: CapLights, brdf: Brdf) -> int:
    if not np.size(lights.heights):
        return 0
    with jax.ensure_compile_time_eval():  # inside jit, too, concrete values are known
        return int(_fitting(jnp.asarray(lights.heights), brdf))


@jax.jit
def _fitting(heights: jax.Array, brdf: Brdf) -> jax.Array:
    """The first of the rules that the caps fit."""
    rules = _rules_for(brdf)
    widest = 2 * jnp.arcsin(jnp.sqrt(jnp.max(heights) / 2))
    # A cap of exactly 90 degrees must not fall on either side by its last digit.
    limits = jnp.asarray(
        [np.radians(r.angle) * (1 + 1e-5) for r in rules], widest.dtype
    )
    lobes = jnp.asarray([min(r.lobes, 1e6) for r in rules], widest.dtype)
    if any(math.isfinite(r.lobes) for r in rules):
        limits = jnp.minimum(limits, lobes * _half_width(brdf).astype(widest.dtype))
    return jnp.argmax((widest <= limits).at[-1].set(True))


def _half_width(brdf: Brdf) -> jax.Array:
    """Angle from its peak at which the narrowest part has half of it, seen head on."""
    angles = np.geomspace(1e-3, np.pi / 2 * 0.98, 64)
    dtype = brdf.parts[0].weight.dtype
    x, z = (jnp.asarray(a, dtype) for a in (np.sin(angles), np.cos(angles)))
    zero, one = jnp.zeros_like(x), jnp.ones_like(x)
    widths = []
    for part in prepared(brdf).parts:
        values = part_values(part, Local(x, zero, z), Local(zero, zero, one))
        values = jax.lax.stop_gradient(values) / jnp.broadcast_to(z, values.shape)
        below = values < jnp.broadcast_to(values[:, :1] / 2, values.shape)
        last = jnp.where(jnp.any(below, axis=1), jnp.argmax(below, axis=1) - 1, 63)
        widths.append(jnp.min(jnp.take(jnp.asarray(angles, dtype), last, mode="clip")))
    return jnp.min(jnp.stack(widths))


@jax.jit
def _by_value(lights: CapLights, brdf: Brdf, normals, views, tangents) -> jax.Array:
    """The rule that fits caps and lobes whose widths are not known when tracing."""
    rules = _rules_for(brdf)
    branches = [functools.partial(_cap_reflection, rule=rule) for rule in rules]
    place = (
        _fitting(jnp.asarray(lights.heights), brdf) if np.size(lights.heights) else 0
    )
    return jax.lax.switch(place, branches, lights, brdf, normals, views, tangents)


@functools.partial(jax.jit, static_argnames=("rule",))
def _cap_reflection(
    lights: CapLights, brdf: Brdf, normals, views, tangents, *, rule: _Rule
) -> jax.Array:
    dtype = normals.dtype
    flux = as_float("flux", lights.flux).astype(dtype)
    if not rule.even:
        towards = as_float("directions", lights.directions).astype(dtype)
        heights = as_float("heights", lights.heights).astype(dtype)
        return over_lobes(
            towards,
            heights,
            flux,
            brdf,
            normals,
            views,
            rings=rule.rings,
            wide=rule.angle > 90,
        )
    towards, shares = cap_nodes(lights, dtype, rule.rings, 2 * rule.rings)
    amounts = flux[:, None] * shares[None, :, None]
    return over_samples(
        amounts.reshape(-1, flux.shape[-1]),
        towards.reshape(-1, 3),
        jnp.ones(towards.shape[0] * towards.shape[1], dtype),
        brdf,
        normals,
        views,
        tangents=tangents,
    )


def over_lobes(
    centres: jax.Array,
    heights: jax.Array,
    flux: jax.Array,
    brdf: Brdf,
    normals: jax.Array,
    views: jax.Array,
    *,
    rings: int,
    wide: bool,
) -> jax.Array:
    """Reflected radiance of caps by quadrature that follows the lobe, ``(*points, C)``.

    Args:
        centres: Unit vectors, ``(n, 3)``.
        heights: ``1 - cos`` of the half angles, ``(n,)``.
        flux: Radiance times solid angle, ``(n, C)``.
        brdf: Without parts about the tangent.
        normals: Unit normals.
        views: Unit vectors to the viewer.
        rings: Distances from the lobe, with twice as many half circles. Static.
        wide: Whether caps may be wider than 90 degrees. Static.
    """
    ready = prepared(brdf)
    horizon = all(part.model.horizon for part in brdf.parts)
    lights = _Lights(centres, heights, heights, flux)
    if wide:  # the whole sphere less the cap on the other side
        big = heights > 1
        signs = jnp.where(big & (2 - heights > _POINT), -1, 0).astype(flux.dtype)
        rest = _Lights(
            -centres,
            jnp.where(big, 2 - heights, 0),
            heights,
            flux * jnp.broadcast_to(signs[:, None], flux.shape),
        )
        lights = lights._replace(heights=jnp.where(big, 2, heights))
        lights = jax.tree.map(lambda a, b: jnp.concatenate([a, b]), lights, rest)
    channels = common_channels(flux.shape[-1], brdf.channels, "brdf")
    if not normals.size:
        return jnp.zeros((*normals.shape[:-1], channels), flux.dtype)
    flat = {"normals": normals, "views": views}
    flat = {name: jnp.asarray(a, flux.dtype).reshape(-1, 3) for name, a in flat.items()}

    def one_tile(tile):
        tile = tile | {"frame": frames(tile["normals"])}
        seen = in_frame(tile["frame"], tile["views"])

        @jax.checkpoint
        def add(total, light):
            towards, shares = _nodes(light, tile, rings, horizon)
            rho = transfer_local(ready, towards, _for_all(seen, shares.shape))
            value = jnp.sum(rho * jnp.broadcast_to(shares[None], rho.shape), axis=-1).T
            shape = (value.shape[0], channels)
            amount = jnp.broadcast_to(light.flux[None], shape)
            return total + jnp.broadcast_to(value, shape) * amount, None

        zero = jnp.zeros((tile["normals"].shape[0], channels), flux.dtype)
        return jax.lax.scan(add, zero, lights)[0]

    made = in_tiles(one_tile, flat, 2 * rings**2)
    return made.reshape(*normals.shape[:-1], channels)


class _Lights(NamedTuple):
    centres: jax.Array
    heights: jax.Array
    own_heights: jax.Array  # of the light that a cap is a part of
    flux: jax.Array


def _for_all(vectors: Local, shape: tuple[int, ...]) -> Local:
    return Local(*(jnp.broadcast_to(part[:, None], shape) for part in vectors))


def _nodes(light: _Lights, tile, rings: int, horizon: bool) -> tuple[Local, jax.Array]:
    """Directions in each point's own frame and their shares of the light's flux."""
    point = light.own_heights < _POINT
    towards, solid = lobe_nodes(
        light.centres,
        jnp.where(point, 1, light.heights),
        tile["normals"],
        tile["views"],
        tile["frame"],
        rings=rings,
        spokes=2 * rings,
        horizon=horizon,
    )
    shares = solid / (2 * np.pi * jnp.where(point, 1, light.own_heights))
    empty = light.heights < _POINT  # a point, or no cap on the other side
    centre = jnp.broadcast_to(light.centres[None], tile["normals"].shape)
    centre = _for_all(in_frame(tile["frame"], centre), shares.shape)
    towards = Local(
        *(jnp.where(empty, a, b) for a, b in zip(centre, towards, strict=True))
    )
    even = jnp.asarray(1 / shares.shape[1], shares.dtype)
    return towards, jnp.where(empty, even, shares)
