"""Pictures from what was estimated, as functions that an Estimate carries."""

from __future__ import annotations

import jax

from shjax.brdf import Brdf
from shjax.brdf.transfer_rows import table_to
from shjax.inverse.shown.glossy import light_up, reflected
from shjax.render import GBuffer
from shjax.render.pictures import covered, image

MIN_COSINE = 0.1  # below, a view is read as one at this n.v


def predict_lighting(
    brdf: Brdf | None, lighting: jax.Array, gbuffer: GBuffer
) -> jax.Array:
    """Predict a picture under estimated light, ``(H, W, C)``; Lambertian without a BRDF."""
    if brdf is None:
        return image(gbuffer, lighting)
    return predict_parametric(brdf, lighting, gbuffer)


def predict_parametric(brdf: Brdf, lighting: jax.Array, gbuffer: GBuffer) -> jax.Array:
    """Predict a picture of a BRDF under lighting coefficients, ``(H, W, C)``."""
    table = table_to(MIN_COSINE)
    closed = all(part.model.radial is not None for part in brdf.parts)
    normals, views = (a.reshape(-1, 3) for a in (gbuffer.normals, gbuffer.views))
    lit = light_up(lighting, normals, views, table, radial=closed)
    values = reflected(brdf, lit, table)
    return covered(gbuffer, values.reshape(*gbuffer.mask.shape, -1))
