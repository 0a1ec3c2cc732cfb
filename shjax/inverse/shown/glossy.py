"""Glossy pixels under a known light, turned into every pixel's frame once for many BRDFs.

References:
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp

from shjax.arrays import Array, einsum, map_blocks
from shjax.brdf import Brdf
from shjax.brdf.expansion import radial_gains
from shjax.brdf.transfer_rows import (
    POINTS_AT_ONCE,
    ViewTable,
    order_slots,
    times,
    view_frames,
    without_closed_form,
)
from shjax.harmonics import basis, rotate
from shjax.harmonics.degrees import degrees


class Lit(NamedTuple):
    """Pixels under a known light, ready for any BRDF.

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
    normals, views = (jnp.asarray(a, lighting.dtype) for a in (normals, views))
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
            return at_normal, at_mirror, at_mirror[:, :1]  # for what is not needed
        turned = rotate(lighting, frames)
        turned = jnp.pad(turned, ((0, 0), (0, 1), (0, 0)))[:, slots]
        return at_normal, at_mirror, turned

    inputs = (seen.frames, normals)
    at_normal, at_mirror, turned = map_blocks(block, inputs, POINTS_AT_ONCE)
    if not radial:
        turned = turned.reshape(-1, l_max + 1, orders, turned.shape[-1])
    nodes = table.weights(seen.angles)
    return Lit(at_normal, at_mirror, None if radial else turned, nodes)


def reflected(brdf: Brdf, lit: Lit, table: ViewTable) -> jax.Array:
    """Reflected radiance of lit pixels in a BRDF, ``(N, C)``."""
    size, l_max = lit.normal.shape[0], lit.normal.shape[1] - 1
    channels = max(brdf.channels, lit.normal.shape[-1])
    total = jnp.zeros((size, channels), lit.normal.dtype)
    for part in brdf.parts:
        if part.model.radial is not None:
            light = lit.normal if part.model.centre == "normal" else lit.mirror
            gains = radial_gains(part, l_max).astype(light.dtype)
            total = total + jnp.sum(times(light, gains[None]), axis=1)
    rest = without_closed_form(brdf)
    if rest is None:
        return total
    assert lit.turned is not None  # lit for parts that are not radial
    kernels = table.kernels(rest, l_max).astype(lit.normal.dtype)
    # At every node for every pixel, then between nodes: products of matrices.
    if kernels.shape[-1] == 1:
        at_nodes = einsum("nlqc,olq->noc", lit.turned, kernels[..., 0])
    elif lit.turned.shape[-1] == 1:
        at_nodes = einsum("nlq,olqc->noc", lit.turned[..., 0], kernels)
    else:
        at_nodes = einsum("nlqc,olqc->noc", lit.turned, kernels)
    return total + einsum("no,noc->nc", lit.nodes, at_nodes)


def _by_degree(values: jax.Array, lighting: jax.Array, l_max: int) -> jax.Array:
    """``sum_m L_lm Y_lm``, ``(n, L, C)``."""
    products = values[:, :, None] * lighting[None]
    return jax.vmap(
        lambda p: jax.ops.segment_sum(
            p, degrees(l_max), num_segments=l_max + 1, indices_are_sorted=True
        )
    )(products)
