"""How many functions each azimuthal order gets, and how they make maps."""

from __future__ import annotations

import numpy as np

# Functions of the view in each order q = 0, 1, ...; those of q > 0 make two maps.
RANKS = {4: (2, 1), 9: (3, 2, 1), 16: (4, 3, 2, 1), 21: (5, 4, 2, 1, 1)}


def check_maps(maps: int) -> tuple[int, ...]:
    """Ranks of a number of maps.

    Raises:
        ValueError: If there is no such set.
    """
    if maps not in RANKS:
        choices = ", ".join(map(str, RANKS))
        raise ValueError(f"maps must be one of {choices}; got {maps!r}.")
    return RANKS[maps]


def orders_of(ranks: tuple[int, ...]) -> tuple[int, ...]:
    """Azimuthal order of each function.

    >>> orders_of((3, 2, 1))
    (0, 0, 0, 1, 1, 2)
    """
    return tuple(q for q, count in enumerate(ranks) for _ in range(count))


def signed_functions(ranks: tuple[int, ...]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Function and signed order of each map: cosine, then sine, of each pair.

    >>> signed_functions((2, 1))
    ((0, 1, 2, 2), (0, 0, 1, -1))
    """
    functions, signed = [], []
    for j, q in enumerate(orders_of(ranks)):
        for sign in (1, -1) if q else (1,):
            functions.append(j)
            signed.append(sign * q)
    return tuple(functions), tuple(signed)


def functions_within(maps: int, larger: int = 21) -> np.ndarray:
    """Functions of a larger set that make a smaller one, ``(J,)`` bool.

    Args:
        maps: Of the smaller set.
        larger: Of the larger one.
    """
    small, large = check_maps(maps), check_maps(larger)
    return np.array(
        [
            q < len(small) and k < small[q]
            for q, rank in enumerate(large)
            for k in range(rank)
        ]
    )


def within(maps: int, larger: int = 21) -> np.ndarray:
    """Maps of a larger set that make a smaller one, ``(larger,)`` bool."""
    functions, _ = signed_functions(check_maps(larger))
    return functions_within(maps, larger)[list(functions)]


def prior(l_max: int) -> np.ndarray:
    """Mean square of a light's coefficients by degree, ``1 / l^2``: ``(l_max + 1,)``.

    That of panoramas whose brightest light sources are taken out.
    """
    return 1 / np.maximum(np.arange(l_max + 1), 1.0) ** 2
