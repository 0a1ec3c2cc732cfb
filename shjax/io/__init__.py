"""Files: environment maps and images in, images and tables out.

What a file format looks like is known here and nowhere else. EXR goes through OpenEXR,
Radiance .hdr through a reader of our own (the format's half step, which the libraries
leave out), all else through OpenImageIO. Outputs are written beside and renamed.

Each name is imported when it is first used: the process that reads files for another
needs no JAX.
"""

from shjax import lazy

# Types are in __init__.pyi; a test compares the two.
_NAMES = {
    "brdf_coefs": (
        "read_brdf_coefs",
        "write_brdf_coefs",
    ),
    "coefs": (
        "read_coefs",
        "write_coefs",
    ),
    "envmaps": (
        "read_envmap",
        "shipped_panorama",
    ),
    "images": (
        "read_image",
        "read_vectors",
        "write_image",
    ),
    "prefiltered": (
        "lights_as_json",
        "write_prefiltered",
    ),
    "writing": ("write_text",),
}
_MODULES = ()

__getattr__, __dir__, __all__ = lazy.attach(__name__, _NAMES, _MODULES)
