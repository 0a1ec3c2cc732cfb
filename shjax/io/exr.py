"""OpenEXR: every pixel type, compression, tiling, part and layer the library reads.

References:
    [TechIntro] Technical introduction to OpenEXR: windows, luminance-chroma images.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from shjax.io.decoded import Decoded, check_size
from shjax.io.exr_channels import Group, picture_of, window_of
from shjax.io.quiet import quiet

MAGIC = b"\x76\x2f\x31\x01"
ALPHA_CHOICES = ("drop", "unpremultiply", "only")
# What makes a picture, in the order of preference.
_COLOURS = (("R", "G", "B"), ("X", "Y", "Z"), ("Y", "RY", "BY"), ("Y",))
_ALIASES = {
    "RED": "R",
    "GREEN": "G",
    "BLUE": "B",
    "ALPHA": "A",
    "L": "Y",
    "LUMINANCE": "Y",
    "GRAY": "Y",
    "GREY": "Y",
}
_CHANNELS_ALLOWED = 4  # channels of the largest image that all parts may hold together


def read_exr(
    path: Path,
    *,
    max_pixels: int,
    layer: str | None = None,
    alpha: str = "drop",
    primaries: str = "rec709",
) -> Decoded:
    """Read an EXR of RGB, XYZ, luminance-chroma or luminance as linear Rec. 709.

    Args:
        path: The file.
        max_pixels: Larger images are refused before they are decoded.
        layer: Name of a part or of a layer; default the first that is in colour, else
            the first.
        alpha: ``"drop"`` or ``"unpremultiply"``.
        primaries: ``"rec709"``, to which others are converted, or ``"keep"``.

    Raises:
        ValueError: If the file is damaged, too large, or has no such channels; without
            the file's name.
    """
    headers = _open(path, header_only=True).parts
    group = _choose(_groups(headers), headers, layer)
    samples = 0
    for part in headers:
        low, high = window_of(part.header, "dataWindow")
        check_size(high - low, max_pixels)
        area = int(np.prod(high - low))
        samples += area * len(part.header["channels"])
    if samples > _CHANNELS_ALLOWED * max_pixels:
        raise ValueError(
            f"{samples} samples in all channels; the limit is "
            f"{_CHANNELS_ALLOWED} x {max_pixels}"
        )
    header = headers[group.part].header
    first, last = window_of(header, "displayWindow")
    check_size(last - first, max_pixels)
    parts = _open(path, separate_channels=True).parts
    if len(parts) != len(headers):
        raise ValueError(f"{len(headers) - len(parts)} of its parts cannot be decoded")
    return picture_of(group, parts[group.part].channels, header, alpha, primaries)


def _open(path: Path, **options: bool):
    import OpenEXR

    with quiet():
        try:
            file = OpenEXR.File(str(path), **options)
        except Exception as error:  # the binding raises RuntimeError, ValueError, ...
            raise ValueError(f"OpenEXR cannot read it ({error})") from error
    if not file.parts:
        raise ValueError("OpenEXR cannot decode any part of it")
    return file


def _short(suffix: str) -> str:
    """A channel's letter, whatever it is called."""
    upper = suffix.upper()
    return _ALIASES.get(upper, upper)


def _groups(parts) -> list[Group]:
    found = []
    for number, part in enumerate(parts):
        layers: dict[str, dict[str, str]] = {}
        for channel in part.header["channels"]:
            prefix, _, suffix = channel.name.rpartition(".")
            short = _short(suffix)
            layers.setdefault(prefix, {}).setdefault(short, channel.name)
        for prefix, names in sorted(layers.items()):
            if set(names) - {"A"} == {"R"}:  # a grey picture of one channel
                names["Y"] = names["R"]
            kind = next((c for c in _COLOURS if set(c) <= set(names)), None)
            if (
                kind == ("X", "Y", "Z")
                and prefix
                and "chromaticities" not in part.header
            ):
                continue  # components of vectors: normals, positions
            if kind is not None:
                name = str(part.header.get("name", ""))
                found.append(Group(number, name, prefix, kind, names))
    return found


def _choose(groups: list[Group], parts, layer: str | None) -> Group:
    import OpenEXR

    names = [c.name for part in parts for c in part.header["channels"]]
    known = [
        group
        for group in groups
        if layer is None or layer in (group.prefix, group.part_name)
    ]
    if not known and layer is not None:
        called = ", ".join(group.called() for group in groups) or "none"
        raise ValueError(f"layer {layer!r} is not among its parts and layers: {called}")
    if not known:
        raise ValueError(
            f"has no R, G, B or Y channels; found {', '.join(names[:12]) or 'none'}"
            + "; x, y and z of a layer are vectors, not colours" * _has_vectors(names)
        )
    best = next((group for group in known if len(group.colour) == 3), known[0])
    storage = parts[best.part].header.get("type")
    if storage in (OpenEXR.deepscanline, OpenEXR.deeptile):
        raise ValueError("holds deep samples, not an image; flatten it first")
    return best


def _has_vectors(names: Sequence[str]) -> bool:
    """Whether a layer among channels holds vectors."""
    layers = {name.rpartition(".")[0] for name in names if "." in name}
    return any(
        {f"{layer}.{c}".upper() for c in "XYZ"} <= {name.upper() for name in names}
        for layer in layers
    )


def read_vectors(
    path: Path, *, max_pixels: int, layer: str | None = None
) -> np.ndarray:
    """Read three channels of an EXR as they are stored, ``(H, W, 3)``: normals, positions.

    Args:
        path: The file.
        max_pixels: Larger images are refused before they are decoded.
        layer: Prefix of the channels or name of a part; default the only one that has
            X, Y and Z, else R, G and B.

    Raises:
        ValueError: If there is no such layer, or several; without the file's name.
    """
    for part in _open(path, header_only=True).parts:
        low, high = window_of(part.header, "dataWindow")
        check_size(high - low, max_pixels)
    parts = _open(path, separate_channels=True).parts
    found: dict[str, tuple] = {}
    for part in parts:
        layers: dict[str, dict[str, object]] = {}
        for name, channel in part.channels.items():
            prefix, _, suffix = name.rpartition(".")
            short = _short(suffix)
            layers.setdefault(prefix, {})[short] = channel
        for prefix, channels in layers.items():
            for kind in (("X", "Y", "Z"), ("R", "G", "B")):
                if set(kind) <= set(channels):
                    called = prefix or str(part.header.get("name", ""))
                    found.setdefault(called, (kind, channels))
    known = ", ".join(name or "the file's own" for name in found) or "none"
    vectors = [name for name, (kind, _) in found.items() if kind[0] == "X"]
    if layer is None:
        named = [name for name in found if "normal" in name.lower()]
        wanted = named or vectors or list(found)
        if len(wanted) > 1:
            raise ValueError(f"which layer holds the vectors must be said: {known}")
        layer = wanted[0] if wanted else None
    if layer is None or layer not in found:
        raise ValueError(
            f"layer {layer!r} is not among its vectors and colours: {known}"
        )
    kind, channels = found[layer]
    planes = [np.asarray(channels[c].pixels, np.float32) for c in kind]
    return np.stack(planes, axis=-1)
