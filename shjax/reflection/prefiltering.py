"""Prefiltering: reflection maps from lighting and BRDF coefficients.

References:
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
"""

from __future__ import annotations

import functools
from typing import NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import (
    Array,
    as_float,
    common_channels,
    einsum,
    safe_sqrt,
)
from shjax.brdf.core import Brdf, select
from shjax.brdf.expansion import BrdfExpansion, degrees_of_rho
from shjax.brdf.quadrature import order_counts
from shjax.harmonics import power_spectrum
from shjax.harmonics.degrees import degree_of_coefs
from shjax.harmonics.orientations import (
    MAX_DEGREE,
    series_tables,
)
from shjax.harmonics.tables import on_device
from shjax.reflection.low_rank import LowRankBrdf
from shjax.reflection.on_pixels import on_cube, on_grid
from shjax.reflection.reading import check_frame
from shjax.reflection.reflection_map import ReflectionMap
from shjax.reflection.view_basis import HarmonicViews, ViewBasis

BrdfCoefs: TypeAlias = BrdfExpansion | LowRankBrdf | Float[Array, "*brdfs L P P D"]


def default_size(l_max: int) -> tuple[int, int]:
    """Rows and columns of a map of this degree: eight samples to the shortest wave.

    Read by cubic interpolation a map of a flat spectrum is off by 0.2 % rms then.

    >>> default_size(24)
    (100, 200)
    """
    return 4 * (l_max + 1), 8 * (l_max + 1)


def prefilter(
    lighting: Float[Array, "*batch K C"],
    rho: BrdfCoefs,
    *,
    n_theta: int | None = None,
    n_phi: int | None = None,
    frame: str = "local",
    centre: str | None = None,
) -> ReflectionMap:
    """Prefilter lighting by a BRDF: a lat-long reflection map [T5, Eqs. 5.9, 5.14].

    Spherical harmonic reflection map (SHRM) of BRDF coefficients, low-rank map of a
    low-rank BRDF. Theta first, then phi: ``O(F^2 P^2 S + F P^2 S^2)`` [T5, Eq. 5.24].

    Args:
        lighting: Radiance coefficients; of degrees beyond ``rho``'s nothing is used.
        rho: The BRDF: coefficients (:func:`shjax.brdf_coefs`) whose batch axes broadcast
            against those of ``lighting``; an expansion (:func:`shjax.brdf.expand`) or a
            low-rank BRDF (:func:`shjax.reflection.fit_low_rank`), of which the map knows
            BRDF and predicted error. One channel, of either, serves all.
        n_theta: Rows; default :func:`default_size` of the map's degree: the lower one of
            the two, plus ``p_max`` for a global map. Static.
        n_phi: Columns; default twice the rows. Static.
        frame: Of the view, ``"local"`` (about R) or ``"global"`` (the world). Static.
        centre: ``"reflection"``, or ``"tangent"`` for coefficients of fibres; default the
            expansion's own, else ``"reflection"``. Static.

    Returns:
        The map, its coefficients ``(..., n_theta, n_phi, Q, C)`` in the lighting's type.

    Raises:
        ValueError: If a shape is wrong, the degree exceeds 128, a size is not positive,
            a choice is unknown, or a low-rank map is asked for in the global frame.
    """
    job = _job(lighting, rho, frame, centre)
    degree = job.l_max
    if frame == "global":
        degree += job.view_basis.p_max
    rows, columns = default_size(degree)
    n_theta = rows if n_theta is None else n_theta
    n_phi = (columns if n_theta == rows else 2 * n_theta) if n_phi is None else n_phi
    if n_theta < 1 or n_phi < 1:
        raise ValueError(f"n_theta, n_phi must be positive; got {n_theta}, {n_phi}.")
    tables = on_device(
        series_tables, job.l_max, job.view_basis.orders, dtype=job.lighting.dtype
    )
    coefs = on_grid(
        job.view_basis,
        job.lighting,
        job.kernels,
        tables,
        size=(n_theta, n_phi),
        frame=frame,
    )
    return job.map_of(coefs, frame, "latlong")


def prefilter_cube(
    lighting: Float[Array, "*batch K C"],
    rho: BrdfCoefs,
    *,
    size: int | None = None,
    frame: str = "local",
    centre: str | None = None,
) -> ReflectionMap:
    """Prefilter lighting by a BRDF on a cube map (:func:`shjax.sphere.cube_directions`).

    Args:
        lighting: As in :func:`prefilter`.
        rho: As in :func:`prefilter`.
        size: Side of a face; default two pixels per degree. Static.
        frame: As in :func:`prefilter`. Static.
        centre: As in :func:`prefilter`. Static.

    Returns:
        The map, its coefficients ``(..., 6, size, size, Q, C)``.

    Raises:
        ValueError: As :func:`prefilter`.
    """
    job = _job(lighting, rho, frame, centre)
    size = 2 * (job.l_max + 1) if size is None else size
    if size < 1:
        raise ValueError(f"size must be positive; got {size}.")
    tables = on_device(
        series_tables, job.l_max, job.view_basis.orders, dtype=job.lighting.dtype
    )
    coefs = on_cube(
        job.view_basis, job.lighting, job.kernels, tables, size=size, frame=frame
    )
    return job.map_of(coefs, frame, "cube")


