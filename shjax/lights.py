"""Small bright lights apart from the rest: caps of the sphere, shaded exactly.

A sun in a panorama holds much of the light in a few pixels, and all degrees. Taken out as
a cap of equal flux it is shaded by the BRDF itself, and what is left is smooth.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array
from shjax.brdf.core import Brdf, frames, transfer
from shjax.convolution import common_channels
from shjax.envmap import EnvironmentMap
from shjax.harmonics import basis
from shjax.harmonics.degrees import degrees
from shjax.reference import luminance
from shjax.sphere import latlong_directions, latlong_solid_angles

_WIDEST = np.radians(3.0)
_WINDOW = np.radians(7.0)
_SHARE_OF_PEAK = 0.25
_LEAST_CONTRAST = 20.0  # of the peak over its surroundings
_LEAST_FLUX = 0.01  # of the whole light
_RINGS, _SPOKES = 3, 6


@functools.partial(
    jax.tree_util.register_dataclass,
    data_fields=("directions", "heights", "flux"),
    meta_fields=(),
)
@dataclasses.dataclass(frozen=True)
class CapLights:
    """Uniform caps of the sphere.

    Attributes:
        directions: Unit vectors to their centres, ``(n, 3)``.
        heights: ``1 - cos`` of each half angle, ``(n,)``: in float32 the cosine of a sun
            has lost its digits. The solid angle is ``2 pi`` times it.
        flux: Radiance times solid angle, ``(n, C)``.
    """

    directions: Float[Array, "n 3"]
    heights: Float[Array, " n"]
    flux: Float[Array, "n C"]

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


def split_lights(
    envmap: EnvironmentMap, *, max_lights: int = 4
) -> tuple[CapLights, EnvironmentMap]:
    """Take the brightest small lights out of a lat-long panorama.

    One after the other: the connected pixels about the brightest one whose excess over
    the surroundings is above a quarter of its own become a cap of the same flux in each
    channel, centroid and mean cosine; the surroundings stay. A light counts if it is at
    most 3 degrees in radius, 20 times brighter than its surroundings, and holds 1 % of
    the whole. Flux is conserved exactly; nothing is taken where nothing stands out.

    Args:
        envmap: A lat-long map (``to_latlong`` makes one).
        max_lights: At most so many.

    Returns:
        The lights, and the rest of the map.

    Raises:
        ValueError: If the map is not lat-long or ``max_lights`` is negative.
    """
    if envmap.layout != "latlong":
        raise ValueError(f"envmap must be lat-long; got {envmap.layout}.")
    if max_lights < 0:
        raise ValueError(f"max_lights must be >= 0; got {max_lights}.")
    image = np.array(envmap.radiance, np.float64)
    height, width, channels = image.shape
    directions = latlong_directions(height, width)
    solid = np.broadcast_to(
        latlong_solid_angles(height, width)[:, None], (height, width)
    )
    whole = float(np.sum(_grey(image) * solid))
    found: list[tuple[np.ndarray, float, np.ndarray]] = []
    for _ in range(max_lights):
        light = _brightest(image, directions, solid, whole)
        if light is None:
            break
        found.append(light)
    rest = dataclasses.replace(
        envmap, radiance=image.astype(envmap.radiance.dtype),
        image=image.astype(envmap.radiance.dtype),
    )  # fmt: skip
    if not found:
        return (
            CapLights(np.zeros((0, 3)), np.zeros(0), np.zeros((0, channels))),
            envmap,
        )
    return CapLights(*(np.stack(parts) for parts in zip(*found, strict=True))), rest


def _grey(image: np.ndarray) -> np.ndarray:
    return np.asarray(luminance(jnp.asarray(image, jnp.float32)), np.float64)


def _brightest(image: np.ndarray, directions, solid, whole: float):
    """Axis, height and flux of the brightest light; its excess leaves the image."""
    grey = _grey(image)
    peak = np.unravel_index(int(np.argmax(grey)), grey.shape)
    near = directions @ directions[peak] > np.cos(_WINDOW)
    region = _connected(near & (grey > _SHARE_OF_PEAK * grey[peak]), peak)
    middle = np.sum((grey * solid)[region][:, None] * directions[region], axis=0)
    cosine = directions @ (middle / max(float(np.linalg.norm(middle)), 1e-300))
    ring = (cosine > np.cos(_WINDOW)) & (cosine < np.cos(_WIDEST + np.radians(1.0)))
    if not np.any(ring):
        return None
    around = np.median(image[ring], axis=0)
    level = float(_grey(around[None, None])[0, 0])
    excess = grey[peak] - level
    if grey[peak] < _LEAST_CONTRAST * max(level, 0.0) or excess <= 0:
        return None
    bright = (cosine > np.cos(_WINDOW)) & (grey - level > _SHARE_OF_PEAK * excess)
    region = _connected(bright, peak)
    if np.min(cosine[region]) < np.cos(_WIDEST):
        return None
    taken = np.maximum(image[region] - around, 0)
    flux = taken * solid[region][:, None]
    grey_flux = _grey(flux[None])[0]
    total = float(grey_flux.sum())
    if total < _LEAST_FLUX * whole:
        return None
    # A pixel is itself a cap: its own mean cosine is 1 - w / 4 pi.
    inner = 1 - solid[region] / (4 * np.pi)
    moment = np.sum((grey_flux * inner)[:, None] * directions[region], axis=0) / total
    mean = float(np.linalg.norm(moment))
    image[region] -= taken
    # The mean cosine of a cap is 1 - height / 2.
    return moment / mean, 2 * (1 - mean), flux.sum(axis=0)


def _connected(bright: np.ndarray, start) -> np.ndarray:
    """The bright pixels that hang together with one, across the seam too."""
    height, width = bright.shape
    seen = np.zeros_like(bright)
    seen[start] = True
    stack = [tuple(int(k) for k in start)]
    while stack:
        row, column = stack.pop()
        for down, right in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            place = (row + down, (column + right) % width)
            if 0 <= place[0] < height and bright[place] and not seen[place]:
                seen[place] = True
                stack.append(place)
    return seen


def cap_coefs(lights: CapLights, *, l_max: int) -> Float[jax.Array, "K C"]:
    """Radiance coefficients of caps, of any degree.

    ``2 pi (P_(l-1)(c) - P_(l+1)(c)) / (2 l + 1) Y_lm`` a unit of radiance.

    Args:
        lights: The caps, with concrete heights.
        l_max: Highest degree, inclusive. Static.
    """
    heights = np.asarray(lights.heights, np.float64)
    cosines = 1 - heights
    before, last = np.ones_like(cosines), cosines
    gains = [heights]
    for l in range(1, l_max + 1):
        after = ((2 * l + 1) * cosines * last - l * before) / (l + 1)
        gains.append((before - after) / (2 * l + 1))
        before, last = last, after
    table = 2 * np.pi * np.stack(gains)[degrees(l_max)]  # [k, n]
    functions = basis(jnp.asarray(lights.directions), l_max=l_max).T
    weighted = functions * jnp.asarray(table, functions.dtype)
    return jnp.matmul(
        weighted,
        jnp.asarray(lights.radiance, functions.dtype),
        precision=jax.lax.Precision.HIGHEST,
    )


@jax.jit
def cap_reflection(
    lights: CapLights,
    brdf: Brdf,
    normals: Float[Array, "*points 3"],
    views: Float[Array, "*points 3"],
    tangents: Float[Array, "*points 3"] | None = None,
) -> Float[jax.Array, "*points C"]:
    """Radiance reflected from caps: the BRDF itself at 18 directions of each.

    Args:
        lights: The caps.
        brdf: The reflectance.
        normals: Unit normals.
        views: Unit vectors to the viewer.
        tangents: Unit tangents, for fibres.
    """
    normals = jnp.asarray(normals)
    dtype, flux = normals.dtype, jnp.asarray(lights.flux)
    channels = common_channels(flux.shape[-1], brdf.channels, "brdf")
    shape = (*normals.shape[:-1], channels)
    towards, shares = _cap_nodes(lights, dtype)
    shine: Callable = functools.partial(transfer, brdf, normals)

    def add(total, light):
        direction, amount = light
        lit = jnp.broadcast_to(direction, normals.shape)
        rho = shine(lit, views, tangents)
        amount = jnp.broadcast_to(amount, shape)
        return total + jnp.broadcast_to(rho.astype(dtype), shape) * amount, None

    amounts = flux[:, None].astype(dtype) * shares[None, :, None]
    rows = (towards.reshape(-1, 3), amounts.reshape(-1, flux.shape[-1]))
    return jax.lax.scan(add, jnp.zeros(shape, dtype), rows)[0]


def _cap_nodes(lights: CapLights, dtype) -> tuple[jax.Array, jax.Array]:
    """Directions ``(n, k, 3)`` over each cap and their shares of its flux, ``(k,)``."""
    x, w = np.polynomial.legendre.leggauss(_RINGS)
    height = jnp.asarray((1 + x) / 2, dtype)  # share of 1 - cos
    turn = 2 * np.pi * np.arange(_SPOKES) / _SPOKES
    fall = jnp.asarray(lights.heights, dtype)[:, None] * height[None]
    across = jnp.sqrt(jnp.maximum(fall * (2 - fall), 0))[..., None]  # [n, ring, 1]
    frame = frames(jnp.asarray(lights.directions, dtype))
    spokes = jnp.asarray(np.stack([np.cos(turn), np.sin(turn)], -1), dtype)
    local = jnp.concatenate(
        [
            across[..., None] * spokes[None, None],
            jnp.broadcast_to((1 - fall)[..., None, None], (*fall.shape, _SPOKES, 1)),
        ],
        axis=-1,
    ).reshape(fall.shape[0], -1, 3)
    towards = jnp.einsum("nij,nki->nkj", frame, local)
    shares = np.repeat(w / 2, _SPOKES) / _SPOKES
    return towards, jnp.asarray(shares, dtype)
