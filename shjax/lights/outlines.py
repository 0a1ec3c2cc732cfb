"""Outlines of area lights on the sphere about a point, and what their boundary gives.

A region's harmonic moments are integrals over its boundary: ``Y_lm`` is an eigenfunction
of the sphere's Laplacian, so by the divergence theorem

``integral of Y_lm = 1 / (l (l + 1)) x boundary integral of grad Y_lm . (inward normal)``

for l >= 1; degree 1 is the vector irradiance [RTR, Eqs. 10.4 to 10.7], and Lambert's sum
over a polygon's edges. Every light's outline consists of arcs ``a + b cos t + c sin t``,
seen from the point: edges of polygons are arcs of great circles, rims of disks and spheres
are the others. What lies below a surface's horizon is cut off arc by arc.

All functions take one point; the region lies to the left of its boundary.

References:
    [RTR] T. Akenine-Moller et al., Real-Time Rendering, 4th ed., CRC Press, 2018,
    chapter 10.
    [OS83] A. Van Oosterom and J. Strackee, The Solid Angle of a Plane Triangle, IEEE
    Transactions on Biomedical Engineering 30 (2), 1983.
    [W20] L. Wu et al., Analytic Spherical Harmonic Gradients for Real-Time Rendering with
    Many Polygonal Area Lights, ACM TOG 39 (4), 2020.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from shjax.arrays import safe_sqrt
from shjax.harmonics import basis
from shjax.harmonics.degrees import degrees
from shjax.vectors import normalize

_PANELS, _PER_PANEL = 8, 10  # of a rim; nodes of each beyond what the degree needs
_SAMPLES, _EVEN = 128, 0.2  # to place them: samples, and how far t is spaced evenly


class Edges(NamedTuple):
    """Arcs of great circles between vectors of any length, each ``(E, 3)``."""

    starts: jax.Array
    ends: jax.Array


class Rims(NamedTuple):
    """Arcs ``centre + cosine cos t + sine sin t``, t from start to end.

    Attributes:
        centre: ``(R, 3)``.
        cosine: ``(R, 3)``.
        sine: ``(R, 3)``.
        start: ``(R,)``.
        end: ``(R,)``.
    """

    centre: jax.Array
    cosine: jax.Array
    sine: jax.Array
    start: jax.Array
    end: jax.Array


class Outline(NamedTuple):
    """Boundary of a region of the sphere.

    Attributes:
        edges: Great arcs.
        rims: Other arcs.
        inside: A vector to a point inside, or a corner, ``(3,)``.
    """

    edges: Edges
    rims: Rims
    inside: jax.Array


class Nodes(NamedTuple):
    """Quadrature along a boundary: unit vectors and inward normals times length."""

    towards: jax.Array
    inward: jax.Array


def no_edges(dtype) -> Edges:
    """Outline without corners."""
    return Edges(jnp.zeros((0, 3), dtype), jnp.zeros((0, 3), dtype))


def no_rims(dtype) -> Rims:
    """Outline of great arcs alone."""
    vector, number = jnp.zeros((0, 3), dtype), jnp.zeros(0, dtype)
    return Rims(vector, vector, vector, number, number)


def whole_turn(dtype) -> tuple[jax.Array, jax.Array]:
    """Start and end of one closed rim."""
    return jnp.full(1, -np.pi, dtype), jnp.full(1, np.pi, dtype)


def dot(a: jax.Array, b: jax.Array) -> jax.Array:
    """Inner products along the last axis."""
    return jnp.sum(a * b, axis=-1)


def length(vectors: jax.Array) -> jax.Array:
    """Length, with derivative 0 at 0."""
    return safe_sqrt(dot(vectors, vectors))


def angle(y: jax.Array, x: jax.Array) -> jax.Array:
    """``arctan2`` with a derivative of zero at the origin."""
    there = (x != 0) | (y != 0)
    return jnp.arctan2(jnp.where(there, y, 0), jnp.where(there, x, 1))


def scaled(factors: jax.Array, vectors: jax.Array) -> jax.Array:
    """Vectors times one factor each."""
    return factors[..., None] * vectors


class GreatArcs(NamedTuple):
    """Great arcs: unit vectors to start and along, inward normal, length."""

    start: jax.Array
    along: jax.Array
    inward: jax.Array
    length: jax.Array


def great_arcs(edges: Edges) -> GreatArcs:
    """Frames and lengths of great arcs; an edge of no length has no direction."""
    # By the difference, whose digits a small light keeps.
    cross = jnp.cross(edges.starts, edges.ends - edges.starts)
    size = length(cross)
    inward = normalize(cross)
    start = normalize(edges.starts)
    arc = jnp.where(size > 0, angle(size, dot(edges.starts, edges.ends)), 0)
    return GreatArcs(start, jnp.cross(inward, start), inward, arc)


def edge_nodes(edges: Edges, count: int) -> Nodes:
    """Gauss nodes of great arcs, ``(E count, 3)`` each."""
    arcs = great_arcs(edges)
    x, w = gauss(count, edges.starts.dtype)
    at = arcs.length[:, None] * x[None]
    towards = scaled(jnp.cos(at), arcs.start[:, None]) + scaled(
        jnp.sin(at), arcs.along[:, None]
    )
    inward = scaled(arcs.length[:, None] * w[None], arcs.inward[:, None])
    return Nodes(towards.reshape(-1, 3), inward.reshape(-1, 3))


def gauss(count: int, dtype) -> tuple[jax.Array, jax.Array]:
    """Gauss-Legendre nodes and weights of [0, 1]."""
    x, w = np.polynomial.legendre.leggauss(count)
    return jnp.asarray((1 + x) / 2, dtype), jnp.asarray(w / 2, dtype)


def rim_points(rims: Rims, at: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Points of rims and their derivatives, at parameters ``(R, n)``: ``(R, n, 3)``."""
    cosine, sine = jnp.cos(at), jnp.sin(at)
    points = (
        rims.centre[:, None]
        + scaled(cosine, rims.cosine[:, None])
        + scaled(sine, rims.sine[:, None])
    )
    slopes = scaled(cosine, rims.sine[:, None]) - scaled(sine, rims.cosine[:, None])
    return points, slopes


