"""Rows of the design: what each pixel receives of each lighting coefficient.

``image = albedo * rows @ lighting``; for a matte surface ``rows = Ahat_l Y_lm(n) / pi``.
Whatever else a pixel is (a footprint of several normals, a glossy surface, a place that
sees part of the sky) is other rows in the same problem.

References:
    [RH01] R. Ramamoorthi and P. Hanrahan, On the relationship between radiance and
    irradiance, JOSA A, 2001.
    [S02] P.-P. Sloan, J. Kautz, J. Snyder, Precomputed Radiance Transfer, SIGGRAPH 2002.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array, in_blocks
from shjax.brdf import Brdf
from shjax.brdf.quadrature import Resolution, moments_at
from shjax.harmonics import basis, rotate
from shjax.harmonics.degrees import degrees
from shjax.irradiance import cosine_kernel_table
from shjax.kernels import radial_gains
from shjax.render import Trace, visibility
from shjax.sphere import fibonacci_directions, mirror, normalize

_einsum = functools.partial(jnp.einsum, precision=jax.lax.Precision.HIGHEST)
_POINTS_AT_ONCE = 256


def seen_by_cosine(l_max: int) -> np.ndarray:
    """Positions of the coefficients that a matte surface reflects, those of gain 0 not."""
    return np.flatnonzero(cosine_kernel_table(l_max)[degrees(l_max)])


def cosine_rows(normals: jax.Array, l_max: int) -> jax.Array:
    """Rows of a white matte surface in the coefficients it reflects, ``(..., J)``.

    Args:
        normals: ``(..., 3)``; zero rows for zero vectors.
        l_max: Highest degree.
    """
    gains = cosine_kernel_table(l_max)[degrees(l_max)] / math.pi
    seen = np.flatnonzero(gains)
    # Only the columns that are used are kept: odd degrees above 1 are half of all.
    columns = basis(normals, l_max=l_max)[..., seen]
    nonzero = jnp.any(normals != 0, axis=-1, keepdims=True)
    scaled = columns * jnp.broadcast_to(
        jnp.asarray(gains[seen], normals.dtype), columns.shape
    )
    return jnp.where(jnp.broadcast_to(nonzero, scaled.shape), scaled, 0)


def footprint_rows(normals: jax.Array, l_max: int) -> jax.Array:
    """Mean over the normals of a pixel's parts, ``(N, S, 3)`` to ``(N, J)``.

    A part that shows nothing has a zero normal, and counts: a pixel on the outline holds
    the black background too.
    """

    def block(some):
        return jnp.mean(cosine_rows(some, l_max), axis=1)

    blocks = jax.lax.map(block, in_blocks(normals, _POINTS_AT_ONCE))
    return blocks.reshape(-1, blocks.shape[-1])[: normals.shape[0]]


def visible_cosine(
    trace: Trace, *, l_max: int, directions: int = 4096
) -> Float[np.ndarray, "H W K"]:
    """Rows of a white matte mesh that shadows itself [S02, section 4.1, ``M_p / pi``].

    The clamped cosine times the visibility of each direction, projected for each pixel:
    odd degrees are no longer invisible.

    Args:
        trace: From :func:`shjax.render.trace_mesh`.
        l_max: Highest degree, inclusive.
        directions: How many are traced from each pixel, equally spread.

    Returns:
        ``(H, W, (l_max + 1)^2)``, to be given as ``rows`` to
        :func:`shjax.estimate_lighting`.

    Raises:
        ImportError: If trimesh is not installed.
        ValueError: If ``l_max`` is out of range.
    """
    towards = fibonacci_directions(directions)
    functions = np.asarray(basis(jnp.asarray(towards), l_max=l_max))
    # Sums over points on the sphere are exact for constants only: divide by their own.
    gains = cosine_kernel_table(l_max)[degrees(l_max)] / math.pi
    normals = np.asarray(trace.gbuffer.normals, float)
    rows = np.zeros((*normals.shape[:2], functions.shape[1]))
    weight = 4 * math.pi / directions / math.pi
    for i in range(normals.shape[0]):
        if not np.any(np.asarray(trace.gbuffer.mask[i]) > 0):
            continue
        cosine = np.maximum(normals[i] @ towards.T, 0)
        hidden = cosine * ~visibility_of_row(trace, i, towards)
        exact = np.asarray(basis(jnp.asarray(normals[i]), l_max=l_max)) * gains
        rows[i] = exact - (hidden @ functions) * weight
    return np.where(np.any(normals != 0, axis=-1)[..., None], rows, 0)


def visibility_of_row(trace: Trace, row: int, directions: np.ndarray) -> np.ndarray:
    """:func:`shjax.render.visibility` of one row of pixels, ``(W, N)``."""
    gbuffer = jax.tree.map(lambda a: a[row : row + 1], trace.gbuffer)
    one = Trace(gbuffer, trace.positions[row : row + 1], trace.geometry)
    return visibility(one, directions)[0]


class Views(NamedTuple):
    """Where glossy pixels look: their frames and the angle of the view in them.

    Attributes:
        frames: Rows x, y, z = R with the view at azimuth 0, ``(N, 3, 3)``.
        angles: Of the view from R, ``(N,)``: twice that from the normal.
        cosines: n.v, ``(N,)``.
    """

    frames: jax.Array
    angles: jax.Array
    cosines: jax.Array


def view_frames(normals: jax.Array, views: jax.Array) -> Views:
    """Frames about the reflected directions, turned to the views."""
    reflected = mirror(normals, views)
    # What shows nothing has no direction; any frame serves, its weight is 0.
    up = jnp.broadcast_to(jnp.eye(3, dtype=normals.dtype)[2], reflected.shape)
    nothing = jnp.all(reflected == 0, axis=-1, keepdims=True)
    z = normalize(jnp.where(nothing, up, reflected))
    along = views - jnp.sum(views * z, axis=-1, keepdims=True) * z
    # Where the view is along R any azimuth serves.
    spare = jax.nn.one_hot(jnp.argmin(jnp.abs(z), axis=-1), 3, dtype=z.dtype)
    turned = jnp.sum(along * along, axis=-1, keepdims=True) > 1e-12
    x = normalize(jnp.where(turned, along, jnp.cross(z, spare)))
    frames = jnp.stack([x, jnp.cross(z, x), z], axis=-2)
    cosines = jnp.sum(normals * views, axis=-1)
    cross = jnp.cross(normals, views)
    squared = jnp.sum(cross * cross, axis=-1)
    sine = jnp.where(squared > 0, jnp.sqrt(jnp.where(squared > 0, squared, 1)), 0)
    return Views(frames, 2 * jnp.arctan2(sine, cosines), cosines)


class ViewTable(NamedTuple):
    """How finely a transfer function is tabulated over its views. Static.

    Attributes:
        highest: Largest angle of a view from R, radians.
        nodes: Chebyshev nodes in that angle.
        light: Of the quadrature over the light, in each of its pieces.
        q_max: Highest azimuthal order about R.
    """

    highest: float
    nodes: int = 20
    light: int = 64
    q_max: int = 12

    def angles(self) -> np.ndarray:
        """The nodes, ``(nodes,)``."""
        return (1 - np.cos(self._phases())) / 2 * self.highest

    def _phases(self) -> np.ndarray:
        return (np.arange(self.nodes) + 0.5) * np.pi / self.nodes

    def weights(self, angles: jax.Array) -> jax.Array:
        """Of the nodes at angles, ``(N, nodes)``: barycentric interpolation."""
        signs = (-1.0) ** np.arange(self.nodes) * np.sin(self._phases())
        nodes = jnp.asarray(self.angles(), angles.dtype)[None]
        inside = jnp.minimum(angles, self.highest)[:, None]
        apart = inside - nodes
        tiny = 4 * self.highest * float(jnp.finfo(angles.dtype).eps)
        terms = jnp.asarray(signs, angles.dtype)[None] / jnp.where(
            jnp.abs(apart) < tiny, tiny, apart
        )
        return terms / jnp.sum(terms, axis=1, keepdims=True)

    def kernels(self, brdf: Brdf, l_max: int) -> jax.Array:
        """Coefficients of ``Y_lq(light)``, view at azimuth 0: ``(nodes, L, Q, C)``."""
        q_max = min(self.q_max, l_max)
        dtype = brdf.parts[0].weight.dtype
        fine = Resolution(self.light, self.light // 2, self.nodes)
        angles = tuple(self.angles().tolist())
        values = moments_at(brdf, angles, fine, l_max, q_max, dtype).values
        # Real harmonics of order q > 0 are sqrt 2 of the complex ones.
        real = np.where(np.arange(q_max + 1) == 0, 1, math.sqrt(2))[:, None]
        return values * jnp.asarray(real, dtype)[None, None]


def table_to(least_cosine: float) -> ViewTable:
    """The table for views with ``n.v`` at least this."""
    return ViewTable(2 * math.acos(least_cosine))


def glossy_rows(
    brdf: Brdf, normals: jax.Array, views: jax.Array, l_max: int, table: ViewTable
) -> jax.Array:
    """Rows of any BRDF about normal or R, ``(N, K, C)``.

    Parts that are radial about the normal or R have closed gains; the others are taken
    from a table over the views.
    """
    seen = view_frames(normals, views)
    total = jnp.zeros((*normals.shape[:-1], (l_max + 1) ** 2, brdf.channels))
    total = total.astype(normals.dtype)
    for part in brdf.parts:
        if part.model.radial is not None:
            about = normals if part.model.centre == "normal" else seen.frames[:, 2]
            gains = radial_gains(part, l_max).astype(normals.dtype)
            gains = jnp.take(gains, degrees(l_max), axis=0)[None]
            total = total + _times(basis(about, l_max=l_max)[..., None], gains)
    rest = _without_closed_form(brdf)
    if rest is None:
        return total
    kernels = table.kernels(rest, l_max).astype(normals.dtype)
    slots = order_slots(l_max, kernels.shape[2])

    def block(inputs):
        weights, frames = inputs
        values = _einsum("no,olqc->nlqc", weights, kernels)
        values = values.reshape(*values.shape[:1], -1, values.shape[-1])
        local = jnp.zeros((weights.shape[0], (l_max + 1) ** 2 + 1, values.shape[-1]))
        local = local.astype(values.dtype).at[:, slots].set(values)[:, :-1]
        return rotate(local, jnp.swapaxes(frames, -1, -2))

    inputs = (table.weights(seen.angles), seen.frames)
    size = min(_POINTS_AT_ONCE, max(normals.shape[0], 1))
    blocks = jax.lax.map(block, tuple(_blocks(a, size) for a in inputs))
    rows = blocks.reshape(-1, *blocks.shape[2:])[: normals.shape[0]]
    return total + jnp.broadcast_to(rows, total.shape)


def order_slots(l_max: int, orders: int) -> np.ndarray:
    """Where ``(l, q >= 0)`` lies among K coefficients; K itself where q > l."""
    l, q = np.meshgrid(np.arange(l_max + 1), np.arange(orders), indexing="ij")
    return np.where(q <= l, l * (l + 1) + q, (l_max + 1) ** 2).ravel()


class Lit(NamedTuple):
    """Pixels under a known light, ready for any BRDF: all that does not depend on it.

    Attributes:
        normal: The light's degrees at the normals, ``sum_m L_lm Y_lm(n)``, ``(N, L, C)``.
        mirror: The same at R.
        turned: The light's coefficients ``(l, q >= 0)`` in the views' frames,
            ``(N, L, Q, C)``; None where every part is radial.
        nodes: Weights of the table's nodes, ``(N, nodes)``.
    """

    normal: jax.Array
    mirror: jax.Array
    turned: jax.Array | None
    nodes: jax.Array


def light_up(
    lighting: jax.Array,
    normals: Array,
    views: Array,
    table: ViewTable,
    *,
    radial: bool,
) -> Lit:
    """Light pixels once, for many BRDFs.

    Args:
        lighting: ``(K, C)``.
        normals: ``(N, 3)``.
        views: ``(N, 3)``.
        table: Over the views.
        radial: Whether only radial parts will come. Static.
    """
    normals, views = jnp.asarray(normals), jnp.asarray(views)
    seen = view_frames(normals, views)
    l_max = math.isqrt(lighting.shape[0]) - 1
    orders = min(table.q_max, l_max) + 1
    slots = order_slots(l_max, orders)

    def block(inputs):
        frames, directions = inputs
        at_normal, at_mirror = (
            _by_degree(basis(a, l_max=l_max), lighting, l_max)
            for a in (directions, frames[:, 2])
        )
        if radial:
            return at_normal, at_mirror, at_mirror[:, :0]
        turned = rotate(lighting, frames)
        turned = jnp.pad(turned, ((0, 0), (0, 1), (0, 0)))[:, slots]
        return at_normal, at_mirror, turned

    size = min(_POINTS_AT_ONCE, max(normals.shape[0], 1))
    inputs = tuple(_blocks(a, size) for a in (seen.frames, normals))
    found = jax.lax.map(block, inputs)
    at_normal, at_mirror, turned = (
        a.reshape(-1, *a.shape[2:])[: normals.shape[0]] for a in found
    )
    if not radial:
        turned = turned.reshape(-1, l_max + 1, orders, turned.shape[-1])
    nodes = table.weights(seen.angles)
    return Lit(at_normal, at_mirror, None if radial else turned, nodes)


def reflected(brdf: Brdf, lit: Lit, table: ViewTable) -> jax.Array:
    """Radiance of lit pixels in a BRDF, ``(N, C)``."""
    size, l_max = lit.normal.shape[0], lit.normal.shape[1] - 1
    channels = max(brdf.channels, lit.normal.shape[-1])
    total = jnp.zeros((size, channels), lit.normal.dtype)
    for part in brdf.parts:
        if part.model.radial is not None:
            light = lit.normal if part.model.centre == "normal" else lit.mirror
            gains = radial_gains(part, l_max).astype(light.dtype)
            total = total + jnp.sum(_times(light, gains[None]), axis=1)
    rest = _without_closed_form(brdf)
    if rest is None:
        return total
    assert lit.turned is not None  # lit for parts that are not radial
    kernels = table.kernels(rest, l_max).astype(lit.normal.dtype)
    at_pixels = _einsum("no,olqc->nlqc", lit.nodes, kernels)
    return total + jnp.sum(_times(lit.turned, at_pixels), axis=(1, 2))


def _by_degree(values: jax.Array, lighting: jax.Array, l_max: int) -> jax.Array:
    """``sum_m L_lm Y_lm``, ``(n, L, C)``."""
    products = values[:, :, None] * lighting[None]
    return jax.vmap(
        lambda p: jax.ops.segment_sum(
            p, degrees(l_max), num_segments=l_max + 1, indices_are_sorted=True
        )
    )(products)


def _without_closed_form(brdf: Brdf) -> Brdf | None:
    parts = tuple(part for part in brdf.parts if part.model.radial is None)
    return Brdf(parts) if parts else None


def _times(a: jax.Array, b: jax.Array) -> jax.Array:
    shape = jnp.broadcast_shapes(a.shape, b.shape)
    return jnp.broadcast_to(a, shape) * jnp.broadcast_to(b, shape)


def _blocks(rows: jax.Array, size: int) -> jax.Array:
    """In blocks, filled up with copies of the first: frames must stay frames."""
    missing = -rows.shape[0] % size
    filling = jnp.broadcast_to(rows[:1], (missing, *rows.shape[1:]))
    return jnp.concatenate([rows, filling]).reshape(-1, size, *rows.shape[1:])
