"""Fitting linearly transformed cosines to a BRDF, view by view from the neighbour.

``D(w) = albedo / pi max(z', 0) / (|M^-1 w|^3 det M)``, with z' the height of the unit
vector along ``M^-1 w`` and ``M = [X Y Z] [[a, 0, c], [0, b, 0], [0, 0, 1]]``, Z the lobe's
mean direction [HDHN16, section 3]. The paper minimises the integral of ``|f - D|^3``; so do
we, by BFGS on quadrature that is dense at the lobe, and without the published table's
quadrature error of up to 1.1 % in the albedo.

References:
    [HDHN16] E. Heitz, J. Dupuy, S. Hill, D. Neubelt, Real-Time Polygonal-Light Shading
    with Linearly Transformed Cosines, ACM TOG 35 (4), 2016.
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from shjax.arrays import check_count, matmul
from shjax.brdf.core import Brdf, Local, prepared, select, transfer_local
from shjax.brdf.ranges import check_brdf
from shjax.lights.lobe_polar import nodes_about
from shjax.lights.outlines import Outline, Rims, no_edges, whole_turn
from shjax.ltc.table import LtcTable

_NODES = 64  # along the horizon, and from the lobe out to it
_STEPS = 200
_LOWEST = 0.05  # cosine of the last view


def fit(brdf: Brdf, *, views: int = 32) -> LtcTable:
    """Fit linearly transformed cosines to an isotropic BRDF, for any view.

    Args:
        brdf: The reflectance; its channels share the shape of their sum.
        views: Angles of the table. Static.

    Returns:
        The table, with the error of the lobe at each view.

    Raises:
        ValueError: If a part of the BRDF is about the tangent, or there are fewer than two
            views.
    """
    check_brdf("brdf", brdf)
    check_count("views", views, minimum=2)
    if select(brdf, "tangent") is not None:
        raise ValueError("brdf must have no parts about the tangent.")
    return _fit(brdf, views=views)


@functools.partial(jax.jit, static_argnames="views")
def _fit(brdf: Brdf, *, views: int) -> LtcTable:
    dtype = brdf.parts[0].weight.dtype
    ready = prepared(brdf)
    cosines = np.maximum(1 - np.linspace(0, 1, views) ** 2, _LOWEST)

    def step(start, cosine):
        towards, solid, lobe = _lobe(ready, cosine)
        total = jnp.sum(lobe, axis=0)
        albedo = jnp.sum(lobe * solid[None], axis=1)
        every = jnp.sum(albedo)
        shape = total / every  # of unit integral
        mean = jnp.sum((shape * solid)[:, None] * towards, axis=0)
        z = mean / jnp.sqrt(jnp.sum(mean * mean))
        frame = jnp.stack(
            [jnp.stack([z[2], 0 * z[0], -z[0]]), jnp.eye(3, dtype=dtype)[1], z], axis=1
        )

        def apart(free, power):
            return jnp.sum(
                jnp.abs(shape - _cosine(free, frame, towards)) ** power * solid
            )

        # Of the size of one: the integral of a lobe's cube grows as its solid angle falls.
        unit = jnp.sum(shape**3 * solid)
        found = optx.minimise(
            lambda free, _: apart(free, 3) / unit,
            optx.BFGS(rtol=1e-6, atol=1e-8),
            start,
            max_steps=_STEPS,
            throw=False,
        ).value
        inverse = jnp.linalg.inv(_matrix(found, frame))
        inverse = inverse / inverse[1, 1]  # no scale: only directions count
        return found, (inverse, albedo, apart(found, 1))

    start = jnp.asarray([jnp.log(0.5), jnp.log(0.5), 0.0], dtype)
    _, rows = jax.lax.scan(step, start, jnp.asarray(cosines, dtype))
    return LtcTable(*rows)


def _lobe(brdf: Brdf, cosine: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Directions over the hemisphere, solid angles, and the transfer function there."""
    dtype = cosine.dtype
    sine = jnp.sqrt(jnp.maximum(1 - cosine**2, 0))
    x, y, z = jnp.eye(3, dtype=dtype)
    horizon = Rims(0 * z[None], x[None], y[None], *whole_turn(dtype))
    centre = jnp.stack([-sine, 0 * sine, cosine])
    towards, solid = nodes_about(Outline(no_edges(dtype), horizon, z), centre, _NODES)
    view = Local(*(jnp.broadcast_to(a, solid.shape) for a in (sine, 0 * sine, cosine)))
    light = Local(*(towards[:, k] for k in range(3)))
    return towards, solid, transfer_local(brdf, light, view)


def _matrix(free: jax.Array, frame: jax.Array) -> jax.Array:
    a, b, c = jnp.exp(free[0]), jnp.exp(free[1]), free[2]
    zero, one = jnp.zeros_like(a), jnp.ones_like(a)
    rows = [[a, zero, c], [zero, b, zero], [zero, zero, one]]
    return matmul(frame, jnp.stack([jnp.stack(row) for row in rows]))


def _cosine(free: jax.Array, frame: jax.Array, towards: jax.Array) -> jax.Array:
    """Linearly transformed cosine of unit integral, at directions ``(N, 3)``."""
    local = matmul(towards, frame)  # its inverse is its transpose
    a, b, c = jnp.exp(free[0]), jnp.exp(free[1]), free[2]
    x, y, z = (local[:, 0] - c * local[:, 2]) / a, local[:, 1] / b, local[:, 2]
    squared = x * x + y * y + z * z
    return jnp.maximum(z, 0) / (np.pi * squared**2 * a * b)
