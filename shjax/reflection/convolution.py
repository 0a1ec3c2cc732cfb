"""Reflection as a convolution: light coefficients times BRDF coefficients.

References:
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Float

from shjax.arrays import (
    Array,
    as_float,
    check_channels,
    check_vectors,
    common_channels,
    einsum,
    matmul,
)
from shjax.brdf.expansion import degrees_of_rho
from shjax.harmonics import rotate, spread
from shjax.harmonics.degrees import degree_of_coefs, degrees
from shjax.reflection.view_basis import HarmonicViews, ViewBasis
from shjax.vectors import frames

_POINTS_AT_ONCE = 64


@jax.jit
def convolve(
    lighting: Float[Array, "*batch K C"], gains: Float[Array, "L D"]
) -> Float[jax.Array, "*batch J E"]:
    """Convolve lighting with a radially symmetric BRDF: ``B_lm = a_l L_lm`` [T5, Eq. 5.7].

    The result is a reflection map's coefficients over the BRDF's centre: the reflected
    direction, or the normal.

    Args:
        lighting: Radiance coefficients.
        gains: ``a_l`` (:func:`shjax.radial_coefs`), ``(l_max + 1, C)``; one channel, of
            either, serves all of the other.

    Returns:
        Coefficients to the lower of the two degrees.

    Raises:
        ValueError: If a shape is wrong.
    """
    check_channels("gains", gains, "l_max + 1, C", 2, batch=False)
    l_max = min(degree_of_coefs(lighting, "lighting"), gains.shape[0] - 1)
    lighting = as_float("lighting", lighting)[..., : (l_max + 1) ** 2, :]
    channels = common_channels(lighting.shape[-1], gains.shape[-1], "gains")
    column = spread(jnp.asarray(gains, lighting.dtype)[: l_max + 1].T).T
    shape = (*lighting.shape[:-1], channels)
    return jnp.broadcast_to(lighting, shape) * jnp.broadcast_to(column, shape)


@jax.jit
def reflected_coefs(
    lighting: Float[Array, "*batch K C"], rho: Float[Array, "*brdfs L P P D"]
) -> Float[jax.Array, "*batch J P P E"]:
    """Reflected light field's coefficients ``B_lmpq = L_lm rho_lpq`` [T5, Eq. 5.23].

    Args:
        lighting: Radiance coefficients.
        rho: BRDF coefficients (:func:`shjax.brdf_coefs`); batch axes broadcast.

    Returns:
        ``(..., K, p_max + 1, p_max + 1, C)``, to the lower degree l of the two.

    Raises:
        ValueError: If a shape is wrong.
    """
    l_rho, p_max = degrees_of_rho(rho)
    l_max = min(degree_of_coefs(lighting, "lighting"), l_rho)
    channels = common_channels(lighting.shape[-1], rho.shape[-1], "rho")
    lighting = as_float("lighting", lighting)[..., : (l_max + 1) ** 2, None, None, :]
    by_coef = jnp.take(as_float("rho", rho), degrees(l_max), axis=-4)
    batch = jnp.broadcast_shapes(lighting.shape[:-4], by_coef.shape[:-4])
    shape = (*batch, (l_max + 1) ** 2, p_max + 1, p_max + 1, channels)
    by_coef = by_coef.astype(lighting.dtype)
    return jnp.broadcast_to(lighting, shape) * jnp.broadcast_to(by_coef, shape)


@jax.jit
def reflect(
    lighting: Float[Array, "K C"],
    rho: Float[Array, "L P P D"],
    reflected: Float[Array, "*points 3"],
    views: Float[Array, "*points 3"],
) -> Float[jax.Array, "*points E"]:
    """Reflected radiance at single points by convolution, without a map [T5, Eq. 5.8].

    The light is rotated into each direction's frame, so nothing is interpolated and the
    derivatives in directions and views are exact, at the poles too. ``O(F^3)`` per point.

    Args:
        lighting: Radiance coefficients.
        rho: BRDF coefficients.
        reflected: Unit reflected directions ``R = 2 (n.v) n - v``; tangents for fibres.
        views: Unit vectors to the viewer, in the world.

    Returns:
        Radiance ``(*points, C)``.

    Raises:
        ValueError: If a shape is wrong.
    """
    check_channels("lighting", lighting, "K, C", 2, batch=False)
    check_channels("rho", rho, "L, P, P, C", 4, batch=False)
    _, p_max = degrees_of_rho(rho)
    common_channels(lighting.shape[-1], rho.shape[-1], "rho")
    view_basis = HarmonicViews(p_max)
    lighting = as_float("lighting", lighting)
    kernels = view_basis.kernels(as_float("rho", rho).astype(lighting.dtype))
    return reflect_kernels(lighting, kernels, view_basis, reflected, views)


@jax.jit
def reflect_kernels(
    lighting: jax.Array,
    kernels: jax.Array,
    view_basis: ViewBasis,
    reflected: Array,
    views: Array,
) -> jax.Array:
    """Reflected radiance by convolution with a BRDF's kernels in any view basis.

    Args:
        lighting: Radiance coefficients, ``(K, C)``.
        kernels: Over the light's degree, one per function of the view, ``(L, Q, C)``.
        view_basis: Those functions.
        reflected: Unit reflected directions or tangents.
        views: Unit vectors to the viewer, in the world.

    Raises:
        ValueError: If the vectors' shapes do not fit.
    """
    for name, vectors in (("reflected", reflected), ("views", views)):
        check_vectors(name, vectors)
        if vectors.shape != reflected.shape:
            raise ValueError(
                f"views must have the shape of reflected; got {views.shape} and "
                f"{reflected.shape}."
            )
    l_max = min(degree_of_coefs(lighting, "lighting"), kernels.shape[0] - 1)
    channels = common_channels(lighting.shape[-1], kernels.shape[-1], "rho")
    lighting, kernels = lighting[: (l_max + 1) ** 2], kernels[: l_max + 1]

    def one(direction, view):
        frame = frames(direction)
        light = rotate(lighting, frame)
        values = view_basis.values(matmul(frame, view))
        return _contract(light, kernels, values, view_basis.orders, channels)

    flat = (reflected.reshape(-1, 3), views.reshape(-1, 3))
    flat = tuple(as_float("reflected", a).astype(lighting.dtype) for a in flat)
    if flat[0].shape[0] == 0:
        return jnp.zeros((*reflected.shape[:-1], channels), lighting.dtype)
    result = jax.lax.map(lambda pair: one(*pair), flat, batch_size=_POINTS_AT_ONCE)
    return result.reshape(*reflected.shape[:-1], channels)


def _contract(turned, kernels, values, orders: tuple[int, ...], channels: int):
    """``sum_lj L'_l,q_j k_lj values_j`` for one point."""
    size = kernels.shape[0]
    l = jnp.arange(size)[:, None]
    q = jnp.asarray(orders)[None]
    slots = jnp.where(jnp.abs(q) <= l, l * (l + 1) + q, size * size)
    light = jnp.take(turned, slots, axis=0, mode="fill", fill_value=0)  # [l, j, c]
    shape = (*light.shape[:-1], channels)
    product = jnp.broadcast_to(light, shape) * jnp.broadcast_to(kernels, shape)
    return einsum("ljc,j->c", product, values)
