"""Measured reflectance: tables over angles, scattered samples, half-difference tables.

References:
    [KvD98] J. Koenderink, A. van Doorn, Phenomenological Description of Bidirectional
    Surface Reflection, JOSA A 15, 1998: reciprocal products of Zernike polynomials.
    [M03] W. Matusik et al., A Data-Driven Reflectance Model, SIGGRAPH 2003: MERL.
    [R98] S. Rusinkiewicz, A New Change of Variables for Efficient BRDF Representation.
"""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Float

from shjax.arrays import Array, safe_sqrt
from shjax.brdf.core import Brdf, Local, Parameters, ReflectanceModel, make_brdf

Grid = tuple[tuple[jax.Array, jax.Array], ...]


def _polar(direction: Local) -> jax.Array:
    """Angle to the normal; finite derivative at 0."""
    squared = direction.x**2 + direction.y**2
    nonzero = squared > 0
    return jnp.arctan2(safe_sqrt(squared), jnp.where(nonzero, direction.z, 1))


def _difference(light: Local, view: Local) -> jax.Array:
    """Angle in [0, pi] between the tangential parts; 0 where one has none."""
    dot = light.x * view.x + light.y * view.y
    cross = jnp.abs(light.x * view.y - light.y * view.x)
    defined = (dot != 0) | (cross != 0)
    angle = jnp.arctan2(jnp.where(defined, cross, 0), jnp.where(defined, dot, 1))
    return jnp.where(defined, angle, 0)


def interpolate(table: jax.Array, places: tuple[jax.Array, ...]) -> jax.Array:
    """Read a table multilinearly at fractional indices, clamped to its edges."""
    shape = places[0].shape
    corners: list[tuple[jax.Array, jax.Array]] = [
        (jnp.zeros(shape, jnp.int32), jnp.ones(shape, table.dtype))
    ]
    for size, place in zip(table.shape, places, strict=True):
        place = jnp.clip(place, 0, size - 1)
        low = jnp.clip(jnp.floor(place).astype(jnp.int32), 0, max(size - 2, 0))
        rest = place - low.astype(place.dtype)
        high = jnp.minimum(low + 1, size - 1)
        corners = [
            (flat * size + index, weight * share)
            for flat, weight in corners
            for index, share in ((low, 1 - rest), (high, rest))
        ]
    values = table.reshape(-1)
    return sum(
        (weight * jnp.take(values, flat) for flat, weight in corners),
        start=jnp.zeros(shape, table.dtype),
    )


def _place(nodes: jax.Array, values: jax.Array) -> jax.Array:
    """Fractional index of values among rising nodes."""
    index = jnp.searchsorted(nodes, values, side="right") - 1
    index = jnp.clip(index, 0, max(nodes.shape[0] - 2, 0))
    if nodes.shape[0] == 1:
        return jnp.zeros_like(values)
    low, high = jnp.take(nodes, index), jnp.take(nodes, index + 1)
    return index.astype(values.dtype) + (values - low) / (high - low)


def _table(parameters: Parameters, light: Local, view: Local) -> jax.Array:
    shape = jnp.broadcast_shapes(light.z.shape, view.z.shape)
    angles = (_polar(light), _polar(view), _difference(light, view))
    places = tuple(
        jnp.broadcast_to(_place(parameters[name], angle), shape)
        for name, angle in zip(("theta_i", "theta_o", "phi"), angles, strict=True)
    )
    return interpolate(parameters["table"], places) * light.z


TABLE = ReflectanceModel("table", _table)


