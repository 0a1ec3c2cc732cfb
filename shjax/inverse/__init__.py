"""Inverse rendering: from pictures back to lighting and reflectance, with error bars.

Three entry points (:func:`estimate_lighting`, :func:`estimate_brdf`,
:func:`estimate_joint`) and, for what else is unknown, :func:`estimate_albedo` and
:func:`estimate_exposure`. Rooms: ``shown``, what a pixel receives of the light;
``linear``, least squares and priors; ``reflectance``, lobes and their parameters.
"""

from shjax.inverse.albedo import AlbedoEstimate, estimate_albedo
from shjax.inverse.brdf import estimate_brdf
from shjax.inverse.estimate import Estimate
from shjax.inverse.exposure import ExposureEstimate, estimate_exposure
from shjax.inverse.joint import estimate_joint
from shjax.inverse.lighting import estimate_lighting
from shjax.inverse.linear.priors import PicturePrior
from shjax.inverse.nonnegative import nonnegative
from shjax.inverse.reflectance.families import Lobe, LobeFamily, ShapeParameter
from shjax.inverse.reflectance.lobes import General, Radial, lobe
from shjax.inverse.shown.pixels import Decoded, decode
from shjax.inverse.shown.rows import visible_cosine
from shjax.inverse.shown.surface import Surface

__all__ = [
    "AlbedoEstimate",
    "Decoded",
    "Estimate",
    "ExposureEstimate",
    "General",
    "Lobe",
    "LobeFamily",
    "PicturePrior",
    "Radial",
    "ShapeParameter",
    "Surface",
    "decode",
    "estimate_albedo",
    "estimate_brdf",
    "estimate_exposure",
    "estimate_joint",
    "estimate_lighting",
    "lobe",
    "nonnegative",
    "visible_cosine",
]
