"""Pictures: cameras, G-buffers, and the radiance of Lambertian surfaces in them.

A picture holds radiance, ``albedo / pi * E(n)``, not irradiance.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array, as_float
from shjax.irradiance import irradiance
from shjax.reference import reference_irradiance_samples
from shjax.sphere import normalize

Vector = tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class Camera:
    """A camera that looks from ``origin`` at ``target``.

    Attributes:
        origin: Where it stands.
        target: What the image's centre shows.
        up: Points up in the image; not along the line of sight.
        width: Width of the view of an orthographic camera, scene units.
        fov: Horizontal field of view of a perspective one, radians; None: orthographic.
    """

    origin: Vector = (-4.0, 0.0, 0.0)
    target: Vector = (0.0, 0.0, 0.0)
    up: Vector = (0.0, 0.0, 1.0)
    width: float = 2.1
    fov: float | None = None


@functools.partial(
    jax.tree_util.register_dataclass,
    data_fields=("normals", "mask", "views", "albedo", "tangents"),
    meta_fields=(),
)
@dataclasses.dataclass(frozen=True)
class GBuffer:
    """What a picture shows, per pixel.

    Attributes:
        normals: Unit normals ``(H, W, 3)``; zero where nothing is seen.
        mask: Coverage in [0, 1], ``(H, W)``.
        views: Unit vectors to the camera ``(H, W, 3)``; zero where nothing is seen.
        albedo: ``(H, W, 1)`` or ``(H, W, C)``.
        tangents: Unit tangents ``(H, W, 3)``, or None.
    """

    normals: Float[Array, "H W 3"]
    mask: Float[Array, "H W"]
    views: Float[Array, "H W 3"]
    albedo: Float[Array, "H W A"]
    tangents: Float[Array, "H W 3"] | None = None


def make_gbuffer(
    normals: Float[Array, "H W 3"],
    *,
    mask: Float[Array, "H W"] | None = None,
    views: Float[Array, "H W 3"] | None = None,
    albedo: Float[Array, "*shape"] | float = 1.0,
) -> GBuffer:
    """A G-buffer from arrays of a user's own.

    Args:
        normals: Normals of any length; zero where nothing is seen.
        mask: Coverage in [0, 1]; default 1 where there is a normal.
        views: Unit vectors to the camera; default zero (not needed by Lambertian).
        albedo: A number, or ``(C,)``, ``(H, W, 1)`` or ``(H, W, C)``.

    Raises:
        ValueError: If the shapes do not fit each other.
    """
    normals = normalize(as_float("normals", normals))
    if normals.ndim != 3 or normals.shape[-1] != 3:
        raise ValueError(f"normals must have shape (H, W, 3); got {normals.shape}.")
    size, dtype = normals.shape[:2], normals.dtype
    if mask is None:
        mask = jnp.any(normals != 0, axis=-1).astype(dtype)
    if mask.shape != size:
        raise ValueError(f"mask must have shape {size}; got {mask.shape}.")
    if views is None:
        views = jnp.zeros_like(normals)
    if views.shape != normals.shape:
        raise ValueError(f"views must have shape {normals.shape}; got {views.shape}.")
    albedo = jnp.atleast_1d(jnp.asarray(albedo, dtype))
    if albedo.ndim not in (1, 3) or (albedo.ndim == 3 and albedo.shape[:2] != size):
        raise ValueError(
            f"albedo must be a number or have shape (C,) or (H, W, C); got {albedo.shape}."
        )
    albedo = jnp.broadcast_to(albedo, (*size, albedo.shape[-1]))
    return GBuffer(normals, jnp.asarray(mask, dtype), jnp.asarray(views, dtype), albedo)


def sphere(
    size: int | tuple[int, int], camera: Camera | None = None, *, albedo: float = 1.0
) -> GBuffer:
    """The unit sphere at the origin.

    Args:
        size: Pixels of a square picture, or (height, width).
        camera: Default: orthographic, looking along +x (a panorama's centre).
        albedo: Of the whole sphere.

    Returns:
        The G-buffer, in JAX's default floating-point type. Pixels that the outline
        crosses have a fractional mask (from 4 x 4 rays) and their visible part's normal.

    Raises:
        ValueError: If the size is not positive or the camera sees along its own up.
    """
    height, width = (size, size) if isinstance(size, int) else size
    if height < 1 or width < 1:
        raise ValueError(f"size must be positive; got {size}.")
    camera = camera or Camera()
    _check_camera(camera)
    return _sphere(height, width, camera, jnp.asarray(albedo, jnp.result_type(float)))


@functools.partial(jax.jit, static_argnames=("height", "width", "camera"))
def _sphere(height: int, width: int, camera: Camera, albedo: jax.Array) -> GBuffer:
    centre = camera_rays(height, width, camera)
    normals, hit = _hit_sphere(*centre)
    offsets = [((i - 1.5) / 4, (j - 1.5) / 4) for i in range(4) for j in range(4)]
    covered, partial = jnp.zeros_like(normals[..., 0]), jnp.zeros_like(normals)
    for offset in offsets:
        some, seen = _hit_sphere(*camera_rays(height, width, camera, offset))
        covered, partial = covered + seen.astype(covered.dtype), partial + some
    normals = jnp.where(hit[..., None], normals, normalize(partial))
    seen = covered > 0
    views = jnp.where(seen[..., None], -centre[1], 0)
    return GBuffer(
        jnp.where(seen[..., None], normals, 0),
        covered / len(offsets),
        views,
        jnp.full((height, width, 1), albedo, normals.dtype),
    )


def _check_camera(camera: Camera) -> None:
    line = [t - o for t, o in zip(camera.target, camera.origin, strict=True)]
    up = camera.up
    cross = [
        line[1] * up[2] - line[2] * up[1],
        line[2] * up[0] - line[0] * up[2],
        line[0] * up[1] - line[1] * up[0],
    ]
    if math.hypot(*cross) <= 1e-6 * math.hypot(*line) * math.hypot(*up):
        raise ValueError(f"camera must not look along its up vector; got {camera}.")
    if camera.fov is not None and not 0 < camera.fov < math.pi:
        raise ValueError(f"camera.fov must lie between 0 and pi; got {camera.fov}.")
    if camera.width <= 0:
        raise ValueError(f"camera.width must be positive; got {camera.width}.")


def camera_rays(
    height: int, width: int, camera: Camera, offset: tuple[float, float] = (0.0, 0.0)
) -> tuple[jax.Array, jax.Array]:
    """Origins and unit directions of the rays through the pixels.

    Args:
        height: Rows.
        width: Columns.
        camera: The camera.
        offset: Down and right from each pixel's centre, in pixels.

    Returns:
        Origins and directions, each ``(H, W, 3)``.
    """
    origin = jnp.array(camera.origin)
    forward = normalize(jnp.array(camera.target) - origin)
    right = normalize(jnp.cross(forward, jnp.array(camera.up)))
    up = jnp.cross(right, forward)
    half = camera.width / 2 if camera.fov is None else math.tan(camera.fov / 2)
    across = ((np.arange(width) + 0.5 + offset[1]) * 2 / width - 1) * half
    down = ((np.arange(height) + 0.5 + offset[0]) * 2 / height - 1) * half
    across = jnp.asarray(across, origin.dtype)
    down = jnp.asarray(down * (height / width), origin.dtype)
    origin, forward, right, up = (v[None, None] for v in (origin, forward, right, up))
    plane = across[None, :, None] * right - down[:, None, None] * up
    if camera.fov is None:
        return origin + plane, jnp.broadcast_to(forward, plane.shape)
    return jnp.broadcast_to(origin, plane.shape), normalize(forward + plane)


def _hit_sphere(origins: jax.Array, directions: jax.Array):
    """Normals (zero where missed) and hits of the unit sphere's near side."""
    along = jnp.sum(origins * directions, axis=-1)
    nearest = origins - along[..., None] * directions
    inside = 1 - jnp.sum(nearest * nearest, axis=-1)
    hit = (inside > 0) & (along < 0)
    depth = jnp.sqrt(jnp.where(hit, inside, 1))
    normals = normalize(nearest - depth[..., None] * directions)
    return jnp.where(hit[..., None], normals, 0), hit


@jax.jit
def lambertian(
    gbuffer: GBuffer, lighting: Float[Array, "K C"]
) -> Float[jax.Array, "H W C"]:
    """Radiance ``albedo / pi * E(n)`` of a matte object, over a black background.

    Args:
        gbuffer: What the picture shows.
        lighting: Radiance coefficients.

    Returns:
        The picture, ``(H, W, C)``, times the coverage.

    Raises:
        ValueError: If a shape is wrong.
    """
    return _reflect(gbuffer, irradiance(lighting, gbuffer.normals))


def lambertian_reference(
    gbuffer: GBuffer,
    radiance: Float[Array, "N C"],
    directions: Float[Array, "N 3"],
    weights: Float[Array, " N"],
) -> Float[jax.Array, "H W C"]:
    """The same by the exact integral over the light's pixels.

    Args:
        gbuffer: What the picture shows; pixels that show nothing cost nothing.
        radiance: The light's samples (``EnvironmentMap.samples()``).
        directions: Their unit vectors.
        weights: Their solid angles.

    Returns:
        The picture, ``(H, W, C)``.

    Raises:
        ValueError: If a shape is wrong.
    """
    # Only the seen pixels are integrated: their number is data, so this runs eagerly.
    rows, columns = jnp.nonzero(gbuffer.mask > 0)
    seen = gbuffer.normals[rows, columns]
    values = reference_irradiance_samples(radiance, directions, weights, seen)
    shape = (*gbuffer.mask.shape, values.shape[-1])
    exact = jnp.zeros(shape, values.dtype).at[rows, columns].set(values)
    return _reflect(gbuffer, exact)


def _reflect(gbuffer: GBuffer, irradiance_map: jax.Array) -> jax.Array:
    scale = gbuffer.albedo * gbuffer.mask[..., None] / math.pi
    return irradiance_map * scale.astype(irradiance_map.dtype)
