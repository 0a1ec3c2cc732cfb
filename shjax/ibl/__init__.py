"""Image-based lighting: a light prefiltered once, every material per pixel.

What a renderer's split-sum does, with the error known beforehand: a chain of maps in the
adapted view basis of GGX (``adapted``), nine irradiance coefficients, and the brightest
small lights apart, shaded by the BRDF itself. The material is glTF's metallic-roughness
model, :func:`shjax.brdf.metallic_roughness`.
"""

from shjax.ibl.prediction import predicted_shading_error as predicted_shading_error
from shjax.ibl.prefiltering import PrefilteredLight as PrefilteredLight
from shjax.ibl.prefiltering import prefilter_light as prefilter_light
from shjax.ibl.shading import shade as shade
