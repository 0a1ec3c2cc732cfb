"""Taking the brightest light sources out of a lat-long panorama.

All in JAX with static shapes, so that it jits and its results differentiate with respect
to the pixels; which pixels belong to a light is taken as given.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Float

from shjax.arrays import Array, as_float, matmul
from shjax.colour import luminance
from shjax.envmap import EnvironmentMap
from shjax.lights.caps import CapLights
from shjax.sphere import latlong_phi, latlong_solid_angles, latlong_theta
from shjax.vectors import frames, normalize, polar_angles

_WIDEST = np.radians(3.0)
_WINDOW = np.radians(7.0)
_SHARE_OF_PEAK = 0.25
_SHARE_TAKEN = 0.05  # of the excess: what hangs together with the light
_MIN_CONTRAST = 20.0  # of the peak over its surroundings
_MIN_FLUX = 0.01  # of the whole light
_RINGS, _SPOKES = 6, 48  # of the samples of the surroundings


def split_lights(
    envmap: EnvironmentMap, *, max_lights: int = 4
) -> tuple[CapLights, EnvironmentMap]:
    """Split the brightest light sources (sun, lamps) off a panorama.

    One after the other: the connected pixels about the brightest one whose excess over
    the surroundings is above a twentieth of its own become a cap of the same flux in each
    channel, centroid and mean cosine; the surroundings stay. A light counts if it is at
    most 3 degrees in radius, 20 times brighter than its surroundings, and holds 1 % of
    the whole. Flux is conserved; nothing is taken where nothing stands out.

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
    radiance = as_float("envmap", envmap.radiance)
    lights, rest = take_lights(radiance, max_lights=max_lights)
    if not isinstance(lights.flux, Tracer):
        count = int(np.count_nonzero(np.any(np.asarray(lights.flux) != 0, axis=-1)))
        if not count:
            rest = envmap.radiance
        lights = jax.tree.map(lambda a: a[:count], lights)
    return lights, dataclasses.replace(envmap, radiance=rest, image=rest)


@functools.partial(jax.jit, static_argnames=("max_lights",))
def take_lights(
    radiance: Float[Array, "H W C"], *, max_lights: int
) -> tuple[CapLights, Float[Array, "H W C"]]:
    """Split light sources off an array; those that were not found have no flux.

    Args:
        radiance: Panorama as it is stored.
        max_lights: How many rows the result has. Static.
    """
    height, width, channels = radiance.shape
    grid = _band(height, width)
    solid = jnp.asarray(latlong_solid_angles(height, width), radiance.dtype)
    grey = luminance(jax.lax.stop_gradient(radiance))
    whole = jnp.sum(jnp.sum(grey, axis=1) * solid)

    def one(state, _):
        light, image, grey = _take_one(state[0], state[1], whole, grid)
        return (image, grey), light

    if not max_lights:
        empty = CapLights(
            jnp.zeros((0, 3), radiance.dtype),
            jnp.zeros(0, radiance.dtype),
            jnp.zeros((0, channels), radiance.dtype),
        )
        return empty, radiance
    (rest, _), lights = jax.lax.scan(one, (radiance, grey), None, length=max_lights)
    return CapLights(*lights), rest


class _Band(NamedTuple):
    """Rows about a light: how many, and cosine and sine of each column's azimuth."""

    rows: int
    cosine: np.ndarray
    sine: np.ndarray


def _band(height: int, width: int) -> _Band:
    rows = min(height, 2 * int(np.ceil(_WINDOW / np.pi * height)) + 1)
    phi = latlong_phi(width)
    return _Band(rows, np.cos(phi), np.sin(phi))


