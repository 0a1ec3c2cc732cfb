"""Estimates: the answer of an inverse problem, its covariance, what is not determined."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Bool, Float, Int

from shjax.arrays import STATIC, Array, in_blocks, safe_sqrt
from shjax.brdf.core import Brdf

_PUSHED = 16  # pictures at once, which share the functions of their pixels
_UNDETERMINED = 0.5  # of an unknown's variance, left by the data: the prior answers


class ChosenPrior(NamedTuple):
    """Prior that a picture chose among power laws of the degree: means over the family.

    Attributes:
        scale: Standard deviation at degree 2 (4 beside free degrees), over L_00.
        slope: How the deviations fall with the degree, ``l^-slope``.
        free: Share of the members whose degrees 1 and 2 are free.
    """

    scale: jax.Array
    slope: jax.Array
    free: jax.Array


class Judge(NamedTuple):
    """Sentences of an estimator about its answers.

    Attributes:
        message: From an estimate that ended well to what is determined, in words.
        possible: Whether the value is one that can be at all.
    """

    message: Callable[[Estimate], str]
    possible: Callable[[Estimate], bool]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True, repr=False)
class Estimate:
    """Estimate with its covariance, and what the data did not determine.

    Attributes:
        value: The unknowns, ``(K, C)``; directions that nothing determines are 0.
        covariance: ``(C, K, K)``; infinite variance for what is not determined.
        singular_values: Of the design (root mean square over channels), falling ``(K,)``.
        singular_vectors: Their directions, ``(K, K)``, one per row.
        rank: How many directions each channel determines, ``(C,)``.
        prior_fraction: Share of each unknown that did not come from the data, ``(K, C)``,
            in [0, 1].
        residual_norm: Weighted root sum of squares, ``(C,)``.
        noise: Standard deviation of a pixel of weight 1, ``(C,)``: given, or from the
            residual.
        steps: Steps of the solver.
        converged: Whether the solver ended well in every channel.
        full_value: All that was fitted, ``(J, C)``: ``value`` and what was marginalised.
        full_covariance: Of that, ``(C, J, J)``.
        forward: ``(full_value, gbuffer)`` to a picture; see :meth:`predict`.
        chosen_prior: The prior that the picture chose, or None.
        brdf: The reflectance that was estimated, or None.
        tolerance: Singular values below this share of the largest count as zero.
        names: Of the unknowns, where they are not coefficients.
        judge: The sentences of the estimator that made it.
    """

    value: Float[Array, "K C"]
    covariance: Float[Array, "C K K"]
    singular_values: Float[Array, " K"]
    singular_vectors: Float[Array, "K K"]
    rank: Int[Array, " C"]
    prior_fraction: Float[Array, "K C"]
    residual_norm: Float[Array, " C"]
    noise: Float[Array, " C"]
    steps: Int[Array, ""]
    converged: Bool[Array, ""]
    full_value: Float[Array, "J C"]
    full_covariance: Float[Array, "C J J"]
    forward: Any
    chosen_prior: ChosenPrior | None = None
    brdf: Brdf | None = None
    tolerance: float = dataclasses.field(default=0.0, metadata=STATIC)
    names: tuple[str, ...] = dataclasses.field(default=(), metadata=STATIC)
    judge: Judge = dataclasses.field(default_factory=lambda: BY_NAME, metadata=STATIC)

    def __repr__(self) -> str:
        """What was estimated and how far to trust it, in three lines."""
        if isinstance(self.value, Tracer):
            return f"Estimate of {self.value.shape} unknowns (traced)"
        value, deviation = np.asarray(self.value), np.asarray(self.standard_deviation)
        names = self.names or ("L_00",)
        cells = [
            f"{name} = {', '.join(f'{v:.4g}' for v in row)} +- "
            f"{', '.join(f'{d:.2g}' for d in sd)}"
            for name, row, sd in zip(names[:4], value, deviation, strict=False)
        ]
        count, channels = value.shape
        return "\n".join(
            [
                f"Estimate: {count} unknowns x {channels} channels, ok = {self.ok}",
                f"  {'; '.join(cells)}{'; ...' if count > len(cells) else ''}",
                f"  {self.message}",
            ]
        )

    @property
    def standard_deviation(self) -> Float[jax.Array, "K C"]:
        """Standard deviation of each unknown: the root of the covariance's diagonal."""
        return safe_sqrt(jnp.diagonal(self.covariance, axis1=1, axis2=2)).T

    @property
    def determined(self) -> np.ndarray:
        """Singular directions that some channel determines, ``(K,)`` booleans."""
        values = np.asarray(self.singular_values)
        return values > self.tolerance * values[0]

    @property
    def null_space(self) -> np.ndarray:
        """Null space: orthonormal directions that no channel determines, ``(r, K)``."""
        return np.asarray(self.singular_vectors)[~self.determined]

    @property
    def condition_number(self) -> float:
        """Largest over smallest singular value of the determined directions."""
        values = np.asarray(self.singular_values)[self.determined]
        return float(values[0] / values[-1]) if values.size else math.inf

    @property
    def ok(self) -> bool:
        """Whether the value is finite, possible, and determined in every channel."""
        finite = bool(np.all(np.isfinite(np.asarray(self.value))))
        whole = bool(np.all(np.asarray(self.rank) == self.value.shape[0]))
        return bool(self.converged) and finite and whole and self.judge.possible(self)

    @property
    def message(self) -> str:
        """Sentence on what was determined."""
        if not bool(self.converged):
            return "the solver did not converge; the value is not to be used"
        return self.judge.message(self)

    @property
    def rank_message(self) -> str:
        """Rank and condition number in words."""
        size, count = self.value.shape[0], int(np.min(np.asarray(self.rank)))
        return f"rank {count} of {size}, condition number {self.condition_number:.3g}"

    def predict(
        self, gbuffer: Any
    ) -> tuple[Float[jax.Array, "H W C"], Float[jax.Array, "H W C"]]:
        """Predict a picture from the estimate, with its standard deviation.

        Args:
            gbuffer: What the picture shows (:mod:`shjax.render`).

        Returns:
            Radiance and its standard deviation by the linearised forward model, each
            ``(H, W, C)``; the deviation is infinite where the picture depends on what was
            not determined. Noise of a new picture is not in it.
        """
        picture, push = jax.linearize(
            lambda x: self.forward(x, gbuffer), self.full_value
        )
        known = jnp.isfinite(jnp.diagonal(self.full_covariance, axis1=1, axis2=2))
        both = known[:, :, None] & known[:, None, :]
        values, vectors = jnp.linalg.eigh(jnp.where(both, self.full_covariance, 0))
        root = vectors * jnp.sqrt(jnp.maximum(values, 0))[:, None]  # [c, j, column]
        variance = _sum_of_squares(push, jnp.moveaxis(root, 2, 0))
        unknown = jax.vmap(jnp.diag)((~known).astype(picture.dtype)).swapaxes(0, 1)
        reach = _sum_of_squares(push, unknown)
        largest = jnp.max(jnp.abs(picture)) / jnp.maximum(
            jnp.max(jnp.abs(self.full_value)), jnp.finfo(picture.dtype).tiny
        )
        lost = reach > (1e-5 * largest) ** 2
        return picture, jnp.where(lost, jnp.inf, safe_sqrt(variance))


def _by_name(found: Estimate) -> str:
    """What is determined of unknowns with names."""
    size, count = found.value.shape[0], int(np.min(np.asarray(found.rank)))
    if count == size:
        return found.rank_message
    lost = np.max(np.asarray(found.prior_fraction), axis=1) > _UNDETERMINED
    words = [name for name, bad in zip(found.names, lost, strict=True) if bad]
    return (
        f"{found.rank_message}; not determined: {', '.join(words) or 'a combination'}"
    )


BY_NAME = Judge(_by_name, lambda found: True)


def _sum_of_squares(push: Any, tangents: jax.Array) -> jax.Array:
    """Of pictures pushed forward, some of ``(n, C, J)`` at a time."""
    columns = jnp.swapaxes(tangents, 1, 2)

    def add(total, some):
        return total + jnp.sum(jax.vmap(push)(some) ** 2, axis=0), None

    start = jnp.zeros_like(push(columns[0]))
    return jax.lax.scan(add, start, in_blocks(columns, _PUSHED))[0]
