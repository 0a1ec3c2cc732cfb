"""Writing of EXR files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

COMPRESSIONS = (
    "none",
    "rle",
    "zips",
    "zip",
    "piz",
    "pxr24",
    "b44",
    "b44a",
    "dwaa",
    "dwab",
)


_NAMES = {1: ("Y",), 3: ("R", "G", "B"), 4: ("R", "G", "B", "A")}


def write_exr(
    path: Path,
    image: np.ndarray,
    attributes: Mapping[str, str],
    names: Sequence[str] | None = None,
    *,
    half: bool = False,
    compression: str = "zip",
    layout: str | None = None,
) -> None:
    """Write an EXR's channels: as named, else Y, RGB, RGBA, or numbered.

    Args:
        path: The file.
        image: ``(H, W, C)``.
        attributes: Texts for the header.
        names: Of the channels.
        half: 16 bits in place of 32; values beyond 65504 are clipped there.
        compression: One of :data:`COMPRESSIONS`.
        layout: OpenEXR's own layouts are marked in the header.

    Raises:
        OSError: If it cannot be written.
    """
    import OpenEXR

    channels = image.shape[-1]
    names = names or _NAMES.get(channels) or [f"c{k:04d}" for k in range(channels)]
    if half:
        limit = np.finfo(np.float16).max
        image = np.clip(image, -limit, limit).astype(np.float16)
    planes = {n: np.ascontiguousarray(image[..., k]) for k, n in enumerate(names)}
    word = "NO" if compression == "none" else compression.upper()
    marks = {
        "openexr_latlong": OpenEXR.ENVMAP_LATLONG,
        "openexr_cube": OpenEXR.ENVMAP_CUBE,
    }
    header = {
        "compression": getattr(OpenEXR, f"{word}_COMPRESSION"),
        "type": OpenEXR.scanlineimage,
        **attributes,
        **({"envmap": marks[layout]} if layout in marks else {}),
    }
    try:
        OpenEXR.File(header, planes).write(str(path))
    except RuntimeError as error:
        raise OSError(f"{path}: OpenEXR cannot write it ({error}).") from error
