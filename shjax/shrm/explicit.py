"""Explicit reflection maps from an SHRM, one a view, and back.

References:
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array, as_float, check_vectors
from shjax.harmonics.orientations import einsum
from shjax.sphere import (
    icosahedron,
    latlong_phi,
    latlong_theta,
    spherical_directions,
)
from shjax.view_basis import HarmonicViews, views_of_maps


@jax.jit
def dynamic_map(
    maps: Float[Array, "*grid Q C"], view: Float[Array, 3]
) -> Float[jax.Array, "*grid C"]:
    """One reflection map for a distant viewer, from a global SHRM [T5, Eq. 5.35].

    Args:
        maps: Global coefficients on any pixels, lat-long or cube.
        view: Unit vector to the viewer, in the world.

    Returns:
        Radiance ``(*grid, C)``.

    Raises:
        ValueError: If a shape is wrong.
    """
    basis = views_of_maps(maps)
    if view.shape != (3,):
        raise ValueError(f"view must have shape (3,); got {view.shape}.")
    maps = as_float("maps", maps)
    values = basis.values(as_float("view", view).astype(maps.dtype))
    return _sum_over_views(maps, values)


def _sum_over_views(maps: jax.Array, values: jax.Array) -> jax.Array:
    """``(*grid, Q, C)`` times ``(Q,)``, as one product with a block of identities."""
    count, channels = maps.shape[-2:]
    blocks = values[:, None, None] * jnp.eye(channels, dtype=maps.dtype)[None]
    flat = maps.reshape(-1, count * channels)
    total = jnp.matmul(
        flat,
        blocks.reshape(count * channels, channels),
        precision=jax.lax.Precision.HIGHEST,
    )
    return total.reshape(*maps.shape[:-2], channels)


def view_maps(
    maps: Float[Array, "*grid Q C"], views: Float[Array, "*views 3"]
) -> Float[jax.Array, "*views_grid C"]:
    """Explicit reflection maps, one for each view, by the same sum [T5, section 5.6.2].

    Args:
        maps: Coefficients on any pixels; the views are in their frame: the world's for
            global ones, (e_theta, e_phi, R) for local ones.
        views: Unit vectors, ``(*views, 3)``.

    Returns:
        ``(*views, *grid, C)``.

    Raises:
        ValueError: If a shape is wrong.
    """
    check_vectors("views", views)
    flat = as_float("views", views).reshape(-1, 3)
    if flat.shape[0] == 0:
        raise ValueError(f"views must hold at least one vector; got {views.shape}.")
    found = jax.lax.map(lambda view: dynamic_map(maps, view), flat)
    return found.reshape(*views.shape[:-1], *found.shape[1:])


def icosahedral_maps(maps: Float[Array, "*grid Q C"]) -> Float[jax.Array, "V *grid C"]:
    """Cabral's twelve reflection maps from a global SHRM [T5, section 5.6.2].

    Args:
        maps: Global coefficients on any pixels.

    Returns:
        ``(12, *grid, C)``, seen from :func:`shjax.sphere.icosahedron`.
    """
    return view_maps(maps, icosahedron())


@jax.jit
def azimuthal_texture(
    maps: Float[Array, "*grid Q C"], theta_o: Float[Array, " T"]
) -> Float[jax.Array, "*grid T C"]:
    """Kautz and McCool's 3D texture, without azimuth, from a local SHRM [T5, Eq. 5.25].

    Args:
        maps: Local coefficients on any pixels.
        theta_o: Angles of the view to R, in [0, pi].

    Returns:
        ``(*grid, T, C)``: the terms q = 0 only.

    Raises:
        ValueError: If ``theta_o`` is not a list of angles.
    """
    basis, maps = views_of_maps(maps), as_float("maps", maps)
    if theta_o.ndim != 1:
        raise ValueError(f"theta_o must have shape (T,); got {theta_o.shape}.")
    theta = as_float("theta_o", theta_o).astype(maps.dtype)
    zero = jnp.zeros_like(theta)
    views = jnp.stack([jnp.sin(theta), zero, jnp.cos(theta)], axis=-1)
    values = basis.values(views)  # [t, q]
    symmetric = jnp.asarray(np.array(basis.orders) == 0)[None]
    values = jnp.where(jnp.broadcast_to(symmetric, values.shape), values, 0)
    return einsum("...qc,tq->...tc", maps, values)


def view_grid(n: int) -> np.ndarray:
    """``n x n`` views over the sphere, theta by phi: ``(n, n, 3)``, float64.

    At the nodes of the lat-long grid, as explicit T x T tables have them.
    """
    return spherical_directions(latlong_theta(n)[:, None], latlong_phi(n))


def fit_views(
    values: Float[Array, "V *grid C"], views: Float[Array, "V 3"], *, p_max: int
) -> Float[jax.Array, "*grid Q C"]:
    """Coefficients over the view from explicit maps, by least squares.

    Args:
        values: Radiance seen in each view, on any pixels.
        views: Unit vectors, in the frame that the result is to have.
        p_max: Highest degree of the fit. Static.

    Returns:
        ``(*grid, (p_max + 1)^2, C)``.

    Raises:
        ValueError: If the shapes do not fit, or the views do not determine so many
            functions (12 icosahedral ones determine p_max = 2).
    """
    basis = HarmonicViews(p_max)
    count = len(basis.orders)
    if views.ndim != 2 or views.shape[1] != 3 or values.shape[:1] != views.shape[:1]:
        raise ValueError(
            "values and views must have shapes (V, ..., C) and (V, 3); got "
            f"{values.shape} and {views.shape}."
        )
    exact = np.asarray(basis.values(jnp.asarray(views)), np.float64)
    rank = int(np.linalg.matrix_rank(exact, tol=1e-4))
    if rank < count:
        raise ValueError(
            f"views must determine {count} functions for p_max={p_max}; these "
            f"{views.shape[0]} determine {rank}."
        )
    values = as_float("values", values)
    inverse = jnp.asarray(np.linalg.pinv(exact), values.dtype)  # [q, v]
    flat = values.reshape(values.shape[0], -1, values.shape[-1])
    fitted = einsum("qv,vnc->nqc", inverse, flat)
    return fitted.reshape(*values.shape[1:-1], count, values.shape[-1])
