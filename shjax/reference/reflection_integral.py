"""Reflection by integration over every pixel of the light: the truth, and the competitor.

No harmonics: for each normal and view the transfer function is evaluated at every sample
of the light and summed, in tiles of points by blocks of samples. With ``lobe_energy`` only
the samples in the lobe's cap are visited, as the thesis's own angular method does.

References:
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, sections 5.6.3 and 5.7.4.
"""

from __future__ import annotations

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Float

from shjax.arrays import (
    Array,
    as_float,
    check_vectors,
    common_channels,
    einsum,
    in_blocks,
    matmul,
)
from shjax.brdf.core import (
    Brdf,
    Local,
    by_frame,
    prepared,
    transfer_local,
)
from shjax.brdf.flux import lobe_angle
from shjax.brdf.quadrature import kind_of
from shjax.brdf.ranges import check_brdf
from shjax.light import Light, light_samples
from shjax.sphere import cube_directions
from shjax.vectors import frames, mirror

_TILE, _BLOCK = 32, 1024


def reference_reflection(
    light: Light,
    brdf: Brdf,
    normals: Float[Array, "*points 3"],
    views: Float[Array, "*points 3"],
    *,
    tangents: Float[Array, "*points 3"] | None = None,
    lobe_energy: float | None = None,
) -> Float[jax.Array, "*points E"]:
    """Reflected radiance by brute-force integration [T5, Eq. 5.2].

    The rendering equation without visibility, ``sum_n w_n L_n rho(d_n, v)`` over every
    pixel or sample of the light: the truth for the error of any reflection map.

    Args:
        light: An environment map of any layout, or a lat-long panorama as it is stored.
        brdf: The reflectance.
        normals: Unit normals.
        views: Unit vectors to the viewer.
        tangents: Unit tangents, for parts about the tangent.
        lobe_energy: Visit only the samples in a cap about the reflected direction that
            holds this share of the outgoing flux (0.95 in [T5, section 5.7.4]); default:
            all samples. Runs eagerly.

    Returns:
        Radiance ``(*points, C)``, in the light's type.

    Raises:
        ValueError: If a shape is wrong, tangents are missing, or ``lobe_energy`` is not
            in (0, 1] or asked for inside ``jit``.
    """
    samples = light_samples(light)
    if lobe_energy is None or normals.size == 0:
        return over_samples(*samples, brdf, normals, views, tangents=tangents)
    flux, towards, points = _checked(*samples, brdf, normals, views, tangents)
    values = _truncated(towards, flux, brdf, points, lobe_energy)
    return values.reshape(*normals.shape[:-1], values.shape[-1])


def over_samples(
    radiance,
    light_directions,
    weights,
    brdf: Brdf,
    normals,
    views,
    *,
    tangents=None,
) -> jax.Array:
    """Reflected radiance as a sum over light samples, of any number of points."""
    flux, towards, points = _checked(
        radiance, light_directions, weights, brdf, normals, views, tangents
    )
    channels = common_channels(flux.shape[-1], brdf.channels, "brdf")
    shape = (*normals.shape[:-1], channels)
    if normals.size == 0:
        return jnp.zeros(shape, flux.dtype)
    return _integrate(towards, flux, brdf, points).reshape(shape)


def _checked(radiance, light_directions, weights, brdf: Brdf, normals, views, tangents):
    """Flux ``(N, C)`` and directions of the samples, and flat points by name."""
    radiance = as_float("light", radiance)
    dtype = radiance.dtype
    check_brdf("brdf", brdf)
    common_channels(radiance.shape[-1], brdf.channels, "brdf")
    points = {"normals": normals, "views": views}
    if tangents is not None:
        points["tangents"] = tangents
    flat = {}
    for name, vectors in points.items():
        check_vectors(name, vectors)
        if vectors.shape != normals.shape:
            raise ValueError(
                f"{name} must have the shape of normals {normals.shape}; got "
                f"{vectors.shape}."
            )
        flat[name] = as_float(name, vectors).astype(dtype).reshape(-1, 3)
    by_frame(brdf, normals, tangents)
    flux = radiance * jnp.asarray(weights, dtype)[:, None]
    return flux, jnp.asarray(light_directions, dtype), flat


@jax.jit
def _integrate(directions, flux, brdf: Brdf, points: dict[str, jax.Array]) -> jax.Array:
    ready = prepared(brdf)
    size = min(_BLOCK, max(flux.shape[0], 1))
    blocks = (in_blocks(directions, size), in_blocks(flux, size))
    channels = common_channels(flux.shape[-1], brdf.channels, "brdf")

    @jax.checkpoint  # the gradient evaluates the BRDF again, and stays small
    def add_block(total, block, tile):
        towards, light = block
        return total + _sum_block(ready, towards, light, tile), None

    def one_tile(tile):
        zero = jnp.zeros((tile["normals"].shape[0], channels), flux.dtype)
        step = functools.partial(add_block, tile=tile)
        return jax.lax.scan(step, zero, blocks)[0]

    return in_tiles(one_tile, points, size)


def in_tiles(one_tile, points: dict[str, jax.Array], samples: int) -> jax.Array:
    """Evaluate points a tile at a time: the fewer samples, the larger, ``(n, C)``.

    Args:
        one_tile: From points of a tile to values, ``(T, C)``.
        points: Unit vectors by name, each ``(n, 3)``.
        samples: Directions visited at once for each point.
    """
    n = points["normals"].shape[0]
    at_once = math.ceil(n / math.ceil(n * samples / (_TILE * _BLOCK)))
    tiles = {name: _padded(a, at_once) for name, a in points.items()}
    made = jax.lax.map(one_tile, tiles)
    return made.reshape(-1, made.shape[-1])[:n]


