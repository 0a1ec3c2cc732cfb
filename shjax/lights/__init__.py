"""Small bright lights apart from the rest: caps of the sphere, shaded exactly.

A sun in a panorama holds much of the light in a few pixels, and all degrees. Taken out as
a cap of equal flux it is shaded by the BRDF itself, and what is left is smooth.
"""

from shjax.lights.caps import CapLights as CapLights
from shjax.lights.caps import cap_coefs as cap_coefs
from shjax.lights.caps import cap_gains as cap_gains
from shjax.lights.caps import cap_light as cap_light
from shjax.lights.caps import cap_nodes as cap_nodes
from shjax.lights.caps import directional_light as directional_light
from shjax.lights.caps import hemisphere_light as hemisphere_light
from shjax.lights.shading import cap_reflection as cap_reflection
from shjax.lights.splitting import split_lights as split_lights
from shjax.lights.splitting import take_lights as take_lights
