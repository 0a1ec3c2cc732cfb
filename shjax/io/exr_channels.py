"""Planes of an EXR as linear Rec. 709: luminance-chroma, XYZ, other primaries, windows."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from shjax.io import colour_spaces
from shjax.io.decoded import Decoded


@dataclasses.dataclass(frozen=True)
class Group:
    """One picture of a file: a part, a layer's prefix, and what its channels are."""

    part: int
    part_name: str
    prefix: str
    colour: tuple[str, ...]
    names: dict[str, str]  # R, G, ... to the channel's whole name

    def called(self) -> str:
        """Name for messages."""
        return self.prefix or self.part_name or "the file's own"


def window_of(header: Mapping, name: str) -> tuple[np.ndarray, np.ndarray]:
    """First row and column of a window, and those past its end."""
    low, high = (np.asarray(corner, np.int64)[::-1] for corner in header[name])
    return low, high + 1


def picture_of(
    group: Group, channels, header: Mapping, alpha: str, primaries: str
) -> Decoded:
    """Decode one picture of a file to linear Rec. 709."""
    planes = {}
    low, high = window_of(header, "dataWindow")
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
    first, last = window_of(header, "displayWindow")
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
        (height, width, channels_out),
        rows,
        ", ".join(words),
        layout_of(header),
        matrix=matrix,
    )


def _colours(
    group: Group, header: Mapping, primaries: str
) -> tuple[np.ndarray, np.ndarray | None, list[str]]:
    """Luminance weights, the matrix to Rec. 709, and what to say of them."""
    given = header.get("chromaticities")
    space = colour_spaces.REC709 if given is None else tuple(np.ravel(given))
    if group.colour == ("X", "Y", "Z"):
        space = colour_spaces.XYZ
    weights = colour_spaces.luminance_weights(
        space if group.colour == ("Y", "RY", "BY") else colour_spaces.REC709
    )
    said = ["luminance-chroma"] * (group.colour == ("Y", "RY", "BY"))
    if group.colour == ("Y",):
        return weights, None, said
    matrix, name = colour_spaces.to_rec709(space)
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
            values = colour_spaces.divided_by_alpha(
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


def layout_of(header: Mapping) -> str | None:
    """Layout of the environment map that a header declares, or None."""
    import OpenEXR

    return {
        OpenEXR.ENVMAP_LATLONG: "openexr_latlong",
        OpenEXR.ENVMAP_CUBE: "openexr_cube",
    }.get(header.get("envmap"))
