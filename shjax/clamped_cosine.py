"""Lambertian irradiance from coefficients: nine numbers, three equal forms.

Irradiance is ``E(n) = int L(w) max(n.w, 0) dw``; constant radiance L gives ``pi L``. What
a picture holds is the radiance ``albedo / pi * E``; that is ``shjax.render``.

References:
    [RH01] R. Ramamoorthi and P. Hanrahan, An Efficient Representation for Irradiance
    Environment Maps, SIGGRAPH 2001.
    [T4] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 4.
"""

from __future__ import annotations

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array, as_float, check_vectors, einsum, shape_of
from shjax.harmonics import evaluate, scale_degrees
from shjax.harmonics.degrees import check_l_max, degree_of_coefs


def cosine_kernel(l_max: int) -> Float[jax.Array, " L"]:
    """Convolution gains of the clamped cosine, ``Ahat_l`` [RH01, Eq. 8].

    Irradiance coefficients are ``E_lm = Ahat_l L_lm``. The factorials of the paper are
    replaced by the ratio ``Ahat_l / Ahat_(l-2) = -(l - 3) / (l + 2)`` for even l, so any
    degree is reached without overflow.

    Args:
        l_max: Highest degree, inclusive.

    Returns:
        ``(l_max + 1,)``, in JAX's default floating-point type.

    >>> [f"{gain:.4f}" for gain in cosine_kernel(4)]
    ['3.1416', '2.0944', '0.7854', '0.0000', '-0.1309']
    """
    return jnp.asarray(cosine_kernel_table(check_l_max(l_max)), jnp.result_type(float))


@functools.lru_cache(maxsize=64)
def cosine_kernel_table(l_max: int) -> np.ndarray:
    """Gains of :func:`cosine_kernel` as a float64 NumPy table, read-only."""
    kernel = np.zeros(max(l_max, 1) + 1)
    kernel[0], kernel[1] = math.pi, 2 * math.pi / 3
    for l in range(2, l_max + 1, 2):
        kernel[l] = -kernel[l - 2] * (l - 3) / (l + 2)
    kernel = kernel[: l_max + 1]
    kernel.setflags(write=False)
    return kernel


def clamped_cosine_coefs(l_max: int) -> Float[jax.Array, " L"]:
    """Zonal harmonic coefficients A_l of the clamped cosine [T4, 4.9].

    Not the convolution gains: those are :func:`cosine_kernel`.

    Args:
        l_max: Highest degree, inclusive.

    Returns:
        ``(l_max + 1,)``.
    """
    degrees = np.arange(check_l_max(l_max) + 1)
    coefs = cosine_kernel_table(l_max) * np.sqrt((2 * degrees + 1) / (4 * np.pi))
    return jnp.asarray(coefs, jnp.result_type(float))


@jax.jit
def irradiance_coefs(
    lighting: Float[Array, "*batch K C"],
) -> Float[jax.Array, "*batch K C"]:
    """Irradiance coefficients: lighting convolved with the clamped cosine [T4, Eq. 4.8].

    Args:
        lighting: Radiance coefficients, W m^-2 sr^-1 or relative.

    Returns:
        Irradiance coefficients of the same shape, W m^-2.

    Raises:
        ValueError: If the axis before the last is not a square number.
    """
    kernel = cosine_kernel_table(degree_of_coefs(lighting, "lighting"))
    return scale_degrees(as_float("lighting", lighting), kernel)


@jax.jit
def irradiance(
    lighting: Float[Array, "*batch K C"], normals: Float[Array, "*points 3"]
) -> Float[jax.Array, "*batch_points C"]:
    """Irradiance at unit normals from lighting coefficients [T4, Eq. 4.10].

    Args:
        lighting: Radiance coefficients, ``(*batch, K, C)``.
        normals: Unit normals, ``(*points, 3)``, the same for the whole batch.

    Returns:
        ``(*batch, *points, C)``, W m^-2.

    Raises:
        ValueError: If a shape is wrong.

    >>> white = jnp.zeros((9, 1)).at[0, 0].set(math.sqrt(4 * math.pi))  # radiance 1
    >>> print(f"{irradiance(white, jnp.array([0.0, 0.0, 1.0]))[0]:.4f}")
    3.1416
    """
    check_vectors("normals", normals)
    return evaluate(irradiance_coefs(lighting), as_float("normals", normals))


