"""Between radiance on a grid, or at samples, and spherical harmonic coefficients.

Which algorithm does the work is hidden here: matrix products up to degree 128
(``theta_first``), an FFT and scanned Legendre functions above (``phi_first``).
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array, as_float, check_channels, check_samples, in_blocks
from shjax.harmonics import phi_first, theta_first
from shjax.harmonics.degrees import check_l_max, degree_of_coefs
from shjax.harmonics.evaluation import basis
from shjax.harmonics.grid import Grid, check_resolution, make_grid

_PRODUCTS_TO = 128  # highest degree of the matrix products
_CHUNK_BYTES = 2**30  # a larger batch on the host goes to the device in parts
_SAMPLES_AT_ONCE = 2**16


def analyze(
    radiance: Float[Array, "*batch n_theta n_phi C"],
    *,
    l_max: int,
    quadrature: str = "fejer",
) -> Float[jax.Array, "*batch K C"]:
    """Spherical harmonic transform of a lat-long panorama: ``L_lm = int L Y_lm dw``.

    Exact for radiance of degree l when ``l + l_max < n_theta`` and ``l + l_max < n_phi``
    (Fejer's first rule on the panorama's own rows). A NumPy batch of more than 1 GiB, in
    memory or memory-mapped, is worked through in parts.

    Args:
        radiance: Panorama as it is stored, W m^-2 sr^-1 or relative.
        l_max: Highest degree, inclusive. Static. Tuned to 128, possible to 1024.
        quadrature: ``"fejer"``; ``"gauss-legendre"`` or ``"clenshaw-curtis"`` for
            radiance sampled on those rings; ``"pixel"`` for radiance that is constant
            over each pixel, at any size. Static. See
            :class:`shjax.harmonics.grid.Grid`.

    Returns:
        Coefficients, shape ``(..., (l_max + 1)^2, C)``, in the panorama's type.

    Raises:
        ValueError: If ``radiance`` lacks an axis, or the grid has too few rows or
            columns for ``l_max`` (fewer than ``2 l_max + 1``).

    >>> print(f"{analyze(jnp.ones((5, 8, 1)), l_max=0)[0, 0]:.4f}")  # sqrt(4 pi)
    3.5449
    """
    check_channels("radiance", radiance, "n_theta, n_phi, C", 3)
    l_max = check_l_max(l_max)
    grid = make_grid(radiance.shape[-3], radiance.shape[-2], quadrature)
    check_resolution(grid, l_max)
    run = functools.partial(_analyze, grid=grid, l_max=l_max)
    if isinstance(radiance, np.ndarray) and radiance.nbytes > _CHUNK_BYTES:
        return _in_parts(run, radiance, 3)
    return run(as_float("radiance", radiance))


def _algorithm(l_max: int):
    """The module that is faster at a degree."""
    return theta_first if l_max <= _PRODUCTS_TO else phi_first


def _analyze(radiance: jax.Array, *, grid: Grid, l_max: int) -> jax.Array:
    tables = _algorithm(l_max).analysis_tables(grid, l_max, radiance.dtype)
    return _analyze_by(radiance, tables, grid=grid, l_max=l_max)


@functools.partial(jax.jit, static_argnames=("grid", "l_max"))
def _analyze_by(radiance: jax.Array, tables, *, grid: Grid, l_max: int) -> jax.Array:
    run = _algorithm(l_max).analyze
    one = functools.partial(run, by=tables, grid=grid, l_max=l_max)
    return _over_batch(one, radiance, 3)


def synthesize(
    coefs: Float[Array, "*batch K C"],
    *,
    n_theta: int,
    n_phi: int,
    quadrature: str = "fejer",
) -> Float[jax.Array, "*batch n_theta n_phi C"]:
    """Inverse spherical harmonic transform: coefficients to a lat-long panorama.

    Args:
        coefs: Coefficients.
        n_theta: Rows. Static.
        n_phi: Columns. Static.
        quadrature: Where the rings lie; see :func:`analyze`. Static.

    Returns:
        The panorama, ``(..., n_theta, n_phi, C)``, in the coefficients' type.

    Raises:
        ValueError: If the axis before the last of ``coefs`` is not a square number, or a
            size is not positive.
    """
    l_max = degree_of_coefs(coefs)
    grid = make_grid(n_theta, n_phi, quadrature)
    return _synthesize(as_float("coefs", coefs), grid=grid, l_max=l_max)


def _synthesize(coefs: jax.Array, *, grid: Grid, l_max: int) -> jax.Array:
    tables = _algorithm(l_max).synthesis_tables(grid, l_max, coefs.dtype)
    return _synthesize_by(coefs, tables, grid=grid, l_max=l_max)


@functools.partial(jax.jit, static_argnames=("grid", "l_max"))
def _synthesize_by(coefs: jax.Array, tables, *, grid: Grid, l_max: int) -> jax.Array:
    run = _algorithm(l_max).synthesize
    one = functools.partial(run, by=tables, grid=grid, l_max=l_max)
    return _over_batch(one, coefs, 2)


@functools.partial(jax.jit, static_argnames=("l_max",))
def project_samples(
    radiance: Float[Array, "*batch N C"],
    directions: Float[Array, "N 3"],
    weights: Float[Array, " N"],
    *,
    l_max: int,
) -> Float[jax.Array, "*batch K C"]:
    """Project light samples on spherical harmonics: ``sum_n w_n L_n Y_lm(d_n)``.

    Args:
        radiance: Samples.
        directions: Their unit vectors.
        weights: Their solid angles, steradians.
        l_max: Highest degree, inclusive. Static.

    Returns:
        Coefficients, ``(..., (l_max + 1)^2, C)``, in the samples' type.

    Raises:
        ValueError: If the shapes do not fit each other.
    """
    check_samples(radiance, directions, weights, batch=True)
    n, l_max = radiance.shape[-2], check_l_max(l_max)
    radiance = as_float("radiance", radiance)
    directions = as_float("directions", directions).astype(radiance.dtype)
    weights = as_float("weights", weights).astype(radiance.dtype)

    def project(light, towards, weight):
        functions = basis(towards, l_max=l_max) * weight[:, None]
        return theta_first.einsum("nk,...nc->...kc", functions, light)

    size = max(_SAMPLES_AT_ONCE // (l_max + 1) ** 2, 256)
    if n <= size:
        return project(radiance, directions, weights)
    # Blocks of samples, so that the basis of all of them is never stored.
    light = jnp.moveaxis(radiance, -2, 0)
    blocks = tuple(in_blocks(a, size) for a in (light, directions, weights))

    @jax.checkpoint
    def add(total, block):
        light, towards, weight = block
        return total + project(jnp.moveaxis(light, 0, -2), towards, weight), None

    shape = (*radiance.shape[:-2], (l_max + 1) ** 2, radiance.shape[-1])
    return jax.lax.scan(add, jnp.zeros(shape, radiance.dtype), blocks)[0]


def _in_parts(run, batch: np.ndarray, rank: int) -> jax.Array:
    """Work through the items of a host array, some at a time."""
    lead = batch.shape[: batch.ndim - rank]
    items = batch.reshape(-1, *batch.shape[batch.ndim - rank :])
    at_once = max(1, _CHUNK_BYTES // max(items[0].nbytes, 1))
    parts = [
        run(as_float("radiance", np.ascontiguousarray(items[i : i + at_once])))
        for i in range(0, items.shape[0], at_once)
    ]
    results = jnp.concatenate(parts)
    return results.reshape(*lead, *results.shape[1:])


def _over_batch(one, array: jax.Array, rank: int) -> jax.Array:
    """Apply ``one`` to each item in front of the last ``rank`` axes."""
    if array.ndim == rank:
        return one(array)
    batch = array.shape[: array.ndim - rank]
    items = array.reshape(-1, *array.shape[array.ndim - rank :])
    # One after the other: a product of the whole batch is up to five times slower.
    results = jax.vmap(one)(items) if items.shape[0] <= 1 else jax.lax.map(one, items)
    return results.reshape(*batch, *results.shape[1:])
