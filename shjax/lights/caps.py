"""Caps of the sphere, from a direction to a hemisphere: coefficients and shading."""

from __future__ import annotations

import dataclasses
import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Float

from shjax.angular import reference_reflection_samples
from shjax.arrays import Array, as_float, check_count, check_vectors
from shjax.brdf.core import Brdf, frames, select
from shjax.harmonics import basis
from shjax.harmonics.degrees import degrees
from shjax.lights.quadrature import over_lobes
from shjax.sphere import normalize


class _Rule(NamedTuple):
    """Directions over caps up to a half angle, degrees: even, or dense at lobes."""

    angle: float
    rings: int
    even: bool = False


_RULES = (
    _Rule(0.3, 4, even=True),
    _Rule(1.0, 10, even=True),
    _Rule(5.0, 16),
    _Rule(90.0, 24),
    _Rule(180.0, 24),
)
_EVEN_RULES = tuple(
    _Rule(angle, rings, even=True)
    for angle, rings in ((5.0, 3), (15.0, 10), (30.0, 20), (90.0, 60), (180.0, 120))
)


@functools.partial(
    jax.tree_util.register_dataclass,
    data_fields=("directions", "heights", "flux"),
    meta_fields=(),
)
@dataclasses.dataclass(frozen=True, repr=False)
class CapLights:
    """Uniform caps of the sphere.

    Attributes:
        directions: Unit vectors to their centres, ``(n, 3)``.
        heights: ``1 - cos`` of each half angle, ``(n,)``: in float32 the cosine of a sun
            has lost its digits. The solid angle is ``2 pi`` times it. 0 is a directional
            light, whose radiance is infinite.
        flux: Radiance times solid angle, ``(n, C)``.
    """

    directions: Float[Array, "*batch n 3"]
    heights: Float[Array, "*batch n"]
    flux: Float[Array, "*batch n C"]

    def __repr__(self) -> str:
        """How many, where and how wide; one line for each."""
        if isinstance(self.heights, Tracer) or np.ndim(self.heights) != 1:
            return f"CapLights of shape {np.shape(self.heights)}"
        rows = zip(
            np.asarray(self.directions),
            np.degrees(np.asarray(self.angles)),
            np.asarray(self.flux),
            strict=True,
        )
        lines = [
            f"  towards ({', '.join(f'{x:.3f}' for x in d)}), half angle {a:.3g} degrees, "
            f"flux {', '.join(f'{x:.4g}' for x in f)}"
            for d, a, f in rows
        ]
        return "\n".join([f"CapLights: {len(lines)}", *lines[:8]])

    @property
    def angles(self) -> Float[jax.Array, " n"]:
        """Half angles, radians."""
        return 2 * jnp.arcsin(jnp.sqrt(jnp.asarray(self.heights) / 2))

    @property
    def radiance(self) -> Float[jax.Array, "n C"]:
        """Flux over solid angle."""
        solid = 2 * np.pi * jnp.asarray(self.heights)
        flux = jnp.asarray(self.flux)
        return flux / jnp.broadcast_to(solid[:, None], flux.shape)


def cap_light(
    direction: Float[Array, " 3"], angle: float, radiance: Float[Array, " C"]
) -> CapLights:
    """A uniform cap, such as a sphere far away: one light.

    Args:
        direction: To its centre, of any length.
        angle: Half angle, radians, in (0, pi].
        radiance: Of the cap, ``(C,)``.

    Raises:
        ValueError: If the angle is outside its range.
    """
    if not 0 < angle <= np.pi:
        raise ValueError(f"angle must lie in (0, pi]; got {angle}.")
    towards = normalize(as_float("direction", direction))[None]
    height = 2 * np.sin(angle / 2) ** 2
    flux = as_float("radiance", radiance) * (2 * np.pi * height)
    return CapLights(towards, jnp.full(1, height, towards.dtype), flux[None])