def rim_nodes(rims: Rims, l_max: int) -> Nodes:
    """Gauss nodes of rims, in panels of equal angle as the point sees them."""
    count = int(np.ceil(l_max * np.pi / _PANELS)) + _PER_PANEL
    x, w = gauss(count, rims.centre.dtype)
    ends = _panels(rims)
    step = jnp.diff(ends, axis=1)[..., None]
    at = (ends[:, :-1, None] + step * x[None, None]).reshape(ends.shape[0], -1)
    weight = (step * w[None, None]).reshape(at.shape)
    points, slopes = rim_points(rims, at)
    squared = dot(points, points)
    weight = weight / jnp.where(squared > 0, squared, 1)
    inward = scaled(weight, jnp.cross(points, slopes))
    return Nodes(normalize(points).reshape(-1, 3), inward.reshape(-1, 3))


def _panels(rims: Rims) -> jax.Array:
    """Parameters between panels of about equal angle, ``(R, panels + 1)``."""
    # Where the inner ones lie is no part of what the nodes sum: it has no derivative.
    fixed = jax.lax.stop_gradient(rims)
    share = jnp.asarray((np.arange(_SAMPLES) + 0.5) / _SAMPLES, fixed.start.dtype)
    span = (fixed.end - fixed.start)[:, None]
    points, slopes = rim_points(fixed, fixed.start[:, None] + span * share[None])
    squared = dot(points, points)
    speed = length(jnp.cross(points, slopes)) / jnp.where(squared > 0, squared, 1)
    speed = speed + _EVEN * jnp.mean(speed, axis=1, keepdims=True) + 1e-6
    passed = jnp.pad(jnp.cumsum(speed, axis=1), ((0, 0), (1, 0)))
    passed = passed / passed[:, -1:]
    marks = jnp.arange(_SAMPLES + 1).astype(share.dtype) / _SAMPLES
    wanted = jnp.arange(1, _PANELS).astype(share.dtype) / _PANELS
    inner = jax.vmap(lambda known: jnp.interp(wanted, known, marks))(passed)
    ends = [a[:, None] for a in (rims.start, rims.end)]
    return jnp.concatenate([ends[0], fixed.start[:, None] + span * inner, ends[1]], 1)


