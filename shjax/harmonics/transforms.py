"""Between radiance on a grid, or at samples, and spherical harmonic coefficients.

How the sums are ordered is hidden here; ``tables`` says why theta goes first.
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Float

from shjax.arrays import Array, as_float, check_channels, check_vectors
from shjax.harmonics import tables
from shjax.harmonics.degrees import check_l_max, degree_of_coefs
from shjax.harmonics.evaluation import basis
from shjax.harmonics.grid import Grid

_einsum = functools.partial(jnp.einsum, precision=jax.lax.Precision.HIGHEST)


@functools.partial(jax.jit, static_argnames=("l_max",))
def analyze(
    radiance: Float[Array, "*batch n_theta n_phi C"], *, l_max: int
) -> Float[Array, "*batch K C"]:
    """Project a lat-long panorama on the harmonics: ``L_lm = int L Y_lm dw``.

    Fejer's first rule in theta: exact for radiance of degree l when
    ``l + l_max < n_theta`` and ``l + l_max < n_phi``.

    Args:
        radiance: Panorama as it is stored, W m^-2 sr^-1 or relative.
        l_max: Highest degree, inclusive. Static.

    Returns:
        Coefficients, shape ``(..., (l_max + 1)^2, C)``, in the panorama's type.

    Raises:
        ValueError: If ``radiance`` lacks an axis, or has fewer than ``2 l_max + 1`` rows
            or columns.

    >>> print(f"{analyze(jnp.ones((5, 8, 1)), l_max=0)[0, 0]:.4f}")  # sqrt(4 pi)
    3.5449
    """
    check_channels("radiance", radiance.shape, "n_theta, n_phi, C", 3)
    radiance = as_float("radiance", radiance)
    grid = _grid_for(radiance.shape[-3], radiance.shape[-2], check_l_max(l_max))
    one = functools.partial(_analyze_one, grid=grid, l_max=l_max)
    return _over_batch(one, radiance, 3)


@functools.partial(jax.jit, static_argnames=("n_theta", "n_phi"))
def synthesize(
    coefs: Float[Array, "*batch K C"], *, n_theta: int, n_phi: int
) -> Float[Array, "*batch n_theta n_phi C"]:
    """Evaluate coefficients at the pixel centres of a lat-long grid.

    Args:
        coefs: Coefficients.
        n_theta: Rows. Static.
        n_phi: Columns. Static.

    Returns:
        The panorama, ``(..., n_theta, n_phi, C)``, in the coefficients' type.

    Raises:
        ValueError: If the axis before the last of ``coefs`` is not a square number, or a
            size is not positive.
    """
    l_max = degree_of_coefs(coefs.shape)
    if n_theta < 1 or n_phi < 1:
        raise ValueError(f"n_theta, n_phi must be positive; got {n_theta}, {n_phi}.")
    coefs = as_float("coefs", coefs)
    one = functools.partial(_synthesize_one, grid=Grid(n_theta, n_phi), l_max=l_max)
    return _over_batch(one, coefs, 2)


@functools.partial(jax.jit, static_argnames=("l_max",))
def project_samples(
    radiance: Float[Array, "*batch N C"],
    directions: Float[Array, "N 3"],
    weights: Float[Array, " N"],
    *,
    l_max: int,
) -> Float[Array, "*batch K C"]:
    """Project radiance known at any directions: ``sum_n w_n L_n Y_lm(d_n)``.

    Args:
        radiance: Samples.
        directions: Their unit vectors.
        weights: Their solid angles, steradians.
        l_max: Highest degree, inclusive. Static.

    Returns:
        Coefficients, ``(..., (l_max + 1)^2, C)``.

    Raises:
        ValueError: If the shapes do not fit each other.
    """
    check_channels("radiance", radiance.shape, "N, C", 2)
    n = radiance.shape[-2]
    if directions.shape != (n, 3):
        raise ValueError(
            f"directions must have shape ({n}, 3); got {directions.shape}."
        )
    if weights.shape != (n,):
        raise ValueError(f"weights must have shape ({n},); got {weights.shape}.")
    check_vectors("directions", directions.shape)
    radiance = as_float("radiance", radiance)
    functions = basis(as_float("directions", directions), l_max=l_max)
    functions = functions.astype(radiance.dtype)
    weighted = functions * as_float("weights", weights).astype(radiance.dtype)[:, None]
    return _einsum("nk,...nc->...kc", weighted, radiance)


def _grid_for(n_theta: int, n_phi: int, l_max: int) -> Grid:
    needed = 2 * l_max + 1
    if n_theta < needed or n_phi < needed:
        raise ValueError(
            f"radiance must have at least 2 l_max + 1 = {needed} rows and columns for "
            f"l_max={l_max}; got {n_theta} x {n_phi}."
        )
    return Grid(n_theta, n_phi)


def _over_batch(one, array: jax.Array, rank: int) -> jax.Array:
    """Apply ``one`` to each item in front of the last ``rank`` axes."""
    if array.ndim == rank:
        return one(array)
    batch = array.shape[: array.ndim - rank]
    items = array.reshape(-1, *array.shape[array.ndim - rank :])
    results = jax.vmap(one)(items) if items.shape[0] <= 1 else jax.lax.map(one, items)
    return results.reshape(*batch, *results.shape[1:])


def _analyze_one(radiance: jax.Array, *, grid: Grid, l_max: int) -> jax.Array:
    dtype, channels = radiance.dtype, radiance.shape[-1]
    ring = jnp.asarray(tables.ring_table(grid, l_max) * grid.weights, dtype)
    rings = _einsum("kh,hx->kx", ring, radiance.reshape(grid.n_theta, -1))
    rings = rings.reshape(2 * l_max + 1, grid.n_phi, channels)
    by_order = []
    for rows, azimuth, degree in zip(
        jnp.split(rings, [l_max + 1]),  # of P_k0, of P_k1
        tables.azimuth_tables(grid.n_phi, l_max),
        tables.degree_tables(l_max),
        strict=True,
    ):
        waves = _einsum("kwc,wm->mkc", rows, jnp.asarray(azimuth, dtype))
        by_order.append(_einsum("mlk,mkc->mlc", jnp.asarray(degree, dtype), waves))
    flat = jnp.concatenate(by_order).reshape(-1, channels)
    return jnp.take(flat, tables.flat_positions(l_max), axis=0)


def _synthesize_one(coefs: jax.Array, *, grid: Grid, l_max: int) -> jax.Array:
    dtype, channels = coefs.dtype, coefs.shape[-1]
    flat = jnp.zeros(((2 * l_max + 1) * (l_max + 1), channels), dtype)
    flat = flat.at[tables.flat_positions(l_max)].set(coefs, unique_indices=True)
    by_order = flat.reshape(2 * l_max + 1, l_max + 1, channels)
    azimuths = tables.azimuth_tables(grid.n_phi, l_max)
    rings = []
    for rows, azimuth, degree in zip(
        jnp.split(by_order, [azimuths[0].shape[1]]),  # of even m, of odd m
        azimuths,
        tables.degree_tables(l_max),
        strict=True,
    ):
        waves = _einsum("mlk,mlc->mkc", jnp.asarray(degree, dtype), rows)
        rings.append(_einsum("mkc,wm->kwc", waves, jnp.asarray(azimuth, dtype)))
    ring = jnp.asarray(tables.ring_table(grid, l_max), dtype)
    stacked = jnp.concatenate(rings).reshape(2 * l_max + 1, -1)
    return _einsum("kh,kx->hx", ring, stacked).reshape(
        grid.n_theta, grid.n_phi, channels
    )
