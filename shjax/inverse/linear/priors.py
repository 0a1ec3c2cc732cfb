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
from shjax.inverse.linear.compression import Compressed
from shjax.inverse.linear.least_squares import regularised

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
_DOUBT, _WIDE_EVIDENCE = 0.3, 0.01


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


@functools.lru_cache(maxsize=8)
def family(l_max: int) -> PriorFamily:
    """Make the family of priors to degree ``l_max``."""
    degrees = np.maximum(np.arange(l_max + 1), 1)
    axes = ([*_SCALES, *_BRIGHT], _SLOPES, [False, True])
    scales, slopes, free = (a.ravel() for a in np.meshgrid(*axes, indexing="ij"))
    start = np.where(free, 4.0, 2.0)[:, None]
    deviations = scales[:, None] * (degrees / start) ** -slopes[:, None]
    deviations[:, 1:3] = np.where(free[:, None], _FREE, deviations[:, 1:3])
    deviations[:, 0] = _UNBOUNDED
    return PriorFamily(deviations, scales, slopes, free)


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


class Posterior(NamedTuple):
    """Mean and covariance under a family of priors.

    Attributes:
        mean: ``(J, C)``.
        covariance: ``(C, J, J)``.
        within: The members' own covariance, without how far they lie apart, ``(C, J, J)``.
        share: Of each unknown's variance that the data left, ``(J, C)``, in [0, 1].
        weights: Of the members, ``(G,)``.
    """

    mean: jax.Array
    covariance: jax.Array
    within: jax.Array
    share: jax.Array
    weights: jax.Array


def posterior(
    problem: Compressed,
    deviations: jax.Array,
    units: jax.Array,
    variance: jax.Array,
    members: Roles,
) -> Posterior:
    """Average the members' posteriors by their marginal likelihood [M92, section 4].

    Args:
        problem: The compressed data.
        deviations: Of the unknowns, relative to ``units``, ``(G, J)``.
        units: One a channel, ``(C,)``.
        variance: Of a pixel of weight 1, ``(C,)``.
        members: Which of them do what.
    """
    dtype = problem.r.dtype
    wide = jnp.result_type(float)  # small, so in the widest type there is
    r, z, units, variance = (
        a.astype(wide) for a in (problem.r, problem.z, units, variance)
    )
    root = jnp.sqrt(variance)
    r, z = r / root[:, None, None], z / root[:, None]
    sd = jnp.asarray(deviations, wide)[:, None] * units[None, :, None]  # [g, c, j]
    evidence, mean, inverse = jax.vmap(
        jax.vmap(_member, in_axes=(0, 0, 0)), in_axes=(None, None, 0)
    )(r, z, sd)
    weights = _weights(jnp.sum(evidence, axis=1), members.answers)
    answer = einsum("g,gcj->cj", weights, mean)
    within = einsum("g,gcij->cij", weights, inverse)
    doubted = _doubted(jnp.mean(evidence, axis=1), members)
    apart = mean - answer[None]
    covariance = einsum("g,gcij->cij", doubted, inverse)
    covariance = covariance + einsum("g,gci,gcj->cij", doubted, apart, apart)
    left = jnp.diagonal(inverse, axis1=2, axis2=3) / sd**2
    share = jnp.clip(einsum("g,gcj->jc", weights, left), 0, 1)
    return Posterior(
        answer.T.astype(dtype),
        covariance.astype(dtype),
        within.astype(dtype),
        share.astype(dtype),
        weights.astype(dtype),
    )


def _weights(evidence: jax.Array, allowed: np.ndarray) -> jax.Array:
    return jax.nn.softmax(jnp.where(jnp.asarray(allowed), evidence, -jnp.inf))


def _doubted(evidence: jax.Array, members: Roles) -> jax.Array:
    """Weights for the covariance: light that a picture does not show may be bright.

    A few numbers, as many as a box has faces, fit a law of small deviations by chance, and
    a lamp behind the camera follows no power law. So a share of the weight stays with
    the wide members, whose evidence counts little; many pixels still rule them out.

    Args:
        evidence: Mean over the channels: those of one light are nearly copies of each
            other, and speak once.
        members: Which of them do what.
    """
    if not np.any(members.wide):
        return _weights(evidence, members.answers)
    own = _weights(evidence, members.answers)
    wide = _weights(_WIDE_EVIDENCE * evidence, members.wide)
    return (1 - _DOUBT) * own + _DOUBT * wide


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


def _member(r: jax.Array, z: jax.Array, sd: jax.Array):
    """Log evidence, mean and covariance under one prior.

    Unknowns in units of their deviations: the prior is ``|x|^2``, rows of their own.
    """
    size = sd.shape[0]
    rows = jnp.concatenate([r * sd[None], jnp.eye(size, dtype=r.dtype)])
    right = jnp.concatenate([z, jnp.zeros(size, z.dtype)])
    x, inverse, log_det = regularised(rows, right)
    # The residual, not the power explained: that is large and nearly the same for all.
    left = right - einsum("ij,j->i", rows, x)
    evidence = -(log_det + jnp.sum(left * left)) / 2
    return evidence, sd * x, inverse * sd[:, None] * sd[None]