def nodes(outline: Outline, l_max: int) -> Nodes:
    """Quadrature along a boundary for harmonics up to a degree."""
    parts = []
    if outline.edges.starts.shape[0]:
        parts.append(edge_nodes(outline.edges, int(np.ceil(l_max * np.pi / 2)) + 8))
    if outline.rims.start.shape[0]:
        parts.append(rim_nodes(outline.rims, l_max))
    return jax.tree.map(lambda *a: jnp.concatenate(a), *parts)


def solid_angle(outline: Outline) -> jax.Array:
    """Solid angle of a region: triangles from a point inside [OS83], and its rims."""
    k = outline.inside
    a, b = outline.edges
    far, near, last = length(a), length(k), length(b)
    # The triple product by differences, whose digits a small light keeps.
    triple = jnp.sum(k[None] * jnp.cross(a - k[None], b - k[None]), axis=-1)
    sum_ = far * near * last + dot(a, k[None]) * last
    sum_ = sum_ + dot(a, b) * near + dot(b, k[None]) * far
    there = far * last > 0  # what is cut off has no length
    total = 2 * jnp.sum(jnp.where(there, angle(triple, sum_), 0))
    if outline.rims.start.shape[0]:
        towards, inward = rim_nodes(outline.rims, 2)
        unit = normalize(k)[None]
        below = 1 + dot(unit, towards)
        total = total + jnp.sum(dot(unit, inward) / jnp.where(below > 0, below, 1))
    return total


def vector_irradiance(outline: Outline) -> jax.Array:
    """Vector irradiance of unit radiance, ``(3,)`` [RTR, Eq. 10.4]."""
    arcs = great_arcs(outline.edges)
    total = jnp.sum(scaled(arcs.length, arcs.inward), axis=0)
    if outline.rims.start.shape[0]:
        total = total + jnp.sum(rim_nodes(outline.rims, 2).inward, axis=0)
    return total / 2


def coefs(outline: Outline, l_max: int) -> jax.Array:
    """Coefficients of a region of unit radiance, ``(K,)``; differentiable [W20]."""
    own = solid_angle(outline)
    zero = (own / np.sqrt(4 * np.pi))[None]
    if l_max == 0:
        return zero
    towards, inward = nodes(outline, l_max)
    slopes = jax.jvp(lambda w: basis(w, l_max=l_max), (towards,), (inward,))[1]
    l = degrees(l_max)[1:]
    over = jnp.asarray(1 / (l * (l + 1)), slopes.dtype)
    return jnp.concatenate([zero, jnp.sum(slopes[:, 1:], axis=0) * over])


def zonal_moments(outline: Outline, axis: jax.Array, l_max: int) -> jax.Array:
    """Integrals of ``P_l(w . axis)`` over a region, ``(L,)``."""
    towards, inward = nodes(outline, l_max)
    z, c = (jnp.sum(a * axis[None], axis=-1) for a in (towards, inward))

    def degree(carry, l):
        value, last, slope, last_slope = carry  # P_l, P_(l-1) and their derivatives
        moment = jnp.sum(c * slope) / (l * (l + 1))
        following = ((2 * l + 1) * z * value - l * last) / (l + 1)
        return (following, value, (2 * l + 1) * value + last_slope, slope), moment

    start = (z, jnp.ones_like(z), jnp.ones_like(z), jnp.zeros_like(z))
    l = jnp.arange(1, l_max + 1).astype(z.dtype)
    _, moments = jax.lax.scan(degree, start, l)
    return jnp.concatenate([solid_angle(outline)[None], moments])
