"""Files: environment maps and images in, images and tables out.

What a file format looks like is known here and nowhere else. EXR goes through OpenEXR,
Radiance .hdr through a reader of our own (the format's half step, which the libraries
leave out), all else through OpenImageIO. Outputs are written beside and renamed.
"""

from shjax.io.brdf_coefs import read_brdf_coefs, write_brdf_coefs
from shjax.io.coefs import read_coefs, write_coefs
from shjax.io.envmaps import read_envmap, shipped_panorama
from shjax.io.images import read_image, read_vectors, write_image
from shjax.io.prefiltered import lights_as_json, write_prefiltered
from shjax.io.writing import write_text

__all__ = [
    "lights_as_json",
    "read_brdf_coefs",
    "read_coefs",
    "read_envmap",
    "read_image",
    "read_vectors",
    "shipped_panorama",
    "write_brdf_coefs",
    "write_coefs",
    "write_image",
    "write_prefiltered",
    "write_text",
]
