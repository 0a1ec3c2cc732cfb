"""Mean and covariance under a family of priors, averaged by marginal likelihood [M92].

A law ``sd_l = scale * shape_l`` scales all its unknowns alike, so one singular value
decomposition of the rows, weighted by the shape, serves every scale, noise and channel:
with ``R F = U s V^T`` the evidence, the mean and the covariance are sums over k with
``scale^2 s_k^2 + variance`` in the denominator. The first degrees, which no scale changes,
are eliminated before by one QR. That is 16 small decompositions in place of 624.

References:
    [M92] D. MacKay, Bayesian Interpolation, Neural Computation 4, 1992.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from shjax.arrays import as_type, einsum
from shjax.inverse.linear.compression import Compressed
from shjax.inverse.linear.members import (
    Posterior,
    doubted_weights,
    member_weights,
    one_by_one,
)
from shjax.inverse.linear.priors import laws, roles


def posterior(
    problem: Compressed,
    deviations: jax.Array,
    units: jax.Array,
    variance: jax.Array,
    degree: np.ndarray,
) -> Posterior:
    """Average the members' posteriors by their marginal likelihood [M92, section 4].

    Args:
        problem: The compressed data.
        deviations: Of the unknowns, relative to ``units``, ``(G, J)``.
        units: One a channel, ``(C,)``.
        variance: Of a pixel of weight 1, ``(C,)``.
        degree: Of the unknowns, rising, ``(J,)``.
    """
    dtype = problem.r.dtype
    wide = jnp.result_type(float)  # small, so in the widest type there is
    given = (problem.r, problem.z, units, variance, deviations)
    given = (jnp.asarray(a, wide) for a in given)
    own = problem.own.astype(wide)
    found = _posterior(tuple(degree.tolist()), own, *given)
    return Posterior(*(a.astype(dtype) for a in found))


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _posterior(degree, own, r, z, units, variance, deviations) -> Posterior:
    """By the decompositions; ``own`` are the triangles, one for all channels or each."""
    channels, members = z.shape[0], roles(len(deviations))
    kinds = _kinds(degree, deviations)
    parts = [slice(None)]
    if len(own) > 1:
        parts = [slice(c, c + 1) for c in range(channels)]
    solved = [
        _solve(r, z[some], units[some], variance[some], kinds)
        for r, some in zip(own, parts, strict=True)
    ]
    evidence = jnp.concatenate([one.evidence for one in solved], axis=3)  # [n, s, t, c]
    mean = jnp.concatenate([one.mean for one in solved], axis=3)
    evidence, mean = (a.reshape(-1, *a.shape[3:]) for a in (evidence, mean))
    weights = member_weights(jnp.sum(evidence, axis=1), members.answers)
    doubted = doubted_weights(jnp.mean(evidence, axis=1), members)
    both = jnp.stack([weights, doubted])
    spread, left = zip(*(_spread(one, both) for one in solved), strict=True)
    within, held = jnp.concatenate(spread, axis=1)
    share = jnp.clip(jnp.concatenate(left, axis=1), 0, 1)
    answer = einsum("g,gcj->cj", weights, mean)
    apart = mean - answer[None]
    covariance = held + einsum("g,gci,gcj->cij", doubted, apart, apart)
    return Posterior(answer.T, covariance, within, share, weights)


@_posterior.defjvp
def _posterior_jvp(degree, primals, tangents):
    own, *given = primals
    _, *moved = tangents
    _, tangent = jax.jvp(one_by_one, tuple(given), tuple(moved))
    return _posterior(degree, own, *given), tangent


class _Kinds(NamedTuple):
    """Laws of K kinds for J unknowns.

    Attributes:
        fixed: Which unknowns no scale changes, ``(K, J)``: the first ones, as 1 and 0.
        deviations: Theirs; 1 for the others, ``(K, J)``.
        shapes: Deviations of the others at scale 1; 0 for the fixed ones, ``(K, S, J)``.
        scales: ``(T,)``.
    """

    fixed: jax.Array
    deviations: jax.Array
    shapes: jax.Array
    scales: jax.Array


def _kinds(degree: tuple[int, ...], deviations: jax.Array) -> _Kinds:
    dtype = deviations.dtype
    if len(deviations) == 1:  # one prior of one's own
        one = jnp.ones_like(deviations)
        return _Kinds(0 * one, one, deviations[None], jnp.ones(1, dtype))
    at, found = np.array(degree), []
    kinds = laws(max(degree))
    for law in kinds:
        fixed = at < len(law.fixed)
        own = np.where(fixed, law.fixed[np.minimum(at, len(law.fixed) - 1)], 1)
        found.append((fixed, own, np.where(fixed, 0, law.shapes[:, at])))
    columns = (np.stack(column) for column in zip(*found, strict=True))
    return _Kinds(*(as_type(a, dtype) for a in (*columns, kinds[0].scales)))


class _Solved(NamedTuple):
    """All members of K kinds, for the C channels of one triangle.

    Attributes:
        evidence: ``(K, S, T, C)``.
        mean: ``(K, S, T, C, J)``.
        vectors: Unknowns of the singular directions at scale 1, ``(K, S, J, J)``.
        left: Of their prior variance, what the data left, ``(K, S, T, C, J)``.
        prior: Their prior variance, ``(T, C)``.
        own: Covariance of the fixed ones where the others are known, ``(K, C, J, J)``.
        over: One over the shapes; 0 for the fixed ones, ``(K, S, J)``.
        fixed: One over the prior variance of the fixed ones; 0 for others, ``(K, J, C)``.
    """

    evidence: jax.Array
    mean: jax.Array
    vectors: jax.Array
    left: jax.Array
    prior: jax.Array
    own: jax.Array
    over: jax.Array
    fixed: jax.Array


def _solve(r, z, units, variance, kinds: _Kinds) -> _Solved:
    """Evidence and mean of every member; ``r`` ``(J, J)``, ``z`` ``(C, J)``."""
    size, channels = r.shape[0], z.shape[0]
    count = len(kinds.fixed)
    # Rows of the fixed degrees' prior, relative to the noise: one for all channels, whose
    # ratios of light to noise are alike; these priors are wide.
    ratio = jnp.log(units) - jnp.log(variance) / 2
    identity = jnp.eye(size, dtype=r.dtype)
    rows = kinds.fixed / (kinds.deviations * jnp.exp(jnp.mean(ratio)))
    prior_rows = rows[:, None] * identity[None]
    data = jnp.concatenate([r, z.T], axis=1)
    tall = jnp.concatenate(
        [
            jnp.pad(prior_rows, ((0, 0), (0, 0), (0, channels))),
            jnp.broadcast_to(data, (count, *data.shape)),
        ],
        axis=1,
    )
    reduced, inverse = jax.lax.map(_eliminated, (tall, kinds.fixed))
    others = 1 - kinds.fixed
    table, target = reduced[:, :size, :size], reduced[:, :size, size:]
    above = table * (others[:, :, None] * others[:, None])
    weighted = above[:, None] * kinds.shapes[:, :, None]
    flat = weighted.reshape(-1, size, size)
    u, s, vt = (a.reshape(count, -1, *a.shape[1:]) for a in jax.lax.map(_svd, flat))
    explained = einsum("nsik,nic->nsck", u, target * others[..., None])
    prior = (kinds.scales[:, None] * units[None]) ** 2  # [t, c]
    noise = variance[None, None, None, :, None]
    scaled = prior[None, None, ..., None] * s[:, :, None, None]  # [n, s, t, c, k]
    spread = scaled * s[:, :, None, None] + noise
    vectors = kinds.shapes[..., None] * jnp.swapaxes(vt, 2, 3)  # [n, s, i, k]
    lift = einsum("nlk,nki->nli", inverse, table * others[:, None])
    whole = vectors - einsum("nli,nsik->nslk", lift, vectors)
    start = einsum("nlk,nkc->ncl", inverse, target)
    mean = einsum("nsik,nstck->nstci", whole, scaled / spread * explained[:, :, None])
    squares = explained[:, :, None] ** 2 / spread
    # The residual, not the power explained: that is large and nearly the same for all.
    evidence = -jnp.sum(jnp.log(spread / noise) + squares, axis=-1) / 2
    missed = (
        jnp.sum(reduced[:, size:, size:] ** 2, axis=1) / variance[None] / 2
    )  # [n, c]
    diagonal = jnp.abs(jnp.diagonal(table, axis1=1, axis2=2)) * kinds.deviations
    wide = jnp.log(jnp.where(kinds.fixed > 0, diagonal, 1))
    wide = einsum("nj->n", wide)[:, None] + einsum("nj,c->nc", kinds.fixed, ratio)
    own = einsum("c,nij,nkj->ncik", variance, inverse, inverse)
    some = jnp.where(kinds.shapes > 0, kinds.shapes, 1)
    return _Solved(
        evidence - (missed + wide)[:, None, None],
        mean + start[:, None, None],
        whole,
        noise / spread,
        prior,
        own,
        jnp.where(kinds.shapes > 0, 1 / some, 0),
        (kinds.fixed / kinds.deviations**2)[..., None] / (units**2)[None, None],
    )


# One by one under vmap, too: see inverse_and_log_det for what batches may do.
@jax.custom_batching.sequential_vmap
def _svd(a: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    u, s, vt = jnp.linalg.svd(a)
    return u, s, vt


@jax.custom_batching.sequential_vmap
def _eliminated(given) -> tuple[jax.Array, jax.Array]:
    """Triangle of some rows, and the inverse of its part of the fixed unknowns."""
    rows, fixed = given
    size = len(fixed)
    reduced = jnp.linalg.qr(rows, mode="r")
    identity = jnp.eye(size, dtype=rows.dtype)
    first = jnp.where(fixed[:, None] * fixed[None] > 0, reduced[:size, :size], identity)
    right = identity * fixed[None]
    return reduced, jax.scipy.linalg.solve_triangular(first, right)


def _spread(one: _Solved, weights: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Sums over the members with each of two weights ``(2, K S T)``.

    Returns:
        Of their covariances, ``(2, C, J, J)``, and with the first weights of what the data
        left of each prior variance, ``(J, C)``.
    """
    by_scale = weights.reshape(2, *one.evidence.shape[:3])
    each = einsum(
        "wnst,nstck->wnsck", by_scale, one.left * one.prior[None, None, ..., None]
    )
    scaled = one.vectors[None, :, :, None] * each[..., None, :]  # [w, n, s, c, i, k]
    covariance = einsum("wnscik,nsjk->wcij", scaled, one.vectors)
    covariance = covariance + einsum("wnst,ncij->wcij", by_scale, one.own)
    left = einsum("nst,nstck->nsck", by_scale[0], one.left)
    scaled = einsum("nsik,nsck->ic", (one.vectors * one.over[..., None]) ** 2, left)
    by_kind = einsum("nsck,nsik->nci", each[0], one.vectors**2)
    by_kind = by_kind + einsum("nst,ncii->nci", by_scale[0], one.own)
    return covariance, scaled + einsum("nci,nic->ic", by_kind, one.fixed)
