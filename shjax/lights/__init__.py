"""Light sources: suns and lamps of a panorama as caps, and area lights near a scene.

A sun in a panorama holds much of the light in a few pixels, and all degrees. Taken out as
a cap of equal flux it is shaded by the BRDF itself, and what is left is smooth.

Area lights (polygon, disk, ellipse, sphere, capsule, line) stand at a distance, so every
point sees another light: its coefficients, irradiance and reflection are exact integrals
over the outline that the point sees.
"""

from shjax.lights.area import area_coefs, area_irradiance, vector_irradiance
from shjax.lights.area_light import AreaLight
from shjax.lights.area_shading import area_reflection, area_shade
from shjax.lights.cap_shading import cap_reflection
from shjax.lights.caps import (
    CapLights,
    cap_coefs,
    cap_gains,
    cap_light,
    cap_nodes,
    directional_light,
    hemisphere_light,
)
from shjax.lights.in_words import parse
from shjax.lights.making import capsule, disk, ellipse, line, polygon, sphere
from shjax.lights.splitting import split_lights, take_lights

__all__ = [
    "AreaLight",
    "CapLights",
    "area_coefs",
    "area_irradiance",
    "area_reflection",
    "area_shade",
    "cap_coefs",
    "cap_gains",
    "cap_light",
    "cap_nodes",
    "cap_reflection",
    "capsule",
    "directional_light",
    "disk",
    "ellipse",
    "hemisphere_light",
    "line",
    "parse",
    "polygon",
    "sphere",
    "split_lights",
    "take_lights",
    "vector_irradiance",
]