def _take_one(image: jax.Array, grey: jax.Array, whole: jax.Array, grid: _Band):
    """Direction, height and flux of the brightest light; image and grey without it."""
    height, width, channels = image.shape
    dtype = image.dtype
    peak = jnp.argmax(grey)
    row, column = peak // width, peak % width
    first = jnp.clip(row - grid.rows // 2, 0, height - grid.rows)
    band = jax.lax.dynamic_slice(image, (first, 0, 0), (grid.rows, width, channels))
    shade = jax.lax.dynamic_slice(grey, (first, 0), (grid.rows, width))
    theta = jnp.asarray(latlong_theta(height), dtype)
    theta = jax.lax.dynamic_slice(theta, (first,), (grid.rows,))
    solid = jnp.asarray(latlong_solid_angles(height, width), dtype)
    solid = jax.lax.dynamic_slice(solid, (first,), (grid.rows,))
    pixels = _directions(theta, grid)
    means = _mean_less_centre(height, width)
    means = jax.lax.dynamic_slice(jnp.asarray(means, dtype), (first, 0), (grid.rows, 2))
    seed = jnp.zeros((grid.rows, width), bool).at[row - first, column].set(True)
    brightest = shade[row - first, column]

    def fall(axis: jax.Array) -> jax.Array:
        """``1 - cos`` of the angle to each pixel, by way of the difference."""
        return jnp.sum((pixels - axis[None, None]) ** 2, axis=-1) / 2

    near = fall(pixels[row - first, column]) < _height(_WINDOW)
    core = _connected(near & (shade > _SHARE_OF_PEAK * brightest), seed)
    amount = jnp.where(core, shade * solid[:, None], 0)
    middle = normalize(jnp.sum(amount[..., None] * pixels, axis=(0, 1)))
    around = _surroundings(image, jax.lax.stop_gradient(middle))
    level = luminance(around)
    excess = brightest - level
    away = fall(middle)
    bright = (away < _height(_WINDOW)) & (shade - level > _SHARE_TAKEN * excess)
    region = _connected(bright, seed)
    stands_out = (excess > 0) & (brightest >= _MIN_CONTRAST * jnp.maximum(level, 0))
    # A pixel is bright that the light touches: its centre may lie half of it further out.
    reach = _WIDEST + np.pi / height / np.sqrt(2)
    small = jnp.all(jnp.where(region, away, 0) < _height(reach))
    taken = jnp.where(region[..., None], jnp.maximum(band - around[None, None], 0), 0)
    flux = jnp.sum(taken * solid[:, None, None], axis=(0, 1))
    found = stands_out & small & (luminance(flux) >= _MIN_FLUX * whole)
    amount = luminance(taken) * solid[:, None]
    direction, cap = _moments(amount, pixels, _off_centre(means, grid), found)
    taken = jnp.where(found, taken, 0)
    light = (direction, cap, jnp.where(found, flux, 0))
    shade = luminance(jax.lax.stop_gradient(band - taken))
    return (
        light,
        jax.lax.dynamic_update_slice(image, band - taken, (first, 0, 0)),
        jax.lax.dynamic_update_slice(grey, shade, (first, 0)),
    )


def _height(angle: float) -> float:
    return 2 * float(np.sin(angle / 2)) ** 2


def _directions(theta: jax.Array, grid: _Band) -> jax.Array:
    across, up = jnp.sin(theta)[:, None], jnp.cos(theta)[:, None]
    x = across * jnp.asarray(grid.cosine, theta.dtype)[None]
    y = across * jnp.asarray(grid.sine, theta.dtype)[None]
    return jnp.stack([x, y, jnp.broadcast_to(up, x.shape)], axis=-1)


def _surroundings(image: jax.Array, axis: jax.Array) -> jax.Array:
    """Median radiance between 4 degrees and the window's end about an axis, ``(C,)``."""
    height, width, channels = image.shape
    ring = np.linspace(_WIDEST + np.radians(1.0), _WINDOW, _RINGS)[:, None]
    turn = (2 * np.pi / _SPOKES) * np.arange(_SPOKES)[None]
    local = np.stack(
        [
            np.sin(ring) * np.cos(turn),
            np.sin(ring) * np.sin(turn),
            np.cos(ring) + 0 * turn,
        ],
        axis=-1,
    ).reshape(-1, 3)
    towards = jnp.asarray(local, image.dtype) @ frames(axis)
    theta, phi = polar_angles(towards)
    row = jnp.clip((theta * (height / np.pi)).astype(jnp.int32), 0, height - 1)
    column = (np.pi - phi) * (width / (2 * np.pi))
    column = jnp.clip(column.astype(jnp.int32), 0, width - 1)
    ranked = jnp.sort(image[row, column].reshape(-1, channels), axis=0)
    half = _RINGS * _SPOKES // 2
    return (ranked[half - 1] + ranked[half]) / 2


def _moments(flux: jax.Array, pixels: jax.Array, off: jax.Array, found):
    """Centroid of pixels with some flux each, and the cap of their mean cosine.

    ``off`` is each pixel's mean direction less its centre: at a pole a row of pixels is a
    cap, whose parts lie on average further out than their centres.
    """
    total = jnp.where(found, jnp.sum(flux), 1)
    moment = jnp.sum(flux[..., None] * (pixels + off), axis=(0, 1))
    upright = jnp.zeros(3, flux.dtype).at[2].set(1)
    axis = jnp.where(found, normalize(jnp.where(found, moment, upright)), upright)
    fall = jnp.sum((pixels - axis[None, None]) ** 2, axis=-1) / 2
    lost = jnp.sum(flux * (fall - matmul(off, axis))) / total
    # The mean cosine of a cap is 1 - height / 2.
    return axis, jnp.where(found, 2 * lost, 0)


def _mean_less_centre(height: int, width: int) -> np.ndarray:
    """Mean direction of a pixel less its centre, across and up: one per row, ``(H, 2)``."""
    half, theta = np.pi / (2 * height), latlong_theta(height)
    between = 2 * np.sin(theta) * np.sin(half)  # of the cosines of the row's edges
    across = half - np.cos(2 * theta) * np.sin(2 * half) / 2
    across = across / between * np.sinc(1 / width)
    return np.stack(
        [across - np.sin(theta), -2 * np.cos(theta) * np.sin(half / 2) ** 2], axis=-1
    )


def _off_centre(means: jax.Array, grid: _Band) -> jax.Array:
    """The same as vectors, for each pixel of a band."""
    across, up = means[:, :1], means[:, 1:]
    x = across * jnp.asarray(grid.cosine, means.dtype)[None]
    y = across * jnp.asarray(grid.sine, means.dtype)[None]
    return jnp.stack([x, y, jnp.broadcast_to(up, x.shape)], axis=-1)


def _connected(bright: jax.Array, seed: jax.Array) -> jax.Array:
    """The bright pixels that hang together with the seed, across the seam too."""

    def grow(state):
        region, _ = state
        wider = region | jnp.roll(region, 1, axis=1) | jnp.roll(region, -1, axis=1)
        down = jnp.pad(region[:-1], [(1, 0), (0, 0)])
        up = jnp.pad(region[1:], [(0, 1), (0, 0)])
        wider = (wider | down | up) & bright
        return wider, jnp.any(wider != region)

    start = (seed, jnp.asarray(True))
    return jax.lax.while_loop(lambda state: state[1], grow, start)[0]
