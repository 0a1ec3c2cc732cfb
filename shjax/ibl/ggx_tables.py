"""GGX of every roughness and reflectance from one set of maps.

Profiles at octaves of alpha, functions of the view at quarter octaves: both are made by
``experiments/low_rank_tables.py`` and shipped. Between them everything is linear in
``log2 alpha``, and affine in f0 as Schlick's term is, so a value has no jumps and a
derivative only at the tables' lines. What multiple scattering adds [T19] depends on the
view alone: it comes from the tables' own response to uniform light, so that a white
metal under white light is white to the last digit.

References:
    [T19] E. Turquin, Practical Multiple Scattering Compensation for Microfacet Models.
"""

from __future__ import annotations

import dataclasses
import functools
import importlib.resources
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from shjax.arrays import safe_sqrt
from shjax.reflection.ranks import check_maps, orders_of, signed_functions

SHIPPED = "ggx_low_rank.npz"
LEVELS, NODES = 5, 17  # of alpha: octaves for profiles, quarters for views
DEGREES = tuple(min(128, 9 * 2**j) for j in range(LEVELS))  # of each level's maps
MIN_ALPHA = 2.0 ** (1 - LEVELS)
TERMS = 12  # Chebyshev polynomials of the functions of the view, as shipped
_LINES = 65  # of the tables they are expanded to
_SQRT_4PI = math.sqrt(4 * math.pi)


def node_alphas() -> np.ndarray:
    """Roughness of the tables' nodes, ``(NODES,)``: 1 to 1/16 by quarter octaves."""
    return 2.0 ** (-(LEVELS - 1) * np.arange(NODES) / (NODES - 1))


def level_shares() -> np.ndarray:
    """Share of each level in the maps at each node, ``(NODES, LEVELS)``."""
    place = -np.log2(node_alphas())
    return np.maximum(1 - np.abs(place[:, None] - np.arange(LEVELS)), 0)


def _abscissa(cosine):
    """Where n.v lies in [-1, 1]; dense towards grazing views."""
    return 2 * np.sqrt(cosine) - 1


def view_terms(
    values: np.ndarray, theta: np.ndarray, weights: np.ndarray, q: int
) -> np.ndarray:
    """Chebyshev coefficients of functions of the view over ``sin(theta_o / 2)^q``.

    Args:
        values: At polar angles about R, ``(..., O)``.
        theta: Those angles, ``(O,)``.
        weights: Of the fit, ``(O,)``.
        q: Azimuthal order.

    Returns:
        ``(..., TERMS)``.
    """
    terms = np.polynomial.chebyshev.chebvander(_abscissa(np.cos(theta / 2)), TERMS - 1)
    rise = np.sin(theta / 2) ** q
    weight = np.sqrt(weights)
    flat = values.reshape(-1, theta.size)
    matrix = terms * (weight * rise)[:, None]
    found = np.linalg.lstsq(matrix, (flat * weight).T, rcond=None)[0].T
    return found.reshape(*values.shape[:-1], TERMS)


@dataclasses.dataclass(frozen=True, eq=False)
class GgxTables:
    """Low-rank approximation of GGX by a number of maps; NumPy, float64.

    Attributes:
        ranks: Functions of the view in each order q.
        profiles: For each level, over the light's degree: ``(F_j + 1, J)``.
        tables: Functions of the view over ``sin(theta_o / 2)^q``, at the nodes of alpha
            and lines of n.v, flattened: ``(J, NODES * lines, 2)``, the part without f0
            and the one times f0.
    """

    ranks: tuple[int, ...]
    profiles: tuple[np.ndarray, ...]
    tables: np.ndarray

    @property
    def functions(self) -> tuple[int, ...]:
        """The function of the view that reads each map."""
        return signed_functions(self.ranks)[0]

    @property
    def orders(self) -> tuple[int, ...]:
        """Signed q of each map."""
        return signed_functions(self.ranks)[1]

    def kernels(self, level: int) -> np.ndarray:
        """Profile of each map at a level, ``(F_j + 1, maps)``."""
        return self.profiles[level][:, self.functions]


