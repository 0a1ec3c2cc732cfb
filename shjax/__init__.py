"""Lighting in frequency space, differentiable: see the README and each module.

A panorama goes in; spherical-harmonic coefficients, irradiance maps, reflection maps and
pictures come out, and from pictures the lighting or the reflectance comes back.

Frame: right-handed, +z up; a panorama's centre looks along +x and u = 0.25 along +y.
Basis: real, orthonormal, without Condon-Shortley phase; index ``l (l + 1) + m``.
Arrays: channel last, batch in front; coefficients are ``(..., K, C)``.
Light: linear radiance, W m^-2 sr^-1 or relative; angles in radians.

``import shjax`` loads nothing: each name is imported when it is first used, and what it
needs with it (JAX, OpenEXR, optimistix). The names are listed in ``__init__.pyi``.
"""

from shjax import lazy

# Types are in __init__.pyi; a test compares the two.
_NAMES = {
    "brdf": (
        "brdf_coefs",
        "choose_degrees",
    ),
    "clamped_cosine": (
        "cosine_kernel",
        "irradiance",
        "irradiance_coefs",
        "irradiance_from_matrix",
        "irradiance_matrix",
        "irradiance_polynomial",
    ),
    "conventions": ("convert",),
    "display": ("tone_map",),
    "envmap": (
        "EnvironmentMap",
        "make_envmap",
    ),
    "harmonics": (
        "analyze",
        "basis",
        "evaluate",
        "multiply",
        "power_spectrum",
        "project_samples",
        "rotate",
        "synthesize",
        "wigner_d",
    ),
    "ibl": (
        "PrefilteredLight",
        "prefilter_light",
        "shade",
    ),
    "inverse": (
        "Estimate",
        "Surface",
        "estimate_brdf",
        "estimate_joint",
        "estimate_lighting",
    ),
    "lights": ("split_lights",),
    "reference": (
        "reference_irradiance",
        "reference_reflection",
    ),
    "reflection": (
        "ReflectionMap",
        "choose_model",
        "prefilter",
    ),
    "windows": (
        "dering",
        "window",
    ),
}
_MODULES = (
    "brdf",
    "ibl",
    "inverse",
    "io",
    "lights",
    "ltc",
    "metrics",
    "plot",
    "reflection",
    "render",
)

__getattr__, __dir__, __all__ = lazy.attach(__name__, _NAMES, _MODULES)

__version__ = "0.1.0"
