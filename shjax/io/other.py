"""Everything else, by OpenImageIO: TIFF, PNG, JPEG and what it was built with."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from shjax.io.colour_spaces import divided_by_alpha
from shjax.io.decoded import Decoded, check_size, colour_channels, from_array
from shjax.io.quiet import quiet
from shjax.srgb import decode_srgb

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
    image = np.asarray(pixels, np.float32).reshape(spec.height, spec.width, -1)
    image = _upright(image, spec.get_int_attribute("Orientation", 1))
    cover = None if spec.alpha_channel < 0 else image[..., spec.alpha_channel]
    if cover is not None:
        image = np.delete(image, spec.alpha_channel, axis=-1)
    if alpha == "only" and cover is not None:
        return from_array(cover[..., None], f"{name}, alpha alone")
    image, left = colour_channels(image)
    image, stored = _linear(image, spec)
    if cover is not None:
        multiplied = not spec.get_int_attribute("oiio:UnassociatedAlpha")
        divide = alpha == "unpremultiply" and multiplied
        image = divided_by_alpha(image, cover) if divide else image
        left += ", divided by alpha" if divide else ", alpha dropped"
    return from_array(image, f"{name}, {stored}{left}")


def _linear(image: np.ndarray, spec) -> tuple[np.ndarray, str]:
    """Linear light from what the file holds, and how it held it, in words."""
    import OpenImageIO as oiio

    kind = spec.format.basetype
    space = str(spec.get_string_attribute("oiio:ColorSpace")).lower()
    if kind in (oiio.UINT8, oiio.UINT16) and space not in _LINEAR:
        bits = 16 if kind == oiio.UINT16 else 8
        return decode_srgb(image).astype(np.float32), f"{bits}-bit sRGB decoded"
    if kind in (oiio.HALF, oiio.FLOAT, oiio.DOUBLE):
        return image, "linear"
    return image, f"linear, {spec.format} over its largest number"


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
    _check_whole(path, pixels)


def _check_whole(path: Path, pixels: np.ndarray) -> None:
    """Read back what was written: a full disk cuts a file without an error.

    Raises:
        OSError: If the file does not hold the pixels.
    """
    import OpenImageIO as oiio

    kind = oiio.UINT8 if pixels.dtype == np.uint8 else oiio.FLOAT
    with quiet():
        held = oiio.ImageBuf(str(path)).get_pixels(kind)
    whole = False
    if held is not None and held.shape == pixels.shape:
        largest = np.max(np.abs(pixels), axis=-1, keepdims=True)
        # Of RGBE, within two steps of its shared exponent.
        step = 0 if pixels.dtype == np.uint8 else largest / 64 + 1e-30
        whole = bool(np.all(np.abs(held.astype(float) - pixels) <= step))
    if not whole:
        raise OSError(f"{path}: was cut off while it was written (is the disk full?).")


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
