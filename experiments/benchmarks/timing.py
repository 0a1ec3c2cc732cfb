"""How the benchmarks take time: interleaved, warmed up, medians."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping

import jax


def interleaved_medians(
    candidates: Mapping[str, Callable[[], object]], rounds: int
) -> dict[str, float]:
    """Median seconds of each candidate, all of them in turn in every round.

    Each is run twice in a row and the second run counts, or the freeing of the results
    of the one before would be billed to it.
    """
    for function in candidates.values():
        jax.block_until_ready(function())
    times: dict[str, list[float]] = {name: [] for name in candidates}
    for _ in range(rounds):
        for name, function in candidates.items():
            jax.block_until_ready(function())
            start = time.perf_counter()
            jax.block_until_ready(function())
            times[name].append(time.perf_counter() - start)
    return {name: statistics.median(values) for name, values in times.items()}