def directional_light(
    direction: Float[Array, " 3"], irradiance: Float[Array, " C"]
) -> CapLights:
    """A light at infinity without extent, by the irradiance of a surface that faces it.

    Args:
        direction: To the light, of any length.
        irradiance: Perpendicular to it, ``(C,)``; the flux of :class:`CapLights`.
    """
    towards = normalize(as_float("direction", direction))[None]
    flux = as_float("irradiance", irradiance)[None]
    return CapLights(towards, jnp.zeros(1, towards.dtype), flux)


def hemisphere_light(
    direction: Float[Array, " 3"],
    above: Float[Array, " C"],
    below: Float[Array, " C"],
) -> CapLights:
    """Two constant hemispheres, as sky and ground: two lights.

    Args:
        direction: To the middle of the upper one, of any length.
        above: Its radiance, ``(C,)``.
        below: That of the other.
    """
    half = np.pi / 2
    up = cap_light(direction, half, above)
    down = cap_light(-jnp.asarray(direction), half, below)
    return jax.tree.map(lambda a, b: jnp.concatenate([a, b]), up, down)


@functools.partial(jax.jit, static_argnames=("l_max",))
def cap_gains(heights: Float[Array, " n"], *, l_max: int) -> Float[jax.Array, "n L"]:
    """Mean of each Legendre polynomial over caps: 1 for a direction.

    Exact quadrature over ``1 - cos``, so that small caps keep their digits.

    Args:
        heights: ``1 - cos`` of the half angles.
        l_max: Highest degree, inclusive. Static.
    """
    x, w = np.polynomial.legendre.leggauss(l_max // 2 + 1)
    heights = as_float("heights", heights)
    nodes, weights = (jnp.asarray(a, heights.dtype) for a in ((1 + x) / 2, w / 2))
    fall = heights[:, None] * nodes[None]  # 1 - t

    def degree(state, l):
        value, step = state  # P_l and P_l - P_(l-1)
        step = (l * step - (2 * l + 1) * fall * value) / (l + 1)
        mean = jnp.sum(value * jnp.broadcast_to(weights[None], value.shape), axis=-1)
        return (value + step, step), mean

    start = (jnp.ones_like(fall), jnp.zeros_like(fall))
    degrees_ = jnp.arange(l_max + 1).astype(heights.dtype)
    return jax.lax.scan(degree, start, degrees_)[1].T


@functools.partial(jax.jit, static_argnames=("l_max",))
def cap_coefs(lights: CapLights, *, l_max: int) -> Float[jax.Array, "K C"]:
    """Radiance coefficients of caps and directions, of any degree; differentiable.

    Args:
        lights: The lights.
        l_max: Highest degree, inclusive. Static.
    """
    flux = as_float("flux", lights.flux)
    towards = as_float("directions", lights.directions).astype(flux.dtype)
    heights = as_float("heights", lights.heights).astype(flux.dtype)
    gains = cap_gains(heights, l_max=l_max)
    table = jnp.take(gains, degrees(l_max), axis=1) * basis(towards, l_max=l_max)
    return jnp.matmul(table.T, flux, precision=jax.lax.Precision.HIGHEST)


def cap_reflection(
    lights: CapLights,
    brdf: Brdf,
    normals: Float[Array, "*points 3"],
    views: Float[Array, "*points 3"],
    tangents: Float[Array, "*points 3"] | None = None,
    *,
    rings: int | None = None,
) -> Float[jax.Array, "*points C"]:
    """Radiance reflected from caps: the BRDF itself at directions over each.

    The directions are dense about the reflected direction (for fibres: even over the
    cap), so that smooth surfaces under wide lights come out as well as rough ones.

    Args:
        lights: The caps.
        brdf: The reflectance.
        normals: Unit normals.
        views: Unit vectors to the viewer.
        tangents: Unit tangents, for fibres.
        rings: Of directions, each with twice as many spokes; default: enough for
            microfacet lobes of alpha 0.02, by the widest of the caps: a choice by value
            that is the same inside ``jit`` and ``vmap``. Static.

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
    rules = _RULES if select(brdf, "tangent") is None else _EVEN_RULES
    if rings is not None:
        check_count("rings", rings)
        even = rules is _EVEN_RULES
        rules = (_Rule(180.0, rings, even),)
    if len(rules) == 1 or not np.size(lights.heights):
        place = 0
    elif isinstance(lights.heights, Tracer):
        return _by_width(lights, brdf, normals, views, tangents, rules=rules)
    else:
        with jax.ensure_compile_time_eval():  # inside jit, too, concrete caps are known
            place = int(_width_of(lights, rules))
    return _cap_reflection(lights, brdf, normals, views, tangents, rule=rules[place])


def _width_of(lights: CapLights, rules: tuple[_Rule, ...]) -> jax.Array:
    """Which of the rules holds the widest of the caps."""
    heights = jnp.asarray(lights.heights)
    limits = np.array([2 * np.sin(np.radians(r.angle) / 2) ** 2 for r in rules[:-1]])
    # A cap of exactly 90 degrees must not fall on either side by its last digit.
    limits = jnp.asarray(limits * (1 + 1e-5), heights.dtype)
    return jnp.sum(jnp.max(heights) > limits)


@functools.partial(jax.jit, static_argnames=("rules",))
def _by_width(
    lights: CapLights, brdf: Brdf, normals, views, tangents, *, rules
) -> jax.Array:
    """The quadrature that fits caps whose width is not known when tracing."""
    branches = [functools.partial(_cap_reflection, rule=rule) for rule in rules]
    return jax.lax.switch(
        _width_of(lights, rules), branches, lights, brdf, normals, views, tangents
    )


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
            towards, heights, flux, brdf, normals, views,
            rings=rule.rings, wide=rule.angle > 90,
        )  # fmt: skip
    towards, shares = cap_nodes(lights, dtype, rule.rings, 2 * rule.rings)
    amounts = flux[:, None] * shares[None, :, None]
    return reference_reflection_samples(
        amounts.reshape(-1, flux.shape[-1]),
        towards.reshape(-1, 3),
        jnp.ones(towards.shape[0] * towards.shape[1], dtype),
        brdf,
        normals,
        views,
        tangents=tangents,
    )


def cap_nodes(
    lights: CapLights, dtype, rings: int, spokes: int
) -> tuple[jax.Array, jax.Array]:
    """Directions ``(n, k, 3)`` over each cap and their shares of its flux, ``(k,)``.

    Args:
        lights: The caps.
        dtype: Of the results. Static.
        rings: Gauss nodes in ``1 - cos``. Static.
        spokes: Directions in each ring. Static.
    """
    x, w = np.polynomial.legendre.leggauss(rings)
    height = jnp.asarray((1 + x) / 2, dtype)  # share of 1 - cos
    turn = 2 * np.pi * np.arange(spokes) / spokes
    fall = jnp.asarray(lights.heights, dtype)[:, None] * height[None]
    squared = fall * (2 - fall)
    wide = squared > 0
    across = jnp.where(wide, jnp.sqrt(jnp.where(wide, squared, 1)), 0)[..., None]
    frame = frames(jnp.asarray(lights.directions, dtype))
    around = jnp.asarray(np.stack([np.cos(turn), np.sin(turn)], -1), dtype)
    local = jnp.concatenate(
        [
            across[..., None] * around[None, None],
            jnp.broadcast_to((1 - fall)[..., None, None], (*fall.shape, spokes, 1)),
        ],
        axis=-1,
    ).reshape(fall.shape[0], -1, 3)
    towards = jnp.einsum("nij,nki->nkj", frame, local)
    shares = np.repeat(w / 2, spokes) / spokes
    return towards, jnp.asarray(shares, dtype)
