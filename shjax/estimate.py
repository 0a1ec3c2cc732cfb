"""The answer of an inverse problem, and how far to trust it."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Bool, Float, Int

from shjax.arrays import Array, safe_sqrt

_UNDETERMINED = 0.5  # of an unknown's variance, left by the data: the prior answers


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
        "noise",
        "steps",
        "converged",
        "full_value",
        "full_covariance",
        "forward",
        "details",
    ),
    meta_fields=("tolerance", "names"),
)
@dataclasses.dataclass(frozen=True, repr=False)
class Estimate:
    """What was estimated and how far to trust it.

    Attributes:
        value: The unknowns, ``(K, C)``; directions that nothing determines are 0.
        covariance: ``(C, K, K)``; infinite variance for what is not determined.
        singular_values: Of the design (root mean square over channels), falling ``(K,)``.
        singular_vectors: Their directions, ``(K, K)``, one a row.
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
        details: More that the method found, by name: the prior's ``scale`` and
            ``slope``, ``gains`` of pictures, an ``albedo``, a ``brdf``.
        tolerance: Singular values below this share of the largest count as zero.
        names: Of the unknowns, where they are not coefficients.
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
    details: dict[str, Any]
    tolerance: float
    names: tuple[str, ...] = ()

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
        """Of each unknown: the root of the covariance's diagonal."""
        return safe_sqrt(jnp.diagonal(self.covariance, axis1=1, axis2=2)).T

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
        return bool(self.converged) and finite and bool(whole) and self._possible

    @property
    def _possible(self) -> bool:
        """Whether some light of non-negative radiance has these degrees 0 and 1."""
        value = np.asarray(self.value, float)
        if self.names or len(value) < 4:
            return True
        first = np.linalg.norm(value[1:4], axis=0)
        return bool(
            np.all(first <= math.sqrt(3) * np.maximum(value[0], 0) * (1 + 1e-4))
        )

    @property
    def message(self) -> str:
        """One line on what was determined."""
        if not bool(self.converged):
            return "the solver did not converge; the value is not to be used"
        size, count = self.value.shape[0], int(np.min(np.asarray(self.rank)))
        if not np.any(np.asarray(self.rank)) and not self.names:
            return "nothing is determined: no pixel has weight and light"
        line = f"rank {count} of {size}, condition number {self.condition_number:.3g}"
        if "scale" in self.details:
            scale, slope = (float(self.details[n]) for n in ("scale", "slope"))
            line += (
                f", degrees above by a prior of scale {scale:.2g}, slope {slope:.2g}"
            )
            if not np.any(np.asarray(self.value)):
                line += "; the picture is black"
            elif np.any(np.asarray(self.value)[0] <= 0):
                line += (
                    "; no light has L_00 <= 0: look for pixels on an outline, or for "
                    "wrong normals"
                )
        if not self._possible and bool(np.all(np.asarray(self.value)[0] > 0)):
            line += (
                "; in some channel |L_1| > sqrt(3) L_00, which no light of non-negative "
                "radiance has: is the picture linear, are outlines and shadows masked? "
                "nonnegative=True (--nonnegative) finds the nearest that can be"
            )
        if count == size:
            return line
        lost = np.max(np.asarray(self.prior_fraction), axis=1) > _UNDETERMINED
        if self.names:
            words = [name for name, bad in zip(self.names, lost, strict=True) if bad]
            return f"{line}; not determined: {', '.join(words) or 'a combination'}"
        return f"{line}; what is missing is left at 0 (see prior_fraction)"

    def predict(
        self, gbuffer: Any
    ) -> tuple[Float[jax.Array, "H W C"], Float[jax.Array, "H W C"]]:
        """The picture that the estimate predicts, and its standard deviation.

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


def _sum_of_squares(push: Any, tangents: jax.Array) -> jax.Array:
    """Of pictures pushed forward, one of ``(n, C, J)`` at a time."""

    def add(total, tangent):
        return total + push(tangent.T) ** 2, None

    start = jnp.zeros_like(push(tangents[0].T))
    return jax.lax.scan(add, start, tangents)[0]
