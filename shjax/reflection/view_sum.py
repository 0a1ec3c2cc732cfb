"""Sums of a reflection map over one view."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Float

from shjax.arrays import (
    Array,
    as_float,
    matmul,
    shape_of,
)
from shjax.reflection.view_basis import ViewBasis
from shjax.vectors import normalize


@jax.jit
def sum_over_view(view_basis: ViewBasis, coefs: jax.Array, view: Array) -> jax.Array:
    """Radiance seen along one unit vector in the map's frame, ``(*grid, C)``."""
    if shape_of("view", view) != (3,):
        raise ValueError(f"view must have shape (3,); got {view.shape}.")
    values = view_basis.values(as_float("view", view).astype(coefs.dtype))
    # (*grid, Q, C) times (Q,), as one product with a block of identities.
    count, channels = coefs.shape[-2:]
    blocks = values[:, None, None] * jnp.eye(channels, dtype=coefs.dtype)[None]
    flat = coefs.reshape(-1, count * channels)
    total = matmul(flat, blocks.reshape(count * channels, channels))
    return total.reshape(*coefs.shape[:-2], channels)


def mean_view(views: Float[Array, "H W 3"]) -> jax.Array:
    """Unit vector of the mean over a picture's views, for a distant viewer."""
    return normalize(jnp.sum(views, axis=(0, 1)))
