"""Rotation and change of frame of an expansion."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Float

from shjax.arrays import Array, as_float
from shjax.harmonics.degrees import degree_of_coefs
from shjax.harmonics.evaluation import basis
from shjax.harmonics.grid import Grid
from shjax.sphere import latlong_directions


@jax.jit
def rotate(
    coefs: Float[Array, "*batch K C"], rotation: Float[Array, "3 3"]
) -> Float[Array, "*batch K C"]:
    """Coefficients of the rotated function ``f'(R w) = f(w)``.

    The matrix ``D_mq = int Y_lm(R w) Y_lq(w) dw`` by exact quadrature. To read the same
    light in another frame whose axes are the rows of ``R``, pass that ``R``.

    Args:
        coefs: Coefficients.
        rotation: Orthogonal matrix R; a mirror is allowed.

    Returns:
        Coefficients of the same shape.

    Raises:
        ValueError: If a shape is wrong.
    """
    l_max = degree_of_coefs(coefs.shape)
    if rotation.shape != (3, 3):
        raise ValueError(f"rotation must have shape (3, 3); got {rotation.shape}.")
    coefs = as_float("coefs", coefs)
    matrix = as_float("rotation", rotation).astype(coefs.dtype)
    grid = Grid(2 * l_max + 1, 2 * l_max + 1)
    nodes = latlong_directions(grid.n_theta, grid.n_phi)
    nodes = jnp.asarray(nodes.reshape(-1, 3), coefs.dtype)
    weights = jnp.repeat(jnp.asarray(grid.weights, coefs.dtype), grid.n_phi)
    turned = basis(
        jnp.matmul(nodes, matrix.T, precision=jax.lax.Precision.HIGHEST), l_max=l_max
    )
    wigner = jnp.einsum(
        "nm,n,nq->mq",
        turned,
        weights,
        basis(nodes, l_max=l_max),
        precision=jax.lax.Precision.HIGHEST,
    )
    return jnp.matmul(wigner, coefs, precision=jax.lax.Precision.HIGHEST)
