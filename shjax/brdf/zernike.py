"""Scattered reflectance measurements completed by reciprocal Zernike products.

References:
    [KvD98] J. Koenderink, A. van Doorn, Phenomenological Description of Bidirectional
    Surface Reflection, JOSA A 15, 1998: reciprocal products of Zernike polynomials.
"""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Float

from shjax.arrays import Array, check_vectors, matmul
from shjax.brdf.core import Brdf, Local, Parameters, ReflectanceModel, make_brdf
from shjax.brdf.measured import _check_finite


def zernike_products(order: int) -> list[tuple[int, int, int]]:
    """Indices ``(m, n, k)`` of reciprocal Zernike products, n and k of m's parity [KvD98].

    >>> len(zernike_products(8))
    55
    """
    return [
        (m, n, k)
        for m in range(order + 1)
        for n in range(m, order + 1, 2)
        for k in range(n, order + 1, 2)
    ]


def _radial_polynomial(n: int, m: int) -> list[tuple[int, float]]:
    """Powers and factors of Zernike's ``R_n^m``."""
    terms = []
    for k in range((n - m) // 2 + 1):
        below = math.factorial(k) * math.factorial((n + m) // 2 - k)
        below *= math.factorial((n - m) // 2 - k)
        terms.append((n - 2 * k, (-1) ** k * math.factorial(n - k) / below))
    return terms


def _radial_values(direction: Local, order: int) -> dict[tuple[int, int], jax.Array]:
    """``R_n^m(r) / r^m``, r = sqrt2 sin(theta / 2), as polynomials in ``r^2 = 1 - cos``."""
    squared = 1 - direction.z
    return {
        (n, m): sum(
            (factor * squared ** ((power - m) // 2) for power, factor in terms),
            start=jnp.zeros_like(squared),
        )
        for m in range(order + 1)
        for n in range(m, order + 1, 2)
        for terms in [_radial_polynomial(n, m)]
    }


def _product_values(light: Local, view: Local, order: int):
    """Yield the value of each reciprocal product at pairs of directions.

    ``r_i^m r_o^m cos(m dphi)`` is the real part of a power of
    ``(l_x + i l_y)(v_x - i v_y) / sqrt((1 + l_z)(1 + v_z))``: no angle is needed.
    """
    scale = 1 / jnp.sqrt((1 + light.z) * (1 + view.z))
    cosine = (light.x * view.x + light.y * view.y) * scale
    sine = (light.y * view.x - light.x * view.y) * scale
    waves = [(jnp.ones_like(cosine), jnp.zeros_like(cosine))]
    for _ in range(order):
        c, s = waves[-1]
        waves.append((c * cosine - s * sine, c * sine + s * cosine))
    here, there = (_radial_values(d, order) for d in (light, view))
    for m, n, k in zernike_products(order):
        both = here[n, m] * there[k, m] + here[k, m] * there[n, m]
        yield both * waves[m][0]


def _zernike(parameters: Parameters, light: Local, view: Local) -> jax.Array:
    coefs = parameters["coefs"]
    order = next(n for n in range(40) if len(zernike_products(n)) == coefs.shape[0])
    above = (light.z > 0) & (view.z > 0)  # the products are defined on the hemisphere
    here, there = (Local(d.x, d.y, jnp.where(above, d.z, 1)) for d in (light, view))
    total = jnp.zeros_like(light.z + view.z)
    for coef, value in zip(coefs, _product_values(here, there, order), strict=True):
        total = total + coef * value
    return jnp.where(above, jnp.maximum(total, 0), 0) * light.z


ZERNIKE = ReflectanceModel("zernike", _zernike)


def from_samples(
    lights: Float[Array, "N 3"],
    views: Float[Array, "N 3"],
    values: Float[Array, "N C"],
    *,
    order: int = 8,
    ridge: float = 0.01,
) -> Brdf:
    """BRDF fitted to scattered measurements by reciprocal Zernike products [KvD98].

    Least squares with a ridge, clamped at 0, times the cosine. The ridge weighs the
    coefficients of the products of Zernike's ``R_n^m``, whose values are of order 1, and
    so damps the high orders most. Differentiable in ``values``.

    Args:
        lights: Unit vectors to the light in the surface's frame, z the normal.
        views: Unit vectors to the viewer.
        values: Measured BRDF, sr^-1.
        order: Highest order of the polynomials; 8 gives 55 products. Static.
        ridge: Weight of the squared coefficients beside that of one squared residual.

    Raises:
        ValueError: If the shapes do not fit, values are not finite, a direction is below
            the surface, or ``order`` or ``ridge`` is out of range.
    """
    for name, vectors in (("lights", lights), ("views", views)):
        check_vectors(name, vectors)
        if (
            vectors.ndim != 2
            or values.shape[:1] != vectors.shape[:1]
            or values.ndim != 2
        ):
            raise ValueError(
                "lights, views and values must have shapes (N, 3), (N, 3) and (N, C); got "
                f"{lights.shape}, {views.shape}, {values.shape}."
            )
        if not isinstance(vectors, Tracer) and np.any(
            np.asarray(vectors)[:, 2] < -1e-6
        ):
            raise ValueError(f"{name} must be above the surface, z >= 0.")
    if not 0 <= order <= 16:
        raise ValueError(f"order must lie in 0..16; got {order}.")
    if not ridge >= 0:
        raise ValueError(f"ridge must be >= 0; got {ridge}.")
    _check_finite("values", values)
    values = jnp.asarray(values)
    dtype = jnp.result_type(float)
    light, view = (
        Local(*jnp.moveaxis(jnp.asarray(v, dtype), -1, 0)) for v in (lights, views)
    )
    design = jnp.stack(list(_product_values(light, view, order)), axis=-1)
    count = design.shape[-1]
    gram = matmul(design.T, design)
    gram = gram + ridge * jnp.eye(count, dtype=dtype)
    right = matmul(design.T, values.astype(dtype))
    coefs = jnp.linalg.solve(gram, right)
    return make_brdf(ZERNIKE, coefs=coefs)
