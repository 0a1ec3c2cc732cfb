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

from shjax.arrays import as_float, check_vectors, einsum
from shjax.reflection.view_basis import ViewBasis
from shjax.sphere import pixel_coordinates
from shjax.vectors import in_spherical_frame, polar_angles

FRAMES = ("local", "global")
CENTRES = ("reflection", "tangent")


def check_frame(frame: str, centre: str) -> None:
    """Refuse an unknown frame or centre.

    Raises:
        ValueError: If it is not one of :data:`FRAMES` or :data:`CENTRES`.
    """
    if frame not in FRAMES:
        raise ValueError(f"frame must be one of {', '.join(FRAMES)}; got {frame!r}.")
    if centre not in CENTRES:
        raise ValueError(f"centre must be one of {', '.join(CENTRES)}; got {centre!r}.")


@functools.partial(jax.jit, static_argnames=("frame", "interpolation"))
def read_latlong(
    view_basis: ViewBasis,
    coefs,
    reflected,
    views,
    *,
    frame: str = "local",
    interpolation: str = "cubic",
) -> jax.Array:
    """Read a lat-long reflection map between its pixels [T5, Eqs. 5.10, 5.11].

    Args:
        view_basis: The functions of the view that ``coefs`` belong to.
        coefs: ``(n_theta, n_phi, Q, C)``, an even number of columns.
        reflected: Unit reflected directions, ``(*points, 3)``; tangents for fibres.
        views: Unit vectors to the viewer, in the world, of the same shape.
        frame: That of the map. Static.
        interpolation: A name of :data:`INTERPOLATIONS`. Static.

    Raises:
        ValueError: If a shape is wrong or the interpolation unknown.
    """
    if interpolation not in INTERPOLATIONS:
        raise ValueError(
            f"interpolation must be one of {', '.join(INTERPOLATIONS)}; got "
            f"{interpolation!r}."
        )
    for name, vectors in (("reflected", reflected), ("views", views)):
        check_vectors(name, vectors)
        if vectors.shape != reflected.shape:
            raise ValueError(
                f"views must have the shape of reflected; got {views.shape} and "
                f"{reflected.shape}."
            )
    points = as_float("reflected", reflected).astype(coefs.dtype).reshape(-1, 3)
    towards = as_float("views", views).astype(coefs.dtype).reshape(-1, 3)
    local = frame == "local"
    seen = in_spherical_frame(points, towards) if local else towards
    values = view_basis.values(seen)
    count = len(view_basis.orders)
    orders = np.array(view_basis.orders) if local else np.zeros(count, int)
    total = _read(coefs, points, values, orders, INTERPOLATIONS[interpolation])
    return total.reshape(*reflected.shape[:-1], coefs.shape[-1])


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


INTERPOLATIONS = {"linear": _linear, "cubic": _cubic}


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
