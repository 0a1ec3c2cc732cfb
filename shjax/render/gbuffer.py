"""What a picture shows, per pixel: G-buffers from arrays and of the unit sphere."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import (
    Array,
    as_float,
    as_number_or_float,
    check_count,
    picture_size,
    shape_of,
)
from shjax.render.camera import Camera, camera_rays, check_camera
from shjax.vectors import normalize


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class GBuffer:
    """G-buffer: normals, views, coverage and material of each pixel of a picture.

    Attributes:
        normals: Unit normals ``(H, W, 3)``; zero where nothing is seen.
        mask: Coverage in [0, 1], ``(H, W)``.
        views: Unit vectors to the camera ``(H, W, 3)``; zero where nothing is seen.
        albedo: ``(H, W, 1)`` or ``(H, W, C)``.
        tangents: Unit tangents ``(H, W, 3)``, or None.
        positions: Points of the surface ``(H, W, 3)``, for area lights, or None.
        roughness: glTF's, in [0, 1], ``(H, W)``, or None.
        metallic: In [0, 1], ``(H, W)``, or None.
    """

    normals: Float[Array, "H W 3"]
    mask: Float[Array, "H W"]
    views: Float[Array, "H W 3"]
    albedo: Float[Array, "H W A"]
    tangents: Float[Array, "H W 3"] | None = None
    positions: Float[Array, "H W 3"] | None = None
    roughness: Float[Array, "H W"] | None = None
    metallic: Float[Array, "H W"] | None = None

    def __repr__(self) -> str:
        """Its size and what each pixel has, in one line."""
        names = [field.name for field in dataclasses.fields(self)]
        held = [name for name in names if getattr(self, name) is not None]
        size = " x ".join(str(n) for n in np.shape(self.mask)[::-1])
        return f"GBuffer: {size}; {', '.join(held)}"


def make_gbuffer(
    normals: Float[Array, "H W 3"],
    *,
    mask: Float[Array, "H W"] | None = None,
    views: Float[Array, "H W 3"] | None = None,
    albedo: Float[Array, "*shape"] | float = 1.0,
    positions: Float[Array, "H W 3"] | None = None,
) -> GBuffer:
    """Make a G-buffer from arrays of normals, views and albedo.

    Args:
        normals: Normals of any length; zero where nothing is seen.
        mask: Coverage in [0, 1]; default 1 where there is a normal.
        views: Vectors to the camera, of any length; default zero (not needed by
            Lambertian).
        albedo: A number, or ``(C,)``, ``(H, W, 1)`` or ``(H, W, C)``.
        positions: Points of the surface, which area lights need.

    Raises:
        ValueError: If the shapes do not fit each other.
    """
    normals = normalize(as_float("normals", normals))
    if normals.ndim != 3 or normals.shape[-1] != 3:
        raise ValueError(f"normals must have shape (H, W, 3); got {normals.shape}.")
    size, dtype = normals.shape[:2], normals.dtype
    if mask is None:
        mask = jnp.any(normals != 0, axis=-1).astype(dtype)
    if shape_of("mask", mask) != size:
        raise ValueError(f"mask must have shape {size}; got {mask.shape}.")
    if views is None:
        views = jnp.zeros_like(normals)
    if positions is not None:
        if shape_of("positions", positions) != normals.shape:
            raise ValueError(
                f"positions must have shape {normals.shape}; got {positions.shape}."
            )
        positions = as_float("positions", positions).astype(dtype)
    if shape_of("views", views) != normals.shape:
        raise ValueError(f"views must have shape {normals.shape}; got {views.shape}.")
    albedo = jnp.atleast_1d(as_number_or_float("albedo", albedo, dtype))
    if albedo.ndim not in (1, 3) or (albedo.ndim == 3 and albedo.shape[:2] != size):
        raise ValueError(
            f"albedo must be a number or have shape (C,) or (H, W, C); got {albedo.shape}."
        )
    albedo = jnp.broadcast_to(albedo, (*size, albedo.shape[-1]))
    return GBuffer(
        normals,
        as_number_or_float("mask", mask, dtype),
        normalize(as_float("views", views).astype(dtype)),
        albedo,
        positions=positions,
    )


def sphere(
    size: int | tuple[int, int],
    camera: Camera | None = None,
    *,
    albedo: float = 1.0,
    tangents: bool = False,
) -> GBuffer:
    """Render the G-buffer of the unit sphere at the origin.

    Args:
        size: Pixels of a square picture, or (height, width).
        camera: Default: orthographic, looking along +x (a panorama's centre).
        albedo: Of the whole sphere.
        tangents: Whether fibres run along its parallels; at the poles along y.

    Returns:
        The G-buffer, in JAX's default floating-point type. Pixels that the outline
        crosses have a fractional mask (from 4 x 4 rays) and their visible part's normal.

    Raises:
        ValueError: If the size is not positive or the camera sees along its own up.
    """
    height, width = picture_size(size)
    camera = camera or Camera()
    check_camera(camera)
    ball = _sphere(
        height,
        width,
        camera,
        as_number_or_float("albedo", albedo, jnp.result_type(float)),
    )
    if not tangents:
        return ball
    return dataclasses.replace(ball, tangents=_along_parallels(ball.normals))


def _along_parallels(normals: jax.Array) -> jax.Array:
    x, y = normals[..., 0], normals[..., 1]
    zero = jnp.zeros_like(x)
    along = normalize(jnp.stack([-y, x, zero], axis=-1))
    pole = (jnp.sum(along * along, axis=-1) == 0) & (normals[..., 2] != 0)
    y_axis = jnp.stack([zero, zero + 1, zero], axis=-1)
    return jnp.where(pole[..., None], y_axis, along)


@functools.partial(jax.jit, static_argnames=("height", "width", "camera"))
def _sphere(height: int, width: int, camera: Camera, albedo: jax.Array) -> GBuffer:
    centre = camera_rays(height, width, camera)
    normals, hit = _hit_sphere(*centre)
    offsets = [((i - 1.5) / 4, (j - 1.5) / 4) for i in range(4) for j in range(4)]

    def add(total, offset):
        some, seen = _hit_sphere(*camera_rays(height, width, camera, offset))
        return (total[0] + seen.astype(some.dtype), total[1] + some), None

    start = jnp.zeros_like(normals[..., 0]), jnp.zeros_like(normals)
    parts = jnp.asarray(offsets, normals.dtype)
    covered, partial = jax.lax.scan(add, start, parts)[0]
    normals = jnp.where(hit[..., None], normals, normalize(partial))
    seen = covered > 0
    views = jnp.where(seen[..., None], -centre[1], 0)
    return GBuffer(
        jnp.where(seen[..., None], normals, 0),
        covered / len(offsets),
        views,
        jnp.full((height, width, 1), albedo, normals.dtype),
        positions=jnp.where(seen[..., None], normals, 0),
    )


def _hit_sphere(origins: jax.Array, directions: jax.Array):
    """Normals (zero where missed) and hits of the unit sphere's near side."""
    along = jnp.sum(origins * directions, axis=-1)
    nearest = origins - along[..., None] * directions
    inside = 1 - jnp.sum(nearest * nearest, axis=-1)
    hit = (inside > 0) & (along < 0)
    depth = jnp.sqrt(jnp.where(hit, inside, 1))
    normals = normalize(nearest - depth[..., None] * directions)
    return jnp.where(hit[..., None], normals, 0), hit


def footprints(
    size: int | tuple[int, int], camera: Camera | None = None, *, samples: int = 4
) -> Float[jax.Array, "H W S 3"]:
    """Normals of the unit sphere at the parts of each pixel, for antialiased estimates.

    For :func:`shjax.estimate_lighting`: a pixel holds the mean over its parts, those on
    an outline with the black background.

    Args:
        size: Pixels of a square picture, or (height, width).
        camera: As for :func:`sphere`.
        samples: Parts along each side of a pixel.

    Returns:
        ``(H, W, samples^2, 3)``; zero where a part misses the sphere.

    Raises:
        ValueError: If a size is not positive or the camera sees along its own up.
    """
    height, width = picture_size(size)
    check_count("samples", samples)
    camera = camera or Camera()
    check_camera(camera)
    steps = (np.arange(samples) + 0.5) / samples - 0.5
    parts = [
        _hit_sphere(*camera_rays(height, width, camera, (float(i), float(j))))[0]
        for i in steps
        for j in steps
    ]
    return jnp.stack(parts, axis=2)
