"""How the experiments take time: warmed up, medians, interleaved where compared."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping

import jax

Work = Callable[[], object]


def stopwatch(function: Work) -> float:
    """Seconds of one call, its arrays waited for."""
    start = time.perf_counter()
    jax.block_until_ready(function())
    return time.perf_counter() - start


def first_call(function: Work) -> float:
    """Seconds of a call for which everything is compiled anew."""
    jax.clear_caches()
    return stopwatch(function)


def median_seconds(function: Work, rounds: int = 5, *, long: float = math.inf) -> float:
    """Median seconds of one piece of work after a first call.

    No round is begun once they have taken ``long`` seconds together.
    """
    stopwatch(function)
    times: list[float] = []
    while len(times) < rounds and sum(times) < long:
        times.append(stopwatch(function))
    return statistics.median(times)


def interleaved_medians(
    candidates: Mapping[str, Work], rounds: int
) -> dict[str, float]:
    """Median seconds of each candidate, all of them in turn in every round.

    Each is run twice in a row and the second run counts, or the freeing of the results
    of the one before would be billed to it.
    """
    for function in candidates.values():
        stopwatch(function)
    times: dict[str, list[float]] = {name: [] for name in candidates}
    for _ in range(rounds):
        for name, function in candidates.items():
            stopwatch(function)
            times[name].append(stopwatch(function))
    return {name: statistics.median(values) for name, values in times.items()}
