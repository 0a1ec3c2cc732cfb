"""Image-based lighting: a light prefiltered once, every material per pixel.

What a renderer's split-sum does, with the error known beforehand: a chain of maps in
low-rank view bases of GGX (``ggx_tables``), nine irradiance coefficients, and the brightest
light sources apart, shaded by the BRDF itself. The material is glTF's metallic-roughness
model, :func:`shjax.brdf.metallic_roughness`.
"""

from shjax.ibl.material import LitMaterial
from shjax.ibl.prefiltered_light import PrefilteredLight, prefilter_light
from shjax.ibl.shading import shade

__all__ = [
    "LitMaterial",
    "PrefilteredLight",
    "prefilter_light",
    "shade",
]
