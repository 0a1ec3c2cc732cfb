"""The answer of an inverse problem, and how far to trust it."""

from __future__ import annotations

import dataclasses
import functools
import math

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from shjax.arrays import Array


@functools.partial(
    jax.tree_util.register_dataclass,
    data_fields=(
        "value",
        "covariance",
        "singular_values",
        "singular_vectors",
        "rank",
        "prior_fraction",
        "residual_norm",
        "steps",
        "converged",
    ),
    meta_fields=("tolerance",),
)
@dataclasses.dataclass(frozen=True)
class Estimate:
    """What was estimated and how far to trust it.

    Attributes:
        value: The unknowns, ``(K, C)``; directions that the data do not determine are 0.
        covariance: ``(C, K, K)``; infinite variance for what is not determined.
        singular_values: Of the design (root mean square over channels), falling ``(K,)``.
        singular_vectors: Their directions, ``(K, K)``, one a row.
        rank: How many directions each channel determines, ``(C,)``.
        prior_fraction: Share of each unknown that did not come from the data, ``(K, C)``,
            in [0, 1].
        residual_norm: Weighted root sum of squares, ``(C,)``.
        steps: Steps of the solver.
        converged: Whether the solver ended well in every channel.
        tolerance: Singular values below this share of the largest count as zero.
    """

    value: Float[Array, "K C"]
    covariance: Float[Array, "C K K"]
    singular_values: Float[Array, " K"]
    singular_vectors: Float[Array, "K K"]
    rank: Int[Array, " C"]
    prior_fraction: Float[Array, "K C"]
    residual_norm: Float[Array, " C"]
    steps: Int[Array, ""]
    converged: Bool[Array, ""]
    tolerance: float

    @property
    def determined(self) -> np.ndarray:
        """Which singular directions some channel determines, ``(K,)`` booleans."""
        values = np.asarray(self.singular_values)
        return values > self.tolerance * values[0]

    @property
    def null_space(self) -> np.ndarray:
        """Directions that no channel determines, ``(r, K)``, orthonormal rows."""
        return np.asarray(self.singular_vectors)[~self.determined]

    @property
    def condition_number(self) -> float:
        """Largest over smallest singular value of the determined directions."""
        values = np.asarray(self.singular_values)[self.determined]
        return float(values[0] / values[-1]) if values.size else math.inf

    @property
    def ok(self) -> bool:
        """Whether the value is finite and every channel determines every unknown."""
        finite = bool(np.all(np.isfinite(np.asarray(self.value))))
        whole = np.all(np.asarray(self.rank) == self.value.shape[0])
        return bool(self.converged) and finite and bool(whole)

    @property
    def message(self) -> str:
        """One line on what was determined."""
        if not bool(self.converged):
            return "the solver did not converge; the value is not to be used"
        size, count = self.value.shape[0], int(np.min(np.asarray(self.rank)))
        if not np.any(np.asarray(self.rank)):
            return "nothing is determined: no pixel has weight and light"
        line = f"rank {count} of {size}, condition number {self.condition_number:.3g}"
        if count == size:
            return line
        return f"{line}; what is missing is left at 0 (see prior_fraction)"
