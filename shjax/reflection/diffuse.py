"""Diffuse reflection: reflected radiance as coefficients about the normal."""

from __future__ import annotations

import dataclasses
import math

import jax
import jax.numpy as jnp
from jaxtyping import Float

from shjax.arrays import (
    Array,
)
from shjax.brdf.core import Brdf
from shjax.brdf.models import lambertian as lambertian_brdf
from shjax.clamped_cosine import irradiance_coefs
from shjax.harmonics import evaluate
from shjax.light import Light
from shjax.reference.random_orientations import (
    MeasuredError,
)
from shjax.reflection.reflector import check_against_integral


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True, repr=False)
class DiffuseReflection:
    """Diffuse reflection: radiance as coefficients about the normal, alike in every view.

    A reflector and a pytree. Made by :func:`shjax.reflection.lambertian`, and a part of
    what :func:`shjax.choose_model` returns.

    Attributes:
        coefs: Reflected radiance over the normal, ``(..., K, C)``.
        lighting: Radiance coefficients that it was made from, ``(..., K, C)``.
        brdf: What it was made for.
    """

    coefs: Float[Array, "*batch J C"]
    lighting: Float[Array, "*lights K D"]
    brdf: Brdf

    def __repr__(self) -> str:
        """Description in one line."""
        return f"DiffuseReflection: {self.message}"

    @property
    def predicted_rms_error(self) -> float:
        """NaN: unknown, since what the light holds beyond its coefficients is."""
        return math.nan

    @property
    def bytes(self) -> int:
        """Memory of the coefficients."""
        return self.coefs.nbytes

    @property
    def message(self) -> str:
        """Description in words."""
        return f"{self.coefs.shape[-2]} coefficients over the normal"

    def radiance(
        self,
        normals: Float[Array, "*points 3"],
        views: Float[Array, "*points 3"] | None = None,
        *,
        tangents: Float[Array, "*points 3"] | None = None,
    ) -> Float[jax.Array, "*points C"]:
        """Reflected radiance at unit normals, ``(*batch, *points, C)``.

        Args:
            normals: Unit normals.
            views: Not used: the radiance is the same in every view.
            tangents: Not used.

        Raises:
            ValueError: If a shape is wrong.
        """
        del views, tangents
        return evaluate(self.coefs, normals)

    def check(
        self, light: Light | None = None, *, n: int = 2048, seed: int = 0
    ) -> MeasuredError:
        """Measure the rms error against the integral at random orientations.

        Args:
            light: An environment map or a panorama; default that of the coefficients.
            n: How many orientations.
            seed: Of their random numbers.
        """
        return check_against_integral(
            self, self.brdf, light, self.lighting, n=n, seed=seed
        )


def lambertian(
    lighting: Float[Array, "*batch K C"], *, albedo: float | Array = 1.0
) -> DiffuseReflection:
    """Lambertian reflection of a light: radiance ``albedo / pi E(n)``, a reflector.

    Args:
        lighting: Radiance coefficients.
        albedo: Diffuse albedo, a number or one per channel.

    Raises:
        ValueError: If a shape is wrong or the albedo outside [0, 1].
    """
    coefs = irradiance_coefs(lighting)
    brdf = lambertian_brdf(albedo)
    scale = jnp.asarray(brdf.parts[0].parameters["albedo"], coefs.dtype) / math.pi
    shape = jnp.broadcast_shapes(coefs.shape, scale.shape)
    scaled = jnp.broadcast_to(coefs, shape) * jnp.broadcast_to(scale, shape)
    return DiffuseReflection(scaled, lighting, brdf)
