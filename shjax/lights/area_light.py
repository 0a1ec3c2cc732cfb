"""What every area light gives to one point, from the outline that the point sees."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from shjax.arrays import Array
from shjax.lights import horizons, outlines
from shjax.lights.lobe_polar import nodes_about
from shjax.lights.outlines import Outline, dot


class AreaLight:
    """Area light of constant radiance; made by :func:`shjax.lights.polygon` and others.

    A subclass says what outline a point sees. All methods take one point ``(3,)`` and give
    what unit radiance does; :mod:`shjax.lights.area` calls them for many.

    Attributes:
        radiance: ``(C,)``.
    """

    radiance: Array

    def seen(self, point: jax.Array) -> tuple[jax.Array, Outline]:
        """Test whether the light shines on a point, 1 or 0, and give its outline there."""
        raise NotImplementedError

    def above(self, point: jax.Array, normal: jax.Array) -> tuple[jax.Array, Outline]:
        """Test whether the light shines on a point; its outline above the horizon there."""
        lit, outline = self.seen(point)
        return lit, horizons.above(outline, normal)

    def transformed(self, matrix: jax.Array, point: jax.Array) -> AreaLight:
        """Apply a matrix to the light about a point, which becomes the origin.

        Raises:
            ValueError: If such a light does not stay of its kind.
        """
        raise ValueError(
            f"light must not be a {type(self).__name__}, which no matrix transforms."
        )

    def coefs(self, point: jax.Array, l_max: int) -> jax.Array:
        """Lighting coefficients, ``(K,)``."""
        lit, outline = self.seen(point)
        return lit * outlines.coefs(outline, l_max)

    def zonal_moments(self, point: jax.Array, axis: jax.Array, l_max: int) -> jax.Array:
        """Integrals of the Legendre polynomials about an axis, ``(L,)``."""
        lit, outline = self.seen(point)
        return lit * outlines.zonal_moments(outline, axis, l_max)

    def vector_irradiance(self, point: jax.Array) -> jax.Array:
        """Vector irradiance, ``(3,)``."""
        lit, outline = self.seen(point)
        return lit * outlines.vector_irradiance(outline)

    def irradiance(self, point: jax.Array, normal: jax.Array) -> jax.Array:
        """Irradiance of what is above the horizon, ``()``."""
        lit, outline = self.above(point, normal)
        return lit * dot(normal, outlines.vector_irradiance(outline))

    def lobe_nodes(
        self,
        point: jax.Array,
        normal: jax.Array,
        lobe: jax.Array,
        count: int,
        horizon: bool,
    ) -> tuple[jax.Array, jax.Array]:
        """Directions over the light, dense about a lobe, and their solid angles."""
        if horizon:
            lit, outline = self.above(point, normal)
            towards, solid = nodes_about(outline, lobe, count)
            return towards, lit * solid
        # Both halves about their own poles: near the opposite one azimuths jump.
        parts = []
        for pole in (lobe, -lobe):
            lit, outline = self.above(point, pole)
            towards, solid = nodes_about(outline, pole, count)
            parts.append((towards, lit * solid))
        towards, solid = (jnp.concatenate(a) for a in zip(*parts, strict=True))
        return towards, solid
