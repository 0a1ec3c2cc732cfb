"""OpenEXR: every pixel type, compression, tiling, part and layer the library reads.

References:
    [TechIntro] Technical introduction to OpenEXR: windows, luminance-chroma images.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from shjax.io import colour
from shjax.io.decoded import Decoded, check_size
from shjax.io.quiet import quiet

MAGIC = b"\x76\x2f\x31\x01"
COMPRESSIONS = (
    "none", "rle", "zips", "zip", "piz", "pxr24", "b44", "b44a", "dwaa", "dwab",
)  # fmt: skip
ALPHA_CHOICES = ("drop", "unpremultiply", "only")
_NAMES = {1: ("Y",), 3: ("R", "G", "B"), 4: ("R", "G", "B", "A")}
# What makes a picture, in the order of preference.
_COLOURS = (("R", "G", "B"), ("X", "Y", "Z"), ("Y", "RY", "BY"), ("Y",))
_ALIASES = {
    "RED": "R", "GREEN": "G", "BLUE": "B", "ALPHA": "A",
    "L": "Y", "LUMINANCE": "Y", "GRAY": "Y", "GREY": "Y",
}  # fmt: skip
_CHANNELS_ALLOWED = 4  # channels of the largest image that all parts may hold together


@dataclasses.dataclass(frozen=True)
class _Group:
    """One picture of a file: a part, a layer's prefix, and what its channels are."""

    part: int
    part_name: str
    prefix: str
    colour: tuple[str, ...]
    names: dict[str, str]  # R, G, ... to the channel's whole name

    def called(self) -> str:
        return self.prefix or self.part_name or "the file's own"