def _padded(vectors: jax.Array, size: int) -> jax.Array:
    """In tiles; what fills the last one up looks along +z, so that it stays finite."""
    tiles = in_blocks(vectors, size)
    empty = jnp.all(tiles == 0, axis=-1, keepdims=True)
    up = jnp.asarray([0.0, 0.0, 1.0], tiles.dtype)
    return jnp.where(empty, jnp.broadcast_to(up, tiles.shape), tiles)


def _sum_block(brdf: Brdf, directions, flux, tile, inside=None) -> jax.Array:
    """Sum over a block of samples for a tile of points, ``(T, C)``."""
    total, normals = None, tile["normals"]
    for axes, part in by_frame(brdf, normals, tile.get("tangents")):
        frame = frames(axes)
        turned = matmul(frame.reshape(-1, 3), directions.T)  # [t i, n]
        turned = turned.reshape(normals.shape[0], 3, -1)
        light = Local(turned[:, 0], turned[:, 1], turned[:, 2])
        seen = jnp.sum(frame * tile["views"][:, None, :], axis=-1)  # [t, i]
        spread = (jnp.broadcast_to(seen[:, i, None], light.x.shape) for i in range(3))
        rho = transfer_local(part, light, Local(*spread))  # [c, t, n]
        if inside is not None:
            rho = jnp.where(jnp.broadcast_to(inside[None], rho.shape), rho, 0)
        if rho.shape[0] == 1:
            value = matmul(rho[0], flux)
        else:
            shape = (flux.shape[0], rho.shape[0])
            columns = jnp.broadcast_to(flux, shape)
            value = einsum("ctn,nc->tc", rho, columns)
        total = value if total is None else total + value
    return jnp.asarray(total)


def _truncated(directions, flux, brdf: Brdf, points: dict, share: float) -> jax.Array:
    """Integrate over the lobe's cap only: points in cells, each with its own samples."""
    leaves = jax.tree.leaves((directions, brdf, points))
    if any(isinstance(leaf, Tracer) for leaf in leaves):
        raise ValueError(
            "lobe_energy chooses samples by value and does not run in jit."
        )
    if not 0 < share <= 1:
        raise ValueError(f"lobe_energy must lie in (0, 1]; got {share}.")
    if kind_of(brdf) == "tangent":
        raise ValueError("lobe_energy needs a lobe about the reflected direction.")
    angle = lobe_angle(brdf, share)
    reflected = np.asarray(mirror(points["normals"], points["views"]), np.float64)
    side = int(np.clip(np.ceil(1.5 / angle), 1, 24))
    centres = cube_directions(side).reshape(-1, 3)
    cell = np.argmax(reflected @ centres.T, axis=1)
    channels = common_channels(flux.shape[-1], brdf.channels, "brdf")
    values = np.zeros((reflected.shape[0], channels), flux.dtype)
    for group, size in _groups(
        np.asarray(directions, np.float64), reflected, cell, angle
    ):
        lists = np.stack([np.resize(near, size) for _, near, _ in group])
        counts = np.array([near.size for _, near, _ in group])
        members = np.stack([some for some, _, _ in group])
        tiles = {name: jnp.take(a, members, axis=0) for name, a in points.items()}
        limit = jnp.asarray(np.cos(angle), flux.dtype)
        found = _capped(directions, flux, brdf, tiles, lists, counts, limit)
        real = np.concatenate([some[:k] for some, _, k in group])
        kept = [np.asarray(found[i, :k]) for i, (_, _, k) in enumerate(group)]
        values[real] = np.concatenate(kept)
    return jnp.asarray(values)


def _groups(directions, reflected, cell, angle: float):
    """Tiles of one cell's points with the samples near them, by size of that list.

    Yields:
        Lists of (point indices of a full tile, sample indices, points that count), and
        the padded length of the sample lists.
    """
    by_size: dict[int, list] = {}
    for one in np.unique(cell):
        members = np.flatnonzero(cell == one)
        axis = reflected[members].mean(axis=0)
        axis /= max(np.linalg.norm(axis), 1e-12)
        spread = np.arccos(np.clip((reflected[members] @ axis).min(), -1, 1))
        reach = np.cos(min(angle + spread + 1e-6, np.pi))
        near = np.flatnonzero(directions @ axis >= reach)
        size = 256 * 2 ** int(np.ceil(np.log2(max(near.size, 1) / 256).clip(0)))
        for start in range(0, members.size, _TILE):
            some = members[start : start + _TILE]
            row = (np.resize(some, _TILE), near, some.size)
            by_size.setdefault(min(size, max(directions.shape[0], 1)), []).append(row)
    for size, rows in by_size.items():
        yield [row for row in rows if row[1].size], size


@jax.jit
def _capped(directions, flux, brdf: Brdf, tiles, lists, counts, limit) -> jax.Array:
    ready = prepared(brdf)

    def one_tile(inputs):
        tile, near, count = inputs
        some, light = jnp.take(directions, near, axis=0), jnp.take(flux, near, axis=0)
        reflected = mirror(tile["normals"], tile["views"])
        inside = matmul(reflected, some.T) >= limit
        inside &= jnp.broadcast_to(
            jnp.arange(near.shape[0])[None] < count, inside.shape
        )
        return _sum_block(ready, some, light, tile, inside)

    return jax.lax.map(one_tile, (tiles, lists, counts))