def map_of_kernels(
    lighting: jax.Array,
    kernels: jax.Array,
    view_basis: ViewBasis,
    brdf: Brdf | None,
    *,
    size: tuple[int, int],
    centre: str,
) -> ReflectionMap:
    """Prefilter lighting by kernels in any view basis; arguments are not checked.

    Args:
        lighting: ``(K, C)``.
        kernels: Over the light's degree, one per function of the view, ``(L, Q, C)``.
        view_basis: Those functions.
        brdf: What they belong to.
        size: Rows and columns. Static.
        centre: As in :func:`prefilter`. Static.
    """
    job = _Job(lighting, kernels, view_basis, centre, brdf, None)
    orders = view_basis.orders
    tables = on_device(series_tables, job.l_max, orders, dtype=lighting.dtype)
    coefs = on_grid(view_basis, lighting, kernels, tables, size=size, frame="local")
    return job.map_of(coefs, "local", "latlong")


class _Job(NamedTuple):
    """What is convolved: coefficients of the light, and the BRDF's kernels."""

    lighting: jax.Array
    kernels: jax.Array
    view_basis: ViewBasis
    centre: str
    brdf: Brdf | None
    truncation_error: jax.Array | None

    @property
    def l_max(self) -> int:
        return min(degree_of_coefs(self.lighting), self.kernels.shape[-3] - 1)

    def map_of(self, coefs: jax.Array, frame: str, layout: str) -> ReflectionMap:
        return ReflectionMap(
            coefs,
            self.view_basis,
            self.kernels,
            self.lighting,
            self.truncation_error,
            self.brdf,
            frame,
            self.centre,
            layout,
        )


def _job(lighting, rho: BrdfCoefs, frame: str, centre: str | None) -> _Job:
    """Check and convert the arguments."""
    degree_of_coefs(lighting, "lighting")
    lighting = as_float("lighting", lighting)
    brdf = error = None
    kernels: jax.Array
    if isinstance(rho, LowRankBrdf):
        brdf, views = rho.brdf, rho.views
        if frame == "global":
            raise ValueError("frame must be local for a low-rank map; got 'global'.")
        kernels = jnp.asarray(rho.kernels, lighting.dtype)
        about = "tangent" if select(brdf, "tangent") is not None else "reflection"
        common_channels(lighting.shape[-1], kernels.shape[-1], "rho")
        energies, kept = rho.energy, jnp.sum(rho.kernels**2, axis=1)
        error = _truncation(lighting, energies, kept)
    else:
        about = "reflection"
        if isinstance(rho, BrdfExpansion):
            brdf, about, coefs = rho.brdf, rho.centre, jnp.asarray(rho.rho)
            common_channels(lighting.shape[-1], coefs.shape[-1], "rho")
            times = jnp.asarray(order_counts(rho.p_max), coefs.dtype)
            kept = einsum("lpqc,q->lc", coefs**2, times)
            error = _truncation(lighting, rho.degree_energy, kept)
        else:
            coefs = rho
        _, p_max = degrees_of_rho(coefs)
        views = HarmonicViews(p_max)
        common_channels(lighting.shape[-1], coefs.shape[-1], "rho")
        rho_lpq = as_float("rho", coefs).astype(lighting.dtype)
        kernels = _harmonic_kernels(views, rho_lpq)
    check_frame(frame, centre or about)
    common_channels(lighting.shape[-1], kernels.shape[-1], "rho")
    job = _Job(lighting, kernels, views, centre or about, brdf, error)
    if job.l_max > MAX_DEGREE:
        raise ValueError(
            f"lighting or rho must end at degree {MAX_DEGREE}; got {job.l_max}. Cut one "
            "of them."
        )
    return job


@functools.partial(jax.jit, static_argnums=0)
def _harmonic_kernels(views: HarmonicViews, rho: jax.Array) -> jax.Array:
    """In one dispatch: it takes longer than the sums of a small map."""
    return jnp.asarray(views.kernels(rho))


def _truncation(
    lighting: jax.Array, energy: Array, kept: jax.Array
) -> jax.Array | None:
    """Relative rms error of what a map leaves out of a light ``(..., K, C)``, ``(...)``.

    Unknown where the light goes on beyond the BRDF's energies.
    """
    count = degree_of_coefs(lighting) + 1
    if count > energy.shape[0]:
        return None
    power = power_spectrum(lighting)
    weight = (
        power / jnp.asarray(2 * np.arange(power.shape[-2]) + 1, power.dtype)[:, None]
    )
    weight = weight[..., :count, :]

    def total(amount: Array) -> jax.Array:
        amount = jnp.maximum(jnp.asarray(amount, power.dtype)[:count], 0)
        shape = jnp.broadcast_shapes(weight.shape, amount.shape)
        wide = (jnp.broadcast_to(weight, shape), jnp.broadcast_to(amount, shape))
        return jnp.sum(wide[0] * wide[1], axis=(-2, -1))

    whole, lost = total(energy), total(energy - kept)
    return safe_sqrt(lost / jnp.where(whole > 0, whole, 1))
