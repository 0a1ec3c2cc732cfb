"""What several commands write and show: pictures side by side, headers, progress."""

from __future__ import annotations

import dataclasses
import sys

import jax.numpy as jnp
import numpy as np
import OpenImageIO as oiio
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
)

import shjax
from shjax.display import show_difference, tone_map
from shjax.envmap import EnvironmentMap
from shjax.render.pictures import panorama_at
from shjax.sphere import latlong_directions

FRAME = (
    "right-handed, +z up (row 0 of a lat-long image), +x at the image centre, "
    "+y at u = 0.25"
)
BASIS = (
    "real orthonormal spherical harmonics without Condon-Shortley phase, "
    "row l (l + 1) + m"
)


def header(source: str, **more: str) -> dict[str, str]:
    """Header attributes that every picture's file carries."""
    about = {"software": f"shjax {shjax.__version__}", "source": source, "frame": FRAME}
    return {**about, **more}


def as_rgb(image: np.ndarray) -> np.ndarray:
    """RGB of an image: one channel three times, or the first three."""
    return np.broadcast_to(image[..., :3], (*image.shape[:2], 3))


def compare(
    approximate: np.ndarray, exact: np.ndarray, panels: str
) -> tuple[np.ndarray, np.ndarray]:
    """Compare two pictures: panels of both and their difference.

    One white for both; the difference has its full colour at a tenth of it.

    Args:
        approximate: ``(H, W, C)``.
        exact: The same.
        panels: What the three show, separated by ``|``.

    Returns:
        ``(H, 3 W, C)``, and ``(H', 3 W, 3)`` with captions below.
    """
    difference = approximate - exact
    lit = exact.mean(axis=-1)
    white = float(np.quantile(lit, 0.99)) or float(lit.max()) or 1.0
    values = np.concatenate([approximate, exact, difference], axis=1)
    shown = [as_rgb(tone_map(part, white=white)) for part in (approximate, exact)]
    coloured = show_difference(difference, white / 10)
    coloured = np.where(exact.sum(axis=-1, keepdims=True) > 0, coloured, 0)
    first, second, third = (text.strip() for text in panels.split("|"))
    dark = float(np.mean(np.any(approximate < 0, axis=-1)))
    if dark > 0.005:
        first += f"; below zero in {dark:.0%}, shown black"
    scale = f"{third}: red +{white / 10:.2g}, blue -{white / 10:.2g}"
    pictures = np.concatenate([*shown, coloured], axis=1)
    return values, captioned(pictures, (first, f"{second}; white {white:.2g}", scale))


_LETTER = 0.55  # width of a letter over the height of its line, about
_MIN_PANEL = 288  # pixels


def captioned(image: np.ndarray, captions: tuple[str, ...]) -> np.ndarray:
    """Caption panels side by side, a line of text below each.

    Letters are as large as the longest caption lets them be; small panels are enlarged.

    Args:
        image: ``(H, W, 3)``; the panels are of one width.
        captions: One for each panel.
    """
    width = image.shape[1] // len(captions)
    factor = max(-(-_MIN_PANEL // width), 1)
    image, width = image.repeat(factor, 0).repeat(factor, 1), width * factor
    longest = max(len(caption) for caption in captions)
    size = min(int(0.94 * width / (_LETTER * longest)), 22)
    strip = oiio.ImageBuf(oiio.ImageSpec(image.shape[1], 2 * size, 3, oiio.FLOAT))
    for place, caption in enumerate(captions):
        left = int((place + 0.03) * width)
        oiio.ImageBufAlgo.render_text(
            strip, left, int(1.4 * size), caption, size, "", (1, 1, 1)
        )
    return np.concatenate(
        [image, np.clip(np.asarray(strip.get_pixels(oiio.FLOAT)), 0, 1)]
    )


def rotated(envmap: EnvironmentMap, rotation: np.ndarray) -> EnvironmentMap:
    """Rotate the light of a lat-long map, read between pixels."""
    flat = envmap.to_latlong(min(len(envmap.image), 512))
    rows = len(flat.image)
    towards = latlong_directions(rows, 2 * rows) @ rotation  # R^T w
    image = np.asarray(panorama_at(jnp.asarray(flat.radiance), jnp.asarray(towards)))
    return dataclasses.replace(flat, radiance=image, image=image)


def progress_display(quiet: bool) -> Progress:
    """Progress bar on standard error, where that is a terminal."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=Console(stderr=True),
        transient=True,
        disable=quiet or not sys.stderr.isatty(),
    )
