"""Images of linear light by the suffix or the first bytes of their file."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from shjax.io import exr, radiance
from shjax.io.writing import replacing

_WRITTEN = (".exr", ".hdr", ".png")


def read_image(
    path: str | os.PathLike, *, max_pixels: int = 2**28
) -> Float[np.ndarray, "H W C"]:
    """Read an image as linear light, whatever its suffix says.

    EXR and Radiance .hdr by their first bytes; anything else through OpenImageIO, whose
    8- and 16-bit pictures are taken as sRGB and decoded to linear.

    Args:
        path: The file.
        max_pixels: Larger images are refused before they are decoded.

    Returns:
        ``(H, W, C)`` float32.

    Raises:
        OSError: If the file cannot be opened.
        ValueError: If its contents cannot be read; the message names the file.
    """
    return read_with_format(Path(path), max_pixels=max_pixels)[0]


def read_with_format(path: Path, *, max_pixels: int) -> tuple[np.ndarray, str]:
    """The image and how it was stored, in words."""
    if path.is_dir():
        raise IsADirectoryError(f"{path}: is a folder, not an image.")
    try:
        with path.open("rb") as file:
            start = file.read(16)
    except OSError as error:
        raise type(error)(f"{path}: {error.strerror or error}.") from None
    if not start:
        raise ValueError(f"{path}: the file is empty.")
    if start.startswith(exr.MAGIC):
        return exr.read_exr(path, max_pixels=max_pixels), "OpenEXR"
    if start.startswith(radiance.MAGIC):
        image = radiance.read_radiance(path, max_pixels=max_pixels)
        return image, "Radiance RGBE (half step decoded)"
    return _read_other(path, max_pixels)


def write_image(
    path: str | os.PathLike,
    image: Float[np.ndarray, "H W C"],
    *,
    attributes: Mapping[str, str] | None = None,
    channels: Sequence[str] | None = None,
) -> None:
    """Write linear light: ``.exr`` and ``.hdr`` as it is, ``.png`` as 8-bit sRGB.

    Args:
        path: The file; its suffix chooses the format.
        image: Linear values; PNG clips them to [0, 1], so tone-map first.
        attributes: Texts stored in the header of an EXR.
        channels: Names of an EXR's channels, ``layer.R`` and the like; default Y, RGB,
            RGBA, or numbers.

    Raises:
        OSError: If the file cannot be written.
        ValueError: If the suffix or the image's shape is not supported.
    """
    suffix = Path(path).suffix.lower()
    pixels = np.asarray(image, np.float32)
    if suffix not in _WRITTEN:
        raise ValueError(f"path must end in {', '.join(_WRITTEN)}; got {path}.")
    if pixels.ndim != 3 or 0 in pixels.shape:
        raise ValueError(f"image must have shape (H, W, C); got {pixels.shape}.")
    if channels is not None and len(set(channels)) != pixels.shape[-1]:
        raise ValueError(
            f"channels must hold {pixels.shape[-1]} different names; got {channels}."
        )
    if suffix != ".exr" and pixels.shape[-1] not in (1, 3):
        raise ValueError(f"{suffix} holds 1 or 3 channels; got {pixels.shape[-1]}.")
    with replacing(path) as temporary:
        if suffix == ".exr":
            exr.write_exr(temporary, pixels, attributes or {}, channels)
        elif suffix == ".hdr":
            _write_other(temporary, np.broadcast_to(pixels, (*pixels.shape[:2], 3)))
        else:
            levels = np.round(255 * encode_srgb(np.clip(pixels, 0, 1)))
            _write_other(temporary, levels.astype(np.uint8))


def encode_srgb(linear: np.ndarray) -> np.ndarray:
    """Linear light in [0, 1] to sRGB [IEC 61966-2-1]."""
    curve = 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(linear <= 0.0031308, 12.92 * linear, curve)


def decode_srgb(encoded: np.ndarray) -> np.ndarray:
    """The inverse of :func:`encode_srgb`."""
    curve = ((np.maximum(encoded, 0.04045) + 0.055) / 1.055) ** 2.4
    return np.where(encoded <= 0.04045, encoded / 12.92, curve)


def _read_other(path: Path, max_pixels: int) -> tuple[np.ndarray, str]:
    import OpenImageIO as oiio

    source = oiio.ImageInput.open(str(path))
    if source is None:
        reason = oiio.geterror().strip().splitlines() or ["unknown format"]
        raise ValueError(f"{path}: not an image that can be read ({reason[0]}).")
    try:
        spec = source.spec()
        if not 0 < spec.width * spec.height <= max_pixels:
            raise ValueError(
                f"{path}: {spec.width} x {spec.height} pixels; the limit is {max_pixels}."
            )
        pixels = source.read_image("float")
        if pixels is None:
            raise ValueError(f"{path}: damaged ({source.geterror()}).")
    finally:
        source.close()
    image = np.asarray(pixels, np.float32).reshape(spec.height, spec.width, -1)
    image = image[..., : 1 if image.shape[-1] < 3 else 3]  # alpha is dropped
    name = source.format_name()
    if spec.format.basetype in (oiio.UINT8, oiio.UINT16):
        return decode_srgb(image).astype(np.float32), f"{name} (sRGB decoded)"
    return image, name


def _write_other(path: Path, pixels: np.ndarray) -> None:
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