@jax.jit
def irradiance_matrix(
    lighting: Float[Array, "*batch K C"],
) -> Float[jax.Array, "*batch 4 4 C"]:
    """Quadratic-form matrix M with ``E(n) = [n 1] M [n 1]^T`` [RH01, Eq. 11; T4, 4.15].

    Args:
        lighting: Radiance coefficients; degrees above 2 are not used.

    Returns:
        ``(..., 4, 4, C)``, W m^-2.

    Raises:
        ValueError: If ``lighting`` does not reach degree 2.
    """
    lighting = _nine("lighting", lighting)
    c1, c2, c3, c4, c5 = _matrix_constants()
    l00, l1m1, l10, l11, l2m2, l2m1, l20, l21, l22 = jnp.moveaxis(lighting, -2, 0)
    rows = [
        [c1 * l22, c1 * l2m2, c1 * l21, c2 * l11],
        [c1 * l2m2, -c1 * l22, c1 * l2m1, c2 * l1m1],
        [c1 * l21, c1 * l2m1, c3 * l20, c2 * l10],
        [c2 * l11, c2 * l1m1, c2 * l10, c4 * l00 - c5 * l20],
    ]
    return jnp.stack([jnp.stack(row, axis=-2) for row in rows], axis=-3)


@jax.jit
def irradiance_from_matrix(
    matrix: Float[Array, "*batch 4 4 C"], normals: Float[Array, "*points 3"]
) -> Float[jax.Array, "*batch_points C"]:
    """Irradiance at normals from its matrix, ``[n 1] M [n 1]^T`` [RH01, Eq. 11].

    Args:
        matrix: From :func:`irradiance_matrix`, ``(*batch, 4, 4, C)``.
        normals: Unit normals, ``(*points, 3)``.

    Returns:
        ``(*batch, *points, C)``, W m^-2.

    Raises:
        ValueError: If a shape is wrong.
    """
    if len(shape_of("matrix", matrix)) < 3 or matrix.shape[-3:-1] != (4, 4):
        raise ValueError(f"matrix must have shape (..., 4, 4, C); got {matrix.shape}.")
    check_vectors("normals", normals)
    matrix = as_float("matrix", matrix)
    normals = as_float("normals", normals).astype(matrix.dtype)
    points = normals.reshape(-1, 3)
    homogeneous = jnp.concatenate([points, jnp.ones_like(points[:, :1])], axis=-1)
    value = einsum(
        "pi,...ijc,pj->...pc",
        homogeneous,
        matrix,
        homogeneous,
    )
    return value.reshape(*matrix.shape[:-3], *normals.shape[:-1], matrix.shape[-1])


@jax.jit
def irradiance_polynomial(
    lighting: Float[Array, "*batch K C"], normals: Float[Array, "*points 3"]
) -> Float[jax.Array, "*batch_points C"]:
    """Irradiance as a quadratic polynomial of the normal [RH01, Eq. 13; T4, 4.16].

    Args:
        lighting: Radiance coefficients; degrees above 2 are not used.
        normals: Unit normals.

    Returns:
        ``(*batch, *points, C)``, W m^-2.

    Raises:
        ValueError: If a shape is wrong.
    """
    check_vectors("normals", normals)
    nine = _nine("lighting", lighting)
    normals = as_float("normals", normals).astype(nine.dtype)
    c1, c2, c3, c4, c5 = _matrix_constants()
    # Coefficients in front, one axis for each of the points' axes, channel last.
    spread_out = (*nine.shape[:-2], *(1,) * (normals.ndim - 1), nine.shape[-1])
    l00, l1m1, l10, l11, l2m2, l2m1, l20, l21, l22 = (
        nine[..., k, :].reshape(spread_out) for k in range(9)
    )
    x, y, z = (normals[..., i, None] for i in range(3))
    shape = jnp.broadcast_shapes(x.shape, spread_out)
    x, y, z = (jnp.broadcast_to(component, shape) for component in (x, y, z))
    return (
        c1 * l22 * (x * x - y * y)
        + c3 * l20 * z * z
        + c4 * l00
        - c5 * l20
        + 2 * c1 * (l2m2 * x * y + l21 * x * z + l2m1 * y * z)
        + 2 * c2 * (l11 * x + l1m1 * y + l10 * z)
    )


def _nine(name: str, lighting) -> jax.Array:
    if degree_of_coefs(lighting, name) < 2:
        raise ValueError(f"{name} must have shape (..., 9, C); got {lighting.shape}.")
    return as_float(name, lighting)[..., :9, :]


def _matrix_constants() -> tuple[float, ...]:
    """c1..c5 of [RH01, Eq. 12] from the kernel and the basis constants [RH01, Eq. 3]."""
    a0, a1, a2 = (float(a) for a in cosine_kernel_table(2))
    y00, y1 = math.sqrt(1 / (4 * math.pi)), math.sqrt(3 / (4 * math.pi))
    y20, y22 = math.sqrt(5 / (16 * math.pi)), math.sqrt(15 / (16 * math.pi))
    return a2 * y22, a1 * y1 / 2, 3 * a2 * y20, a0 * y00, a2 * y20
