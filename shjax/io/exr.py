"""OpenEXR: linear RGB or grey, half or float, any compression."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

MAGIC = b"\x76\x2f\x31\x01"
_NAMES = {1: ("Y",), 3: ("R", "G", "B"), 4: ("R", "G", "B", "A")}


def read_exr(path: Path, *, max_pixels: int) -> np.ndarray:
    """Read the first part's RGB, or its Y, as ``(H, W, 3 or 1)`` float32.

    Raises:
        ValueError: If the file is damaged, too large, or has no such channels.
    """
    height, width = _checked_size(
        path, _open(path, header_only=True).header(), max_pixels
    )
    channels = _open(path, separate_channels=True).channels()
    names = next((n for n in (_NAMES[3], _NAMES[1]) if set(n) <= set(channels)), None)
    if names is None:
        found = ", ".join(channels) or "none"
        raise ValueError(f"{path}: has no R, G, B or Y channels; found {found}.")
    planes = [np.asarray(channels[name].pixels, np.float32) for name in names]
    if any(plane.shape != (height, width) for plane in planes):
        raise ValueError(f"{path}: subsampled channels are not supported.")
    return np.stack(planes, axis=-1)


def _open(path: Path, **options: bool):
    import OpenEXR

    with _quiet_library():
        try:
            file = OpenEXR.File(str(path), **options)
            file.header()  # raises where the file holds no part
        except Exception as error:  # the binding raises RuntimeError, ValueError, ...
            raise ValueError(f"{path}: OpenEXR cannot read it ({error}).") from error
    return file


def _checked_size(path: Path, header: Mapping, max_pixels: int) -> tuple[int, int]:
    low, high = (np.asarray(corner, np.int64) for corner in header["dataWindow"])
    width, height = (int(n) for n in high - low + 1)
    if not 0 < width * height <= max_pixels:
        raise ValueError(
            f"{path}: {width} x {height} pixels; the limit is {max_pixels}."
        )
    display = header["displayWindow"]
    if not (np.array_equal(low, display[0]) and np.array_equal(high, display[1])):
        raise ValueError(
            f"{path}: its data window differs from its display window; not supported."
        )
    return height, width


def write_exr(
    path: Path,
    image: np.ndarray,
    attributes: Mapping[str, str],
    names: Sequence[str] | None = None,
) -> None:
    """Write float32 channels, zip-compressed: as named, else Y, RGB, RGBA, or numbered.

    Raises:
        OSError: If it cannot be written.
    """
    import OpenEXR

    channels = image.shape[-1]
    names = names or _NAMES.get(channels) or [f"c{k:04d}" for k in range(channels)]
    planes = {n: np.ascontiguousarray(image[..., k]) for k, n in enumerate(names)}
    header = {
        "compression": OpenEXR.ZIP_COMPRESSION,
        "type": OpenEXR.scanlineimage,
        **attributes,
    }
    try:
        OpenEXR.File(header, planes).write(str(path))
    except RuntimeError as error:
        raise OSError(f"{path}: OpenEXR cannot write it ({error}).") from error


@contextlib.contextmanager
def _quiet_library() -> Iterator[None]:
    """Keep the C library from printing beside the exception that it also raises."""
    sys.stdout.flush()
    sys.stderr.flush()
    saved = [os.dup(stream) for stream in (1, 2)]
    sink = os.open(os.devnull, os.O_WRONLY)
    try:
        for stream in (1, 2):
            os.dup2(sink, stream)
        yield
    finally:
        for stream, kept in zip((1, 2), saved, strict=True):
            os.dup2(kept, stream)
            os.close(kept)
        os.close(sink)