@functools.lru_cache
def ggx_tables(maps: int) -> GgxTables:
    """Load the shipped low-rank approximation of GGX.

    Args:
        maps: 4, 9, 16 or 21.

    Raises:
        ValueError: If there is none of so many maps.
    """
    ranks = check_maps(maps)
    file = importlib.resources.files("shjax") / "data" / SHIPPED
    with importlib.resources.as_file(file) as path, np.load(path) as shipped:
        rows = shipped[f"profiles_{maps}"].astype(np.float64)
        terms = shipped[f"views_{maps}"].astype(np.float64)  # [i, 2, j, t]
    ends = np.cumsum([degree + 1 for degree in DEGREES])
    profiles = tuple(np.split(rows, ends[:-1]))
    lines = np.linspace(0, 1, _LINES)
    polynomials = np.polynomial.chebyshev.chebvander(2 * lines - 1, TERMS - 1)
    tables = np.einsum("ifjt,nt->jinf", terms, polynomials)
    tables = np.ascontiguousarray(tables.reshape(len(orders_of(ranks)), -1, 2))
    for array in (*profiles, tables):
        array.setflags(write=False)
    return GgxTables(ranks, profiles, tables)


class Roughness(NamedTuple):
    """Position of a roughness among the levels.

    Attributes:
        place: ``-log2 alpha``, between 0 and LEVELS - 1.
        level: The rougher of the two levels, an integer.
        share: Of the smoother one.
    """

    place: jax.Array
    level: jax.Array
    share: jax.Array


def locate(alpha: jax.Array) -> Roughness:
    """Locate a roughness among the levels; a smoother one is as the last."""
    place = -jnp.log2(jnp.clip(alpha, MIN_ALPHA, 1))
    level = jnp.clip(jnp.floor(place), 0, LEVELS - 2).astype(jnp.int32)
    return Roughness(place, level, place - level.astype(place.dtype))


def view_functions(
    fit: GgxTables, rough: Roughness, cosine: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Functions of the view over ``sin(theta_o / 2)^q``, ``(J, n)``.

    Those without f0, and those times f0.

    Args:
        fit: The fit.
        rough: Of each point, ``(n,)``.
        cosine: n.v of each, ``(n,)``; those below 0 count as 0.
    """
    dtype = cosine.dtype
    across = jnp.minimum(safe_sqrt(cosine), 1) * (_LINES - 1)
    along = rough.place * ((NODES - 1) / (LEVELS - 1))
    (i, s), (k, t) = (
        _between(a, size) for a, size in ((along, NODES), (across, _LINES))
    )
    corner = i * _LINES + k
    places = [corner, corner + 1, corner + _LINES, corner + _LINES + 1]
    shares = [(1 - s) * (1 - t), (1 - s) * t, s * (1 - t), s * t]

    def one(_, table):
        parts = []
        for f in (0, 1):
            taps = [
                table.at[place, f].get(mode="promise_in_bounds") * share
                for place, share in zip(places, shares, strict=True)
            ]
            parts.append(taps[0] + taps[1] + taps[2] + taps[3])
        return None, tuple(parts)

    tables = jnp.asarray(fit.tables, dtype)
    return jax.lax.scan(one, None, tables)[1]


def _between(place: jax.Array, size: int) -> tuple[jax.Array, jax.Array]:
    whole = jnp.clip(jnp.floor(place), 0, size - 2)
    return whole.astype(jnp.int32), place - whole


def uniform_response(
    fit: GgxTables, rough: Roughness, views: tuple[jax.Array, jax.Array]
) -> tuple[jax.Array, jax.Array]:
    """Response of the maps to uniform light of radiance 1, without f0 and times f0.

    Args:
        fit: The fit.
        rough: Of each point, ``(n,)``.
        views: From :func:`view_functions`.
    """
    count = fit.ranks[0]
    uniform = np.stack([profile[0, :count] for profile in fit.profiles])
    rises = np.diff(uniform, axis=0) * _SQRT_4PI
    parts = [jnp.zeros_like(rough.share), jnp.zeros_like(rough.share)]
    for k in range(count):
        low, rise = (
            jnp.take(jnp.asarray(a[:, k], rough.share.dtype), rough.level)
            for a in (uniform[:-1] * _SQRT_4PI, rises)
        )
        mixed = low + rough.share * rise
        parts = [
            part + view[k] * mixed for part, view in zip(parts, views, strict=True)
        ]
    return parts[0], parts[1]
