"""Pictures from G-buffers: radiance, from coefficients, maps or the integral.

A picture holds radiance, ``albedo / pi * E(n)`` for a matte surface, not irradiance; over
a black background, times the coverage.

References:
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
"""

from __future__ import annotations

import math
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Float

from shjax import shrm
from shjax.angular import reference_reflection
from shjax.arrays import Array, picture_size
from shjax.brdf import Brdf
from shjax.ibl import PrefilteredLight
from shjax.ibl import shade as shade_points
from shjax.irradiance import irradiance
from shjax.model import Model
from shjax.reference import reference_irradiance_samples
from shjax.render.camera import Camera, camera_rays
from shjax.render.gbuffer import GBuffer
from shjax.sphere import mirror, normalize


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


def glossy(
    gbuffer: GBuffer,
    maps: Float[Array, "n_theta n_phi Q C"],
    *,
    frame: str = "local",
    interpolation: str = "cubic",
) -> Float[jax.Array, "H W C"]:
    """A picture from a spherical harmonic reflection map.

    Args:
        gbuffer: What the picture shows; with tangents the map is read at them.
        maps: From :func:`shjax.prefilter`.
        frame: ``"local"``, ``"global"``, or ``"dynamic"``: a global map summed once for
            the mean view, for a distant viewer [T5, Eq. 5.35]. Static.
        interpolation: As in :func:`shjax.shrm.radiance`. Static.

    Returns:
        The picture, ``(H, W, C)``, times albedo and coverage.

    Raises:
        ValueError: If a shape is wrong or a choice unknown.
    """
    if frame not in ("local", "global", "dynamic"):
        raise ValueError(f"frame must be local, global or dynamic; got {frame!r}.")
    centre = gbuffer.tangents
    if centre is None:
        centre = mirror(gbuffer.normals, gbuffer.views)
    if frame == "dynamic":
        view = normalize(jnp.sum(gbuffer.views, axis=(0, 1)))
        # One coefficient, Y_00 = 1 / sqrt(4 pi): a reflection map of radiance.
        single = shrm.dynamic_map(maps, view)[:, :, None]
        maps, frame = single * math.sqrt(4 * math.pi), "global"
    values = shrm.radiance(
        maps, centre, gbuffer.views, frame=frame, interpolation=interpolation
    )
    return covered(gbuffer, values)


def shade(gbuffer: GBuffer, model: Model) -> Float[jax.Array, "H W C"]:
    """A picture from a chosen model (:func:`shjax.choose_model`).

    Args:
        gbuffer: What the picture shows; albedo scales the reflected radiance.
        model: The reflected light field.

    Returns:
        The picture, ``(H, W, C)``, times albedo and coverage.

    Raises:
        ValueError: If the model needs tangents that the G-buffer lacks.
    """
    values = model.radiance(gbuffer.normals, gbuffer.views, tangents=gbuffer.tangents)
    return covered(gbuffer, values)


def metallic_roughness(
    gbuffer: GBuffer,
    light: PrefilteredLight,
    *,
    roughness: Float[Array, "H W"] | float | None = None,
    metallic: Float[Array, "H W"] | float | None = None,
    f0: Any = 0.04,
) -> Float[jax.Array, "H W C"]:
    """A picture of glTF's material under a prefiltered light (:func:`shjax.shade`).

    Args:
        gbuffer: What the picture shows; its albedo is the base colour.
        light: From :func:`shjax.prefilter_light`.
        roughness: A number or one a pixel; default the G-buffer's.
        metallic: The same; default the G-buffer's, or 0.
        f0: Reflectance of the dielectric at normal incidence.

    Returns:
        The picture, ``(H, W, C)``, times the coverage.

    Raises:
        ValueError: If neither the call nor the G-buffer has a roughness.
    """
    rough = gbuffer.roughness if roughness is None else roughness
    metal = gbuffer.metallic if metallic is None else metallic
    if rough is None:
        raise ValueError("roughness must be given: the G-buffer has none.")
    values = shade_points(
        light, gbuffer.normals, gbuffer.views, albedo=gbuffer.albedo, roughness=rough,
        metallic=0.0 if metal is None else metal, f0=f0,
    )  # fmt: skip
    mask = jnp.broadcast_to(gbuffer.mask[..., None], values.shape).astype(values.dtype)
    return jnp.where(mask == 0, 0, values * mask)


