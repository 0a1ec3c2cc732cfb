"""Reflectance models: analytic, microfacet, measured; isotropic, or about a tangent.

A BRDF is a pytree; ``a + b`` and ``0.3 * b`` combine them. What a model defines is its
*transfer function*: the BRDF times the clamped cosine, or what its paper puts there.
"""

from shjax.brdf.checks import Check, check
from shjax.brdf.core import Brdf, select, transfer
from shjax.brdf.expansion import BrdfExpansion, brdf_coefs, expand, radial_coefs
from shjax.brdf.fibres import charlie, kajiya_kay
from shjax.brdf.files import read_cornell, read_curet, read_merl
from shjax.brdf.ggx import ggx, metallic_roughness
from shjax.brdf.measured import from_table
from shjax.brdf.models import (
    gaussian_microfacet,
    lafortune,
    lambertian,
    phong,
    phong_cosine,
)
from shjax.brdf.parse import parse
from shjax.brdf.quadrature import Resolution
from shjax.brdf.truncation import (
    choose_degrees,
    energy_held,
    lighting_degree,
    predicted_energy_error,
    predicted_rms_error,
    residual_heuristic,
)
from shjax.brdf.zernike import from_samples

__all__ = [
    "Brdf",
    "BrdfExpansion",
    "Check",
    "Resolution",
    "brdf_coefs",
    "charlie",
    "check",
    "choose_degrees",
    "energy_held",
    "expand",
    "from_samples",
    "from_table",
    "gaussian_microfacet",
    "ggx",
    "kajiya_kay",
    "lafortune",
    "lambertian",
    "lighting_degree",
    "metallic_roughness",
    "parse",
    "phong",
    "phong_cosine",
    "predicted_energy_error",
    "predicted_rms_error",
    "radial_coefs",
    "read_cornell",
    "read_curet",
    "read_merl",
    "residual_heuristic",
    "select",
    "transfer",
]
