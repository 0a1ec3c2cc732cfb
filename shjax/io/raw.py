"""Plain arrays of numbers: PFM, NumPy's .npy, and headerless .float light probes.

All are mapped, not read: a band at a time comes from the disk.

References:
    [PFM] Debevec. PFM: rows from the bottom up, a scale whose sign is the byte order.
    (OpenImageIO 3.2 hands PFM rows over as stored, upside down.)
"""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path

import numpy as np

from shjax.io.decoded import Decoded, check_size, colour_channels, from_array, oriented

PFM_MAGIC = (b"PF\n", b"Pf\n", b"PF ", b"Pf ", b"PF\r", b"Pf\r")
NPY_MAGIC = b"\x93NUMPY"
_GAP = rb"(?:\s|#[^\n]*\n)+"  # white space and comments
_PFM_HEADER = re.compile(
    _GAP.join((rb"P([Ff])", rb"(\d{1,9})", rb"(\d{1,9})", rb"([-+.\deE]{1,40})\s"))
)


def read_pfm(path: Path, *, max_pixels: int) -> Decoded:
    """Read a portable float map.

    Raises:
        ValueError: If the file is damaged or too large; without the file's name.
    """
    with path.open("rb") as file:
        head = _PFM_HEADER.match(file.read(1024))
    if head is None:
        raise ValueError("a PFM without width, height and scale")
    width, height = int(head[2]), int(head[3])
    check_size((height, width), max_pixels)
    channels = 3 if head[1] == b"F" else 1
    try:
        scale = float(head[4])
    except ValueError:
        scale = 0.0
    if scale == 0 or not math.isfinite(scale):
        raise ValueError(
            f"a PFM's scale must be a number but 0; got {head[4].decode()}"
        )
    order = "<f4" if scale < 0 else ">f4"
    image = _mapped(path, order, head.end(), (height, width, channels))
    kind = "PFM" if abs(scale) == 1 else f"PFM, scale {abs(scale):g} applied"
    found = oriented(from_array(image, kind), flip_rows=True, flip_columns=False)
    if abs(scale) == 1:
        return found
    gain = np.float32(abs(scale))
    return dataclasses.replace(found, rows=lambda a, b: found.rows(a, b) * gain)


def read_npy(path: Path, *, max_pixels: int) -> Decoded:
    """Read a NumPy array ``(H, W)`` or ``(H, W, C)`` of floating-point numbers.

    Raises:
        ValueError: If the array is of another kind or too large; without the file's name.
    """
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # a damaged header raises many kinds
        raise ValueError(f"NumPy cannot read it ({error})") from error
    if array.dtype.kind != "f" or array.ndim not in (2, 3):
        raise ValueError(
            f"must hold floating-point (H, W) or (H, W, C); got {array.dtype} {array.shape}"
        )
    image = array[..., None] if array.ndim == 2 else array
    check_size(image.shape[:2], max_pixels)
    if not 1 <= image.shape[2] <= 4:
        raise ValueError(f"must have 1 to 4 channels; got {image.shape[2]}")
    image, left = colour_channels(image)
    return from_array(image, f"npy {array.dtype}{left}")


def read_float(path: Path, *, max_pixels: int) -> Decoded:
    """Read a headerless square light probe: RGB in 32-bit floats, either byte order.

    Raises:
        ValueError: If the file's length is no square's; without the file's name.
    """
    length = path.stat().st_size
    side = math.isqrt(length // 12)
    if side * side * 12 != length:
        raise ValueError(
            f"a .float probe holds side^2 x 3 floats of 4 bytes; got {length} bytes"
        )
    check_size((side, side), max_pixels)
    both = [_mapped(path, order, 0, (side, side, 3)) for order in ("<f4", ">f4")]
    image = max(both, key=_plausible)
    order = "little" if image.dtype.str[0] == "<" else "big"
    return from_array(image, f"raw floats, {order}-endian (told from the values)")


def _plausible(image: np.ndarray) -> float:
    """Share of values that a picture could hold, from some hundred rows."""
    some = image[:: max(len(image) // 100, 1)].astype(np.float32)
    with np.errstate(invalid="ignore"):
        size = np.abs(some)
        return float(np.mean((some == 0) | ((size > 1e-10) & (size < 1e10))))


def _mapped(path: Path, order: str, offset: int, shape: tuple[int, ...]) -> np.ndarray:
    if path.stat().st_size < offset + 4 * math.prod(shape):
        raise ValueError("damaged or cut off in its pixels")
    return np.memmap(path, order, "r", offset, shape)
