"""Pictures from G-buffers: any reflector, the integral, a mirror, the light itself.

A picture holds radiance, ``albedo / pi * E(n)`` for a Lambertian surface, not irradiance;
over a black background, times the coverage.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array, as_float, check_vectors, picture_size
from shjax.brdf import Brdf
from shjax.clamped_cosine import irradiance
from shjax.ibl import LitMaterial, PrefilteredLight
from shjax.light import Light, as_panorama
from shjax.lights import AreaLight, area_irradiance, area_reflection
from shjax.reference import reference_irradiance, reference_reflection
from shjax.reflection import Reflector
from shjax.reflection.reading import read_latlong
from shjax.reflection.view_basis import HarmonicViews
from shjax.render.camera import Camera, camera_rays
from shjax.render.gbuffer import GBuffer
from shjax.vectors import mirror


def image(
    gbuffer: GBuffer, reflector: Reflector | PrefilteredLight | Float[Array, "K C"]
) -> Float[jax.Array, "H W C"]:
    """Render a G-buffer: the radiance of any reflector, over a black background.

    Args:
        gbuffer: What the picture shows; its albedo scales the reflected radiance.
        reflector: A reflector, such as a :class:`shjax.ReflectionMap`, what
            :func:`shjax.choose_model` chose, or ``light.with_material(...)`` of a
            prefiltered light, whose albedo, roughness and metallic are the G-buffer's
            where they are not given. A prefiltered light alone has the G-buffer's
            material. Lighting coefficients ``(K, C)`` light a Lambertian surface.

    Returns:
        The picture, ``(H, W, C)``, times albedo and coverage.

    Raises:
        ValueError: If it is no reflector, or needs tangents or a roughness that the
            G-buffer lacks.
    """
    if isinstance(reflector, PrefilteredLight):
        reflector = reflector.with_material()
    if isinstance(reflector, LitMaterial):
        return _lit(gbuffer, reflector)
    if isinstance(reflector, Array):
        return _lambertian(gbuffer, reflector)
    if not isinstance(reflector, Reflector):
        raise ValueError(
            "reflector must be a reflection map, a model, a lit material or lighting "
            f"coefficients; got {type(reflector).__name__}."
        )
    values = reflector.radiance(
        gbuffer.normals, gbuffer.views, tangents=gbuffer.tangents
    )
    return covered(gbuffer, values)


@jax.jit
def _lambertian(gbuffer: GBuffer, lighting: jax.Array) -> jax.Array:
    """Radiance ``albedo / pi * E(n)``."""
    return _reflect(gbuffer, irradiance(lighting, gbuffer.normals))


@jax.jit
def _reflect(gbuffer: GBuffer, irradiance_map: jax.Array) -> jax.Array:
    scale = gbuffer.albedo * gbuffer.mask[..., None] / math.pi
    return irradiance_map * scale.astype(irradiance_map.dtype)


def _lit(gbuffer: GBuffer, material: LitMaterial) -> jax.Array:
    """A material whose missing parameters are the G-buffer's."""
    own = {
        name: getattr(gbuffer, name)
        for name in ("albedo", "roughness", "metallic")
        if getattr(material, name) is None
    }
    if own.get("roughness", material.roughness) is None:
        raise ValueError("roughness must be given: the G-buffer has none.")
    values = dataclasses.replace(material, **own).radiance(
        gbuffer.normals, gbuffer.views
    )
    mask = jnp.broadcast_to(gbuffer.mask[..., None], values.shape).astype(values.dtype)
    return jnp.where(mask == 0, 0, values * mask)


def reference(
    gbuffer: GBuffer, light: Light, brdf: Brdf | None = None
) -> Float[jax.Array, "H W C"]:
    """Render a G-buffer by brute-force integration over every pixel of the light.

    Args:
        gbuffer: What the picture shows; pixels that show nothing cost nothing.
        light: An environment map of any layout, or a lat-long panorama.
        brdf: The reflectance; default Lambertian, by the irradiance.

    Returns:
        The picture, ``(H, W, C)``, times albedo and coverage.

    Raises:
        ValueError: If a shape is wrong or tangents are missing.
    """
    # Only the seen pixels are integrated: their number is data, so this runs eagerly.
    seen = np.asarray(gbuffer.mask) > 0
    normals = np.asarray(gbuffer.normals)[seen]
    if brdf is None:
        values = reference_irradiance(light, normals)
    else:
        views = np.asarray(gbuffer.views)[seen]
        tangents = gbuffer.tangents
        tangents = None if tangents is None else np.asarray(tangents)[seen]
        values = reference_reflection(light, brdf, normals, views, tangents=tangents)
    exact = np.zeros((*seen.shape, values.shape[-1]), values.dtype)
    exact[seen] = values
    finish = _reflect if brdf is None else covered
    return finish(gbuffer, jnp.asarray(exact))


