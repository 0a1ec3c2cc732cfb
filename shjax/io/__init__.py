"""Files: environment maps and images in, images and tables out.

What a file format looks like is known here and nowhere else. EXR goes through OpenEXR,
Radiance .hdr through a reader of our own (the format's half step, which the libraries
leave out), all else through OpenImageIO. Outputs are written beside and renamed.
"""

from shjax.io.coefs import read_coefs as read_coefs
from shjax.io.coefs import write_coefs as write_coefs
from shjax.io.envmaps import read_envmap as read_envmap
from shjax.io.envmaps import shipped_panorama as shipped_panorama
from shjax.io.images import read_image as read_image
from shjax.io.images import read_vectors as read_vectors
from shjax.io.images import write_image as write_image
from shjax.io.kernels import read_brdf_coefs as read_brdf_coefs
from shjax.io.kernels import write_brdf_coefs as write_brdf_coefs
from shjax.io.prefiltered import lights_as_json as lights_as_json
from shjax.io.prefiltered import write_prefiltered as write_prefiltered
from shjax.io.writing import write_text as write_text
