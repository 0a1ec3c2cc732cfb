"""The irradiance integral itself, over every pixel of the light: the truth for errors.

References:
    [RH01] R. Ramamoorthi and P. Hanrahan, An Efficient Representation for Irradiance
    Environment Maps, SIGGRAPH 2001.
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import (
    Array,
    as_float,
    check_channels,
    check_vectors,
    in_blocks,
    map_blocks,
    matmul,
)
from shjax.clamped_cosine import irradiance
from shjax.colour import luminance
from shjax.light import Light, light_samples
from shjax.sphere import fibonacci_directions

_TILE, _BLOCK = 512, 1024


def reference_irradiance(
    light: Light, normals: Float[Array, "*points 3"]
) -> Float[jax.Array, "*points C"]:
    """Irradiance by brute-force integration: ``sum_n w_n L_n max(n.d_n, 0)``.

    Over every pixel or sample of the light, the truth for the error of nine coefficients.

    Args:
        light: An environment map of any layout, or a lat-long panorama as it is stored.
        normals: Unit normals.

    Returns:
        ``(*points, C)``, W m^-2, in the light's type.

    Raises:
        ValueError: If a shape is wrong.
    """
    check_vectors("normals", normals)
    return _integrate(*light_samples(light), normals)


@jax.jit
def _integrate(radiance, light_directions, weights, normals) -> jax.Array:
    """In tiles of normals by blocks of samples: one tile and block of cosines is stored."""
    radiance = as_float("light", radiance)
    dtype, channels = radiance.dtype, radiance.shape[-1]
    normals = as_float("normals", normals).astype(dtype)
    flux = radiance * jnp.asarray(weights, dtype)[:, None]
    towards = jnp.asarray(light_directions, dtype)
    blocks = (in_blocks(towards, _BLOCK), in_blocks(flux, _BLOCK))

    @jax.checkpoint  # the gradient recomputes the cosines, and stays small
    def add_block(total, block, some_normals):
        directions, light = block
        cosines = jnp.maximum(matmul(some_normals, directions.T), 0)
        return total + matmul(cosines, light), None

    def one_tile(some_normals):
        start = jnp.zeros((some_normals.shape[0], channels), dtype)
        step = functools.partial(add_block, some_normals=some_normals)
        return jax.lax.scan(step, start, blocks)[0]

    values = map_blocks(one_tile, normals.reshape(-1, 3), _TILE)
    return values.reshape(*normals.shape[:-1], channels)


def irradiance_error(
    lighting: Float[Array, "K C"], light: Light
) -> dict[str, Float[Array, ""]]:
    """Error of the irradiance from coefficients against the integral [RH01, section 3.1].

    ``|E_coefs - E| / int L dw`` in luminance over 4000 uniform normals: the paper's "error
    as a fraction of the total intensity of the illumination".

    Args:
        lighting: Radiance coefficients of the same light.
        light: The light itself: an environment map, or a lat-long panorama.

    Returns:
        ``mean`` and ``max`` of the error (fractions), and ``ringing``: the smallest value
        of the coefficients' irradiance over its mean, negative where the map rings.

    Raises:
        ValueError: If a shape is wrong.
    """
    check_channels("lighting", lighting, "K, C", 2, batch=False)
    return _irradiance_error(lighting, *light_samples(light))


@jax.jit
def _irradiance_error(lighting, radiance, light_directions, weights):
    radiance = as_float("light", radiance)
    dtype = radiance.dtype
    lighting = as_float("lighting", lighting).astype(dtype)
    normals = jnp.asarray(fibonacci_directions(4000), dtype)
    exact = _integrate(radiance, light_directions, weights, normals)
    total = jnp.sum(luminance(radiance) * jnp.asarray(weights, dtype))
    return compare_irradiance(
        luminance(irradiance(lighting, normals)), luminance(exact), total
    )


def compare_irradiance(expansion, exact, total) -> dict:
    """Mean and largest error of irradiance over the total radiance, and the ringing.

    Args:
        expansion: Irradiance from coefficients, luminance at some normals, ``(N,)``.
        exact: By the integral; arrays of JAX or of NumPy.
        total: Radiance over the sphere, ``int L dw``.
    """
    mean = expansion.mean()
    tiny = float(np.finfo(expansion.dtype).tiny)  # black light has no error: 0 / tiny
    error = abs(expansion - exact) / (abs(total) + tiny)
    ringing = expansion.min() * mean / (mean * mean + tiny)
    return {"mean": error.mean(), "max": error.max(), "ringing": ringing}