def area_lit(
    gbuffer: GBuffer,
    light: AreaLight | Sequence[AreaLight],
    brdf: Brdf | None = None,
    *,
    nodes: int = 16,
) -> Float[jax.Array, "H W C"]:
    """Render a G-buffer under area lights, to be added to the picture under a panorama.

    Args:
        gbuffer: What the picture shows, with positions; nothing casts a shadow. Pixels
            that show nothing cost nothing.
        light: One area light, or several.
        brdf: The reflectance; default Lambertian, by the exact irradiance.
        nodes: Of :func:`shjax.lights.area_reflection`. Static.

    Returns:
        The picture, ``(H, W, C)``, times albedo and coverage.

    Raises:
        ValueError: If the G-buffer has no positions, or a part is about the tangent.
    """
    if gbuffer.positions is None:
        raise ValueError("gbuffer must have positions: area lights stand near.")
    # Only the seen pixels are lit: their number is data, so this runs eagerly.
    seen = np.asarray(gbuffer.mask) > 0
    points, normals, views = (
        np.asarray(a)[seen] for a in (gbuffer.positions, gbuffer.normals, gbuffer.views)
    )
    if brdf is None:
        values = area_irradiance(light, points, normals)
    else:
        values = area_reflection(light, brdf, points, normals, views, nodes=nodes)
    made = np.zeros((*seen.shape, values.shape[-1]), values.dtype)
    made[seen] = values
    finish = _reflect if brdf is None else covered
    return finish(gbuffer, jnp.asarray(made))


@jax.jit
def covered(gbuffer: GBuffer, values: jax.Array) -> jax.Array:
    """Scale radiance by albedo and coverage; 0 where nothing is seen."""
    scale = gbuffer.albedo * gbuffer.mask[..., None]
    shape = (*scale.shape[:-1], max(scale.shape[-1], values.shape[-1]))
    scale = jnp.broadcast_to(scale.astype(values.dtype), shape)
    # What is not seen has no normal; its reading is finite and counts for nothing.
    return jnp.where(scale == 0, 0, jnp.broadcast_to(values, shape) * scale)


def mirrored(gbuffer: GBuffer, light: Light) -> Float[jax.Array, "H W C"]:
    """Render a perfect mirror: the panorama at the reflected directions.

    Args:
        gbuffer: What the picture shows.
        light: An environment map, or a lat-long panorama of an even number of columns.

    Returns:
        The picture, ``(H, W, C)``, times albedo and coverage.
    """
    reflected = mirror(gbuffer.normals, gbuffer.views)
    return covered(gbuffer, panorama_at(light, reflected))


def background(
    light: Light, camera: Camera, size: int | tuple[int, int]
) -> Float[jax.Array, "H W C"]:
    """Render the light itself as a camera sees it, read between pixels.

    Args:
        light: An environment map, or a lat-long panorama of an even number of columns.
        camera: The camera; an orthographic one sees a single direction.
        size: Pixels of a square picture, or (height, width).

    Returns:
        The picture, ``(H, W, C)``.
    """
    height, width = picture_size(size)
    _, directions = camera_rays(height, width, camera)
    return panorama_at(light, directions)


def panorama_at(
    light: Light, light_directions: Float[Array, "*points 3"]
) -> Float[jax.Array, "*points C"]:
    """Read the radiance of a light at directions, linearly between pixels.

    Args:
        light: An environment map, or a lat-long panorama of an even number of columns.
        light_directions: Unit vectors.
    """
    check_vectors("light_directions", light_directions)
    radiance = as_float("light", as_panorama(light))
    # A map of one coefficient, Y_00 = 1 / sqrt(4 pi).
    coefs = radiance[:, :, None] * math.sqrt(4 * math.pi)
    towards = jnp.asarray(light_directions, coefs.dtype)
    return read_latlong(
        HarmonicViews(0),
        coefs,
        towards,
        towards,
        frame="global",
        interpolation="linear",
    )
