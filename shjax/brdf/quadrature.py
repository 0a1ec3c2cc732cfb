"""Integrals of a BRDF over light and view, in the frame of its centre.

This module hides where a transfer function has kinks. About the reflected direction R, in
``(theta_i, theta_o, phi)`` [T5, section 5.3.1], the horizon is the great circle
``n.l = 0``, which no fixed grid follows: so for each theta_o the nodes in theta_i are
split where that circle begins and ends, and those in phi end on it. Between kinks the
integrands are smooth, and Gauss-Legendre converges fast; a substitution takes out the
square root with which the circle begins.

``G_lq(theta_o) = int int rho cos(q phi) f_lq(theta_i) sin theta_i d theta_i d phi`` over
the whole sphere of light, f_lq the theta part of the complex harmonic.

References:
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from shjax.arrays import einsum
from shjax.brdf.core import (
    Brdf,
    Local,
    prepared,
    select,
    transfer_local,
)
from shjax.brdf.ranges import check_brdf
from shjax.harmonics import legendre
from shjax.harmonics.tables import cached


@dataclasses.dataclass(frozen=True)
class Resolution:
    """Quadrature nodes in each smooth piece of theta_i, in phi, and in theta_o."""

    light: int
    phi: int
    view: int

    def times(self, factor: float) -> Resolution:
        """So many times the nodes of each angle, rounded up."""
        return Resolution(
            *(math.ceil(factor * n) for n in (self.light, self.phi, self.view))
        )


def first_resolution(l_max: int, p_max: int) -> Resolution:
    """Nodes for the harmonics themselves and a moderately narrow lobe.

    A harmonic of degree l has l / 4 waves in a piece of theta_i, and through the angle of
    n and R as many in theta_o.
    """
    return Resolution(16 + (3 * l_max) // 5, 20 + p_max, 20 + p_max + l_max // 2)


class Moments(NamedTuple):
    """Moments of a BRDF: its integrals over the light for each view.

    Attributes:
        values: ``G_lq(theta_o)``, ``(O, L, Q, C)``.
        flux: ``int rho dw``, the directional albedo, ``(O, C)``.
        power: ``int rho^2 dw``, ``(O, C)``.
        negative: ``int max(-rho, 0) dw``, ``(O, C)``.
    """

    values: jax.Array
    flux: jax.Array
    power: jax.Array
    negative: jax.Array


@cached
def view_nodes(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Polar angles of the view in [0, pi] and weights with ``sin theta_o``, ``(n,)``."""
    x, w = np.polynomial.legendre.leggauss(n)
    theta = np.pi / 2 * (1 + x)
    return theta, np.pi / 2 * w * np.sin(theta)


def kind_of(brdf: Brdf) -> str:
    """Discontinuities of a BRDF: ``"horizon"``, ``"none"`` or ``"tangent"``.

    Raises:
        ValueError: If parts about the tangent are mixed with others.
    """
    about_tangent = select(check_brdf("brdf", brdf), "tangent")
    if about_tangent is not None:
        if len(about_tangent.parts) < len(brdf.parts):
            raise ValueError(
                "brdf must not mix parts about the tangent with others in one expansion."
            )
        return "tangent"
    return "horizon" if all(part.model.horizon for part in brdf.parts) else "none"


