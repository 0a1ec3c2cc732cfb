"""Pictures from what was estimated, as functions that an Estimate carries."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from shjax import render
from shjax.brdf import Brdf
from shjax.inverse.rows import light_up, reflected, table_to
from shjax.render import GBuffer


def predict_lighting(
    brdf: Brdf | None, lighting: jax.Array, gbuffer: GBuffer
) -> jax.Array:
    """A picture under estimated light, ``(H, W, C)``."""
    if brdf is None:
        return render.lambertian(gbuffer, lighting)
    return predict_reflectance(lighting, brdf, gbuffer)


def predict_reflectance(lighting: jax.Array, brdf: Brdf, gbuffer: GBuffer) -> jax.Array:
    """A picture of an estimated reflectance, ``(H, W, C)``."""
    normals, views = (
        a.reshape(-1, 3).astype(lighting.dtype)
        for a in (gbuffer.normals, gbuffer.views)
    )
    table = table_to(0.02)
    closed = all(part.model.radial is not None for part in brdf.parts)
    lit = light_up(lighting, normals, views, table, radial=closed)
    values = reflected(brdf, lit, table).reshape(*gbuffer.mask.shape, -1)
    scale = gbuffer.albedo.astype(values.dtype) * gbuffer.mask[..., None]
    shape = (*values.shape[:-1], max(values.shape[-1], scale.shape[-1]))
    scale = jnp.broadcast_to(scale, shape).astype(values.dtype)
    return jnp.where(scale == 0, 0, jnp.broadcast_to(values, shape) * scale)
