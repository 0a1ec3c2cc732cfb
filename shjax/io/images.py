"""Images of linear light: read whatever their suffix says, written by their suffix."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from shjax.io import exr_writing, isolation, other, readers
from shjax.io.decoded import Decoded
from shjax.io.writing import replacing
from shjax.srgb import encode_srgb

MAX_PIXELS = 2**28
_WRITTEN = (".exr", ".hdr", ".png")
_RADIANCE_LIMIT = np.float32(2.0**127)


def read_image(
    path: str | os.PathLike,
    *,
    max_pixels: int = MAX_PIXELS,
    layer: str | None = None,
    alpha: str = "drop",
    primaries: str = "rec709",
    isolate: bool = False,
) -> Float[np.ndarray, "H W C"]:
    """Read an image as linear Rec. 709, whatever its suffix says.

    EXR, Radiance .hdr, PFM and .npy are known by their first bytes, a headerless .float
    probe by its suffix; anything else goes through OpenImageIO, whose 8- and 16-bit
    pictures are taken as sRGB and decoded to linear.

    Args:
        path: The file; or a folder that holds the six faces of a cube, named px, nx, py,
            ny, pz, nz (or right, left, top, bottom, front, back), which are stacked.
        max_pixels: Larger images are refused before they are decoded.
        layer: Name of a part or layer of an EXR; default the first in colour.
        alpha: What to do with an image's alpha: ``"drop"`` it, or ``"unpremultiply"``,
            divide by it first where the colours were multiplied by it (EXR, some TIFF;
            never PNG); ``"only"``: the alpha of a PNG or TIFF in their place.
        primaries: ``"rec709"``: other primaries (ACEScg, XYZ, ...) are converted;
            ``"keep"``: the file's own are left.
        isolate: Read in another process, which a file that crashes or hangs its reader
            cannot leave.

    Returns:
        ``(H, W, C)`` float32, C 1 or 3.

    Raises:
        OSError: If the file cannot be opened.
        ValueError: If its contents cannot be read; the message names the file.
    """
    decoded = decode(
        path,
        max_pixels=max_pixels,
        layer=layer,
        alpha=alpha,
        primaries=primaries,
        isolate=isolate,
    )
    return in_memory(Path(path), decoded)


def read_vectors(
    path: str | os.PathLike, *, layer: str | None = None, isolate: bool = False
) -> Float[np.ndarray, "H W 3"]:
    """Read normals or other vectors from an EXR's X, Y, Z (or R, G, B) as they are stored.

    Args:
        path: The file; what is no EXR is read as an image.
        layer: Prefix of an EXR's channels (``nn``, ``ViewLayer.Normal``) or name of a
            part; default the one that is called normal, or the only one.
        isolate: As in :func:`read_image`.

    Raises:
        OSError: If the file cannot be opened.
        ValueError: If it holds no vectors, or several layers of them and none is named.
    """
    decoded = decode(
        path, max_pixels=MAX_PIXELS, layer=layer, vectors=True, isolate=isolate
    )
    return in_memory(Path(path), decoded)


def decode(path: str | os.PathLike, *, isolate: bool, **options) -> Decoded:
    """Decode an image and tell how it was stored; arguments as of :func:`read_image`."""
    reader = isolation.read if isolate else readers.read
    return reader(Path(path), **options)


def in_memory(path: Path, decoded: Decoded) -> np.ndarray:
    """Load all pixels of an image that was read from ``path``."""
    with readers.naming(path):
        return decoded.pixels()


def write_image(
    path: str | os.PathLike,
    image: Float[np.ndarray, "H W C"] | UInt8[np.ndarray, "H W C"],
    *,
    attributes: Mapping[str, str] | None = None,
    channels: Sequence[str] | None = None,
    half: bool = False,
    compression: str = "zip",
    layout: str | None = None,
) -> None:
    """Write linear light: ``.exr`` and ``.hdr`` as it is, ``.png`` as 8-bit sRGB.

    Args:
        path: The file; its suffix chooses the format.
        image: Linear values; PNG clips them to [0, 1], so tone-map first. uint8 is
            written to a PNG as it stands, as values that are encoded already. A
            ``.hdr`` holds no negative or infinite values, neither it nor a PNG NaN.
        attributes: Texts stored in the header of an EXR.
        channels: Names of an EXR's channels, ``layer.R`` and the like; default Y, RGB,
            RGBA, or numbers.
        half: An EXR in 16 bits; values beyond 65504 are clipped to that.
        compression: Of an EXR: none, rle, zips, zip, piz (these lose nothing), pxr24,
            b44, b44a, dwaa or dwab.
        layout: An environment map's; OpenEXR's own two are marked in an EXR's header.

    Raises:
        OSError: If the file cannot be written.
        ValueError: If the suffix or the image's shape is not supported, or the format
            cannot hold a value of the image.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in _WRITTEN:
        raise ValueError(f"path must end in {', '.join(_WRITTEN)}; got {path}.")
    given = np.asarray(image)
    if given.ndim != 3 or 0 in given.shape:
        raise ValueError(f"image must have shape (H, W, C); got {given.shape}.")
    pixels = _writable(given, suffix)
    if channels is not None and len(set(channels)) != pixels.shape[-1]:
        raise ValueError(
            f"channels must hold {pixels.shape[-1]} different names; got {channels}."
        )
    if compression not in exr_writing.COMPRESSIONS:
        raise ValueError(
            f"compression must be one of {', '.join(exr_writing.COMPRESSIONS)}; "
            f"got {compression!r}."
        )
    if suffix != ".exr" and pixels.shape[-1] not in (1, 3):
        raise ValueError(f"{suffix} holds 1 or 3 channels; got {pixels.shape[-1]}.")
    with replacing(path) as temporary:
        if suffix == ".exr":
            exr_writing.write_exr(
                temporary,
                pixels,
                attributes or {},
                channels,
                half=half,
                compression=compression,
                layout=layout,
            )
        elif suffix == ".hdr":
            other.write_other(
                temporary, np.broadcast_to(pixels, (*pixels.shape[:2], 3))
            )
        else:
            levels = pixels
            if levels.dtype != np.uint8:
                levels = np.round(255 * encode_srgb(np.clip(pixels, 0, 1)))
            other.write_other(temporary, levels.astype(np.uint8))


