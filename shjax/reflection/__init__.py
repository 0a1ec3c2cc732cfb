"""Reflection of distant light from any material, as one kind of object: a reflector.

A reflector gives the reflected radiance at normals and views and knows its own error.
Diffuse reflection is coefficients about the normal; a reflection map holds coefficients
over the view for each reflected direction R (the tangent, for fibres), in a view basis:
spherical harmonics (the SHRM of the thesis, local or global), zonal ones, or a low-rank
approximation; a reflection model, which :func:`choose_model` chooses by its error, is a
sum of these with the brightest light sources apart.

References:
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
"""

from shjax.reflection.choice import choose_model
from shjax.reflection.convolution import convolve, reflect, reflected_coefs
from shjax.reflection.diffuse import DiffuseReflection, lambertian
from shjax.reflection.energies import (
    Energies,
    PreparedLight,
    brdf_energies,
    prepare_light,
)
from shjax.reflection.explicit import (
    azimuthal_texture,
    dynamic_map,
    fit_views,
    icosahedral_maps,
    view_grid,
    view_maps,
)
from shjax.reflection.low_rank import LowRankBrdf, fit_low_rank
from shjax.reflection.model import ReflectionModel
from shjax.reflection.prefiltering import default_size, prefilter, prefilter_cube
from shjax.reflection.reflection_map import ReflectionMap
from shjax.reflection.reflector import Reflector

__all__ = [
    "DiffuseReflection",
    "Energies",
    "LowRankBrdf",
    "PreparedLight",
    "ReflectionMap",
    "ReflectionModel",
    "Reflector",
    "azimuthal_texture",
    "brdf_energies",
    "choose_model",
    "convolve",
    "default_size",
    "dynamic_map",
    "fit_low_rank",
    "fit_views",
    "icosahedral_maps",
    "lambertian",
    "prefilter",
    "prefilter_cube",
    "prepare_light",
    "reflect",
    "reflected_coefs",
    "view_grid",
    "view_maps",
]
