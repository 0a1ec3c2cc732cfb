"""Everything else, by OpenImageIO: TIFF, PNG, JPEG and what it was built with."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from shjax.io.colour import decode_srgb, divided_by_alpha
from shjax.io.decoded import Decoded, check_size, colour_channels, from_array
from shjax.io.quiet import quiet

_LINEAR = ("linear", "scene_linear", "lin_rec709", "lin_rec709_scene", "lin_srgb")
_REFUSED = ("null", "term")  # formats that make a picture of nothing


def read_other(path: Path, *, max_pixels: int, alpha: str = "drop") -> Decoded:
    """Read an image; 8 and 16 bits are taken as sRGB unless the file says otherwise.

    Colours come as the file stores them: a PNG's are not multiplied by its alpha.

    Raises:
        ValueError: If it is no image, damaged or too large; without the file's name.
    """
    with quiet():
        return _read(path, max_pixels, alpha)


def _read(path: Path, max_pixels: int, alpha: str) -> Decoded:
    import OpenImageIO as oiio

    as_stored = oiio.ImageSpec()
    as_stored.attribute("oiio:UnassociatedAlpha", 1)
    source = oiio.ImageInput.open(str(path), as_stored)
    if source is None:
        raise ValueError(f"not an image that can be read ({_reason(oiio.geterror())})")
    try:
        spec = source.spec()
        name = source.format_name()
        if name in _REFUSED:
            raise ValueError("not an image that can be read (unknown format)")
        check_size((spec.height, spec.width), max_pixels)
        if spec.depth > 1 or spec.deep:
            raise ValueError("holds a volume or deep samples, not an image")
        if spec.nchannels > 16:
            raise ValueError(f"{spec.nchannels} channels; at most 16 are read")
        pixels = source.read_image("float")
        if pixels is None:
            raise ValueError(f"damaged ({_reason(source.geterror())})")
    finally:
        source.close()
    pixels = np.asarray(pixels, np.float32).reshape(spec.height, spec.width, -1)
    pixels = _upright(pixels, spec.get_int_attribute("Orientation", 1))
    opacity = spec.alpha_channel
    if opacity < 0:
        image, left = colour_channels(pixels)
    else:
        image, left = colour_channels(np.delete(pixels, opacity, axis=-1))
        left += ", alpha dropped"
    space = str(spec.get_string_attribute("oiio:ColorSpace")).lower()
    encoded = spec.format.basetype in (oiio.UINT8, oiio.UINT16)
    if encoded and space not in _LINEAR:
        bits = 16 if spec.format.basetype == oiio.UINT16 else 8
        image, stored = (
            decode_srgb(image).astype(np.float32),
            f"{bits}-bit sRGB decoded",
        )
    elif spec.format.basetype in (oiio.HALF, oiio.FLOAT, oiio.DOUBLE):
        stored = "linear"
    else:
        stored = f"linear, {spec.format} over its largest number"
    multiplied = not spec.get_int_attribute("oiio:UnassociatedAlpha")
    if alpha == "unpremultiply" and opacity >= 0 and multiplied:
        image = divided_by_alpha(image, pixels[..., opacity])
        left = left.replace("alpha dropped", "divided by alpha")
    return from_array(image, f"{name}, {stored}{left}")


def write_other(path: Path, pixels: np.ndarray) -> None:
    """Write uint8 or float pixels in the format of the suffix.

    Raises:
        OSError: If it cannot be written.
    """
    import OpenImageIO as oiio

    height, width, channels = pixels.shape
    kind = "uint8" if pixels.dtype == np.uint8 else "float"
    target = oiio.ImageOutput.create(str(path))
    spec = oiio.ImageSpec(width, height, channels, kind)
    if target is None or not target.open(str(path), spec):
        raise OSError(f"{path}: OpenImageIO cannot write it ({oiio.geterror()}).")
    written = target.write_image(np.ascontiguousarray(pixels))
    if not (target.close() and written):
        raise OSError(f"{path}: OpenImageIO cannot write it ({target.geterror()}).")


def _upright(image: np.ndarray, orientation: int) -> np.ndarray:
    """Turn a photograph as its Exif orientation (1 to 8) says."""
    if orientation in (5, 6, 7, 8):
        image = image.transpose(1, 0, 2)
    if orientation in (3, 4, 7, 8):
        image = image[::-1]
    if orientation in (2, 3, 6, 7):
        image = image[:, ::-1]
    return image


def _reason(text: str) -> str:
    lines = text.strip().splitlines()
    return lines[0] if lines else "unknown format"
