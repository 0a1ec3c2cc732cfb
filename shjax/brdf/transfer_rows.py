"""Transfer functions of pixels: rows of coefficients in the frame of each view.

In the frame whose z is the reflected direction R, with the view at azimuth 0, a transfer
function has coefficients ``G_lq`` that depend on the view's angle alone; they are
tabulated at a few angles and read between them. Radial parts have closed gains and need no
table.

References:
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from shjax.arrays import einsum, map_blocks, safe_sqrt
from shjax.brdf.core import Brdf
from shjax.brdf.expansion import radial_gains
from shjax.brdf.quadrature import Resolution, moments_at
from shjax.harmonics import basis, rotate
from shjax.harmonics.degrees import degrees
from shjax.vectors import mirror, normalize

POINTS_AT_ONCE = 256


class Views(NamedTuple):
    """View geometry of glossy pixels: their frames and the view's angle in them.

    Attributes:
        frames: Rows x, y, z = R with the view at azimuth 0, ``(N, 3, 3)``.
        angles: Of the view from R, ``(N,)``: twice that from the normal.
    """

    frames: jax.Array
    angles: jax.Array


def view_frames(normals: jax.Array, views: jax.Array) -> Views:
    """Frames about the reflected directions, rotated to the views."""
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
    sine = safe_sqrt(jnp.sum(cross * cross, axis=-1))
    return Views(frames, 2 * jnp.arctan2(sine, cosines))


class ViewTable(NamedTuple):
    """Table of a transfer function over its views: how finely. Static.

    Attributes:
        max_angle: Largest angle of a view from R, radians.
        nodes: Chebyshev nodes in that angle.
        light: Of the quadrature over the light, in each of its pieces.
        q_max: Highest azimuthal order about R.
    """

    max_angle: float
    nodes: int = 20
    light: int = 64
    q_max: int = 12

    def angles(self) -> np.ndarray:
        """Chebyshev nodes in the view's angle, ``(nodes,)``."""
        return (1 - np.cos(self._phases())) / 2 * self.max_angle

    def _phases(self) -> np.ndarray:
        return (np.arange(self.nodes) + 0.5) * np.pi / self.nodes

    def weights(self, angles: jax.Array) -> jax.Array:
        """Barycentric weights of the nodes at angles, ``(N, nodes)``."""
        signs = (-1.0) ** np.arange(self.nodes) * np.sin(self._phases())
        nodes = jnp.asarray(self.angles(), angles.dtype)[None]
        inside = jnp.minimum(angles, self.max_angle)[:, None]
        apart = inside - nodes
        tiny = 4 * self.max_angle * float(jnp.finfo(angles.dtype).eps)
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


def table_to(min_cosine: float) -> ViewTable:
    """Table for views with ``n.v`` at least this."""
    return ViewTable(2 * math.acos(min_cosine))


def glossy_rows(
    brdf: Brdf, normals: jax.Array, views: jax.Array, l_max: int, table: ViewTable
) -> jax.Array:
    """Design rows of a glossy surface in the light's coefficients, ``(N, K, C)``.

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
            total = total + times(basis(about, l_max=l_max)[..., None], gains)
    rest = without_closed_form(brdf)
    if rest is None:
        return total
    kernels = table.kernels(rest, l_max).astype(normals.dtype)
    slots = order_slots(l_max, kernels.shape[2])

    def block(inputs):
        weights, frames = inputs
        values = einsum("no,olqc->nlqc", weights, kernels)
        values = values.reshape(*values.shape[:1], -1, values.shape[-1])
        local = jnp.zeros((weights.shape[0], (l_max + 1) ** 2 + 1, values.shape[-1]))
        local = local.astype(values.dtype).at[:, slots].set(values)[:, :-1]
        return rotate(local, jnp.swapaxes(frames, -1, -2))

    inputs = (table.weights(seen.angles), seen.frames)
    rows = map_blocks(block, inputs, POINTS_AT_ONCE)
    return total + jnp.broadcast_to(rows, total.shape)


def order_slots(l_max: int, orders: int) -> np.ndarray:
    """Position of ``(l, q >= 0)`` among K coefficients; K itself where q > l."""
    l, q = np.meshgrid(np.arange(l_max + 1), np.arange(orders), indexing="ij")
    return np.where(q <= l, l * (l + 1) + q, (l_max + 1) ** 2).ravel()


def without_closed_form(brdf: Brdf) -> Brdf | None:
    """Select the parts of a BRDF whose gains need a table; None without any."""
    parts = tuple(part for part in brdf.parts if part.model.radial is None)
    return Brdf(parts) if parts else None


def times(a: jax.Array, b: jax.Array) -> jax.Array:
    """Multiply two arrays, each broadcast to the other."""
    shape = jnp.broadcast_shapes(a.shape, b.shape)
    return jnp.broadcast_to(a, shape) * jnp.broadcast_to(b, shape)
