"""Vectors in JAX: unit length, mirror images, angles, frames about a direction."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Float

from shjax.arrays import Array, safe_sqrt


@jax.jit
def normalize(vectors: Float[Array, "*batch 3"]) -> Float[jax.Array, "*batch 3"]:
    """Scale vectors to unit length; a zero vector stays zero, with zero derivative.

    >>> [f"{x:.1f}" for x in normalize(jnp.array([0.0, 3.0, 4.0]))]
    ['0.0', '0.6', '0.8']
    """
    squared = jnp.sum(vectors * vectors, axis=-1, keepdims=True)
    nonzero = squared > 0
    length = jnp.sqrt(jnp.where(nonzero, squared, 1))
    return jnp.where(nonzero, vectors / length, 0)


@jax.jit
def mirror(
    normals: Float[Array, "*batch 3"], views: Float[Array, "*batch 3"]
) -> Float[jax.Array, "*batch 3"]:
    """Reflect views about normals: the reflected direction ``R = 2 (n.v) n - v``.

    >>> up, view = jnp.array([0.0, 0.0, 1.0]), jnp.array([0.6, 0.0, 0.8])
    >>> [f"{x:.1f}" for x in mirror(up, view)]
    ['-0.6', '0.0', '0.8']
    """
    cosine = jnp.sum(normals * views, axis=-1, keepdims=True)
    return 2 * cosine * normals - views


@jax.jit
def polar_angles(
    directions: Float[Array, "*batch 3"],
) -> tuple[Float[jax.Array, "*batch"], Float[jax.Array, "*batch"]]:
    """Polar angles theta and phi of directions, with finite derivatives at the poles.

    Args:
        directions: Vectors, ``(..., 3)``.
    """
    x, y, z = (jnp.asarray(directions)[..., k] for k in range(3))
    squared = x * x + y * y
    off = squared > 0
    across = safe_sqrt(squared)
    theta = jnp.arctan2(across, jnp.where(off, z, jnp.sign(z)))
    phi = jnp.where(off, jnp.arctan2(jnp.where(off, y, 0), jnp.where(off, x, 1)), 0)
    return theta, phi


@jax.jit
def frames(normals: jax.Array) -> jax.Array:
    """Right-handed frames whose last row is the normal, ``(..., 3, 3)``.

    Smooth except across the equator's plane z = 0 [Duff et al. 2017, revised].
    """
    x, y, z = normals[..., 0], normals[..., 1], normals[..., 2]
    sign = jnp.where(z < 0, -1, 1).astype(z.dtype)
    a = -1 / (sign + z)
    b = x * y * a
    first = jnp.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=-1)
    second = jnp.stack([b, sign + y * y * a, -y], axis=-1)
    return jnp.stack([first, second, normals], axis=-2)


def in_spherical_frame(directions: jax.Array, vectors: jax.Array) -> jax.Array:
    """Components of vectors along e_theta, e_phi and the directions, ``(..., 3)``.

    At the poles the frame is that of phi = 0.
    """
    x, y, z = directions[..., 0], directions[..., 1], directions[..., 2]
    squared = x * x + y * y
    off = squared > 0
    across = safe_sqrt(squared)
    cosine = jnp.where(off, x / jnp.where(off, across, 1), 1)
    sine = jnp.where(off, y / jnp.where(off, across, 1), 0)
    a, b, c = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    along = cosine * a + sine * b
    return jnp.stack(
        [z * along - across * c, cosine * b - sine * a, x * a + y * b + z * c], axis=-1
    )
