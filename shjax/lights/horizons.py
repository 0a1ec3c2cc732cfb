"""What of an area light is above a surface's horizon.

A plane through the point cuts each arc where ``a + b cos t + c sin t`` vanishes along the
normal, and closes the outline along the horizon.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from shjax.arrays import safe_sqrt
from shjax.lights.outlines import Edges, Outline, Rims, angle, dot, rim_points, scaled


class _Cut(NamedTuple):
    """Where an arc enters and leaves the upper half space; zero where it does not."""

    entry: jax.Array
    exit: jax.Array


def above(outline: Outline, normal: jax.Array) -> Outline:
    """Part of a convex region above a horizon; it crosses that at most twice."""
    edges, first = _edges_above(outline.edges, normal)
    rims, second = _rims_above(outline.rims, normal)
    leaves = first.exit + second.exit
    enters = first.entry + second.entry
    closed = Edges(
        jnp.concatenate([edges.starts, leaves[None]]),
        jnp.concatenate([edges.ends, enters[None]]),
    )
    return Outline(closed, rims, outline.inside)


def polygon_above(vertices: jax.Array, normal: jax.Array) -> jax.Array:
    """Clip a polygon ``(V, 3)`` to a half space: ``(2 V, 3)``, vertices may repeat.

    Sutherland and Hodgman's algorithm with a static shape: each edge gives both its ends,
    or twice the last point where it lies below.
    """
    following = jnp.roll(vertices, -1, axis=0)
    edges, _ = _edges_above(Edges(vertices, following), normal)
    seen = jnp.any(edges.starts != edges.ends, axis=-1)

    def fill(last, edge):
        start, end, there = edge
        start, end = (jnp.where(there, a, last) for a in (start, end))
        return end, jnp.stack([start, end])

    rows = (edges.starts, edges.ends, seen)
    last, _ = jax.lax.scan(fill, jnp.zeros_like(normal), rows)
    return jax.lax.scan(fill, last, rows)[1].reshape(-1, 3)


def _edges_above(edges: Edges, normal: jax.Array) -> tuple[Edges, _Cut]:
    """Great arcs above the horizon, of length zero where there is nothing."""
    first, last = (dot(a, normal[None]) for a in edges)
    up, down = (first <= 0) & (last > 0), (first > 0) & (last <= 0)
    crossing = up | down
    share = jnp.where(crossing, first, 0) / jnp.where(crossing, first - last, 1)
    cut = edges.starts + scaled(share, edges.ends - edges.starts)
    seen = (first > 0) | (last > 0)
    starts = jnp.where(up[:, None], cut, edges.starts)
    ends = jnp.where(down[:, None], cut, edges.ends)
    starts, ends = (jnp.where(seen[:, None], a, 0) for a in (starts, ends))
    entry, exit_ = (jnp.sum(jnp.where(w[:, None], cut, 0), axis=0) for w in (up, down))
    return Edges(starts, ends), _Cut(entry, exit_)


def _rims_above(rims: Rims, normal: jax.Array) -> tuple[Rims, _Cut]:
    """Rims above the horizon, each in two parts: before its lowest point and after."""
    constant, cosine, sine = (
        dot(a, normal[None]) for a in (rims.centre, rims.cosine, rims.sine)
    )
    size = safe_sqrt(cosine**2 + sine**2)
    tilted = size > 0
    ratio = jnp.where(tilted, -constant, jnp.sign(-constant)) / jnp.where(
        tilted, size, 1
    )
    crosses, hidden = jnp.abs(ratio) < 1, ratio >= 1
    half = jnp.where(crosses, jnp.arccos(jnp.where(crosses, ratio, 0)), np.pi)
    # The lowest point, within one turn from the start.
    turn = 2 * np.pi
    low = angle(sine, cosine) + np.pi - rims.start
    low = rims.start + low - turn * jnp.floor(low / turn)
    before = (rims.start, jnp.minimum(low, rims.end), low - np.pi)
    after = (jnp.minimum(low, rims.end), rims.end, low + np.pi)
    pieces, entry, exit_ = [], 0, 0
    for start, end, top in (before, after):
        rises, falls = crosses & (top - half > start), crosses & (top + half < end)
        own = jnp.where(rises, top - half, start), jnp.where(falls, top + half, end)
        there = (own[1] > own[0]) & ~hidden
        own = tuple(jnp.where(there, a, start) for a in own)
        ends = rim_points(rims, jnp.stack(own, axis=1))[0]
        entry += jnp.sum(jnp.where((there & rises)[:, None], ends[:, 0], 0), axis=0)
        exit_ += jnp.sum(jnp.where((there & falls)[:, None], ends[:, 1], 0), axis=0)
        pieces.append(rims._replace(start=own[0], end=own[1]))
    both = jax.tree.map(lambda a, b: jnp.concatenate([a, b]), *pieces)
    return both, _Cut(jnp.asarray(entry), jnp.asarray(exit_))
