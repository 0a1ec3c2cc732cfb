"""Quadrature over any outline in polar coordinates about a lobe.

The integral over a region is one along its boundary of integrals from the lobe's centre
out to it, with the sign of the azimuth's change: parts outside the region cancel. Both
coordinates are graded by asinh, so that one rule serves lobes of every width.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from shjax.lights.outlines import (
    Outline,
    Rims,
    angle,
    dot,
    gauss,
    great_arcs,
    length,
    rim_points,
    scaled,
)
from shjax.vectors import normalize

_GRADED = 0.02  # radians; distances are uniform below it and logarithmic above


def nodes_about(
    outline: Outline, lobe: jax.Array, count: int
) -> tuple[jax.Array, jax.Array]:
    """Directions and solid angles, of either sign, ``(arcs count^2, 3)``.

    Args:
        outline: Of the region.
        lobe: Unit vector to the lobe's centre.
        count: Nodes along each arc, and out to it. Static.
    """
    arcs = _as_rims(outline)
    x, w = gauss(count, lobe.dtype)
    at, step = _along(arcs, lobe, x, w)
    points, slopes = rim_points(arcs, at)
    towards = normalize(points)
    across = jnp.cross(jnp.broadcast_to(lobe, towards.shape), towards)
    sine, cosine = length(across), jnp.sum(towards * lobe[None, None], axis=-1)
    # Azimuth about the lobe: lobe . (w x w') / sin^2 for each step.
    squared = dot(points, points) * sine**2
    there = squared > 0
    turn = jnp.sum(jnp.cross(points, slopes) * lobe[None, None], axis=-1)
    turn = step * jnp.where(there, turn, 0) / jnp.where(there, squared, 1)
    away = jnp.cross(across, jnp.broadcast_to(lobe, across.shape))
    away = normalize(away)
    longest = jnp.arcsinh(angle(sine, cosine) / _GRADED)[..., None]
    graded = longest * x[None, None]
    distance = _GRADED * jnp.sinh(graded)
    solid = _GRADED * jnp.cosh(graded) * longest * w[None, None] * jnp.sin(distance)
    solid = solid * turn[..., None]
    found = scaled(jnp.cos(distance), lobe[None, None, None])
    found = found + scaled(jnp.sin(distance), away[:, :, None])
    return found.reshape(-1, 3), solid.reshape(-1)


def _as_rims(outline: Outline) -> Rims:
    """All arcs in one form."""
    great = great_arcs(outline.edges)
    zero = jnp.zeros_like(great.length)
    edges = Rims(
        jnp.zeros_like(great.start), great.start, great.along, zero, great.length
    )
    return jax.tree.map(lambda a, b: jnp.concatenate([a, b]), edges, outline.rims)


def _along(
    arcs: Rims, lobe: jax.Array, x: jax.Array, w: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Parameters of nodes along arcs, dense where they pass the lobe, and their steps."""
    # Where the nodes lie is no part of what they sum: it has no derivative.
    fixed, lobe = jax.lax.stop_gradient((arcs, lobe))
    middle = (fixed.start + fixed.end) / 2
    near = angle(
        jnp.sum(fixed.sine * lobe[None], axis=-1),
        jnp.sum(fixed.cosine * lobe[None], axis=-1),
    )
    near = near - 2 * np.pi * jnp.round((near - middle) / (2 * np.pi))
    points, slopes = rim_points(fixed, near[:, None])
    size = length(points[:, 0])
    towards, speed = normalize(points[:, 0]), length(slopes[:, 0])
    speed = jnp.where(size > 0, speed, 1) / jnp.where(size > 0, size, 1)
    apart = length(towards - lobe[None])
    width = jnp.sqrt(apart**2 + _GRADED**2) / jnp.where(speed > 0, speed, 1)
    # A closed rim begins opposite the lobe.
    closed = fixed.end - fixed.start > 2 * np.pi - 1e-4
    start = jnp.where(closed, near - np.pi, arcs.start)
    end = jnp.where(closed, near + np.pi, arcs.end)
    low, high = (jnp.arcsinh((a - near) / width) for a in (start, end))
    graded = low[:, None] + (high - low)[:, None] * x[None]
    at = near[:, None] + width[:, None] * jnp.sinh(graded)
    step = width[:, None] * jnp.cosh(graded) * (high - low)[:, None] * w[None]
    return at, step
