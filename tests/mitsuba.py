"""Mitsuba's pictures (shared/data/renders): its environments on the library's pixels."""

import numpy as np

from shjax import io, render
from shjax.sphere import latlong_directions

# Its front camera at (0, 0, 4), y up, in the library's frame (x, y, z) = (z, x, y).
FRONT = render.Camera(origin=(4.0, 0.0, 0.0), width=2.1)


def environment(renders, name, rows=128):
    """A map of theirs, columns centred and rows on both poles, read between texels."""
    image = io.read_image(renders / "envs" / f"{name}.exr")
    height, width, _ = image.shape
    z, x, y = np.moveaxis(latlong_directions(rows, 2 * rows), -1, 0)
    u = np.mod(np.arctan2(x, -z) / (2 * np.pi), 1)
    row = np.arccos(np.clip(y, -1, 1)) / np.pi * (height - 1)
    column = u * width - 0.5
    top, left = (
        np.clip(np.floor(row).astype(int), 0, height - 2),
        np.floor(column).astype(int),
    )
    total = 0.0
    for down in (0, 1):
        for right in (0, 1):
            share = np.abs(1 - down - (row - top)) * np.abs(1 - right - (column - left))
            total = (
                total
                + share[..., None] * image[top + down, np.mod(left + right, width)]
            )
    return np.asarray(total, np.float32)
