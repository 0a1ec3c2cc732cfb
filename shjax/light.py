"""A light as functions take it: an environment map, or a lat-long panorama array."""

from __future__ import annotations

import math
from typing import TypeAlias

from jaxtyping import Float

from shjax.arrays import Array, check_channels, shape_of
from shjax.envmap import EnvironmentMap, make_envmap, panorama_samples

Light: TypeAlias = EnvironmentMap | Float[Array, "n_theta n_phi C"]


def light_samples(light: Light) -> tuple[Array, Array, Array]:
    """Samples of a light given as an environment map or as a lat-long panorama array.

    Args:
        light: The light.

    Raises:
        ValueError: If it is neither.
    """
    if isinstance(light, EnvironmentMap):
        return light.samples()
    check_channels("light", light, "n_theta, n_phi, C", 3, batch=False)
    return panorama_samples(light)


def as_light(
    light_or_lighting: Light | Float[Array, "*lights K C"],
) -> EnvironmentMap | Array:
    """Environment map of a light, or radiance coefficients as they are.

    An array ``(n, 2 n, C)`` of at least 16 rows is a panorama, and so is one of three axes
    whose second is no square number; other arrays are coefficients.
    """
    if isinstance(light_or_lighting, EnvironmentMap):
        return light_or_lighting
    shape = shape_of("light_or_lighting", light_or_lighting)
    if len(shape) == 3:
        twice = shape[1] == 2 * shape[0] and shape[0] >= 16
        if twice or math.isqrt(shape[1]) ** 2 != shape[1]:
            return make_envmap(light_or_lighting, layout="latlong")
    return light_or_lighting


def as_panorama(light: Light, n_theta: int | None = None) -> Array:
    """Lat-long panorama array of a light, resampled where it is larger or not lat-long.

    Args:
        light: The light.
        n_theta: Most rows, or None; of a map of another layout, default 512.
    """
    if not isinstance(light, EnvironmentMap):
        check_channels("light", light, "n_theta, n_phi, C", 3, batch=False)
        light = make_envmap(light, layout="latlong")
    small = n_theta is None or len(light.image) <= n_theta
    if light.layout == "latlong" and small:
        return light.radiance
    return light.to_latlong(n_theta or 512).radiance
