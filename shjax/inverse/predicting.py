"""Pictures from what was estimated, as functions that an Estimate carries."""

from __future__ import annotations

import jax

from shjax import render
from shjax.brdf import Brdf
from shjax.inverse.glossy import light_up, reflected, table_to
from shjax.render import GBuffer
from shjax.render.shading import covered

LEAST_COSINE = 0.1  # below, a view is read as one at this n.v


def predict_lighting(
    brdf: Brdf | None, lighting: jax.Array, gbuffer: GBuffer
) -> jax.Array:
    """A picture under estimated light, ``(H, W, C)``; matte where there is no BRDF."""
    if brdf is None:
        return render.lambertian(gbuffer, lighting)
    return predict_parametric(brdf, lighting, gbuffer)


def predict_parametric(brdf: Brdf, lighting: jax.Array, gbuffer: GBuffer) -> jax.Array:
    """A picture of a reflectance under coefficients of light, ``(H, W, C)``."""
    table = table_to(LEAST_COSINE)
    closed = all(part.model.radial is not None for part in brdf.parts)
    normals, views = (a.reshape(-1, 3) for a in (gbuffer.normals, gbuffer.views))
    lit = light_up(lighting, normals, views, table, radial=closed)
    values = reflected(brdf, lit, table)
    return covered(gbuffer, values.reshape(*gbuffer.mask.shape, -1))