def _writable(image: np.ndarray, suffix: str) -> np.ndarray:
    """The pixels as float32 (uint8 for an 8-bit PNG), or an error for what is no light.

    Raises:
        ValueError: If the format cannot hold a value.
    """
    if image.dtype == np.uint8 and suffix == ".png":
        return image
    if image.dtype != bool and not np.issubdtype(image.dtype, np.floating):
        encoded = " (uint8 is written as it is to .png)" * (image.dtype == np.uint8)
        raise ValueError(
            f"image must hold linear light in floating point; got {image.dtype}{encoded}."
        )
    with np.errstate(over="ignore"):
        pixels = image.astype(np.float32)
    beyond = np.isinf(pixels) & np.isfinite(image)
    rules = {
        "beyond float32": beyond,
        "NaN": np.isnan(pixels) if suffix != ".exr" else None,
        "infinite": np.isinf(pixels) if suffix == ".hdr" else None,
        "negative": pixels < 0 if suffix == ".hdr" else None,
        "at 2^127 or above": pixels >= _RADIANCE_LIMIT if suffix == ".hdr" else None,
    }
    for name, bad in rules.items():
        if bad is not None and np.any(bad):
            row, column, channel = np.argwhere(bad)[0]
            raise ValueError(
                f"image must hold what {suffix} can store; {int(bad.sum())} values are "
                f"{name}, the first at row {row}, column {column}, channel {channel}."
            )
    return pixels
