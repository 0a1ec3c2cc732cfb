"""Explicit reflection maps from a spherical harmonic one, one per view, and back.

References:
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import (
    Array,
    as_float,
    check_floating,
    check_vectors,
    einsum,
    shape_of,
)
from shjax.reflection.reflection_map import ReflectionMap
from shjax.reflection.view_basis import HarmonicViews
from shjax.reflection.view_sum import sum_over_view
from shjax.sphere import (
    icosahedron,
    latlong_phi,
    latlong_theta,
    spherical_directions,
)


def dynamic_map(
    reflection_map: ReflectionMap, view: Float[Array, " 3"]
) -> Float[jax.Array, "*grid C"]:
    """Dynamic reflection map: radiance over R for one distant viewer [T5, Eq. 5.35].

    Args:
        reflection_map: A global one, lat-long or cube.
        view: Unit vector to the viewer, in the world.

    Returns:
        Radiance ``(*grid, C)``.

    Raises:
        ValueError: If the map is not global or a shape is wrong.
    """
    if shape_of("view", view) != (3,):
        raise ValueError(f"view must have shape (3,); got {view.shape}.")
    check_floating("view", view)
    _check_frame(reflection_map, "global")
    return sum_over_view(reflection_map.view_basis, reflection_map.coefs, view)


def _check_frame(reflection_map: ReflectionMap, frame: str) -> None:
    if reflection_map.frame != frame:
        raise ValueError(
            f"reflection_map must be {frame}; got a {reflection_map.frame} one."
        )


def view_maps(
    reflection_map: ReflectionMap, views: Float[Array, "*views 3"]
) -> Float[jax.Array, "*views_grid C"]:
    """Explicit reflection maps, one per view [T5, section 5.6.2].

    Args:
        reflection_map: Of any frame; the views are in it: the world for a global map,
            (e_theta, e_phi, R) for a local one.
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
    basis, coefs = reflection_map.view_basis, reflection_map.coefs
    found = jax.lax.map(lambda view: sum_over_view(basis, coefs, view), flat)
    return found.reshape(*views.shape[:-1], *found.shape[1:])


def icosahedral_maps(
    reflection_map: ReflectionMap,
) -> Float[jax.Array, "V *grid C"]:
    """Cabral's twelve explicit reflection maps from a global map [T5, section 5.6.2].

    Args:
        reflection_map: A global one.

    Returns:
        ``(12, *grid, C)``, seen from :func:`shjax.sphere.icosahedron`.

    Raises:
        ValueError: If the map is not global.
    """
    _check_frame(reflection_map, "global")
    return view_maps(reflection_map, icosahedron())


def azimuthal_texture(
    reflection_map: ReflectionMap, theta_o: Float[Array, " T"]
) -> Float[jax.Array, "*grid T C"]:
    """Kautz and McCool's 3D texture, without azimuth, from a local map [T5, Eq. 5.25].

    Args:
        reflection_map: A local one.
        theta_o: Angles of the view to R, in [0, pi].

    Returns:
        ``(*grid, T, C)``: the terms q = 0 only.

    Raises:
        ValueError: If the map is not local, or ``theta_o`` is not a list of angles.
    """
    if len(shape_of("theta_o", theta_o)) != 1:
        raise ValueError(f"theta_o must have shape (T,); got {theta_o.shape}.")
    check_floating("theta_o", theta_o)
    _check_frame(reflection_map, "local")
    basis, coefs = reflection_map.view_basis, reflection_map.coefs
    theta = as_float("theta_o", theta_o).astype(coefs.dtype)
    zero = jnp.zeros_like(theta)
    views = jnp.stack([jnp.sin(theta), zero, jnp.cos(theta)], axis=-1)
    values = basis.values(views)  # [t, q]
    symmetric = jnp.asarray(np.array(basis.orders) == 0)[None]
    values = jnp.where(jnp.broadcast_to(symmetric, values.shape), values, 0)
    return einsum("...qc,tq->...tc", coefs, values)


def view_grid(n: int) -> np.ndarray:
    """Grid of ``n x n`` views over the sphere, theta by phi: ``(n, n, 3)``, float64.

    At the nodes of the lat-long grid, as explicit T x T tables have them.
    """
    return spherical_directions(latlong_theta(n)[:, None], latlong_phi(n))


def fit_views(
    values: Float[Array, "V *grid C"], views: Float[Array, "V 3"], *, p_max: int
) -> Float[jax.Array, "*grid Q C"]:
    """Fit coefficients over the view to explicit reflection maps, by least squares.

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
