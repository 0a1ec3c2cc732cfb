"""From one layout to another: without seams, and with the energy kept when shrinking.

A pixel of the target reads the source between its pixels' centres; what lies beyond the
edge of a face or disc is looked up on the face where it belongs. Where the target has
fewer pixels, each is an average over many readings, whose shares are then balanced until
every target pixel is filled once and every source pixel is spent once: constant light
stays so, and one bright pixel keeps its flux.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from shjax.layouts import LAYOUTS
from shjax.layouts.layout import Layout

_STEPS, _ITERATIONS = 6, 200
_BALANCED = 1e-5
_PIXELS_KEPT = 9  # lat-long pixels for each of the target's, at most

Shares = Any  # a sparse matrix (target pixels, source pixels), from SciPy


def resample(
    image: np.ndarray,
    source: str,
    target: str,
    shape: tuple[int, int],
    rotation: np.ndarray | None = None,
) -> np.ndarray:
    """Resample an environment image to another layout or size.

    Args:
        image: ``(H, W, C)``.
        source: Its layout, a name in :data:`shjax.layouts.LAYOUTS`.
        target: The layout wanted.
        shape: Height and width wanted.
        rotation: Turns the light, ``(3, 3)``.

    Returns:
        ``(*shape, C)`` of the image's dtype; pixels that are not part of the map are 0.
    """
    if source == "latlong" and target == "latlong" and rotation is None:
        return _average_latlong(image, *shape).astype(image.dtype)
    old, new = LAYOUTS[source], LAYOUTS[target]
    old = old if rotation is None else old.rotated(np.asarray(rotation, np.float64))
    inside = new.solid_angles(*shape).ravel() > 0
    count = np.count_nonzero(inside)
    if source == "latlong":
        rows = int(np.ceil(np.sqrt(_PIXELS_KEPT * count / 2)))
        if len(image) > rows:
            image = _average_latlong(image, rows, 2 * rows).astype(image.dtype)
    height, width, channels = image.shape
    known = np.count_nonzero(old.solid_angles(height, width))
    if known > count:
        shares = _averaging(old, (height, width), new, shape)
    else:
        directions = new.pixels(*shape)[0].reshape(-1, 3)[inside]
        shares = _between(old, directions, height, width)
    values = shares @ image.reshape(-1, channels).astype(np.float64)
    result = np.zeros((inside.size, channels), image.dtype)
    result[inside] = values / shares.sum(axis=1)[:, None]
    return result.reshape(*shape, channels)


def _between(
    layout: Layout,
    directions: np.ndarray,
    height: int,
    width: int,
    *,
    edges: bool = True,
) -> Shares:
    """Bilinear shares of a layout's pixels at directions ``(N, 3)``; rows sum to 1.

    A corner that lies beyond its chart is itself read between the pixels of the chart
    where its direction belongs; there, corners beyond the edge do not count.
    """
    from scipy.sparse import coo_array, diags_array

    chart, row, column = layout.locate(directions, height, width)
    charts = layout.charts(height, width)
    top, left = np.floor(row).astype(np.int64), np.floor(column).astype(np.int64)
    size = (len(directions), height * width)
    points, pixels, parts, more = [], [], [], []
    for i in (0, 1):
        for j in (0, 1):
            r, c = top + i, left + j
            share = np.abs(1 - i - (row - top)) * np.abs(1 - j - (column - left))
            clipped = np.clip(r, 0, height - 1), np.clip(c, 0, width - 1)
            own = (clipped[0] == r) & (clipped[1] == c) & (charts[clipped] == chart)
            points.append(np.flatnonzero(own))
            pixels.append((r * width + c)[own])
            parts.append(share[own] + 1e-9)  # so that some corner counts
            beyond = np.flatnonzero(~own & (share > 1e-9))
            if edges and beyond.size:
                there = layout.towards(
                    chart[beyond], r[beyond], c[beyond], height, width
                )
                read = _between(layout, there, height, width, edges=False)
                pick = (share[beyond], (beyond, np.arange(beyond.size)))
                more.append(coo_array(pick, (size[0], beyond.size)).tocsr() @ read)
    entries = [np.concatenate(group) for group in (parts, points, pixels)]
    total = coo_array((entries[0], (entries[1], entries[2])), size).tocsr()
    for part in more:
        total = total + part
    return diags_array(1 / total.sum(axis=1)) @ total


def _averaging(
    old: Layout, size: tuple[int, int], new: Layout, shape: tuple[int, int]
) -> Shares:
    """Balanced shares for a target of fewer pixels, in steradians."""
    from scipy.sparse import coo_array

    spent = old.solid_angles(*size).ravel()
    angles = new.solid_angles(*shape)
    filled = angles[angles > 0]
    k = 1 + int(np.ceil(np.sqrt(np.count_nonzero(spent) / filled.size)))
    row, column = np.nonzero(angles)
    chart = new.charts(*shape)[row, column]
    shares = coo_array((filled.size, spent.size)).tocsr()
    for down in (np.arange(k) + 0.5) / k - 0.5:
        for across in (np.arange(k) + 0.5) / k - 0.5:
            points = new.towards(chart, row + down, column + across, *shape)
            shares = shares + _between(old, points, *size)
    shares = shares.multiply((filled / k**2)[:, None]).tocsr()
    # Source pixels that the readings missed, near a lat-long map's poles, say.
    missed = np.flatnonzero((spent > 0) & (shares.sum(axis=0) < spent / 4))
    if missed.size:
        r, c = np.divmod(missed, size[1])
        there = old.towards(old.charts(*size)[r, c], r, c, *size)
        back = _between(new, there, *shape)[:, np.flatnonzero(angles)]
        spend = (spent[missed], (missed, np.arange(missed.size)))
        shares = shares + (coo_array(spend, (spent.size, missed.size)).tocsr() @ back).T
    return _balanced(shares.tocsr(), filled, spent)


def _balanced(shares: Shares, filled: np.ndarray, spent: np.ndarray) -> Shares:
    """Scale rows and columns until they sum to the pixels' solid angles.

    A few steps of Sinkhorn and Knopp take the local unevenness away; what is left is
    small and smooth, for which they are slow and conjugate gradients are not.
    """
    from scipy.sparse import block_array, diags_array
    from scipy.sparse.linalg import cg

    def safe(total: np.ndarray) -> np.ndarray:
        return np.where(total > 0, total, 1)

    for _ in range(_STEPS):
        shares = diags_array(filled / safe(shares.sum(axis=1))) @ shares
        shares = shares @ diags_array(spent / safe(shares.sum(axis=0)))
    rows, columns = shares.sum(axis=1), shares.sum(axis=0)
    # Row and column sums of the shares times 1 + u + v, less those of now.
    sums = block_array([[diags_array(rows), shares], [shares.T, diags_array(columns)]])
    x, _ = cg(
        sums.tocsr(),
        np.concatenate([filled - rows, spent - columns]),
        rtol=0,
        atol=_BALANCED * float(np.linalg.norm(filled)),
        maxiter=_ITERATIONS,
        M=diags_array(1 / np.concatenate([safe(rows), safe(columns)])),
    )
    n = filled.size
    entries = shares.tocoo()
    data = entries.data * (1 + x[:n][entries.coords[0]] + x[n:][entries.coords[1]])
    return type(entries)((data, entries.coords), entries.shape).tocsr()


def _average_latlong(image: np.ndarray, n_theta: int, n_phi: int) -> np.ndarray:
    """Average over the overlap of old and new pixels, which separates in rows, columns."""
    height, width, _ = image.shape
    # In z = cos t the area is uniform; rows are counted from the top.
    rows = _overlap(
        *(1 - np.cos(np.pi * np.arange(n + 1) / n) for n in (n_theta, height))
    )
    columns = _overlap(*(np.arange(n + 1) / n for n in (n_phi, width)))
    wide = np.einsum("ih,hwc->iwc", rows, image.astype(np.float64), optimize=True)
    return np.einsum("jw,iwc->ijc", columns, wide, optimize=True)


def _overlap(new: np.ndarray, old: np.ndarray) -> np.ndarray:
    """Share of each old interval in each new one, ``(len(new) - 1, len(old) - 1)``."""
    lower = np.maximum(new[:-1, None], old[:-1])
    upper = np.minimum(new[1:, None], old[1:])
    return np.maximum(upper - lower, 0) / np.diff(new)[:, None]
