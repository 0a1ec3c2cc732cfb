"""The usual tricks for area lights, to be compared: small functions, large errors.

References:
    [RTR] T. Akenine-Moller et al., Real-Time Rendering, 4th ed., CRC Press, 2018, chapter
        10: wrap lighting (Eqs. 10.9 and 10.10), isotropic lines (Eq. 10.12).
    [K13] B. Karis, Real Shading in Unreal Engine 4, SIGGRAPH courses, 2013: the
        representative point of spheres and tubes, and its loss of energy.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from shjax.brdf import ggx
from shjax.brdf.core import transfer
from shjax.vectors import mirror, normalize


def wrap(cosine: jax.Array, k: float) -> jax.Array:
    """Wrap lighting, ``max((cos + k) / (1 + k), 0)`` [RTR, Eq. 10.9].

    Its mean over the sphere is ``(1 + k) / 4``: too bright by ``1 + k``.
    """
    return jnp.maximum((cosine + k) / (1 + k), 0)


def valves_wrap(cosine: jax.Array) -> jax.Array:
    """Half Lambert, ``((cos + 1) / 2)^2`` [RTR, Eq. 10.10]; its mean is 1/3, not 1/4."""
    return ((cosine + 1) / 2) ** 2


def isotropic_line(start: jax.Array, end: jax.Array, normal: jax.Array) -> jax.Array:
    """Integral of ``n . x / |x|^3`` along a segment above the horizon.

    ``|p1 - p0| (n.p0 / |p0| + n.p1 / |p1|) / (|p0| |p1| + p0.p1)``; as [RTR, Eq. 10.12] is
    printed it is another number.
    """
    first, last = (jnp.linalg.norm(a) for a in (start, end))
    slopes = jnp.dot(normal, start) / first + jnp.dot(normal, end) / last
    apart = jnp.linalg.norm(end - start)
    return apart * slopes / (first * last + jnp.dot(start, end))


def point_light(centre, solid_angle, alpha, f0, points, normals, views) -> jax.Array:
    """All of the light at its centre."""
    towards = normalize(centre[None] - points)
    value = transfer(ggx(alpha, f0), normals, towards, views)[..., 0]
    return value * solid_angle


def roughened(
    centre, radius, solid_angle, alpha, f0, points, normals, views
) -> jax.Array:
    """A point at the centre, the roughness widened by the light's size [K13]."""
    apart = centre[None] - points
    distance = jnp.linalg.norm(apart, axis=-1)
    wider = jnp.clip(alpha + radius / (2 * distance), 0, 1)
    each = jax.vmap(lambda a, n, l, v: transfer(ggx(a, f0), n, l, v)[0])
    return each(wider, normals, normalize(apart), views) * solid_angle


def representative_point(
    centre, radius, solid_angle, alpha, f0, points, normals, views, *, half_length=None
) -> jax.Array:
    """The point of a sphere nearest to the reflected ray, with Karis' energy [K13].

    The lobe's loss is ``(alpha / alpha')^2``; of a tube, which widens it in one dimension
    by its half length, ``alpha / alpha'``.
    """
    lobe = mirror(normals, views)
    apart = jnp.broadcast_to(centre, points.shape) - points
    across = jnp.sum(apart * lobe, axis=-1, keepdims=True) * lobe - apart
    size = jnp.linalg.norm(across, axis=-1, keepdims=True)
    nearest = apart + across * jnp.clip(radius / jnp.maximum(size, 1e-9), 0, 1)
    distance = jnp.linalg.norm(apart, axis=-1)
    width, power = (radius, 2) if half_length is None else (half_length, 1)
    wider = jnp.clip(alpha + width / (2 * distance), 0, 1)
    value = transfer(ggx(alpha, f0), normals, normalize(nearest), views)[..., 0]
    return value * (alpha / wider) ** power * solid_angle


def representative_point_of_a_tube(
    start, end, radius, solid_angle, alpha, f0, points, normals, views
) -> jax.Array:
    """The point of a segment nearest to the reflected ray, as a sphere's [K13]."""
    lobe = mirror(normals, views)
    first, part = start[None] - points, (end - start)[None]
    along = jnp.sum(lobe * part, axis=-1)
    top = jnp.sum(lobe * first, axis=-1) * along - jnp.sum(first * part, axis=-1)
    below = jnp.sum(part * part, axis=-1) - along**2
    share = jnp.clip(top / jnp.maximum(below, 1e-9), 0, 1)
    centre = start[None] + share[:, None] * part
    given = (alpha, f0, points, normals, views)
    half = jnp.linalg.norm(end - start) / 2
    return representative_point(centre, radius, solid_angle, *given, half_length=half)


def monte_carlo(towards, solid, alpha, f0, normals, views) -> jax.Array:
    """Mean over directions drawn evenly in the light's solid angle.

    Args:
        towards: ``(N, S, 3)``.
        solid: Solid angle of the light, ``(N,)``.
        alpha: Roughness.
        f0: Reflectance at normal incidence.
        normals: ``(N, 3)``.
        views: ``(N, 3)``.
    """
    shape = towards.shape
    n, v = (jnp.broadcast_to(a[:, None], shape) for a in (normals, views))
    return jnp.mean(transfer(ggx(alpha, f0), n, towards, v)[..., 0], axis=1) * solid


def draw_cap(rng, axis: np.ndarray, height: np.ndarray, count: int) -> np.ndarray:
    """Directions drawn evenly in caps: axes ``(N, 3)``, ``1 - cos`` of half angles."""
    from shjax.vectors import frames

    fall = height[:, None] * rng.random((len(axis), count))
    across, phi = np.sqrt(fall * (2 - fall)), 2 * np.pi * rng.random(fall.shape)
    local = np.stack([across * np.cos(phi), across * np.sin(phi), 1 - fall], axis=-1)
    return np.einsum("nij,nsi->nsj", np.asarray(frames(jnp.asarray(axis))), local)
