"""The numbers of a run, and questions that one asks of them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

ERRORS = (0.3, 0.1, 0.03, 0.01, 0.003)
NOT_A_METHOD = "brute force"  # the reference itself


def load(folder: Path) -> dict:
    """The numbers of a report."""
    return json.loads((folder / "results.json").read_text())


def entries(result: dict) -> Iterator[tuple[str, str, dict]]:
    """Panorama, material (or ``irradiance``) and what was measured there."""
    for panorama, entry in result["irradiance"].items():
        yield panorama, "irradiance", entry
    for panorama, group in result["glossy"].items():
        for material, entry in group.items():
            yield panorama, material, entry


def of_material(result: dict, material: str) -> list[tuple[str, dict]]:
    """Panoramas and what was measured of a material under each."""
    return [(p, e) for p, m, e in entries(result) if m == material]


def front(methods: dict[str, dict], key: str = "seconds") -> list[str]:
    """Names of the methods that no other beats in both time and error, fastest first."""
    best, found = np.inf, []
    for name, row in sorted(methods.items(), key=lambda item: item[1][key]):
        if name != NOT_A_METHOD and row["rms"] < best:
            best = row["rms"]
            found.append(name)
    return found


def cheapest(
    methods: dict[str, dict], error: float, *, whole: bool = False
) -> str | None:
    """The fastest method within an error; with ``whole``, building counted."""
    within = {
        name: row["seconds"] + whole * row["build seconds"]
        for name, row in methods.items()
        if row["rms"] <= error and name != NOT_A_METHOD
    }
    return min(within, key=within.__getitem__) if within else None