def reference(
    gbuffer: GBuffer, radiance: Float[Array, "n_theta n_phi C"], brdf: Brdf
) -> Float[jax.Array, "H W C"]:
    """The same by the integral over every pixel of the light.

    Args:
        gbuffer: What the picture shows; pixels that show nothing cost nothing.
        radiance: Panorama as it is stored.
        brdf: The reflectance.

    Returns:
        The picture, ``(H, W, C)``, times albedo and coverage.

    Raises:
        ValueError: If a shape is wrong or tangents are missing.
    """
    # Only the seen pixels are integrated: their number is data, so this runs eagerly.
    rows, columns = jnp.nonzero(gbuffer.mask > 0)
    normals, views = (a[rows, columns] for a in (gbuffer.normals, gbuffer.views))
    tangents = None if gbuffer.tangents is None else gbuffer.tangents[rows, columns]
    values = reference_reflection(radiance, brdf, normals, views, tangents=tangents)
    shape = (*gbuffer.mask.shape, values.shape[-1])
    exact = jnp.zeros(shape, values.dtype).at[rows, columns].set(values)
    return covered(gbuffer, exact)


def covered(gbuffer: GBuffer, values: jax.Array) -> jax.Array:
    """Radiance at albedo 1 times albedo and coverage; 0 where nothing is seen."""
    scale = gbuffer.albedo * gbuffer.mask[..., None]
    shape = (*scale.shape[:-1], max(scale.shape[-1], values.shape[-1]))
    scale = jnp.broadcast_to(scale.astype(values.dtype), shape)
    # What is not seen has no normal; its reading is finite and counts for nothing.
    return jnp.where(scale == 0, 0, jnp.broadcast_to(values, shape) * scale)


def mirrored(
    gbuffer: GBuffer, radiance: Float[Array, "n_theta n_phi C"]
) -> Float[jax.Array, "H W C"]:
    """A perfect mirror: the panorama at the reflected directions.

    Args:
        gbuffer: What the picture shows.
        radiance: Panorama as it is stored, with an even number of columns.

    Returns:
        The picture, ``(H, W, C)``, times albedo and coverage.
    """
    return covered(
        gbuffer, panorama_at(radiance, mirror(gbuffer.normals, gbuffer.views))
    )


def background(
    radiance: Float[Array, "n_theta n_phi C"],
    camera: Camera,
    size: int | tuple[int, int],
) -> Float[jax.Array, "H W C"]:
    """What a camera sees of the light itself, read between pixels.

    Args:
        radiance: Panorama as it is stored, with an even number of columns.
        camera: The camera; an orthographic one sees a single direction.
        size: Pixels of a square picture, or (height, width).

    Returns:
        The picture, ``(H, W, C)``.
    """
    height, width = picture_size(size)
    _, directions = camera_rays(height, width, camera)
    return panorama_at(radiance, directions)


def panorama_at(
    radiance: Float[Array, "n_theta n_phi C"], directions: Float[Array, "*points 3"]
) -> Float[jax.Array, "*points C"]:
    """Radiance of a panorama at directions, read linearly between pixels.

    Args:
        radiance: Panorama as it is stored, with an even number of columns.
        directions: Unit vectors.
    """
    # A map of one coefficient, Y_00 = 1 / sqrt(4 pi).
    maps = jnp.asarray(radiance)[:, :, None] * math.sqrt(4 * math.pi)
    towards = jnp.asarray(directions, maps.dtype)
    return shrm.radiance(maps, towards, towards, frame="global", interpolation="linear")
