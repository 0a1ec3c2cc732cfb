"""Reflectors: everything that reflects light is one kind of object, and its error check."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jaxtyping import Float

from shjax.arrays import Array
from shjax.brdf.core import Brdf
from shjax.envmap import EnvironmentMap
from shjax.harmonics import synthesize
from shjax.harmonics.degrees import degree_of_coefs
from shjax.light import Light, as_panorama
from shjax.reference.random_orientations import (
    MeasuredError,
    draw_orientations,
    measured_error,
)
from shjax.reference.reflection_integral import reference_reflection

CHECK_ROWS = 128  # of the panorama that a reflector is checked against


@runtime_checkable
class Reflector(Protocol):
    """Reflected light field of a material under a distant light, ready to be read.

    A pytree. Implemented by :class:`DiffuseReflection`, :class:`ReflectionMap`,
    :class:`ReflectionModel` and :class:`shjax.ibl.LitMaterial`; what implements it is
    drawn by :func:`shjax.render.image`.
    """

    def radiance(
        self,
        normals: Float[Array, "*points 3"],
        views: Float[Array, "*points 3"],
        *,
        tangents: Float[Array, "*points 3"] | None = None,
    ) -> Float[jax.Array, "*points C"]:
        """Reflected radiance at unit normals, seen along unit vectors to the viewer."""
        ...

    def check(self, light: Any = None) -> MeasuredError:
        """Measure the rms error against the integral at random orientations and views."""
        ...

    @property
    def predicted_rms_error(self) -> Any:
        """Predicted rms error over all orientations and views, relative; NaN: unknown."""
        ...

    @property
    def bytes(self) -> int:
        """Memory that the reflected light field takes."""
        ...

    @property
    def message(self) -> str:
        """Description in one sentence."""
        ...


def check_against_integral(
    reflector: Reflector,
    brdf: Brdf,
    light: Light | None,
    lighting: Float[Array, "K C"],
    *,
    n: int,
    seed: int,
) -> MeasuredError:
    """Measure a reflector's error by brute-force integration.

    Args:
        reflector: What is measured.
        brdf: The reflectance it was made for.
        light: A map, of which one of more than 128 rows is averaged to 128; None: that
            of the coefficients.
        lighting: Radiance coefficients.
        n: How many orientations and views.
        seed: Of their random numbers.
    """
    drawn = draw_orientations(n, seed=seed)
    dtype = lighting.dtype
    normals, views, tangents = (
        jnp.asarray(a, dtype) for a in (drawn.normals, drawn.views, drawn.reflected)
    )
    found = reflector.radiance(normals, views, tangents=tangents)
    panorama = jnp.asarray(_panorama(light, lighting), dtype)
    exact = reference_reflection(panorama, brdf, normals, views, tangents=tangents)
    return measured_error(found, exact, drawn.weights)


def _panorama(light: Light | None, lighting: Float[Array, "K C"]) -> Array:
    if light is None:
        rows = max(2 * degree_of_coefs(lighting) + 2, CHECK_ROWS)
        return synthesize(lighting, n_theta=rows, n_phi=2 * rows)
    return (
        as_panorama(light, CHECK_ROWS) if isinstance(light, EnvironmentMap) else light
    )
