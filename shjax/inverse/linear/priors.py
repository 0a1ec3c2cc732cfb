"""Degrees that a picture hardly shows, marginalised under a Gaussian prior.

The light of a real place does not end at degree 2, and from one view what lies above
looks like degrees 0 to 2: by plain least squares an error of 13 %, the median over six
real places in pictures almost without noise. So higher degrees
are estimated too, with ``L_lm ~ N(0, (L_00 sd_l)^2)``. How ``sd_l`` falls differs from
place to place; a family of power laws is weighed by its marginal likelihood, in closed
form, and the answers of all its members are averaged with these weights (a quadrature of
the hierarchical model, not its mode: an uncertain scale widens the answer).

The fit ends at some degree, the light does not: how far the next ten degrees, continued
by the same laws, move the answer is added to its covariance. Without that the error bars of
pictures with less than 1 % of noise were three to ten times too small.

A picture of few normals, or of a lamp behind the camera, tells little of all this: the
covariance, not the answer, keeps a share of wide members (experiments/calibration.py).

Two families are weighed: one power law from degree 1 on, and one for degrees above 2
beside free degrees 1 and 2, which fits light that ends there.

References:
    [M92] D. MacKay, Bayesian Interpolation, Neural Computation 4, 1992.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from shjax.arrays import Array, einsum
from shjax.harmonics.degrees import check_l_max
from shjax.inverse.estimate import ChosenPrior

FIT_L_MAX = 10  # beyond, the clamped cosine passes less than a thousandth of the energy
# So many degrees above the fit move the answer too: that is in its covariance.
BEYOND = 10

_SCALES = np.geomspace(0.02, 4, 10)  # sd at degree 2 (at 4 beside free ones), over L_00
_SLOPES = np.linspace(-1, 5, 8)
_FREE = 1.0  # non-negative light has rms_m L_lm <= L_00
_UNBOUNDED = 1e3  # of L_00 itself
# What the covariance leaves to wide members; see experiments/calibration.py.
_WIDE = 1.0  # the least scale of a wide member
_BRIGHT = (6.0, 10.0, 16.0)  # scales that count for the covariance alone


@dataclasses.dataclass(frozen=True)
class PicturePrior:
    """Prior on higher degrees of light whose scale and slope each picture chooses.

    Attributes:
        l_max: Highest degree that is fitted. Of real places without noise, 10 left the
            nine coefficients off by 15 % in the median and 20 by 6 %, in fifteen times
            the time; from 2 % noise on they are alike.
    """

    l_max: int = FIT_L_MAX


def highest_degree(prior: Any, l_max: int) -> int:
    """Highest degree that is fitted under a prior.

    Raises:
        ValueError: If it is unknown, or a prior of one's own does not reach ``l_max``.
    """
    if prior is None:
        return l_max
    if isinstance(prior, str):
        if prior != "picture":
            raise ValueError(
                "prior must be 'picture', a PicturePrior, None or numbers; got "
                f"{prior!r}."
            )
        prior = PicturePrior()
    if isinstance(prior, PicturePrior):
        return max(l_max, check_l_max(prior.l_max, "prior.l_max"))
    shape = np.shape(prior)
    if len(shape) != 1 or shape[0] <= l_max:
        raise ValueError(
            f"prior must have one standard deviation per degree, ({l_max + 1},) or more; "
            f"got {shape}."
        )
    if not isinstance(prior, Tracer) and not np.all(np.asarray(prior) > 0):
        raise ValueError(f"prior must be positive; got {prior}.")
    return shape[0] - 1


def deviations_of(prior: Any, highest: int) -> Array | None:
    """Standard deviations over L_00 of a family of priors, ``(G, L)``, or None."""
    if prior is None:
        return None
    if isinstance(prior, str | PicturePrior):
        return family(highest).deviations
    return jnp.asarray(prior)[None, : highest + 1]


class PriorFamily(NamedTuple):
    """Family of priors, one member per row, relative to L_00.

    Attributes:
        deviations: ``(G, L)``, one per degree.
        scales: Of the power laws, ``(G,)``.
        slopes: Of the power laws: ``sd_l = scale (l / l_0)^-slope``, ``(G,)``.
        free: Whether degrees 1 and 2 stand beside the law (l_0 = 4) or in it (l_0 = 2).
    """

    deviations: np.ndarray
    scales: np.ndarray
    slopes: np.ndarray
    free: np.ndarray


class Laws(NamedTuple):
    """Power laws of one kind: every scale of every shape.

    Attributes:
        fixed: Deviations of the degrees that no scale changes, the first ones.
        shapes: Deviations of all degrees at scale 1, one law per row, ``(S, L)``.
        scales: ``(T,)``.
        slopes: Of the shapes, ``(S,)``.
    """

    fixed: np.ndarray
    shapes: np.ndarray
    scales: np.ndarray
    slopes: np.ndarray


@functools.lru_cache(maxsize=8)
def laws(l_max: int) -> tuple[Laws, Laws]:
    """Make the power laws to degree ``l_max``: from degree 1 on, and beside free ones."""
    degrees = np.maximum(np.arange(l_max + 1), 1)
    scales = np.array([*_SCALES, *_BRIGHT])
    kinds = ([_UNBOUNDED], 2.0), ([_UNBOUNDED, _FREE, _FREE], 4.0)
    one, other = (
        Laws(
            np.array(fixed[: l_max + 1]),
            (degrees / start) ** -_SLOPES[:, None],
            scales,
            _SLOPES,
        )
        for fixed, start in kinds
    )
    return one, other


@functools.lru_cache(maxsize=8)
def family(l_max: int) -> PriorFamily:
    """Make the family of priors to degree ``l_max``: kind by kind, shape by shape."""
    parts = []
    for free, law in enumerate(laws(l_max)):
        deviations = law.scales[None, :, None] * law.shapes[:, None]  # [s, t, l]
        deviations[..., : len(law.fixed)] = law.fixed
        slopes, scales = np.meshgrid(law.slopes, law.scales, indexing="ij")
        parts.append((deviations, scales, slopes, np.full(scales.shape, bool(free))))
    return PriorFamily(
        np.concatenate([part[0].reshape(-1, l_max + 1) for part in parts]),
        *(np.concatenate([part[k].ravel() for part in parts]) for k in (1, 2, 3)),
    )


class Roles(NamedTuple):
    """Roles of the members of a family of priors, ``(G,)`` each.

    Attributes:
        answers: Whether the answer is their mean.
        wide: Whether the covariance never quite gives them up.
    """

    answers: np.ndarray
    wide: np.ndarray


def roles(count: int) -> Roles:
    """Roles in a family of so many members; one's own prior, alone, answers."""
    if count == 1:
        return Roles(np.ones(1, bool), np.zeros(1, bool))
    members = family(FIT_L_MAX)
    return Roles(members.scales < _BRIGHT[0], members.scales >= _WIDE)


def chosen(weights: jax.Array, l_max: int) -> ChosenPrior:
    """Prior that a picture chose: means over the family."""
    members = family(l_max)

    def mean(column: np.ndarray) -> jax.Array:
        return jnp.sum(weights * jnp.asarray(column, weights.dtype))

    return ChosenPrior(
        scale=jnp.exp(mean(np.log(members.scales))),
        slope=mean(members.slopes),
        free=mean(members.free.astype(float)),
    )


def deviations_at(weights: jax.Array, degree: np.ndarray) -> jax.Array:
    """Deviations over L_00 at any degrees, root mean square over the family, ``(T,)``."""
    squares = family(int(degree.max())).deviations[:, degree] ** 2
    return jnp.sqrt(einsum("g,gt->t", weights, jnp.asarray(squares, weights.dtype)))
