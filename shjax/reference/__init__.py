"""The integrals over the light itself: the truth that every approximation is compared with.

For irradiance and for reflection in any BRDF, from an environment map of any layout, its
samples included, or from a lat-long panorama array; and seeded orientations at which an
approximation's error is measured against them.
"""

from shjax.reference.irradiance_integral import irradiance_error
from shjax.reference.irradiance_integral import (
    reference_irradiance as reference_irradiance,
)
from shjax.reference.random_orientations import (
    MeasuredError,
    Orientations,
    draw_orientations,
    measured_error,
)
from shjax.reference.reflection_integral import (
    reference_reflection as reference_reflection,
)

__all__ = [
    "MeasuredError",
    "Orientations",
    "draw_orientations",
    "irradiance_error",
    "measured_error",
]
