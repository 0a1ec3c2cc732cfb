"""Lighting in frequency space, differentiable: see the README and each module.

Frame: right-handed, +z up; a panorama's centre looks along +x and u = 0.25 along +y.
Basis: real, orthonormal, without Condon-Shortley phase; index ``l (l + 1) + m``.
Arrays: channel last, batch in front; coefficients are ``(..., K, C)``.
Light: linear radiance, W m^-2 sr^-1 or relative; angles in radians.

``import shjax`` loads JAX and NumPy only; ``shjax.io``, ``shjax.inverse`` and what they
need are loaded when first used.
"""

import importlib
from typing import TYPE_CHECKING

from shjax import brdf as brdf
from shjax import ibl as ibl
from shjax import lights as lights
from shjax import render as render
from shjax import shrm as shrm
from shjax.adapted import adapt as adapt
from shjax.angular import reference_reflection as reference_reflection
from shjax.angular import (
    reference_reflection_samples as reference_reflection_samples,
)
from shjax.conventions import convert as convert
from shjax.convolution import convolve as convolve
from shjax.convolution import reflect as reflect
from shjax.convolution import reflected_coefs as reflected_coefs
from shjax.envmap import EnvironmentMap as EnvironmentMap
from shjax.envmap import make_envmap as make_envmap
from shjax.estimate import Estimate as Estimate
from shjax.harmonics import analyze as analyze
from shjax.harmonics import basis as basis
from shjax.harmonics import evaluate as evaluate
from shjax.harmonics import multiply as multiply
from shjax.harmonics import power_spectrum as power_spectrum
from shjax.harmonics import project_samples as project_samples
from shjax.harmonics import rotate as rotate
from shjax.harmonics import scale_degrees as scale_degrees
from shjax.harmonics import spread as spread
from shjax.harmonics import synthesize as synthesize
from shjax.harmonics import wigner_d as wigner_d
from shjax.ibl import PrefilteredLight as PrefilteredLight
from shjax.ibl import predicted_shading_error as predicted_shading_error
from shjax.ibl import prefilter_light as prefilter_light
from shjax.ibl import shade as shade
from shjax.irradiance import clamped_cosine_coefs as clamped_cosine_coefs
from shjax.irradiance import cosine_kernel as cosine_kernel
from shjax.irradiance import irradiance as irradiance
from shjax.irradiance import irradiance_coefs as irradiance_coefs
from shjax.irradiance import irradiance_from_matrix as irradiance_from_matrix
from shjax.irradiance import irradiance_matrix as irradiance_matrix
from shjax.irradiance import irradiance_polynomial as irradiance_polynomial
from shjax.kernels import BrdfExpansion as BrdfExpansion
from shjax.kernels import brdf_coefs as brdf_coefs
from shjax.kernels import expand_brdf as expand_brdf
from shjax.kernels import radial_coefs as radial_coefs
from shjax.lights import CapLights as CapLights
from shjax.lights import cap_coefs as cap_coefs
from shjax.lights import cap_reflection as cap_reflection
from shjax.lights import split_lights as split_lights
from shjax.model import Model as Model
from shjax.model import brdf_energies as brdf_energies
from shjax.model import choose_model as choose_model
from shjax.model import prepare_light as prepare_light
from shjax.orders import choose_orders as choose_orders
from shjax.orders import energy_held as energy_held
from shjax.orders import lighting_order as lighting_order
from shjax.orders import predicted_energy_error as predicted_energy_error
from shjax.orders import predicted_error as predicted_error
from shjax.orders import residual_heuristic as residual_heuristic
from shjax.reference import irradiance_error as irradiance_error
from shjax.reference import reference_irradiance as reference_irradiance
from shjax.reference import (
    reference_irradiance_samples as reference_irradiance_samples,
)
from shjax.shrm import prefilter as prefilter
from shjax.shrm import prefilter_cube as prefilter_cube
from shjax.windows import dering as dering
from shjax.windows import window as window

if TYPE_CHECKING:
    from shjax import inverse as inverse
    from shjax import io as io
    from shjax import metrics as metrics
    from shjax import plot as plot
    from shjax.inverse import estimate_brdf as estimate_brdf
    from shjax.inverse import estimate_joint as estimate_joint
    from shjax.inverse import estimate_lighting as estimate_lighting

__version__ = "0.1.0"

_LAZY = {
    "io": "shjax.io",
    "inverse": "shjax.inverse",
    "metrics": "shjax.metrics",
    "plot": "shjax.plot",
    "estimate_brdf": "shjax.inverse",
    "estimate_joint": "shjax.inverse",
    "estimate_lighting": "shjax.inverse",
}


def __getattr__(name: str):
    if name not in _LAZY:
        raise AttributeError(f"module 'shjax' has no attribute {name!r}")
    module = importlib.import_module(_LAZY[name])
    return module if _LAZY[name] == f"shjax.{name}" else getattr(module, name)


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(_LAZY))
