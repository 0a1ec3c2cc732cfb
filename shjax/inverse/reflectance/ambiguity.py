"""What pictures leave open of lighting and reflectance together."""

from __future__ import annotations

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp

from shjax.arrays import matmul
from shjax.inverse.estimate import Estimate
from shjax.inverse.reflectance.families import LobeFamily
from shjax.inverse.reflectance.free_gains import FreeGains
from shjax.inverse.reflectance.nonlinear import Found
from shjax.inverse.shown.predicting import predict_lighting

HELD = 1e-5  # deviation of a known parameter, in its free form
_FORGIVEN = 1e-3  # share of an unknown in the null space, below which it is determined


def joint_estimate(
    kind: LobeFamily | FreeGains,
    found: Found,
    light: jax.Array,
    design: Callable[[jax.Array], jax.Array],
    spread: jax.Array,
    sigma: jax.Array,
    squares: jax.Array,
    brightest: jax.Array,
    dtype,
    *,
    l_max: int,
    lights: int,
) -> Estimate:
    """Report lighting and reflectance, and what the derivatives leave open of both."""
    channels = light.shape[1]
    places = kind.places(channels)
    value = jnp.concatenate([found.value[places].T, light])  # [j, c]

    def picture(one, channel):
        """A channel's weighted picture of its own unknowns, over its noise."""
        vector = found.value.at[places[channel]].set(one[: places.shape[1]])
        rows = design(vector)[channel]
        return matmul(rows, one[places.shape[1] :])

    largest = jnp.max(jnp.abs(light), axis=0)
    largest = jnp.where(largest > 0, largest, 1)
    held = spread[places] <= HELD  # [c, p]
    answers = []
    for c in range(channels):
        jacobian = jax.jacfwd(lambda one, c=c: picture(one, c))(value[:, c]) / sigma[c]
        # Units: a known parameter has none, a free one its own, the light its largest.
        unit = jnp.where(held[c], 0.0, 1.0)
        unit = jnp.concatenate([unit, jnp.full(light.shape[0], largest[c])])
        answers.append(_known(jacobian * unit[None], unit, held[c]))
    covariance, missing, singular, vectors, rank = (
        jnp.stack(a) for a in zip(*answers, strict=True)
    )
    slopes = jax.vmap(jax.jacfwd(lambda u: kind.natural(u[:, None])[:, 0]))(
        value[: places.shape[1]].T
    )
    whole = jax.vmap(
        lambda a: jnp.eye(value.shape[0], dtype=a.dtype).at[: len(a), : len(a)].set(a)
    )(slopes)
    natural = jnp.einsum("cij,cjk,clk->cil", whole, covariance, whole)
    # A reported parameter is open where it depends on one that is.
    depends = (jnp.abs(whole) > 0).astype(missing.dtype)
    missing = jnp.max(depends * missing[:, None], axis=2)
    lost = missing > _FORGIVEN
    open_ended = jax.vmap(jnp.diag)(jnp.where(lost, jnp.inf, 0.0))
    coefs = tuple(
        f"L_{l}{m:+d}" if lights == 1 else f"L{i}_{l}{m:+d}"
        for i in range(lights)
        for l in range(l_max + 1)
        for m in range(-l, l + 1)
    )
    cast = functools.partial(jnp.asarray, dtype=dtype)
    shown = jnp.concatenate([kind.natural(value[: places.shape[1]]), light])
    return Estimate(
        value=cast(shown),
        covariance=cast(natural + open_ended),
        singular_values=cast(singular[brightest]),
        singular_vectors=cast(vectors[brightest]),
        rank=rank,
        prior_fraction=cast(missing.T),
        residual_norm=cast(jnp.sqrt(squares)),
        noise=cast(sigma),
        steps=found.steps,
        converged=found.converged,
        full_value=cast(light[: (l_max + 1) ** 2]),
        full_covariance=cast(
            (covariance + open_ended)[:, places.shape[1] :, places.shape[1] :][
                :, : (l_max + 1) ** 2, : (l_max + 1) ** 2
            ]
        ),
        forward=jax.tree_util.Partial(
            predict_lighting, kind.brdf(cast(value[: places.shape[1]]))
        ),
        tolerance=1e-7 if dtype == jnp.float64 else 1e-4,
        names=(*kind.names, *coefs),
    )


def _known(jacobian: jax.Array, unit: jax.Array, held: jax.Array):
    """Covariance, what is open of each unknown, and the singular directions."""
    size = jacobian.shape[1]
    _, r = jnp.linalg.qr(jacobian)
    # A held parameter is known: it has a row of its own.
    held = jnp.concatenate([held, jnp.zeros(size - held.shape[0], bool)])
    scale = jnp.max(jnp.abs(r))
    rows = jnp.where(held, scale, 0.0)
    _, values, vectors = jnp.linalg.svd(
        jnp.concatenate([r, jnp.diag(rows)]), full_matrices=False
    )
    tolerance = 1e-7 if jacobian.dtype == jnp.float64 else 1e-4
    known = values > tolerance * values[0]
    inverse = jnp.where(known, 1 / jnp.where(known, values, 1), 0)
    half = vectors * inverse[:, None] * unit[None]
    share = jnp.sum(jnp.where(known[:, None], 0, vectors**2), axis=0)
    covariance = matmul(half.T, half)
    return covariance, share, values, vectors, jnp.sum(known)