def from_table(
    table: Float[Array, "I O J C"],
    *,
    theta_i: Float[Array, " I"] | None = None,
    theta_o: Float[Array, " O"] | None = None,
    phi: Float[Array, " J"] | None = None,
) -> Brdf:
    """Tabulated BRDF over the angles of light and view to the normal and between them.

    Read multilinearly, held constant beyond the outermost nodes, times the cosine.

    Args:
        table: BRDF values, sr^-1, ``(n_theta_i, n_theta_o, n_phi, C)``.
        theta_i: Rising angles of the light; default even from 0 to pi/2.
        theta_o: Rising angles of the view; the same default.
        phi: Rising differences of azimuth in [0, pi], 0 where light and view are on the
            same side; default even from 0 to pi.

    Raises:
        ValueError: If the table is malformed: wrong shape, empty, not finite, nodes that
            do not rise or do not fit. Negative or non-reciprocal values are reported by
            :func:`check`.
    """
    if table.ndim != 4 or 0 in table.shape:
        raise ValueError(
            f"table must have shape (n_theta_i, n_theta_o, n_phi, C); got {table.shape}."
        )
    _check_finite("table", table)
    limits = (math.pi / 2, math.pi / 2, math.pi)
    given, nodes = (theta_i, theta_o, phi), {}
    names = ("theta_i", "theta_o", "phi")
    for axis, (name, values, limit) in enumerate(
        zip(names, given, limits, strict=True)
    ):
        size = table.shape[axis]
        chosen = np.linspace(0, limit, size) if values is None else np.asarray(values)
        if chosen.shape != (size,) or not np.all(np.diff(chosen) > 0):
            raise ValueError(
                f"{name} must hold {size} rising angles, one for each row of the table; "
                f"got shape {chosen.shape}."
            )
        if not -1e-6 <= chosen[0] <= chosen[-1] <= limit + 1e-6:
            raise ValueError(
                f"{name} must lie in [0, {limit:.4f}]; got {chosen[0]:g} to {chosen[-1]:g}."
            )
        nodes[name] = jnp.asarray(chosen[:, None], jnp.asarray(table).dtype)
    return make_brdf(TABLE, table=table, **nodes)


def _check_finite(name: str, values) -> None:
    if isinstance(values, Tracer):
        return
    bad = int(np.sum(~np.isfinite(np.asarray(values))))
    if bad:
        raise ValueError(f"{name} must be finite; {bad} values are not.")


def _half_difference(light: Local, view: Local):
    """theta_h, theta_d and phi_d in [0, pi] [R98]."""
    x, y, z = light.x + view.x, light.y + view.y, light.z + view.z
    across = jnp.sqrt(jnp.maximum(x * x + y * y, 1e-30))
    length = jnp.sqrt(jnp.maximum(x * x + y * y + z * z, 1e-30))
    theta_h = jnp.arctan2(across, z)
    d_x, d_y, d_z = light.x - view.x, light.y - view.y, light.z - view.z
    half = jnp.sqrt(jnp.maximum(d_x * d_x + d_y * d_y + d_z * d_z, 1e-30))
    theta_d = jnp.arctan2(half, length)
    # (l - v) / 2 is across h; its angle from the plane of n and h.
    side = x * d_y - y * d_x  # along n x h, times |h_xy|
    along = (across * across * d_z - z * (x * d_x + y * d_y)) / length
    phi_d = jnp.arctan2(side, -along)
    return theta_h, theta_d, jnp.mod(phi_d, math.pi)


def _merl(parameters: Parameters, light: Local, view: Local) -> jax.Array:
    table = parameters["table"]
    above = (light.z > 0) & (view.z > 0)
    light, view = (Local(d.x, d.y, jnp.where(above, d.z, 1)) for d in (light, view))
    theta_h, theta_d, phi_d = _half_difference(light, view)
    n_h, n_d, n_phi = table.shape
    # Bin k holds its lower edge's angle; theta_h is stored at its square root.
    place_h = jnp.sqrt(theta_h / (math.pi / 2)) * n_h
    place_d = theta_d / (math.pi / 2) * n_d
    place_phi = phi_d / math.pi * n_phi
    # phi_d = pi is phi_d = 0 by reciprocity: the table goes on with its first row.
    ring = jnp.concatenate([table, table[:, :, :1]], axis=2)
    value = interpolate(ring, (place_h, place_d, place_phi))
    return jnp.where(above, value * light.z, 0)


MERL = ReflectanceModel("merl", _merl)