def read_exr(
    path: Path,
    *,
    max_pixels: int,
    layer: str | None = None,
    alpha: str = "drop",
    primaries: str = "rec709",
) -> Decoded:
    """Read RGB, XYZ, luminance-chroma or luminance as linear Rec. 709.

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
        low, high = _window(part.header, "dataWindow")
        check_size(high - low, max_pixels)
        area = int(np.prod(high - low))
        samples += area * len(part.header["channels"])
    if samples > _CHANNELS_ALLOWED * max_pixels:
        raise ValueError(
            f"{samples} samples in all channels; the limit is "
            f"{_CHANNELS_ALLOWED} x {max_pixels}"
        )
    header = headers[group.part].header
    first, last = _window(header, "displayWindow")
    check_size(last - first, max_pixels)
    parts = _open(path, separate_channels=True).parts
    if len(parts) != len(headers):
        raise ValueError(f"{len(headers) - len(parts)} of its parts cannot be decoded")
    return _picture(group, parts[group.part].channels, header, alpha, primaries)


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


def _groups(parts) -> list[_Group]:
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
                found.append(_Group(number, name, prefix, kind, names))
    return found


def _choose(groups: list[_Group], parts, layer: str | None) -> _Group:
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
    """Three channels as they are stored, ``(H, W, 3)``: normals, positions.

    Args:
        path: The file.
        max_pixels: Larger images are refused before they are decoded.
        layer: Prefix of the channels or name of a part; default the only one that has
            X, Y and Z, else R, G and B.

    Raises:
        ValueError: If there is no such layer, or several; without the file's name.
    """
    for part in _open(path, header_only=True).parts:
        low, high = _window(part.header, "dataWindow")
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


def _window(header: Mapping, name: str) -> tuple[np.ndarray, np.ndarray]:
    """First row and column of a window, and those past its end."""
    low, high = (np.asarray(corner, np.int64)[::-1] for corner in header[name])
    return low, high + 1


def _picture(
    group: _Group, channels, header: Mapping, alpha: str, primaries: str
) -> Decoded:
    planes = {}
    low, high = _window(header, "dataWindow")
    size = high - low
    for name in group.colour + ("A",) * ("A" in group.names):
        channel = channels[group.names[name]]
        plane = np.asarray(channel.pixels)
        steps = np.array([channel.ySampling, channel.xSampling])
        expected = -(-size // steps)  # the window starts at a multiple of the steps
        if plane.ndim != 2 or tuple(plane.shape) != tuple(expected):
            raise ValueError(f"channel {channel.name} does not fill its data window")
        if np.any(steps != 1):
            plane = _upsampled(plane, size, steps)
        planes[name] = plane
    weights, matrix, said = _colours(group, header, primaries)
    kinds = sorted({str(plane.dtype).replace("16", " 16") for plane in planes.values()})
    kind = {"float 16": "half", "float32": "float", "uint32": "uint"}
    words = ["OpenEXR " + "/".join(kind.get(k, k) for k in kinds)]
    words += [f"layer {group.called()}"] * bool(group.prefix or group.part_name)
    words += said
    if "A" in planes:
        words.append("alpha dropped" if alpha == "drop" else "divided by alpha")
    first, last = _window(header, "displayWindow")
    inside = (np.maximum(first, low), np.minimum(last, high))
    if np.any(inside[0] >= inside[1]):
        raise ValueError("its data window lies outside its display window")
    if np.any(inside[0] > first) or np.any(inside[1] < last):
        words.append("black outside its data window")
    elif np.any(first != low) or np.any(last != high):
        words.append("cropped to its display window")

    def rows(start: int, stop: int) -> np.ndarray:
        band = np.zeros(
            (stop - start, int(last[1] - first[1]), channels_out), np.float32
        )
        top, bottom = (
            max(first[0] + start, inside[0][0]),
            min(first[0] + stop, inside[1][0]),
        )
        if top < bottom:
            held = (
                slice(int(top - low[0]), int(bottom - low[0])),
                slice(int(inside[0][1] - low[1]), int(inside[1][1] - low[1])),
            )
            values = _mixed(planes, held, group.colour, weights, matrix, alpha)
            left = int(inside[0][1] - first[1])
            at = int(top - first[0]) - start
            band[at : at + len(values), left : left + values.shape[1]] = values
        return band

    channels_out = 1 if group.colour == ("Y",) else 3
    height, width = (int(n) for n in last - first)
    return Decoded(
        (height, width, channels_out), rows, ", ".join(words), _layout(header),
        matrix=matrix,
    )  # fmt: skip


def _colours(
    group: _Group, header: Mapping, primaries: str
) -> tuple[np.ndarray, np.ndarray | None, list[str]]:
    """Luminance weights, the matrix to Rec. 709, and what to say of them."""
    given = header.get("chromaticities")
    space = colour.REC709 if given is None else tuple(np.ravel(given))
    if group.colour == ("X", "Y", "Z"):
        space = colour.XYZ
    weights = colour.luminance_weights(
        space if group.colour == ("Y", "RY", "BY") else colour.REC709
    )
    said = ["luminance-chroma"] * (group.colour == ("Y", "RY", "BY"))
    if group.colour == ("Y",):
        return weights, None, said
    matrix, name = colour.to_rec709(space)
    if matrix is not None and primaries == "keep":
        return weights, None, [*said, f"{name} kept"]
    if matrix is not None:
        said.append(f"{name} converted to Rec. 709")
    return weights, matrix, said


def _mixed(planes, held, names, weights, matrix, alpha: str) -> np.ndarray:
    """A band of planes as channels of linear Rec. 709."""
    with np.errstate(all="ignore"):
        parts = [planes[name][held].astype(np.float32) for name in names]
        if names == ("Y", "RY", "BY"):
            luminance, red, blue = parts
            red, blue = (red + 1) * luminance, (blue + 1) * luminance
            green = (luminance - weights[0] * red - weights[2] * blue) / weights[1]
            parts = [red, green, blue]
        values = np.stack(parts, axis=-1)
        if matrix is not None:
            values = values @ matrix.T.astype(np.float32)
        if alpha == "unpremultiply" and "A" in planes:
            values = colour.divided_by_alpha(
                values, planes["A"][held].astype(np.float32)
            )
    return values


def _upsampled(plane: np.ndarray, size: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """A channel stored at every n-th pixel, read bilinearly at each."""
    if 0 in plane.shape:
        raise ValueError("a subsampled channel holds no samples")
    result = plane.astype(np.float32)
    for axis in (0, 1):
        n = result.shape[axis]
        at = np.minimum(np.arange(size[axis]) / steps[axis], n - 1)
        left = np.minimum(at.astype(int), n - 1)
        right = np.minimum(left + 1, n - 1)
        share = (at - left).astype(np.float32)
        share = share[:, None] if axis == 0 else share
        before, after = np.take(result, left, axis), np.take(result, right, axis)
        result = before * (1 - share) + after * share
    return result


def _layout(header: Mapping) -> str | None:
    import OpenEXR

    return {
        OpenEXR.ENVMAP_LATLONG: "openexr_latlong",
        OpenEXR.ENVMAP_CUBE: "openexr_cube",
    }.get(header.get("envmap"))


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
    """Write channels: as named, else Y, RGB, RGBA, or numbered.

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
        "openexr_latlong": OpenEXR.ENVMAP_LATLONG, "openexr_cube": OpenEXR.ENVMAP_CUBE
    }  # fmt: skip
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
