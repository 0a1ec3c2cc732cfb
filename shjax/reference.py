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
    check_samples,
    check_vectors,
    in_blocks,
)
from shjax.harmonics.grid import Grid
from shjax.irradiance import irradiance
from shjax.sphere import fibonacci_directions, latlong_directions

LUMINANCE = (0.2126, 0.7152, 0.0722)  # Rec. 709


def reference_irradiance(
    radiance: Float[Array, "n_theta n_phi C"], normals: Float[Array, "*points 3"]
) -> Float[jax.Array, "*points C"]:
    """The integral over every pixel of a lat-long panorama, the truth for errors.

    Args:
        radiance: Panorama as it is stored.
        normals: Unit normals.

    Returns:
        ``(*points, C)``, W m^-2.

    Raises:
        ValueError: If a shape is wrong.
    """
    return reference_irradiance_samples(*panorama_samples(radiance), normals)


def panorama_samples(radiance: Array) -> tuple[Array, np.ndarray, np.ndarray]:
    """Samples ``(N, C)``, directions and solid angles of a lat-long panorama.

    Raises:
        ValueError: If it does not have shape ``(n_theta, n_phi, C)``.
    """
    check_channels("radiance", radiance, "n_theta, n_phi, C", 3)
    if radiance.ndim != 3:
        raise ValueError(
            f"radiance must have shape (n_theta, n_phi, C); got {radiance.shape}."
        )
    n_theta, n_phi, channels = radiance.shape
    directions = latlong_directions(n_theta, n_phi).reshape(-1, 3)
    weights = np.repeat(Grid(n_theta, n_phi).weights, n_phi)
    return radiance.reshape(-1, channels), directions, weights


@functools.partial(jax.jit, static_argnames=("tile", "block"))
def reference_irradiance_samples(
    radiance: Float[Array, "N C"],
    directions: Float[Array, "N 3"],
    weights: Float[Array, " N"],
    normals: Float[Array, "*points 3"],
    *,
    tile: int = 512,
    block: int = 1024,
) -> Float[jax.Array, "*points C"]:
    """The integral ``sum_n w_n L_n max(n.d_n, 0)`` over samples at any directions.

    Works on tiles of normals by blocks of samples, so the cosines of one tile and block
    are all that is stored beside the input.

    Args:
        radiance: Samples.
        directions: Their unit vectors.
        weights: Their solid angles, steradians.
        normals: Unit normals.
        tile: Normals at a time. Static.
        block: Samples at a time. Static.

    Returns:
        ``(*points, C)``, W m^-2.

    Raises:
        ValueError: If a shape is wrong.
    """
    check_samples(radiance, directions, weights)
    check_vectors("normals", normals)
    radiance = as_float("radiance", radiance)
    dtype, channels = radiance.dtype, radiance.shape[-1]
    normals = as_float("normals", normals).astype(dtype)
    flux = radiance * jnp.asarray(weights, dtype)[:, None]
    blocks = (
        in_blocks(jnp.asarray(directions, dtype), block),
        in_blocks(flux, block),
    )
    matmul = functools.partial(jnp.matmul, precision=jax.lax.Precision.HIGHEST)

    @jax.checkpoint  # the gradient recomputes the cosines, and stays small
    def add_block(total, directions_and_flux, some_normals):
        towards, light = directions_and_flux
        cosines = jnp.maximum(matmul(some_normals, towards.T), 0)
        return total + matmul(cosines, light), None

    def one_tile(some_normals):
        start = jnp.zeros((some_normals.shape[0], channels), dtype)
        step = functools.partial(add_block, some_normals=some_normals)
        return jax.lax.scan(step, start, blocks)[0]

    points = normals.reshape(-1, 3)
    tiles = in_blocks(points, min(tile, max(points.shape[0], 1)))
    values = jax.lax.map(one_tile, tiles).reshape(-1, channels)[: points.shape[0]]
    return values.reshape(*normals.shape[:-1], channels)


def luminance(values: Float[Array, "*batch C"]) -> Float[jax.Array, "*batch"]:
    """Rec. 709 luminance of RGB, or the mean of any other number of channels."""
    channels = values.shape[-1]
    weights = LUMINANCE if channels == 3 else (1 / channels,) * channels
    return jnp.matmul(
        values, jnp.asarray(weights, values.dtype), precision=jax.lax.Precision.HIGHEST
    )


@jax.jit
def irradiance_error(
    lighting: Float[Array, "K C"],
    radiance: Float[Array, "N C"],
    directions: Float[Array, "N 3"],
    weights: Float[Array, " N"],
) -> dict[str, Float[Array, ""]]:
    """Error of the irradiance from coefficients against the integral [RH01, section 3.1].

    ``|E_coefs - E| / int L dw`` in luminance over 4000 uniform normals: the paper's "error
    as a fraction of the total intensity of the illumination".

    Args:
        lighting: Radiance coefficients of the same light.
        radiance: The light's pixels.
        directions: Their unit vectors.
        weights: Their solid angles, steradians.

    Returns:
        ``mean`` and ``max`` of the error (fractions), and ``ringing``: the smallest value
        of the coefficients' irradiance over its mean, negative where the map rings.

    Raises:
        ValueError: If a shape is wrong.
    """
    check_samples(radiance, directions, weights)
    radiance = as_float("radiance", radiance)
    dtype = radiance.dtype
    check_channels("lighting", lighting, "K, C", 2, batch=False)
    lighting = as_float("lighting", lighting).astype(dtype)
    normals = jnp.asarray(fibonacci_directions(4000), dtype)
    exact = reference_irradiance_samples(radiance, directions, weights, normals)
    expansion = luminance(irradiance(lighting, normals))
    total = jnp.sum(luminance(radiance) * jnp.asarray(weights, dtype))
    # Black light has no error: 0 / 1, not 0 / 0.
    total = jnp.where(total == 0, 1, jnp.abs(total))
    error = jnp.abs(expansion - luminance(exact)) / total
    mean = jnp.mean(expansion)
    ringing = jnp.min(expansion) / jnp.where(mean == 0, 1, mean)
    return {"mean": jnp.mean(error), "max": jnp.max(error), "ringing": ringing}
