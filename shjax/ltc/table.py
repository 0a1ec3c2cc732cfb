"""Tables of linearly transformed cosines over the view, and shading by them.

References:
    [HDHN16] E. Heitz, J. Dupuy, S. Hill, D. Neubelt, Real-Time Polygonal-Light Shading
    with Linearly Transformed Cosines, ACM TOG 35 (4), 2016.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Float

from shjax.arrays import Array, common_channels, map_blocks, matmul
from shjax.lights.area import add_channels, as_lights, check_points
from shjax.lights.area_light import AreaLight
from shjax.lights.outlines import dot
from shjax.vectors import frames, normalize

_AT_ONCE = 2048  # points


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True, repr=False)
class LtcTable:
    """Linearly transformed cosines of one isotropic BRDF. Made by :func:`shjax.ltc.fit`.

    The views stand evenly in ``sqrt(1 - cos theta)``; between them all is linear.

    Attributes:
        inverse: Matrices that take directions in the frame of normal and view to the
            cosine's, ``(T, 3, 3)``.
        albedo: Directional albedo, the lobe's integral, ``(T, C)``.
        error: Integral of the absolute difference over that of the lobe, ``(T,)``.
    """

    inverse: Float[Array, "*batch T 3 3"]
    albedo: Float[Array, "*batch T C"]
    error: Float[Array, "*batch T"]

    def __repr__(self) -> str:
        """Its size and error, in one line."""
        if isinstance(self.error, Tracer) or np.ndim(self.error) != 1:
            return f"LtcTable of shape {np.shape(self.error)}"
        mean, worst = float(np.mean(self.error)), float(np.max(self.error))
        return (
            f"LtcTable: {len(self.error)} views, error of the lobe {mean:.1%} in the mean, "
            f"{worst:.1%} at most"
        )

    def radiance(
        self,
        light: AreaLight | Sequence[AreaLight],
        points: Float[Array, "*points 3"],
        normals: Float[Array, "*points 3"],
        views: Float[Array, "*points 3"],
    ) -> Float[jax.Array, "*points C"]:
        """Reflected radiance of area lights [HDHN16]; a sphere is the disk that it seems.

        Args:
            light: One light, or several, which add up; no capsule, which has no
                transform (a thin one is a line).
            points: Shading points, in the lights' units.
            normals: Unit normals.
            views: Unit vectors to the viewer.

        Raises:
            ValueError: If a shape is wrong or a light is a capsule.
        """
        lights = as_lights(light)
        named = {"points": points, "normals": normals, "views": views}
        arrays = [a.reshape(-1, 3) for a in check_points(named)]
        for one in lights:
            common_channels(one.radiance.shape[-1], self.albedo.shape[-1], "brdf")
        found = _radiance(self, lights, arrays)
        return found.reshape(*points.shape[:-1], found.shape[-1])

    def at(self, cosine: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Matrix ``(3, 3)`` and albedo ``(C,)`` of one view, by its cosine."""
        last = self.inverse.shape[0] - 1
        cosine = jnp.clip(cosine, 0, 1)
        off = cosine < 1  # the root has no derivative there
        place = last * jnp.where(off, jnp.sqrt(jnp.where(off, 1 - cosine, 1)), 0)
        low = jnp.clip(place.astype(jnp.int32), 0, last - 1)
        share = place - low.astype(place.dtype)
        matrix, albedo = (
            jnp.asarray(a, place.dtype)[low] * (1 - share)
            + jnp.asarray(a, place.dtype)[low + 1] * share
            for a in (self.inverse, self.albedo)
        )
        return matrix, albedo


@jax.jit
def _radiance(table: LtcTable, lights, arrays) -> jax.Array:
    dtype = arrays[0].dtype

    def one(point, normal, view):
        cosine = dot(normal, view)
        along = normalize(view - cosine * normal)
        tilted = jnp.any(along != 0)
        along = jnp.where(tilted, along, frames(normal)[0])
        frame = jnp.stack([along, jnp.cross(normal, along), normal])
        inverse, albedo = table.at(cosine)
        origin, up = jnp.zeros(3, dtype), jnp.asarray([0, 0, 1], dtype)
        total = None
        for light in lights:
            moved = light.transformed(matmul(inverse, frame), point)
            radiance = jnp.asarray(light.radiance, dtype)
            value = moved.irradiance(origin, up) / np.pi * radiance
            total = value if total is None else add_channels(total, value)
        assert total is not None  # there is at least one light
        shape = jnp.broadcast_shapes(total.shape, albedo.shape)
        value = jnp.broadcast_to(total, shape) * jnp.broadcast_to(albedo, shape)
        return jnp.where(cosine > 0, value, 0)

    return map_blocks(lambda some: jax.vmap(one)(*some), tuple(arrays), _AT_ONCE)
