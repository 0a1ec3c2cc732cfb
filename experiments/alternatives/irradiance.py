"""Irradiance by other representations: each a fit to a panorama, and its evaluation.

All take the light as coefficients or as exact irradiance at directions of their own, and
give irradiance ``(..., C)`` at normals; constant light L gives pi L in each.

References:
    [MMG06] Mitchell, McTaggart, Green. Shading in Valve's Source engine: ambient cube.
    [IS17] Iwanicki, Sloan. Ambient dice. EGSR 2017.
    [Geo15] Geomerics. Reconstructing diffuse lighting from spherical harmonic data: the
        non-linear form of degree 1.
    [RSL*24] Roughton, Sloan, et al. ZH3: quadratic zonal harmonics.
    [HW10] Habel, Wimmer. Efficient irradiance normal mapping: the H-basis.
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np

import shjax
from shjax.clamped_cosine import cosine_kernel_table
from shjax.colour import LUMINANCE
from shjax.sphere import cube_directions, fibonacci_directions, icosahedron

HIGHEST = jax.lax.Precision.HIGHEST


def _dot(a, b):
    return jnp.matmul(a, b, precision=HIGHEST)


def _fitted(lighting: jax.Array, towards: np.ndarray, inverse: np.ndarray) -> jax.Array:
    """Least squares to the irradiance of coefficients at directions."""
    exact = shjax.evaluate(
        shjax.irradiance_coefs(lighting), jnp.asarray(towards, lighting.dtype)
    )
    return _dot(jnp.asarray(inverse, lighting.dtype), exact)


@jax.jit
def cube_light(radiance: jax.Array) -> jax.Array:
    """A panorama on a cube of 128 texels a side, averaged to 16: ``(6, 16, 16, C)``.

    The web demo's input: it sums over these texels for each texel of its output.
    """
    rows, columns, channels = radiance.shape
    towards = cube_directions(128).reshape(-1, 3)
    theta = np.arccos(np.clip(towards[:, 2], -1, 1))
    phi = np.arctan2(towards[:, 1], towards[:, 0])
    i = np.clip((theta / np.pi * rows).astype(int), 0, rows - 1)
    j = ((np.pi - phi) / (2 * np.pi) * columns).astype(int) % columns
    texels = radiance.reshape(-1, channels)[i * columns + j]
    blocks = texels.reshape(6, 16, 8, 16, 8, channels)
    return jnp.mean(blocks, axis=(2, 4))


@functools.lru_cache
def _cube_angles(size: int) -> np.ndarray:
    edges = np.linspace(-1, 1, size + 1)
    corner = np.arctan2(
        edges * edges[:, None], np.sqrt(edges**2 + edges[:, None] ** 2 + 1)
    )
    tile = np.diff(np.diff(corner, axis=0), axis=1)
    return np.broadcast_to(tile, (6, size, size)).reshape(-1)


@jax.jit
def cube_irradiance(texels: jax.Array, normals: jax.Array) -> jax.Array:
    """The sum over the cube's texels at each normal."""
    size, channels = texels.shape[1], texels.shape[-1]
    towards = jnp.asarray(cube_directions(size).reshape(-1, 3), texels.dtype)
    flux = (
        texels.reshape(-1, channels)
        * jnp.asarray(_cube_angles(size), texels.dtype)[:, None]
    )
    cosine = jnp.maximum(_dot(normals, towards.T), 0)
    return _dot(cosine, flux)


AXES = np.concatenate([np.eye(3), -np.eye(3)])


@jax.jit
def ambient_cube(colours: jax.Array, normals: jax.Array) -> jax.Array:
    """Six irradiances (+x, +y, +z, -x, ...) weighted by squared components [MMG06]."""
    squared = normals**2
    weights = jnp.concatenate(
        [jnp.where(normals > 0, squared, 0), jnp.where(normals > 0, 0, squared)],
        axis=-1,
    )
    return _dot(weights, colours)


def _dice_weights(normals: jax.Array) -> jax.Array:
    cosine = jnp.maximum(_dot(normals, jnp.asarray(icosahedron().T, normals.dtype)), 0)
    return 0.35 * cosine**2 + 0.25 * cosine**4  # .7 of half cos^2, .3 of 5/6 cos^4


@functools.lru_cache
def _dice_fit(count: int = 2048) -> tuple[np.ndarray, np.ndarray]:
    """Directions, and the pseudo-inverse of the twelve lobes there."""
    towards = fibonacci_directions(count)
    cosine = np.maximum(towards @ icosahedron().T, 0)
    return towards, np.linalg.pinv(0.35 * cosine**2 + 0.25 * cosine**4)


@jax.jit
def ambient_dice_fit(lighting: jax.Array) -> jax.Array:
    """Twelve colours, least squares over the sphere to the irradiance of coefficients."""
    return _fitted(lighting, *_dice_fit())


@jax.jit
def ambient_dice(colours: jax.Array, normals: jax.Array) -> jax.Array:
    """Cosine-squared and -fourth lobes at an icosahedron's vertices [IS17]."""
    return _dot(_dice_weights(normals), colours)


