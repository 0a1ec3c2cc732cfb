"""Light sources: suns and lamps as caps of the sphere, shaded exactly.

A sun in a panorama holds much of the light in a few pixels, and all degrees. Taken out as
a cap of equal flux it is shaded by the BRDF itself, and what is left is smooth.
"""

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
from shjax.lights.splitting import split_lights, take_lights

__all__ = [
    "CapLights",
    "cap_coefs",
    "cap_gains",
    "cap_light",
    "cap_nodes",
    "cap_reflection",
    "directional_light",
    "hemisphere_light",
    "split_lights",
    "take_lights",
]
