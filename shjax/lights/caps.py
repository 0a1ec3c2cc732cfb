"""Caps of the sphere, from a direction to a hemisphere, and their coefficients."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Float

from shjax.arrays import (
    Array,
    as_float,
    check_channels,
    check_floating,
    matmul,
    safe_sqrt,
    shape_of,
)
from shjax.harmonics import basis
from shjax.harmonics.degrees import degrees
from shjax.vectors import frames, normalize


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True, repr=False)
class CapLights:
    """Cap lights: uniform spherical caps, such as suns, lamps or a sky.

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
        """Radiance of each cap: flux over solid angle."""
        solid = 2 * np.pi * jnp.asarray(self.heights)
        flux = jnp.asarray(self.flux)
        return flux / jnp.broadcast_to(solid[:, None], flux.shape)


def cap_light(
    direction: Float[Array, " 3"], angle: float, radiance: Float[Array, " C"]
) -> CapLights:
    """Make a uniform spherical cap light, such as a sun: one light.

    Args:
        direction: To its centre, of any length.
        angle: Half angle, radians, in (0, pi].
        radiance: Of the cap, ``(C,)``.

    Raises:
        ValueError: If the angle is outside its range or a shape is wrong.
    """
    _check_light(direction, radiance=radiance)
    if not 0 < angle <= np.pi:
        raise ValueError(f"angle must lie in (0, pi]; got {angle}.")
    towards = normalize(as_float("direction", direction))[None]
    height = 2 * float(np.sin(angle / 2)) ** 2
    flux = as_float("radiance", radiance).astype(towards.dtype)
    flux = flux * (2 * np.pi * height)
    return CapLights(towards, jnp.full(1, height, towards.dtype), flux[None])


def directional_light(
    direction: Float[Array, " 3"], irradiance: Float[Array, " C"]
) -> CapLights:
    """Make a directional light at infinity, by its irradiance at normal incidence.

    Args:
        direction: To the light, of any length.
        irradiance: Perpendicular to it, ``(C,)``; the flux of :class:`CapLights`.

    Raises:
        ValueError: If a shape is wrong.
    """
    _check_light(direction, irradiance=irradiance)
    towards = normalize(as_float("direction", direction))[None]
    flux = as_float("irradiance", irradiance).astype(towards.dtype)[None]
    return CapLights(towards, jnp.zeros(1, towards.dtype), flux)


def hemisphere_light(
    direction: Float[Array, " 3"],
    above: Float[Array, " C"],
    below: Float[Array, " C"],
) -> CapLights:
    """Make a hemisphere light of two constant halves, sky and ground: two lights.

    Args:
        direction: To the middle of the upper one, of any length.
        above: Its radiance, ``(C,)``.
        below: That of the other.

    Raises:
        ValueError: If a shape is wrong.
    """
    _check_light(direction, above=above, below=below)
    half = np.pi / 2
    up = cap_light(direction, half, above)
    down = cap_light(-jnp.asarray(direction), half, below)
    return jax.tree.map(lambda a, b: jnp.concatenate([a, b]), up, down)


def _check_light(direction, **colours) -> None:
    """Refuse what is no vector ``(3,)``, or no colour ``(C,)``."""
    if shape_of("direction", direction) != (3,):
        raise ValueError(f"direction must have shape (3,); got {direction.shape}.")
    check_floating("direction", direction)
    for name, colour in colours.items():
        check_channels(name, colour, "C", 1, batch=False)


def cap_gains(heights: Float[Array, " n"], *, l_max: int) -> Float[jax.Array, "n L"]:
    """Legendre coefficients of uniform caps, relative to a direction's.

    Exact quadrature over ``1 - cos``, so that small caps keep their digits.

    Args:
        heights: ``1 - cos`` of the half angles.
        l_max: Highest degree, inclusive. Static.

    Raises:
        ValueError: If the shape is wrong.
    """
    if len(shape_of("heights", heights)) != 1:
        raise ValueError(f"heights must have shape (n,); got {heights.shape}.")
    return _cap_gains(heights, l_max=l_max)


@functools.partial(jax.jit, static_argnames=("l_max",))
def _cap_gains(heights: Array, *, l_max: int) -> jax.Array:
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
    """Lighting coefficients of cap and directional lights, of any degree.

    Args:
        lights: The lights.
        l_max: Highest degree, inclusive. Static.
    """
    flux = as_float("flux", lights.flux)
    towards = as_float("directions", lights.directions).astype(flux.dtype)
    heights = as_float("heights", lights.heights).astype(flux.dtype)
    gains = cap_gains(heights, l_max=l_max)
    table = jnp.take(gains, degrees(l_max), axis=1) * basis(towards, l_max=l_max)
    return matmul(table.T, flux)


def cap_nodes(
    lights: CapLights, dtype, rings: int, spokes: int
) -> tuple[jax.Array, jax.Array]:
    """Quadrature directions ``(n, k, 3)`` over each cap and their shares of its flux.

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
    across = safe_sqrt(fall * (2 - fall))[..., None]
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
