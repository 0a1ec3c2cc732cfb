"""Reading a reflection map between its pixels, over the poles too.

References:
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array, as_float, check_vectors
from shjax.harmonics.orientations import einsum
from shjax.shrm.prefiltering import check_frame
from shjax.sphere import pixel_coordinates, polar_angles
from shjax.view_basis import ViewBasis, views_of_maps


@functools.partial(jax.jit, static_argnames=("frame", "interpolation"))
def radiance(
    maps: Float[Array, "n_theta n_phi Q C"],
    directions: Float[Array, "*points 3"],
    views: Float[Array, "*points 3"],
    *,
    frame: str = "local",
    interpolation: str = "cubic",
) -> Float[jax.Array, "*points C"]:
    """Read a lat-long SHRM at reflected directions and views [T5, Eqs. 5.10, 5.11].

    Differentiable in the map, the views and, piecewise, the directions. Not smooth within
    a pixel of a pole for local maps, whose frame turns there; :func:`shjax.reflect` is.

    Args:
        maps: From :func:`prefilter`; an even number of columns.
        directions: Unit reflected directions ``R = 2 (n.v) n - v``; tangents for fibres.
        views: Unit vectors to the viewer, in the world.
        frame: That of the map, ``"local"`` or ``"global"``. Static.
        interpolation: ``"cubic"`` (Catmull-Rom, 16 pixels) or ``"linear"`` (4). Static.

    Returns:
        ``(*points, C)``.

    Raises:
        ValueError: If a shape is wrong, or a choice unknown.
    """
    check_frame(frame)
    if interpolation not in _WEIGHTS:
        raise ValueError(
            f"interpolation must be one of {', '.join(_WEIGHTS)}; got {interpolation!r}."
        )
    if maps.ndim != 4 or 0 in maps.shape or maps.shape[1] % 2:
        raise ValueError(
            "maps must have shape (n_theta, n_phi, Q, C) with n_phi even; got "
            f"{maps.shape}."
        )
    basis = views_of_maps(maps)
    for name, vectors in (("directions", directions), ("views", views)):
        check_vectors(name, vectors)
        if vectors.shape != directions.shape:
            raise ValueError(
                f"views must have the shape of directions; got {views.shape} and "
                f"{directions.shape}."
            )
    return read_in(
        basis, maps, directions, views, frame=frame, interpolation=interpolation
    )


@functools.partial(jax.jit, static_argnames=("frame", "interpolation"))
def read_in(
    basis: ViewBasis,
    maps,
    directions,
    views,
    *,
    frame: str = "local",
    interpolation: str = "cubic",
) -> jax.Array:
    """:func:`radiance` of maps in a view basis of one's own; arguments are not checked."""
    maps = as_float("maps", maps)
    points = as_float("directions", directions).astype(maps.dtype).reshape(-1, 3)
    towards = as_float("views", views).astype(maps.dtype).reshape(-1, 3)
    local = frame == "local"
    seen = in_spherical_frame(points, towards) if local else towards
    values = basis.values(seen)
    orders = np.array(basis.orders) if local else np.zeros(len(basis.orders), int)
    total = _read(maps, points, values, orders, _WEIGHTS[interpolation])
    return total.reshape(*directions.shape[:-1], maps.shape[-1])


def in_spherical_frame(directions: jax.Array, vectors: jax.Array) -> jax.Array:
    """Components of vectors along e_theta, e_phi and the directions, ``(..., 3)``.

    At the poles the frame is that of phi = 0.
    """
    x, y, z = directions[..., 0], directions[..., 1], directions[..., 2]
    squared = x * x + y * y
    off = squared > 0
    across = jnp.where(off, jnp.sqrt(jnp.where(off, squared, 1)), 0)
    cosine = jnp.where(off, x / jnp.where(off, across, 1), 1)
    sine = jnp.where(off, y / jnp.where(off, across, 1), 0)
    a, b, c = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    along = cosine * a + sine * b
    return jnp.stack(
        [z * along - across * c, cosine * b - sine * a, x * a + y * b + z * c], axis=-1
    )


def _linear(t: jax.Array) -> list[tuple[int, jax.Array]]:
    return [(0, 1 - t), (1, t)]


def _cubic(t: jax.Array) -> list[tuple[int, jax.Array]]:
    """Catmull and Rom's weights of the pixels -1, 0, 1, 2."""
    t2, t3 = t * t, t * t * t
    return [
        (-1, (-t3 + 2 * t2 - t) / 2),
        (0, (3 * t3 - 5 * t2 + 2) / 2),
        (1, (-3 * t3 + 4 * t2 + t) / 2),
        (2, (t3 - t2) / 2),
    ]


_WEIGHTS = {"linear": _linear, "cubic": _cubic}


def _read(maps, points, values, orders: np.ndarray, weights: Callable) -> jax.Array:
    """Sum of interpolated coefficients times the basis values, ``(n, C)``."""
    n_theta, n_phi, maps_count, channels = maps.shape
    theta, phi = polar_angles(points)
    row, column = pixel_coordinates(theta, phi, n_theta, n_phi)
    top, left = (jnp.floor(a).astype(jnp.int32) for a in (row, column))
    flat = maps.reshape(n_theta * n_phi, maps_count, channels)
    odd = jnp.asarray(orders % 2 == 1)[None]
    total = jnp.zeros((points.shape[0], channels), maps.dtype)
    for down, weight in weights(row - top.astype(row.dtype)):
        line = top + down
        # Across a pole the next row is the one on the other side, half a turn on,
        # in a frame that is turned by pi.
        north, south = line < 0, line >= n_theta
        line = jnp.where(
            north, -1 - line, jnp.where(south, 2 * n_theta - 1 - line, line)
        )
        line = jnp.clip(line, 0, n_theta - 1)
        over = north | south
        flipped = jnp.where(over[:, None] & odd, -values, values)
        for right, share in weights(column - left.astype(column.dtype)):
            place = left + right + jnp.where(over, n_phi // 2, 0)
            index = line * n_phi + jnp.mod(place, n_phi)
            texels = jnp.take(flat, index, axis=0)
            part = einsum("nqc,nq->nc", texels, flipped)
            total = total + part * jnp.broadcast_to(
                (weight * share)[:, None], part.shape
            )
    return total
