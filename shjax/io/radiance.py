"""Radiance .hdr (RGBE and XYZE), with the format's own decoding.

A mantissa byte m stands for the interval [m, m + 1), so it decodes to
``(m + 1/2) 2^(e - 136)`` [Ward 1991, Real Pixels]; common libraries leave out the half,
which makes every pixel darker by 0.4 % in the mean.

References:
    [Radiance] File formats: the header's variables, the eight orientations, run lengths.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from shjax.io import colour_spaces
from shjax.io.decoded import Decoded, check_size, oriented

MAGIC = b"#?"  # the name of the program that wrote it follows: RADIANCE, RGBE, ...
_FORMATS = {"32-bit_rle_rgbe": False, "32-bit_rle_xyze": True}
_HEADER_LIMIT = 2**20
# What Radiance itself writes, and everybody reads as Rec. 709.
_OWN_PRIMARIES = (0.640, 0.330, 0.290, 0.600, 0.150, 0.060, 1 / 3, 1 / 3)
_AXIS = rb"([-+])([XY])[ \t]+(\d{1,9})"
_SIZE = re.compile(rb"[ \t]*" + _AXIS + rb"[ \t]+" + _AXIS + rb"[ \t]*\r?\n")


def read_radiance(path: Path, *, max_pixels: int, primaries: str = "rec709") -> Decoded:
    """Read a Radiance picture as linear Rec. 709, or in its own primaries (``"keep"``).

    Raises:
        ValueError: If the file is damaged or too large; without the file's name.
    """
    data = path.read_bytes()
    fields, size, start = _header(data)
    kind = fields.get("FORMAT", ["32-bit_rle_rgbe"])[-1]
    if kind not in _FORMATS:
        raise ValueError(f"FORMAT={kind} is not a Radiance picture's")
    gain, gamma = _scale(fields)
    matrix, said = _primaries(fields, xyz=_FORMATS[kind])
    if matrix is not None and primaries == "keep":
        matrix, said = None, [said[0].replace("converted to Rec. 709", "kept")]
    outer, outer_count, inner, inner_count = size
    lines, length = outer_count, inner_count
    check_size((lines, length), max_pixels)
    try:
        rgbe = _scanlines(memoryview(data)[start:], lines, length)
    except (IndexError, ValueError) as error:
        raise ValueError(f"damaged or cut off in its pixels ({error})") from error
    turned = outer[1] == "X"
    if turned:
        rgbe = rgbe.transpose(1, 0, 2)
    y, x = (inner[0], outer[0]) if turned else (outer[0], inner[0])

    def rows(first: int, last: int) -> np.ndarray:
        exponent = rgbe[first:last, :, 3:].astype(np.int32)
        mantissa = rgbe[first:last, :, :3].astype(np.float32) + np.float32(0.5)
        with np.errstate(over="ignore"):
            values = np.ldexp(mantissa, exponent - 136) * (exponent > 0)
            if gamma != 1:
                values = values ** np.float32(gamma)
            if matrix is not None:
                values = values @ matrix.T.astype(np.float32)
            return (values * gain).astype(np.float32)

    words = [
        "Radiance " + ("XYZE" if _FORMATS[kind] else "RGBE") + " (half step decoded)"
    ]
    words += said
    words += ["gamma undone"] * (gamma != 1)
    words += ["exposure undone"] * bool(np.any(gain != 1))
    image = Decoded((*rgbe.shape[:2], 3), rows, ", ".join(words), matrix=matrix)
    # Rows from the top are -Y, columns from the left +X.
    return oriented(image, flip_rows=y == "+", flip_columns=x == "-")


def _header(data: bytes) -> tuple[dict[str, list[str]], tuple, int]:
    """Fields, the two axes with their lengths, and where the pixels start."""
    head = data[:_HEADER_LIMIT]
    if not head.startswith(MAGIC):
        raise ValueError("not a Radiance picture")
    end = re.compile(rb"\r?\n\r?\n").search(head)
    size = None if end is None else _SIZE.match(data, end.end())
    if end is None or size is None or size[2] == size[5]:
        raise ValueError("a Radiance picture without a line for its size (-Y H +X W)")
    fields: dict[str, list[str]] = {}
    for line in head[: end.start()].decode("latin-1").splitlines()[1:]:
        key, equals, value = line.partition("=")
        if equals and not line.startswith("#"):
            fields.setdefault(key.strip().upper(), []).append(value.strip())
    first = (size[1].decode(), size[2].decode())
    second = (size[4].decode(), size[5].decode())
    return fields, (first, int(size[3]), second, int(size[6])), size.end()


def _numbers(fields: dict[str, list[str]], key: str, count: int) -> list[np.ndarray]:
    found = []
    for text in fields.get(key, []):
        try:
            values = np.array([float(word) for word in text.split()])
        except ValueError:
            values = np.zeros(0)
        if values.shape != (count,) or not np.all(np.isfinite(values)):
            many = "no number" if count == 1 else f"not {count} numbers"
            raise ValueError(f"{key}={text} is {many}")
        found.append(values)
    return found


def _scale(fields: dict[str, list[str]]) -> tuple[np.ndarray, float]:
    """What undoes exposure and colour correction ``(3,)``, and the gamma."""
    gain = np.ones(3)
    for key, count in (("EXPOSURE", 1), ("COLORCORR", 3)):
        for values in _numbers(fields, key, count):  # several multiply
            if np.any(values <= 0):
                raise ValueError(f"{key}={fields[key][-1]} is not positive")
            gain = gain / values
    gammas = _numbers(fields, "GAMMA", 1)
    gamma = float(gammas[-1][0]) if gammas else 1.0
    if not (0 < gamma < 100) or not np.all(np.isfinite(gain.astype(np.float32))):
        raise ValueError("its GAMMA, EXPOSURE or COLORCORR is beyond reason")
    return gain.astype(np.float32), gamma


def _primaries(
    fields: dict[str, list[str]], *, xyz: bool
) -> tuple[np.ndarray | None, list[str]]:
    # Photoshop writes zeros where it does not know them.
    given = [space for space in _numbers(fields, "PRIMARIES", 8) if np.any(space)]
    space = given[-1] if given else np.array(_OWN_PRIMARIES)
    if xyz:
        space = np.array(colour_spaces.XYZ)
    elif np.max(np.abs(space - _OWN_PRIMARIES)) < 2e-3:
        return None, []
    matrix, name = colour_spaces.to_rec709(space)
    return matrix, [] if matrix is None else [f"{name} converted to Rec. 709"]


def _scanlines(data: memoryview, lines: int, length: int) -> np.ndarray:
    """RGBE bytes ``(lines, length, 4)`` of run-length encoded or flat scanlines."""
    if len(data) < 4 * lines:  # a pixel, or the mark of an encoded line
        raise ValueError("fewer bytes than its lines need")
    pixels = np.zeros((lines, length, 4), np.uint8)
    flat = len(data) == pixels.size
    at = 0
    try:
        for line in range(lines):
            new_style = (
                8 <= length < 32768
                and bytes(data[at : at + 2]) == b"\2\2"
                and data[at + 2] * 256 + data[at + 3] == length
            )
            read = _new_scanline if new_style else _old_scanline
            at = read(data, at + 4 * new_style, pixels[line])
    except (IndexError, ValueError):
        if not flat:
            raise
        at = 0
    if flat and at != len(data):
        # Pixels as they are, some of which look like the marks of an encoding.
        return np.frombuffer(data, np.uint8).reshape(pixels.shape)
    return pixels


def _new_scanline(data: memoryview, at: int, line: np.ndarray) -> int:
    """Four planes of runs (count > 128) and literals, one after the other."""
    length = line.shape[0]
    decoded = bytearray()
    for plane in range(1, 5):
        end = plane * length
        while len(decoded) < end:
            count = data[at]
            if count > 128:
                decoded += bytes(data[at + 1 : at + 2]) * (count - 128)
                at += 2
            elif count:
                decoded += data[at + 1 : at + 1 + count]
                at += 1 + count
            else:
                raise ValueError("an empty run")
            if at > len(data) or len(decoded) > end:
                raise ValueError("a run passes the end of its line")
    line[:] = np.frombuffer(decoded, np.uint8).reshape(4, length).T
    return at


def _old_scanline(data: memoryview, at: int, line: np.ndarray) -> int:
    """Pixels as they are, where (1, 1, 1, n) repeats the one before n times.

    A repeat that follows a repeat counts 256 times as much [Radiance].
    """
    length = line.shape[0]
    units = np.frombuffer(data[at : at + 4 * length], np.uint8)
    units = units[: units.size // 4 * 4].reshape(-1, 4)
    repeats = np.all(units[:, :3] == 1, axis=-1)
    repeats[:1] = False  # nothing stands before it
    if not repeats.any():
        if len(units) < length:
            raise ValueError("cut off")
        line[:] = units
        return at + 4 * length
    place = np.arange(len(units))
    pixel = np.maximum.accumulate(np.where(repeats, 0, place))
    shift = 8 * np.minimum(place - pixel - 1, 4)
    counts = np.where(repeats, units[:, 3].astype(np.int64) << np.maximum(shift, 0), 1)
    ends = np.cumsum(counts)
    used = int(np.searchsorted(ends, length)) + 1
    if used > len(units):
        raise ValueError("cut off")
    if ends[used - 1] != length:
        raise ValueError("a run passes the end of its line")
    line[:] = np.repeat(units[pixel[:used]], counts[:used], axis=0)
    return at + 4 * used
