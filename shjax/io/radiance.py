"""Radiance .hdr (RGBE), with the format's own decoding.

A mantissa byte m stands for the interval [m, m + 1), so it decodes to
``(m + 1/2) 2^(e - 136)`` [Ward 1991, Real Pixels]; common libraries leave out the half,
which makes every pixel darker by 0.4 % in the mean.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

MAGIC = (b"#?RADIANCE", b"#?RGBE")


def read_radiance(path: Path, *, max_pixels: int) -> np.ndarray:
    """Read a picture of linear RGB, ``(H, W, 3)`` float32.

    Raises:
        ValueError: If the file is damaged, too large, or of a kind not supported.
    """
    data = path.read_bytes()
    fields, height, width, start = _header(path, data)
    if fields.get("FORMAT", "32-bit_rle_rgbe") != "32-bit_rle_rgbe":
        raise ValueError(f"{path}: FORMAT={fields['FORMAT']} is not supported.")
    if not 0 < height * width <= max_pixels:
        raise ValueError(
            f"{path}: {width} x {height} pixels; the limit is {max_pixels}."
        )
    try:
        rgbe = _scanlines(memoryview(data)[start:], height, width)
    except (IndexError, ValueError) as error:
        raise ValueError(f"{path}: damaged or cut off in its pixels.") from error
    exposure = float(fields.get("EXPOSURE", 1.0))
    exponent = rgbe[..., 3:].astype(np.int32)
    mantissa = rgbe[..., :3].astype(np.float32) + np.float32(0.5)
    rgb = np.ldexp(mantissa, exponent - 136) * (exponent > 0)
    return (rgb / np.float32(exposure)).astype(np.float32)


def _header(path: Path, data: bytes) -> tuple[dict[str, str], int, int, int]:
    """Fields, height, width and where the pixels start."""
    end = data.find(b"\n\n")
    size = re.compile(rb"-Y (\d{1,9}) \+X (\d{1,9})\n").match(data, end + 2)
    if not data.startswith(MAGIC) or end < 0:
        raise ValueError(f"{path}: not a Radiance picture.")
    if size is None:
        raise ValueError(f"{path}: only pictures stored -Y +X are supported.")
    fields: dict[str, str] = {}
    for line in data[:end].decode("latin-1").splitlines()[1:]:
        key, equals, value = line.partition("=")
        if not equals or line.startswith("#"):
            continue
        key, value = key.strip().upper(), value.strip()
        if key == "EXPOSURE":  # several multiply
            try:
                value = str(float(fields.get(key, 1.0)) * float(value))
            except ValueError as error:
                raise ValueError(f"{path}: EXPOSURE={value} is no number.") from error
        fields[key] = value
    return fields, int(size[1]), int(size[2]), size.end()


def _scanlines(data: memoryview, height: int, width: int) -> np.ndarray:
    """RGBE bytes ``(H, W, 4)`` of run-length encoded or flat scanlines."""
    pixels = np.zeros((height, width, 4), np.uint8)
    at = 0
    for row in range(height):
        new_style = (
            8 <= width < 32768
            and bytes(data[at : at + 2]) == b"\2\2"
            and data[at + 2] * 256 + data[at + 3] == width
        )
        read = _new_scanline if new_style else _old_scanline
        at = read(data, at + 4 * new_style, pixels[row])
    return pixels


def _new_scanline(data: memoryview, at: int, row: np.ndarray) -> int:
    """Four planes of runs (count > 128) and literals, one after the other."""
    width = row.shape[0]
    for plane in range(4):
        column = 0
        while column < width:
            count = data[at]
            run = count > 128
            count = count - 128 if run else count
            if count == 0 or column + count > width:
                raise ValueError("a run passes the end of its line")
            source = data[at + 1 : at + 2 if run else at + 1 + count]
            row[column : column + count, plane] = np.frombuffer(source, np.uint8)
            at += 1 + len(source)
            column += count
    return at


def _old_scanline(data: memoryview, at: int, row: np.ndarray) -> int:
    """Pixels as they are, where (1, 1, 1, n) repeats the one before n times."""
    width = row.shape[0]
    column, shift = 0, 0
    while column < width:
        pixel = np.frombuffer(data[at : at + 4], np.uint8)
        at += 4
        if tuple(pixel[:3]) == (1, 1, 1) and column:
            count = int(pixel[3]) << shift
            if column + count > width:
                raise ValueError("a run passes the end of its line")
            row[column : column + count] = row[column - 1]
            column, shift = column + count, shift + 8
        else:
            row[column] = pixel
            column, shift = column + 1, 0
    return at