@cached
def light_nodes(
    theta_o: tuple[float, ...], kind: str, n: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Quadrature nodes over the light for views that are known, as tables."""
    return nodes_for(np.array(theta_o), kind, n, np)


def nodes_for(theta_o, kind: str, n: int, xp=jnp):
    """Quadrature nodes in theta_i for each view, and where the horizon cuts their circles.

    Args:
        theta_o: Polar angles of the views about the centre, ``(O,)``.
        kind: From :func:`kind_of`. Static.
        n: Nodes in each piece. Static.
        xp: ``jnp`` (differentiable in the angles) or ``np``.

    Returns:
        ``theta_i``, its weights with ``sin theta_i``, and the azimuth in [0, pi] up to
        which a circle is above the horizon, each ``(O, N)``.
    """
    x, w = np.polynomial.legendre.leggauss(n)
    s, w = (xp.asarray(a, theta_o.dtype)[None] for a in ((1 + x) / 2, w / 2))

    def piece(low, high, dense: str):
        """Nodes between; dense where a square root begins."""
        shape = (theta_o.shape[0], n)
        start = xp.broadcast_to((high if dense == "high" else low)[:, None], shape)
        length = xp.broadcast_to((high - low)[:, None], shape)
        if dense:
            step, rate = length * xp.broadcast_to(s * s, shape), 2 * s * w
        else:
            step, rate = length * xp.broadcast_to(s, shape), w
        theta = start - step if dense == "high" else start + step
        return theta, length * xp.broadcast_to(rate, shape)

    quarter, zero, half = np.pi / 2, xp.zeros_like(theta_o), theta_o / 2
    if kind == "tangent":
        low = xp.maximum(theta_o - quarter, 0)
        high = xp.minimum(theta_o + quarter, np.pi)
        pieces = [piece(low, theta_o, ""), piece(theta_o, high, "")]
    else:
        rise = quarter - half  # where the horizon begins
        pieces = [piece(zero, rise, "low"), piece(rise, zero + quarter, "low")]
        pieces.append(piece(zero + quarter, quarter + half, "high"))
        if kind == "none":
            pieces.append(piece(quarter + half, zero + np.pi, ""))
    theta = xp.concatenate([t for t, _ in pieces], axis=1)
    weight = xp.concatenate([w for _, w in pieces], axis=1) * xp.sin(theta)
    if kind == "tangent":
        return theta, weight, xp.full_like(theta, np.pi)
    sine, cosine = (
        xp.broadcast_to(f(half)[:, None], theta.shape) for f in (xp.sin, xp.cos)
    )
    ratio = -cosine * xp.cos(theta) / xp.maximum(sine * xp.sin(theta), 1e-30)
    cut = xp.abs(ratio) < 1
    end = xp.arccos(xp.where(cut, ratio, 0))
    return theta, weight, xp.where(cut, end, xp.where(ratio < 0, np.pi, 0))


def azimuths_of(end: jax.Array, kind: str, n: int) -> tuple[jax.Array, jax.Array]:
    """Nodes in [0, pi] and their weights for the whole circle, ``(N, J)``.

    Up to the horizon; without one also beyond it, where a lobe has its own kink.
    """
    x, w = np.polynomial.legendre.leggauss(n)
    s, w = (jnp.asarray(a, end.dtype)[None] for a in ((1 + x) / 2, w))

    def between(low, high):
        shape = (end.shape[0], n)
        length = jnp.broadcast_to((high - low)[:, None], shape)
        low = jnp.broadcast_to(low[:, None], shape)
        s_all, w_all = (jnp.broadcast_to(a, shape) for a in (s, w))
        return low + length * s_all, length * w_all

    parts = [between(jnp.zeros_like(end), end)]
    if kind == "none":
        parts.append(between(end, jnp.full_like(end, np.pi)))
    phi, share = zip(*parts, strict=True)
    return jnp.concatenate(phi, axis=1), jnp.concatenate(share, axis=1)


def moments(
    brdf: Brdf, resolution: Resolution, l_max: int, q_max: int, dtype
) -> Moments:
    """Moments of a BRDF at the views of :func:`view_nodes`.

    The caller jits; nothing of size (views x lights) is held at once.
    """
    theta_o, _ = view_nodes(resolution.view)
    return moments_at(brdf, tuple(theta_o.tolist()), resolution, l_max, q_max, dtype)


def moments_at(
    brdf: Brdf,
    theta_o: tuple[float, ...],
    resolution: Resolution,
    l_max: int,
    q_max: int,
    dtype,
) -> Moments:
    """Moments of a BRDF at given polar angles of the view about its centre."""
    kind, ready = kind_of(brdf), prepared(brdf)
    theta, weight, end = light_nodes(theta_o, kind, resolution.light)
    views = theta.shape[0]
    seeds = legendre.seeds_of_rings(theta.ravel(), l_max, q_max, dtype)
    heights = legendre.heights_of_rings(theta.ravel(), dtype)
    steps = legendre.scan_steps(l_max, dtype, q_max)

    def by_view(table):
        if table is None:
            return None
        return jnp.moveaxis(table.reshape(table.shape[0], views, -1), 1, 0)

    split = functools.partial(jax.tree.map, by_view)
    arrays = tuple(jnp.asarray(a, dtype) for a in (theta_o, theta, weight, end))

    @jax.checkpoint
    def one_view(inputs):
        (to, ti, w, last), some_seeds, some_heights = inputs
        azimuth, around = azimuths_of(last, kind, resolution.phi)
        rho = transfer_at(ready, kind, to, ti, azimuth)  # [c, n, j]
        flux = jnp.sum(weigh(rho, w, around), axis=(1, 2))
        power = jnp.sum(weigh(rho * rho, w, around), axis=(1, 2))
        negative = jnp.sum(weigh(jnp.maximum(-rho, 0), w, around), axis=(1, 2))
        waves = _azimuth_moments(weigh(rho, w, around), azimuth, q_max)  # [q, c, n]

        def degree(state, step):
            state, values = legendre.next_degree(state, step, some_heights, some_seeds)
            return state, einsum("qn,qcn->qc", values, waves)

        _, by_degree = jax.lax.scan(degree, legendre.start(some_seeds), steps)
        return Moments(by_degree, flux, power, negative)

    inputs = (arrays, split(seeds), split(heights))
    return jax.lax.map(one_view, inputs)


def weigh(rho: jax.Array, weight: jax.Array, share: jax.Array) -> jax.Array:
    """Weight values by their nodes and by the share of each circle above the horizon."""
    both = jnp.broadcast_to(weight[:, None], share.shape) * share
    return rho * jnp.broadcast_to(both[None], rho.shape)


def _azimuth_moments(rho: jax.Array, phi: jax.Array, q_max: int) -> jax.Array:
    """``sum_j rho cos(q phi_j)``, ``(Q, C, N)``, the cosines by their recurrence."""
    twice = 2 * jnp.cos(phi)

    def order(carry, _):
        last, before = carry
        total = jnp.sum(rho * jnp.broadcast_to(last[None], rho.shape), axis=-1)
        return (twice * last - before, last), total

    start = (jnp.ones_like(phi), jnp.cos(phi))
    return jax.lax.scan(order, start, None, length=q_max + 1)[1]


def transfer_at(brdf: Brdf, kind: str, to, ti, phi) -> jax.Array:
    """Values at lights ``(n, j)`` of the centre's frame for one view, ``(C, n, j)``."""
    ti = jnp.broadcast_to(ti[:, None], phi.shape)
    x, y, z = jnp.sin(ti) * jnp.cos(phi), jnp.sin(ti) * jnp.sin(phi), jnp.cos(ti)
    if kind == "tangent":
        view = Local(jnp.sin(to), jnp.zeros_like(to), jnp.cos(to))
        return transfer_local(brdf, Local(x, y, z), _spread(view, phi.shape))
    # n = (sin to/2, 0, cos to/2); its frame is turned by to/2 about y.
    sine, cosine = jnp.sin(to / 2), jnp.cos(to / 2)
    light = Local(x * cosine - z * sine, y, x * sine + z * cosine)
    view = Local(sine, jnp.zeros_like(to), cosine)
    return transfer_local(brdf, light, _spread(view, phi.shape))


def _spread(direction: Local, shape: tuple[int, ...]) -> Local:
    return Local(*(jnp.broadcast_to(part, shape) for part in direction))


@functools.partial(jax.jit, static_argnames=("kind",))
def flux_by_angle(brdf: Brdf, kind: str, theta_o, theta, end) -> jax.Array:
    """Magnitude of the flux at each ``theta_i``, all channels and azimuths: ``(O, N)``."""
    ready = prepared(brdf)

    def one_view(view):
        to, ti, last = view
        phi, share = azimuths_of(last, kind, 32)
        rho = jnp.sum(jnp.abs(transfer_at(ready, kind, to, ti, phi)), axis=0)
        return jnp.sum(rho * share, axis=-1)

    return jax.lax.map(one_view, (theta_o, theta, end))


def order_counts(p_max: int) -> np.ndarray:
    """Number of orders q of each ``|q|``: 1, 2, 2, ..., ``(p_max + 1,)``."""
    return np.where(np.arange(p_max + 1) == 0, 1, 2)
