"""Low-rank approximation of a BRDF: few maps, small errors at grazing views too.

The thesis expands the view in harmonics ``Y_pq`` [T5, Eq. 5.10], which are smooth where
Fresnel's term and ``1 / n.v`` pile up. Here, in each azimuthal order q, the kernel
``G_lq(theta_o)`` (the BRDF about R, a function of the view) is approximated by a
truncated singular value decomposition, a sum of a few separable products
``c_lk b_k(theta_o)`` as in [KM99]: profiles over the light's degree, which make the maps,
and functions of the view, which read them. Everything else of the theory stays, the exact
error included.

References:
    [KM99] J. Kautz, M. McCool, Interactive Rendering with Arbitrary BRDFs using
    Separable Approximations, Eurographics Workshop on Rendering, 1999.
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
"""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array, as_type, numpy_or_jax
from shjax.brdf.core import Brdf
from shjax.brdf.quadrature import Resolution, moments_at, view_nodes
from shjax.brdf.ranges import check_brdf
from shjax.reflection.ranks import (
    check_maps,
    functions_within,
    prior,
    signed_functions,
    within,
)
from shjax.reflection.view_basis import LowRankViews, view_lines

_VIEWS = 96
_RESOLUTION = Resolution(88, 44, _VIEWS)
_MAX_ORDER = 32  # of the azimuth in the energies
_UNIFORM = 1e4  # weight of degree 0 over the prior's: uniform light is met


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class LowRankBrdf:
    """Low-rank approximation of a BRDF: products of light profiles and view functions.

    Attributes:
        kernels: Profile of each map, ``(l_max + 1, maps, C)``.
        views: The functions that read the maps.
        energy: All that the BRDF holds of each degree, ``(l_max + 1, C)``.
        tests: The functions of each order at the nodes of the fit, orthonormal.
        brdf: What was approximated.
    """

    kernels: Float[Array, "L maps C"]
    views: LowRankViews
    energy: Float[Array, "L C"]
    tests: tuple[Array, ...]
    brdf: Brdf

    def __repr__(self) -> str:
        """How many maps of which BRDF, in one line."""
        l_max, maps = self.kernels.shape[0] - 1, self.kernels.shape[1]
        return f"LowRankBrdf: {maps} maps, degree {l_max}; {self.brdf}"

    @property
    def lost(self) -> Float[jax.Array, "L C"]:
        """Energy of each degree that the low-rank approximation loses."""
        return jnp.maximum(self.energy - jnp.sum(self.kernels**2, axis=1), 0)

    def fewer(self, maps: int) -> LowRankBrdf:
        """Truncate to fewer maps, which are among these.

        Args:
            maps: 4, 9, 16 or 21, at most as many as there are.

        Raises:
            ValueError: If there is no set of so many maps.
        """
        ranks, larger = check_maps(maps), self.kernels.shape[1]
        rows = np.flatnonzero(functions_within(maps, larger))
        kept = np.flatnonzero(within(maps, larger))
        numpy = numpy_or_jax(self.kernels)
        table, kernels, *tests = (
            numpy.asarray(a) for a in (self.views.table, self.kernels, *self.tests)
        )
        table, kernels = jnp.asarray(table[rows]), jnp.asarray(kernels[:, kept])
        cut = (jnp.asarray(t[:n]) for t, n in zip(tests, ranks, strict=False))
        views = LowRankViews(table, *signed_functions(ranks))
        return dataclasses.replace(self, kernels=kernels, views=views, tests=tuple(cut))


def fit_low_rank(brdf: Brdf, *, maps: int = 9, l_max: int = 128) -> LowRankBrdf:
    """Fit a low-rank (truncated SVD, separable) approximation to a BRDF.

    The best one of so many maps. In each azimuthal order the singular vectors of
    ``G_lq(theta_o)``, all channels together, degrees weighted by a ``1 / l^2`` light;
    uniform light is met where there are as many functions as channels of different
    shapes.

    Args:
        brdf: The reflectance; concrete, all parts about one centre.
        maps: 4, 9, 16 or 21.
        l_max: Highest degree of the light.

    Returns:
        What :func:`shjax.prefilter` takes in place of coefficients.

    Raises:
        ValueError: If there is no set of so many maps, or parts about the tangent are
            mixed with others.
    """
    check_brdf("brdf", brdf)
    ranks = check_maps(maps)
    lines = view_lines()
    angles = np.concatenate([view_nodes(_VIEWS)[0], lines])
    kernels = view_kernels(brdf, tuple(angles.tolist()), l_max, _MAX_ORDER)
    at_nodes, at_lines = kernels[:_VIEWS], kernels[_VIEWS:]
    weights = _solid_angles()
    times = np.where(np.arange(_MAX_ORDER + 1) == 0, 1, 2)
    energy = np.einsum("olqc,o,q->lc", at_nodes**2, weights, times)
    tests = [
        leading_functions(at_nodes[:, :, q], weights, rank, q == 0)
        for q, rank in enumerate(ranks)
    ]
    profiles = [_profiles(at_nodes[:, :, q], test) for q, test in enumerate(tests)]
    table = [
        _over_rise(_at_lines(at_lines[:, :, q], profile, q == 0), lines, q)
        for q, profile in enumerate(profiles)
    ]
    functions, signed = signed_functions(ranks)
    dtype = brdf.parts[0].weight.dtype
    kernels = np.concatenate(profiles, axis=1)[:, functions]
    views = LowRankViews(as_type(np.concatenate(table), dtype), functions, signed)
    return LowRankBrdf(
        as_type(kernels, dtype),
        views,
        as_type(energy, dtype),
        tuple(as_type(test, dtype) for test in tests),
        brdf,
    )


