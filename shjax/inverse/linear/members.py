"""Members of a family of priors: their posteriors one by one, and their weights.

References:
    [M92] D. MacKay, Bayesian Interpolation, Neural Computation 4, 1992.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from shjax.arrays import einsum
from shjax.inverse.linear.least_squares import regularised
from shjax.inverse.linear.priors import Roles, roles

# What the covariance leaves to wide members; see experiments/calibration.py.
_DOUBT, _WIDE_EVIDENCE = 0.3, 0.01


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


def one_by_one(r, z, units, variance, deviations) -> Posterior:
    """Average the members' posteriors, one member after the other [M92, section 4].

    :func:`shjax.inverse.linear.marginal.posterior` is fifteen times faster; its derivatives
    are those of this.

    Args:
        r: Triangles, ``(C, J, J)``.
        z: Right sides, ``(C, J)``.
        units: One a channel, ``(C,)``.
        variance: Of a pixel of weight 1, ``(C,)``.
        deviations: Of the unknowns, relative to ``units``, ``(G, J)``.
    """
    members = roles(len(deviations))
    root = jnp.sqrt(variance)
    r, z = r / root[:, None, None], z / root[:, None]
    sd = deviations[:, None] * units[None, :, None]  # [g, c, j]
    evidence, mean, inverse = jax.vmap(
        jax.vmap(_member, in_axes=(0, 0, 0)), in_axes=(None, None, 0)
    )(r, z, sd)
    weights = member_weights(jnp.sum(evidence, axis=1), members.answers)
    answer = einsum("g,gcj->cj", weights, mean)
    within = einsum("g,gcij->cij", weights, inverse)
    doubted = doubted_weights(jnp.mean(evidence, axis=1), members)
    apart = mean - answer[None]
    covariance = einsum("g,gcij->cij", doubted, inverse)
    covariance = covariance + einsum("g,gci,gcj->cij", doubted, apart, apart)
    left = jnp.diagonal(inverse, axis1=2, axis2=3) / sd**2
    share = jnp.clip(einsum("g,gcj->jc", weights, left), 0, 1)
    return Posterior(answer.T, covariance, within, share, weights)


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


def member_weights(evidence: jax.Array, allowed: np.ndarray) -> jax.Array:
    """Posterior probabilities of the members that are allowed, ``(G,)``."""
    return jax.nn.softmax(jnp.where(jnp.asarray(allowed), evidence, -jnp.inf))


def doubted_weights(evidence: jax.Array, members: Roles) -> jax.Array:
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
        return member_weights(evidence, members.answers)
    own = member_weights(evidence, members.answers)
    wide = member_weights(_WIDE_EVIDENCE * evidence, members.wide)
    return (1 - _DOUBT) * own + _DOUBT * wide
