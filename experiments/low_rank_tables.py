"""Make the tables of the adapted view bases of GGX that the package ships.

For each number of maps and each azimuthal order: profiles ``c_lk`` at five roughnesses
(octaves of alpha), linear in log2 alpha between them, and functions of the view
``b_k(theta_o)`` at 17 (quarter octaves), affine in f0 as Schlick's term is. Both by
alternating least squares on the exact kernels ``G_lq(theta_o; alpha, f0)``: given the
profiles, the functions that predict the reflected light best; given the functions, the
profiles. It starts from a singular value decomposition of the whole ggx_tables.

    python -m experiments.low_rank_tables            # prints the errors, a minute
    python -m experiments.low_rank_tables --write    # and writes shjax/data
"""

from __future__ import annotations

import argparse
import functools
import io
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

import shjax
from shjax.brdf import ggx
from shjax.brdf.quadrature import Resolution, moments, view_nodes
from shjax.ibl.ggx_tables import (
    DEGREES,
    LEVELS,
    NODES,
    SHIPPED,
    TERMS,
    level_shares,
    node_alphas,
    view_terms,
)
from shjax.reflection.ranks import RANKS, prior

REFLECTANCES = (0.04, 1.0)  # between them the functions of the view are affine
VIEWS = 96
HIGHEST_ORDER = 32  # of the azimuth in the kernels' energies
ROUNDS = 100
SHARPNESS = 2.0  # large: the worst roughness counts more
# Weight of the two reflectances: with four maps they pull apart.
BALANCE = {4: (2.5, 1.0), 9: (1.0, 1.0), 16: (1.0, 1.0), 21: (1.0, 1.0)}


class Kernels(NamedTuple):
    """``G_lq(theta_o)`` of the ggx_tables at :data:`REFLECTANCES`, ``(i, O, L, Q, 2)``.

    Attributes:
        values: Of the lowest orders q.
        weights: Of the integral over theta_o, ``(O,)``.
        theta: Polar angles of the view about R, ``(O,)``.
        energy: Of all orders with the prior spectrum, ``(i, 2)``.
    """

    values: np.ndarray
    weights: np.ndarray
    theta: np.ndarray
    energy: np.ndarray


def positive_triangle(columns: np.ndarray) -> np.ndarray:
    """Upper triangular R with ``columns = Q R``, Q orthonormal, R's diagonal positive."""
    _, triangle = np.linalg.qr(columns)
    return triangle * np.where(np.diag(triangle) < 0, -1.0, 1.0)[:, None]


def family_kernels() -> Kernels:
    """Integrate the kernels of the whole ggx_tables, float64."""
    with jax.enable_x64(True):
        reach = Resolution(160, 64, VIEWS)
        l_max = DEGREES[-1]

        @jax.jit
        def at(alpha):
            pair = ggx(alpha, f0=jnp.asarray(REFLECTANCES))
            return moments(pair, reach, l_max, HIGHEST_ORDER, jnp.float64).values

        every = [np.asarray(at(jnp.asarray(a))) for a in node_alphas()]
    theta, weights = view_nodes(VIEWS)
    times = np.where(np.arange(HIGHEST_ORDER + 1) == 0, 1, 2)
    kept, energy = len(RANKS[21]), []
    for one in every:
        energy.append(np.einsum("olqf,o,l,q->f", one**2, weights, prior(l_max), times))
    values = np.stack([one[:, :, :kept] for one in every])
    return Kernels(values, weights, theta, np.stack(energy))


