"""What a reader hands over: an image of which any band of rows can be had.

Bands, because a panorama may be large: whoever wants the pixels makes room for them once
and has the bands put there, and a colour conversion never needs a second copy.
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable, Iterable, Iterator
from contextvars import ContextVar

import numpy as np
from jaxtyping import Float

_BAND = 2**20  # values at a time
_tell_size: ContextVar[Callable[[int], None] | None] = ContextVar("size", default=None)


@dataclasses.dataclass(frozen=True)
class Decoded:
    """Decoded image of linear light, as read from a file.

    Attributes:
        shape: Height, width and channels.
        rows: ``(start, stop)`` to those rows, ``(stop - start, W, C)``; any real dtype.
        kind: How the file stored it and what was converted, in words.
        layout: The layout that the file itself names, of :data:`shjax.layouts.LAYOUTS`.
        whole: The image, where it is in memory already as float32.
        matrix: What took its own primaries to Rec. 709, ``(3, 3)``; None if nothing did.
            Colours outside Rec. 709 are then negative.
    """

    shape: tuple[int, int, int]
    rows: Callable[[int, int], np.ndarray]
    kind: str
    layout: str | None = None
    whole: np.ndarray | None = None
    matrix: np.ndarray | None = None

    def bands(self) -> Iterator[tuple[slice, np.ndarray]]:
        """Rows in order, a few at a time, as contiguous float32."""
        height, width, channels = self.shape
        step = max(_BAND // (width * channels), 1)
        for start in range(0, height, step):
            stop = min(start + step, height)
            with np.errstate(over="ignore"):  # beyond float32: infinite, and counted so
                band = np.ascontiguousarray(self.rows(start, stop), np.float32)
            if band.shape != (stop - start, width, channels):
                raise ValueError("damaged or cut off in its pixels")
            yield slice(start, stop), band

    def pixels(self) -> Float[np.ndarray, "H W C"]:
        """All pixels of the image, float32."""
        if self.whole is not None:
            return self.whole
        image = np.empty(self.shape, np.float32)
        for where, band in self.bands():
            image[where] = band
        return image


def from_array(image: np.ndarray, kind: str, layout: str | None = None) -> Decoded:
    """Wrap an image ``(H, W, C)`` that is in memory, or mapped there."""
    height, width, channels = image.shape
    return Decoded(
        (height, width, channels), lambda start, stop: image[start:stop], kind, layout
    )


def colour_channels(image: np.ndarray) -> tuple[np.ndarray, str]:
    """Colour channels of an image: the first three, or the first; and what was left out."""
    count = image.shape[-1]
    kept = 1 if count < 3 else 3
    left = "" if kept == count else f", the first {kept} of {count} channels"
    return image[..., :kept], left.replace("the first 1 of", "the first of")


def check_size(size: Iterable[int] | np.ndarray, max_pixels: int) -> None:
    """Refuse what is empty or larger than the limit, before it is decoded.

    Raises:
        ValueError: Without the file's name, which the caller puts before it.
    """
    height, width = (int(n) for n in size)
    if height < 1 or width < 1:
        raise ValueError(f"{width} x {height} pixels: it is empty")
    if height * width > max_pixels:
        raise ValueError(f"{width} x {height} pixels; the limit is {max_pixels}")
    tell = _tell_size.get()
    if tell is not None:
        tell(height * width)


@contextlib.contextmanager
def telling_size(tell: Callable[[int], None]) -> Iterator[None]:
    """Report the pixels of each image to ``tell`` before they are decoded, within it."""
    token = _tell_size.set(tell)
    try:
        yield
    finally:
        _tell_size.reset(token)


def oriented(image: Decoded, *, flip_rows: bool, flip_columns: bool) -> Decoded:
    """Flip an image's rows or columns."""
    if not (flip_rows or flip_columns):
        return image
    height = image.shape[0]

    def rows(start: int, stop: int) -> np.ndarray:
        band = (
            image.rows(height - stop, height - start)[::-1]
            if flip_rows
            else (image.rows(start, stop))
        )
        return band[:, ::-1] if flip_columns else band

    return dataclasses.replace(image, rows=rows)
