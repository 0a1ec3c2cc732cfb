"""What area lights give at points: coefficients, vector irradiance, irradiance.

Exact for constant radiance, by the outline that each point sees (:mod:`.outlines`), and
differentiable in points, vertices and radiance.

References:
    [RTR] T. Akenine-Moller et al., Real-Time Rendering, 4th ed., CRC Press, 2018,
    chapter 10.
    [S96] J. Snyder, Area Light Sources for Real-Time Graphics, Microsoft Research
    MSR-TR-96-11, 1996.
    [WR18] J. Wang and R. Ramamoorthi, Analytic Spherical Harmonic Coefficients for
    Polygonal Area Lights, ACM TOG 37 (4), 2018.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import (
    Array,
    as_float,
    check_vectors,
    common_channels,
    map_blocks,
)
from shjax.harmonics.degrees import check_l_max
from shjax.lights import polygon_moments
from shjax.lights.area_light import AreaLight
from shjax.lights.flat_lights import PolygonLight

METHODS = ("auto", "boundary", "recurrence")
_AT_ONCE = 2**22  # numbers of the largest temporary of a block of points


def area_coefs(
    light: AreaLight | Sequence[AreaLight],
    points: Float[Array, "*points 3"],
    *,
    l_max: int,
    method: str = "auto",
) -> Float[jax.Array, "*points K C"]:
    """Lighting coefficients of area lights as points see them.

    Nothing is sampled: integrals over the outline, for polygons up to degree 16 by a
    recurrence over the edges [WR18]. Add them to a panorama's for a moving light in a
    fixed surrounding. Below one degree across, float32 keeps four to five digits.

    Args:
        light: One light, or several, which add up.
        points: Shading points, in the lights' units.
        l_max: Highest degree, inclusive. Static.
        method: ``boundary``, ``recurrence`` (polygons only) or ``auto``. Static.

    Raises:
        ValueError: If a shape is wrong, the method unknown, or the recurrence asked for
            another light than a polygon.
    """
    l_max = check_l_max(l_max)
    if method not in METHODS:
        raise ValueError(f"method must be one of {', '.join(METHODS)}; got {method!r}.")
    lights = as_lights(light)
    if method == "recurrence" and not all(isinstance(a, PolygonLight) for a in lights):
        raise ValueError(
            "method must be boundary or auto: the recurrence is of polygons."
        )
    numbers = (l_max + 1) ** 2 * (2 * l_max + 16)
    return _at_points(CoefsOf(l_max, method), lights, {"points": points}, numbers)


@dataclasses.dataclass(frozen=True)
class CoefsOf:
    """Coefficients of a light of unit radiance at one point, up to a degree. Static."""

    l_max: int
    method: str = "auto"

    def __call__(self, light: AreaLight, point: jax.Array) -> jax.Array:
        """Coefficients, ``(K,)``."""
        few = self.method == "auto" and self.l_max <= polygon_moments.MAX_DEGREE
        if isinstance(light, PolygonLight) and (few or self.method == "recurrence"):
            return light.coefs_by_recurrence(point, self.l_max)
        return light.coefs(point, self.l_max)


def vector_irradiance(
    light: AreaLight | Sequence[AreaLight], points: Float[Array, "*points 3"]
) -> Float[jax.Array, "*points 3 C"]:
    """Vector irradiance, or net flux, of area lights [RTR, Eq. 10.4].

    Its product with a normal is the irradiance where all light is above the horizon.

    Args:
        light: One light, or several, which add up.
        points: Shading points.

    Raises:
        ValueError: If a shape is wrong.
    """
    return _at_points(_vector, as_lights(light), {"points": points}, 512)


def _vector(light: AreaLight, point: jax.Array) -> jax.Array:
    return light.vector_irradiance(point)


def area_irradiance(
    light: AreaLight | Sequence[AreaLight],
    points: Float[Array, "*points 3"],
    normals: Float[Array, "*points 3"],
) -> Float[jax.Array, "*points C"]:
    """Irradiance of area lights, exact, with what is below the horizon cut off.

    Polygons by Lambert's sum over the clipped edges [RTR, Eq. 10.7], spheres in closed
    form [S96], disks in closed form above the horizon, all else by one-dimensional
    quadrature along the outline.

    Args:
        light: One light, or several, which add up.
        points: Shading points.
        normals: Unit normals.

    Raises:
        ValueError: If a shape is wrong.
    """
    given = {"points": points, "normals": normals}
    return _at_points(_irradiance, as_lights(light), given, 1024)


def _irradiance(light: AreaLight, point: jax.Array, normal: jax.Array) -> jax.Array:
    return light.irradiance(point, normal)


def as_lights(light: AreaLight | Sequence[AreaLight]) -> tuple[AreaLight, ...]:
    """Area lights as a tuple.

    Raises:
        ValueError: If there is anything else.
    """
    lights = tuple(light) if isinstance(light, Sequence) else (light,)
    for one in lights:
        if not isinstance(one, AreaLight):
            raise ValueError(
                "light must be an area light (shjax.lights.polygon, disk, sphere, "
                f"capsule, line) or several; got {type(one).__name__}."
            )
    if not lights:
        raise ValueError("light must hold at least one area light.")
    return lights


def check_points(points: dict[str, Any]) -> list[jax.Array]:
    """Vectors of one shape and type.

    Raises:
        ValueError: If they are not.
    """
    first = next(iter(points))
    for name, vectors in points.items():
        check_vectors(name, vectors)
        if vectors.shape != points[first].shape:
            raise ValueError(
                f"{name} must have the shape of {first} {points[first].shape}; got "
                f"{vectors.shape}."
            )
    arrays = [as_float(name, vectors) for name, vectors in points.items()]
    dtype = np.result_type(*(a.dtype for a in arrays))
    return [a.astype(dtype) for a in arrays]


def _at_points(
    what: Callable[..., jax.Array],
    lights: tuple[AreaLight, ...],
    vectors: dict[str, Any],
    numbers: int,
) -> jax.Array:
    """What lights give at points, in blocks of points of so many numbers each."""
    arrays = check_points(vectors)
    shape, flat = arrays[0].shape[:-1], [a.reshape(-1, 3) for a in arrays]
    found = _summed(what, lights, flat, size=max(_AT_ONCE // numbers, 16))
    return found.reshape(*shape, *found.shape[1:])


@functools.partial(jax.jit, static_argnames=("what", "size"))
def _summed(what, lights, flat, *, size: int) -> jax.Array:
    dtype, total = flat[0].dtype, None
    for light in lights:
        one = jax.vmap(functools.partial(what, light))
        pattern = map_blocks(lambda some, one=one: one(*some), flat, size)[..., None]
        radiance = jnp.asarray(light.radiance, dtype)
        shape = (*pattern.shape[:-1], radiance.shape[0])
        value = jnp.broadcast_to(pattern, shape) * radiance.reshape(
            *(1,) * (len(shape) - 1), -1
        )
        total = value if total is None else add_channels(total, value)
    assert total is not None  # there is at least one light
    return total


def add_channels(a: jax.Array, b: jax.Array) -> jax.Array:
    """Sum of two, of which one may have a single channel for all of the other's."""
    common_channels(a.shape[-1], b.shape[-1], "light")
    shape = jnp.broadcast_shapes(a.shape, b.shape)
    return jnp.broadcast_to(a, shape) + jnp.broadcast_to(b, shape)