def fit_views(profiles: np.ndarray, kernel: np.ndarray, exact: bool) -> np.ndarray:
    """Functions of the view that predict best from given maps, ``(k, O)``.

    Args:
        profiles: ``(L, k)``.
        kernel: ``(O, L)``.
        exact: Whether degree 0 is met exactly, so that uniform light is.
    """
    weighted = prior(len(profiles) - 1)[:, None] * profiles
    gram, right = profiles.T @ weighted, weighted.T @ kernel.T
    if not exact:
        return np.linalg.solve(gram, right)
    count = profiles.shape[1]
    system = np.zeros((count + 1, count + 1))
    system[:count, :count] = gram
    system[count, :count] = system[:count, count] = profiles[0]
    right = np.concatenate([right, kernel[:, :1].T])
    return np.linalg.solve(system, right)[:count]


def first_profiles(kernels: Kernels, q: int, rank: int) -> np.ndarray:
    """Profiles from fixed test functions of the whole ggx_tables, ``(levels, L, k)``."""
    values, weights, _, energy = kernels
    l_max = values.shape[2] - 1
    scale = 1 / np.sqrt(energy.mean(axis=0))
    own = 1 / np.sqrt((energy * scale**2).sum(axis=1))
    rows = np.einsum(
        "iolf,o,f,i,l->ilof",
        values[:, :, :, q],
        np.sqrt(weights),
        scale,
        own,
        np.sqrt(prior(l_max)),
    )
    flat = rows.reshape(NODES * (l_max + 1), -1)
    _, _, right = np.linalg.svd(flat, full_matrices=False)
    test = right[:rank].reshape(rank, VIEWS, 2) * np.sqrt(weights)[:, None] * scale
    at_levels = values[:: (NODES - 1) // (LEVELS - 1), :, :, q]
    profiles = np.einsum("jolf,kof->jlk", at_levels, test)
    return _fixed_gauge(_cut(profiles))


def _cut(profiles: np.ndarray) -> np.ndarray:
    for j, degree in enumerate(DEGREES):
        profiles[j, degree + 1 :] = 0
    return profiles


def _fixed_gauge(profiles: np.ndarray) -> np.ndarray:
    """One triangular factor for all levels: well conditioned, and still continuous."""
    weight = np.sqrt(prior(profiles.shape[1] - 1))[:, None]
    triangle = positive_triangle(weight * profiles.sum(axis=0))
    return profiles @ np.linalg.inv(triangle)


def best_profiles(
    kernels: Kernels, q: int, views: np.ndarray, importance: np.ndarray
) -> np.ndarray:
    """Profiles that serve given functions of the view best, ``(levels, L, k)``.

    Args:
        kernels: Of the ggx_tables.
        q: Azimuthal order.
        views: ``(i, 2, k, O)``.
        importance: Of each roughness and reflectance, ``(i, 2)``.
    """
    shares, rank = level_shares(), views.shape[2]
    sum_up = functools.partial(np.einsum, optimize=True)
    gram = sum_up(
        "if,ij,im,ifko,ifno,o->jkmn",
        importance,
        shares,
        shares,
        views,
        views,
        kernels.weights,
    )
    right = sum_up(
        "if,ij,ifko,iolf,o->ljk",
        importance,
        shares,
        views,
        kernels.values[:, :, :, q],
        kernels.weights,
    )
    found = np.zeros((LEVELS, DEGREES[-1] + 1, rank))
    # Degrees that the same levels hold share one system.
    for first, degree in enumerate(DEGREES):
        degrees = np.arange(DEGREES[first - 1] + 1 if first else 0, degree + 1)
        levels = np.arange(first, LEVELS)
        size = levels.size * rank
        matrix = gram[levels][:, :, levels]
        matrix = matrix.reshape(size, size)
        matrix = matrix + 1e-12 * np.trace(matrix) / size * np.eye(size)
        wanted = right[np.ix_(degrees, levels)].reshape(degrees.size, size)
        solved = np.linalg.solve(matrix, wanted.T).T
        solved = solved.reshape(degrees.size, levels.size, rank)
        found[np.ix_(levels, degrees)] = solved.transpose(1, 0, 2)
    return _fixed_gauge(found)


def fit(kernels: Kernels, maps: int, rounds: int = ROUNDS):
    """Profiles and functions of the view for a number of maps.

    Returns:
        Profiles ``(levels, L, J)``, functions ``(i, 2, J, O)`` at
        :data:`REFLECTANCES`, and relative rms errors ``(i, 2)``.
    """
    ranks, balance = RANKS[maps], np.array(BALANCE[maps])
    importance = np.ones((NODES, 2)) * balance
    profiles = [first_profiles(kernels, q, rank) for q, rank in enumerate(ranks)]
    weight, views, error = prior(DEGREES[-1]), [], np.zeros((NODES, 2))
    for turn in range(rounds + 1):
        views, held = [], np.zeros((NODES, 2))
        for q in range(len(ranks)):
            mixed = np.einsum("ij,jlk->ilk", level_shares(), profiles[q])
            kernel = kernels.values[:, :, :, q]
            some = np.stack(
                [
                    [fit_views(mixed[i], kernel[i, :, :, f], q == 0) for f in (0, 1)]
                    for i in range(NODES)
                ]
            )
            views.append(some)
            guess = np.einsum("ilk,ifko->iolf", mixed, some)
            gain = kernel**2 - (kernel - guess) ** 2
            gain = np.einsum("iolf,o,l->if", gain, kernels.weights, weight)
            held += (2 if q else 1) * gain
        error = np.sqrt(1 - held / kernels.energy)
        if turn < rounds:
            total = importance / kernels.energy
            profiles = [
                best_profiles(kernels, q, some, total) for q, some in enumerate(views)
            ]
            importance = (error / error.mean(axis=0)) ** SHARPNESS * balance
    return np.concatenate(profiles, -1), np.concatenate(views, 2), error


def packed(kernels: Kernels, maps: int, rounds: int = ROUNDS):
    """What is shipped for a number of maps, and the errors.

    Returns:
        Profiles of all levels, one after the other, ``(sum of F_j + 1, J)``; terms of
        the view ``(i, 2, J, T)``: without f0 and times f0; the errors of :func:`fit`.
    """
    profiles, views, error = fit(kernels, maps, rounds)
    rows = [profiles[j, : degree + 1] for j, degree in enumerate(DEGREES)]
    low, high = views[:, 0], views[:, 1]
    slope = (high - low) / (REFLECTANCES[1] - REFLECTANCES[0])
    affine = np.stack([low - REFLECTANCES[0] * slope, slope], axis=1)  # [i, 2, j, o]
    terms = []
    at = 0
    for q, rank in enumerate(RANKS[maps]):
        terms.append(
            view_terms(affine[:, :, at : at + rank], kernels.theta, kernels.weights, q)
        )
        at += rank
    stacked = np.concatenate(terms, axis=2)
    assert stacked.shape[-1] == TERMS
    return np.concatenate(rows).astype("f4"), stacked.astype("f4"), error


def main() -> None:
    """Fit all sets, print their errors, and write them if asked to."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--write", action="store_true", help="write the shipped file")
    write = parser.parse_args().write
    kernels = family_kernels()
    arrays = {}
    print("rms error in %, 1/l^2 light, over alpha = 1 ... 1/16: mean, worst")
    for maps in RANKS:
        profiles, views, error = packed(kernels, maps)
        arrays[f"profiles_{maps}"], arrays[f"views_{maps}"] = profiles, views
        row = ", ".join(
            f"f0 {f0:g}: {100 * error[:, f].mean():.2f}, {100 * error[:, f].max():.2f}"
            for f, f0 in enumerate(REFLECTANCES)
        )
        print(f"{maps:3d} maps  {row}", flush=True)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    print(f"{len(buffer.getvalue()) / 1000:.1f} kB")
    if write:
        path = Path(shjax.__file__).parent / "data" / SHIPPED
        path.write_bytes(buffer.getvalue())
        print(f"written: {path}")


if __name__ == "__main__":
    main()
