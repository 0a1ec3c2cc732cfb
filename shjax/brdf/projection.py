"""Projection of a BRDF on spherical harmonics by quadrature that settles."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from shjax.arrays import einsum
from shjax.brdf.core import Brdf
from shjax.brdf.quadrature import (
    Resolution,
    first_resolution,
    moments,
    order_counts,
    view_nodes,
)
from shjax.harmonics.legendre import legendre

_LEAST_VIEWS = 16
_MAX_NODES = 400  # in each piece of theta_i; beyond, the error stands as it is


@dataclasses.dataclass(frozen=True)
class Projection:
    """Coefficients and energies of one quadrature, arrays as in ``BrdfExpansion``."""

    rho: jax.Array
    degree_energy: jax.Array
    total_energy: jax.Array


@functools.partial(
    jax.jit, static_argnames=("resolution", "l_max", "p_max", "q_max", "dtype")
)
def _high_energy(
    brdf: Brdf, *, resolution: Resolution, l_max: int, p_max: int, q_max: int, dtype
) -> jax.Array:
    """Energy by degree of the azimuthal orders above ``p_max``, ``(L, C)``."""
    found = moments(brdf, resolution, l_max, q_max, dtype)
    solid = jnp.asarray(2 * np.pi * view_nodes(resolution.view)[1], dtype)
    counts = jnp.asarray(order_counts(q_max)[p_max + 1 :], dtype)
    return einsum("olqc,o,q->lc", found.values[:, :, p_max + 1 :] ** 2, solid, counts)


@functools.partial(
    jax.jit, static_argnames=("resolution", "l_max", "p_max", "q_max", "dtype")
)
def _integrate(
    brdf: Brdf, *, resolution: Resolution, l_max: int, p_max: int, q_max: int, dtype
) -> tuple[jax.Array, jax.Array, jax.Array]:
    found = moments(brdf, resolution, l_max, q_max, dtype)
    theta, weight = view_nodes(resolution.view)
    functions = np.stack(
        [legendre(p_max, q, np.cos(theta), np.sin(theta)) for q in range(p_max + 1)], -1
    )  # [p, o, q]
    onto = jnp.asarray(2 * np.pi * functions * weight[:, None], dtype)
    rho = einsum("olqc,poq->lpqc", found.values[:, :, : p_max + 1], onto)
    # Parseval in the view: 2 pi int G_lq^2 sin to d to = sum_p rho_lpq^2.
    solid = jnp.asarray(2 * np.pi * weight, dtype)
    counts = jnp.asarray(order_counts(q_max), dtype)
    energy = einsum("olqc,o,q->lc", found.values**2, solid, counts)
    return rho, energy, einsum("oc,o->c", found.power, solid)


def settled(
    brdf: Brdf,
    l_max: int,
    p_max: int,
    q_max: int,
    accuracy: float,
    resolution: Resolution | None,
    *,
    check: float = 2.0,
) -> tuple[Projection, jax.Array, Resolution]:
    """Integrate with the nodes doubled until the coefficients hold still.

    The high orders q > p_max count in the energies alone, and hold less than a hundredth
    of them: they are integrated at the end, at a third of the views, off by 1e-6 of all
    energy.

    Args:
        brdf: The reflectance.
        l_max: Highest degree of the light.
        p_max: Highest degree of the view.
        q_max: Highest azimuthal order in the energies.
        accuracy: Relative change at which it ends.
        resolution: Nodes to use, without a comparison.
        check: So many times the first nodes they are compared with; later ones double.
    """
    if not accuracy > 0:
        raise ValueError(f"accuracy must be positive; got {accuracy}.")
    dtype = brdf.parts[0].weight.dtype

    def run(nodes: Resolution, q: int) -> Projection:
        nodes = dataclasses.replace(nodes, phi=max(nodes.phi, 16 + (3 * q) // 2))
        return Projection(
            *_integrate(
                brdf, resolution=nodes, l_max=l_max, p_max=p_max, q_max=q, dtype=dtype
            )
        )

    def high(nodes: Resolution) -> jax.Array:
        view = max(nodes.view // 3, _LEAST_VIEWS)
        nodes = Resolution(nodes.light, max(nodes.phi, 16 + (3 * q_max) // 2), view)
        return _high_energy(
            brdf, resolution=nodes, l_max=l_max, p_max=p_max, q_max=q_max, dtype=dtype
        )

    used = resolution or first_resolution(l_max, p_max)
    if resolution is not None or any(
        isinstance(x, Tracer) for x in jax.tree.leaves(brdf)
    ):
        used = resolution or used.times(2.0)
        with jax.debug_nans(False):  # this one is meant: the error is not known
            unknown = jnp.asarray(np.nan, dtype)
        return run(used, q_max), unknown, used
    limit = max(accuracy, 30 * float(jnp.finfo(dtype).eps))
    found, error, coarse, factor = run(used, p_max), np.inf, used, check
    while error > limit and used.light < _MAX_NODES:
        coarse, before = used, found
        used, factor = used.times(factor), 2.0
        found = run(used, p_max)
        energies = _change(found.total_energy, before.total_energy)
        error = max(_change(found.rho, before.rho), energies)
    if q_max > p_max:
        # By the coarser nodes, whose error is what was measured.
        energies = found.degree_energy + high(coarse)
        found = dataclasses.replace(found, degree_energy=energies)
    return found, jnp.asarray(error, dtype), used


def _change(value: jax.Array, before: jax.Array) -> float:
    norm = float(jnp.linalg.norm(value.ravel()))
    return float(jnp.linalg.norm((value - before).ravel())) / (norm or 1.0)
