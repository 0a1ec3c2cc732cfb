"""Lighting in frequency space, differentiable: see the README and each module.

A panorama goes in; spherical-harmonic coefficients, irradiance maps, reflection maps and
pictures come out, and from pictures the lighting or the reflectance comes back.

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
from shjax import reflection as reflection
from shjax import render as render
from shjax.brdf import brdf_coefs as brdf_coefs
from shjax.brdf import choose_degrees as choose_degrees
from shjax.conventions import convert as convert
from shjax.display import tone_map as tone_map
from shjax.envmap import EnvironmentMap as EnvironmentMap
from shjax.envmap import make_envmap as make_envmap
from shjax.harmonics import analyze as analyze
from shjax.harmonics import basis as basis
from shjax.harmonics import evaluate as evaluate
from shjax.harmonics import multiply as multiply
from shjax.harmonics import power_spectrum as power_spectrum
from shjax.harmonics import project_samples as project_samples
from shjax.harmonics import rotate as rotate
from shjax.harmonics import synthesize as synthesize
from shjax.harmonics import wigner_d as wigner_d
from shjax.ibl import PrefilteredLight as PrefilteredLight
from shjax.ibl import prefilter_light as prefilter_light
from shjax.ibl import shade as shade
from shjax.irradiance import cosine_kernel as cosine_kernel
from shjax.irradiance import irradiance as irradiance
from shjax.irradiance import irradiance_coefs as irradiance_coefs
from shjax.irradiance import irradiance_from_matrix as irradiance_from_matrix
from shjax.irradiance import irradiance_matrix as irradiance_matrix
from shjax.irradiance import irradiance_polynomial as irradiance_polynomial
from shjax.lights import split_lights as split_lights
from shjax.reference import reference_irradiance as reference_irradiance
from shjax.reference import reference_reflection as reference_reflection
from shjax.reflection import ReflectionMap as ReflectionMap
from shjax.reflection import choose_model as choose_model
from shjax.reflection import prefilter as prefilter
from shjax.windows import dering as dering
from shjax.windows import window as window

if TYPE_CHECKING:
    from shjax import inverse as inverse
    from shjax import io as io
    from shjax import metrics as metrics
    from shjax import plot as plot
    from shjax.inverse import Estimate as Estimate
    from shjax.inverse import Surface as Surface
    from shjax.inverse import estimate_brdf as estimate_brdf
    from shjax.inverse import estimate_joint as estimate_joint
    from shjax.inverse import estimate_lighting as estimate_lighting

__version__ = "0.1.0"

_LAZY = {
    "io": "shjax.io",
    "inverse": "shjax.inverse",
    "metrics": "shjax.metrics",
    "plot": "shjax.plot",
    "Estimate": "shjax.inverse",
    "Surface": "shjax.inverse",
    "estimate_brdf": "shjax.inverse",
    "estimate_joint": "shjax.inverse",
    "estimate_lighting": "shjax.inverse",
}
__all__ = [
    "EnvironmentMap",
    "Estimate",
    "PrefilteredLight",
    "ReflectionMap",
    "Surface",
    "analyze",
    "basis",
    "brdf",
    "brdf_coefs",
    "choose_degrees",
    "choose_model",
    "convert",
    "cosine_kernel",
    "dering",
    "estimate_brdf",
    "estimate_joint",
    "estimate_lighting",
    "evaluate",
    "inverse",
    "io",
    "irradiance",
    "irradiance_coefs",
    "irradiance_from_matrix",
    "irradiance_matrix",
    "irradiance_polynomial",
    "lights",
    "make_envmap",
    "metrics",
    "multiply",
    "plot",
    "power_spectrum",
    "prefilter",
    "prefilter_light",
    "project_samples",
    "reference_irradiance",
    "reference_reflection",
    "reflection",
    "render",
    "rotate",
    "shade",
    "split_lights",
    "synthesize",
    "tone_map",
    "wigner_d",
    "window",
]


def __getattr__(name: str):
    if name not in _LAZY:
        raise AttributeError(f"module 'shjax' has no attribute {name!r}")
    module = importlib.import_module(_LAZY[name])
    return module if _LAZY[name] == f"shjax.{name}" else getattr(module, name)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