@jax.jit
def geomerics(lighting: jax.Array, normals: jax.Array) -> jax.Array:
    """Degree 1 without negative values: ``R0 (a + (1 - a) (p + 1) q^p)`` [Geo15]."""
    coefs = shjax.irradiance_coefs(lighting[:4])
    mean = jnp.maximum(coefs[0] * np.float32(np.sqrt(1 / (4 * np.pi))), 1e-12)
    # Rows y, z, x of degree 1.
    half = 0.5 * np.float32(np.sqrt(3 / (4 * np.pi))) * coefs[jnp.array([3, 1, 2])]
    length = jnp.sqrt(jnp.sum(half**2, axis=0) + 1e-20)
    ratio = jnp.minimum(length / mean, 1)
    q = 0.5 * (1 + _dot(normals, half / length[None]))
    p = 1 + 2 * ratio
    a = (1 - ratio) / (1 + ratio)
    mean, a, p = (part[None] for part in (mean, a, p))
    return mean * (a + (1 - a) * (p + 1) * jnp.maximum(q, 0) ** p)


@jax.jit
def zh3(lighting: jax.Array, normals: jax.Array) -> jax.Array:
    """Degree 1, and of degree 2 the part zonal about degree 1's axis [RSL*24]."""
    linear = shjax.evaluate(shjax.irradiance_coefs(lighting[:4]), normals)
    weights = jnp.asarray(LUMINANCE, lighting.dtype)
    axis = _dot(lighting[jnp.array([3, 1, 2])], weights)
    axis = axis / jnp.maximum(jnp.linalg.norm(axis), 1e-12)
    second = jnp.concatenate([jnp.zeros_like(lighting[:4]), lighting[4:9]])
    along = shjax.evaluate(second, axis[None])[0]
    cosine = _dot(normals, axis)[..., None]
    return linear + np.float32(np.pi / 4) * along[None] * (1.5 * cosine**2 - 0.5)


_LOBES, _SHARPNESS = 12, 4.0


@functools.lru_cache
def _gaussians() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Axes, pseudo-inverse over 2048 directions, and irradiance of a lobe by its angle."""
    axes = fibonacci_directions(_LOBES)
    towards = fibonacci_directions(2048)
    lobes = np.exp(_SHARPNESS * (towards @ axes.T - 1))
    cosines = np.linspace(-1, 1, 257)
    l = np.arange(33)
    nodes, weights = np.polynomial.legendre.leggauss(128)
    from numpy.polynomial.legendre import legvander

    gains = (
        2 * np.pi * (weights * np.exp(_SHARPNESS * (nodes - 1))) @ legvander(nodes, 32)
    )
    kernel = cosine_kernel_table(32)
    table = legvander(cosines, 32) @ ((2 * l + 1) / (4 * np.pi) * gains * kernel)
    return axes, np.linalg.pinv(lobes), table


def gaussian_directions() -> np.ndarray:
    """Where :func:`gaussian_fit` wants the light, ``(2048, 3)``."""
    return fibonacci_directions(2048)


@jax.jit
def gaussian_fit(radiance: jax.Array) -> jax.Array:
    """Twelve amplitudes, least squares to the light at :func:`gaussian_directions`."""
    return _dot(jnp.asarray(_gaussians()[1], radiance.dtype), radiance)


@jax.jit
def gaussian_irradiance(amplitudes: jax.Array, normals: jax.Array) -> jax.Array:
    """Irradiance of twelve spherical Gaussians, from a table over the angle."""
    axes, _, table = _gaussians()
    cosine = _dot(normals, jnp.asarray(axes.T, normals.dtype))
    place = (cosine + 1) * 128
    low = jnp.clip(jnp.floor(place), 0, 255).astype(jnp.int32)
    share = place - low.astype(place.dtype)
    values = jnp.asarray(table, normals.dtype)
    return _dot(values[low] * (1 - share) + values[low + 1] * share, amplitudes)


def h_basis(directions):
    """The six functions on the upper hemisphere [HW10], ``(..., 6)``."""
    xp = jnp if isinstance(directions, jax.Array) else np
    x, y, z = directions[..., 0], directions[..., 1], directions[..., 2]
    one, three, fifteen = (np.float32(np.sqrt(k / (2 * np.pi))) for k in (1, 3, 15))
    return xp.stack(
        [
            one * xp.ones_like(x),
            three * y,
            three * (2 * z - 1),
            three * x,
            fifteen * x * y,
            0.5 * fifteen * (x * x - y * y),
        ],
        axis=-1,
    )


@functools.lru_cache
def _upper() -> tuple[np.ndarray, np.ndarray]:
    towards = fibonacci_directions(4096)
    upper = towards[towards[:, 2] > 0]
    return upper, np.linalg.pinv(h_basis(upper))


@jax.jit
def h_basis_fit(lighting: jax.Array) -> jax.Array:
    """Six coefficients, least squares on the upper hemisphere to the irradiance."""
    return _fitted(lighting, *_upper())


@jax.jit
def h_basis_irradiance(coefs: jax.Array, normals: jax.Array) -> jax.Array:
    """Irradiance of upward normals."""
    return _dot(h_basis(normals), coefs)
