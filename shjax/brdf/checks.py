"""Is a BRDF physical? A report, never a refusal.

The thesis's own transfer functions return more than they receive at grazing views and are
not reciprocal, and measured tables have negative values; they serve all the same.
"""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array
from shjax.brdf.core import Brdf, Local, prepared, transfer_local
from shjax.brdf.quadrature import Resolution, kind_of, moments_at

_VIEWS = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 85.0)  # degrees from the normal


@dataclasses.dataclass(frozen=True)
class Check:
    """Physical plausibility of a BRDF, as :func:`check` found it.

    Attributes:
        views: Angles of the view to the normal (to the tangent, for fibres), degrees.
        albedo: Directional albedo at those views, ``(n, C)``.
        reciprocity: Largest ``|f(l, v) - f(v, l)|`` over the mean f, for each channel;
            f is the transfer function over the cosine of the light.
        negative: Share of the energy that is negative, for each channel.
    """

    views: tuple[float, ...]
    albedo: Float[Array, "n C"]
    reciprocity: Float[Array, " C"]
    negative: Float[Array, " C"]

    @property
    def message(self) -> str:
        """Summary in one line."""
        worst = float(np.max(self.albedo))
        gain = (
            "no view returns more than it receives"
            if worst <= 1 + 1e-3
            else ("some views return more than they receive")
        )
        return (
            f"albedo {float(np.min(self.albedo)):.3f} to {worst:.3f} ({gain}); "
            f"reciprocity off by {float(np.max(self.reciprocity)):.1%}; "
            f"negative energy {float(np.max(self.negative)):.2%}"
        )


def check(brdf: Brdf) -> Check:
    """Check a BRDF's energy conservation, reciprocity and negative values.

    Args:
        brdf: The reflectance; its parameters are concrete (this runs eagerly).

    Returns:
        The report.

    Raises:
        ValueError: If parts about the tangent are mixed with others.
    """
    kind = kind_of(brdf)
    turn = 1 if kind == "tangent" else 2  # about R the view is at twice the angle to n
    theta = tuple(float(np.radians(v)) * turn for v in _VIEWS)
    dtype = brdf.parts[0].weight.dtype
    found = _at_views(brdf, theta, dtype)
    albedo, negative = np.asarray(found.flux), np.asarray(found.negative)
    whole = np.abs(albedo).sum(axis=0) + 2 * negative.sum(axis=0)
    share = negative.sum(axis=0) / np.where(whole == 0, 1, whole)
    return Check(_VIEWS, albedo, np.asarray(_reciprocity(brdf)), share)


@functools.partial(jax.jit, static_argnames=("theta", "dtype"))
def _at_views(brdf: Brdf, theta: tuple[float, ...], dtype):
    return moments_at(brdf, theta, Resolution(96, 96, len(theta)), 0, 0, dtype)


@jax.jit
def _reciprocity(brdf: Brdf) -> jax.Array:
    ready, dtype = prepared(brdf), brdf.parts[0].weight.dtype
    angles = np.radians([5.0, 25.0, 45.0, 65.0, 80.0])
    azimuth = np.radians([0.0, 60.0, 120.0, 180.0])
    i, o, phi = (a.ravel() for a in np.meshgrid(angles, angles, azimuth, indexing="ij"))

    def direction(theta, phi):
        parts = (
            np.sin(theta) * np.cos(phi),
            np.sin(theta) * np.sin(phi),
            np.cos(theta),
        )
        return Local(*(jnp.asarray(part, dtype) for part in parts))

    light, view = direction(i, phi), direction(o, 0 * phi)

    def value(light, view):
        values = transfer_local(ready, light, view)
        return values / jnp.broadcast_to(light.z[None], values.shape)

    one, other = value(light, view), value(view, light)
    mean = jnp.mean(jnp.abs(one), axis=1)
    return jnp.max(jnp.abs(one - other), axis=1) / jnp.where(mean == 0, 1, mean)
