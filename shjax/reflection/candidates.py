"""Candidate maps of a reflection model, and the energy that each loses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import jax
import numpy as np

from shjax.brdf.quadrature import order_counts
from shjax.reflection.energies import (
    Energies,
)
from shjax.reflection.ranks import RANKS, within
from shjax.reflection.view_basis import HarmonicViews, ViewBasis, ZonalViews


class CandidateMaps(NamedTuple):
    """Candidate maps of one kind: view bases, the energy each loses, its kernels.

    Attributes:
        bases: One per column.
        lost: Lost energy of each light's degree F and basis, ``(F, bases)``.
        kernels: From a column to kernels over the light's degree, ``(L, Q, C)``.
    """

    bases: Sequence[ViewBasis]
    lost: np.ndarray
    kernels: Callable[[int], jax.Array | np.ndarray]


def candidate_maps(weight: np.ndarray, known: Energies, d: int) -> list[CandidateMaps]:
    """All candidate maps, with the energy that each loses.

    Degrees to d of the diffuse part are kept about the normal; of the specular part those
    to F, and of them the coefficients to P. Where the diffuse part is lost too, so is
    twice its product with what the specular part loses.
    """
    count = weight.shape[0]
    diffuse, specular, both = (
        a[:count] for a in (known.diffuse, known.specular, known.both)
    )
    beyond = (np.arange(count) > d)[:, None]
    product = (both - diffuse - specular) / 2
    if d < 0:
        diffuse, product = np.zeros_like(diffuse), np.zeros_like(product)
    all_of_it = np.sum(weight * (specular + np.where(beyond, diffuse + 2 * product, 0)))
    times, every = order_counts(known.rho.shape[1] - 1), []
    for make, chosen in (
        (HarmonicViews, times),
        (ZonalViews, np.where(times == 1, 1, 0)),
    ):
        squares, crossed = (
            np.cumsum(np.einsum("lpqc,q->lpc", a[:count], chosen), axis=1)
            for a in (known.rho**2, known.cross)
        )
        gain = squares + np.where(beyond[:, None], 2 * crossed, 0)
        kept = np.cumsum(np.einsum("lc,lpc->lp", weight, gain), axis=0)
        bases = [make(p) for p in range(len(times))]

        def kernels(p: int, bases=bases) -> np.ndarray:
            return np.asarray(bases[p].kernels(known.rho[:, : p + 1, : p + 1]))

        every.append(CandidateMaps(bases, all_of_it - kept, kernels))
    if known.low_rank:
        own, crossed = (
            np.asarray(a, np.float64)[:count]
            for a in (known.low_rank[-1].kernels, known.low_rank_cross)
        )
        gain = own**2 + np.where(beyond[:, None], 2 * crossed, 0)
        each = np.cumsum(np.einsum("lc,lkc->lk", weight, gain), axis=0)
        sets = np.stack([within(maps) for maps in RANKS], axis=1)
        bases = [one.views for one in known.low_rank]
        lost = all_of_it - each @ sets
        every.append(CandidateMaps(bases, lost, lambda p: known.low_rank[p].kernels))
    return every