def project(low_rank: LowRankBrdf, brdf: Brdf) -> np.ndarray:
    """Project another BRDF on the view functions of a low-rank fit, ``(L, maps, C)``.

    Args:
        low_rank: The fit.
        brdf: About the same centre or the normal.
    """
    angles = tuple(view_nodes(_VIEWS)[0].tolist())
    l_max, q_max = low_rank.kernels.shape[0] - 1, len(low_rank.tests) - 1
    kernels = view_kernels(brdf, angles, l_max, q_max)
    profiles = [
        _profiles(kernels[:, :, q], np.asarray(test, np.float64))
        for q, test in enumerate(low_rank.tests)
    ]
    return np.concatenate(profiles, axis=1)[:, low_rank.views.functions]


def _solid_angles() -> np.ndarray:
    """Of the rings of views about R at the nodes, ``(O,)``: they sum to 4 pi."""
    return 2 * np.pi * view_nodes(_VIEWS)[1]


def _profiles(kernel: np.ndarray, test: np.ndarray) -> np.ndarray:
    """``(O, L, C)`` on functions ``(k, O)``: ``(L, k, C)``."""
    return np.einsum("olc,ko,o->lkc", kernel, test, _solid_angles())


def _at_lines(kernel: np.ndarray, profile: np.ndarray, uniform: bool) -> np.ndarray:
    """The functions at other views: what the kernels there project on, ``(k, lines)``."""
    scale, rank = _importance(profile.shape[0] - 1, uniform), profile.shape[1]
    gram = np.einsum("lkc,lnc,l->kn", profile, profile, scale)
    right = np.einsum("lkc,olc,l->ko", profile, kernel, scale)
    least = 1e-12 * np.trace(gram) / rank + 1e-300  # a BRDF may lack an order
    return np.linalg.solve(gram + least * np.eye(rank), right)


def _over_rise(values: np.ndarray, lines: np.ndarray, q: int) -> np.ndarray:
    """Functions at the lines over ``sin(theta_o / 2)^q``, ``(k, lines)``.

    At the last line, the view along R, both vanish: the value there goes on smoothly.
    """
    if not q:
        return values
    table = values / np.sin(lines / 2) ** q
    table[:, -1] = 3 * (table[:, -2] - table[:, -3]) + table[:, -4]
    return table


def leading_functions(
    kernel: np.ndarray, weights: np.ndarray, rank: int, uniform: bool
) -> np.ndarray:
    """Orthonormal functions of the view that hold most of a kernel, ``(rank, O)``.

    Args:
        kernel: ``(O, L, C)``.
        weights: Of the integral over theta_o, ``(O,)``.
        rank: How many.
        uniform: Whether degree 0 is to be met.
    """
    count, degrees, _ = kernel.shape
    root = np.sqrt(weights)
    rows = kernel * np.sqrt(_importance(degrees - 1, uniform))[:, None]
    rows = (rows * root[:, None, None]).reshape(count, -1)
    vectors = np.linalg.svd(rows @ rows.T)[0][:, :rank]
    return vectors.T / root


def _importance(l_max: int, uniform: bool) -> np.ndarray:
    weight = prior(l_max)
    return weight * np.where(np.arange(l_max + 1) == 0, _UNIFORM if uniform else 1, 1)


def view_kernels(
    brdf: Brdf, theta_o: tuple[float, ...], l_max: int, q_max: int
) -> np.ndarray:
    """Kernels ``G_lq(theta_o)`` of a BRDF at given views, ``(O, L, Q, C)``, float64.

    Args:
        brdf: The reflectance.
        theta_o: Polar angles about the centre.
        l_max: Highest degree.
        q_max: Highest azimuthal order.
    """
    values = _view_kernels(brdf, theta_o=theta_o, l_max=l_max, q_max=q_max)
    return np.asarray(values, np.float64)


@functools.partial(jax.jit, static_argnames=("theta_o", "l_max", "q_max"))
def _view_kernels(brdf: Brdf, *, theta_o, l_max: int, q_max: int) -> jax.Array:
    dtype = brdf.parts[0].weight.dtype
    return moments_at(brdf, theta_o, _RESOLUTION, l_max, q_max, dtype).values
