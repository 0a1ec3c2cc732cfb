"""Environment maps from files: the image, its layout, and what is wrong with it."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import numpy as np

from shjax.envmap import EnvironmentMap, Report, make_envmap
from shjax.io.images import read_with_format
from shjax.layouts import LAYOUTS

INVALID_CHOICES = ("error", "clamp", "zero", "keep")
NEGATIVE_ENERGY_LIMIT = 1e-4


def shipped_panorama() -> Path:
    """The 1024 x 512 panorama that comes with the package: a city (CC0, Greg Zaal)."""
    return Path(__file__).parent.parent / "data" / "city.exr"


def read_envmap(
    path: str | os.PathLike,
    *,
    layout: str = "auto",
    invalid: str = "error",
    max_pixels: int = 2**28,
) -> EnvironmentMap:
    """Read an environment map: lat-long, angular map or vertical cross.

    Args:
        path: EXR, Radiance .hdr, or what OpenImageIO reads.
        layout: ``"latlong"``, ``"angular"``, ``"vertical_cross"``, or ``"auto"``: told
            from the image's aspect, and said in the report.
        invalid: What to do with NaN, infinite and negative values. ``"error"`` refuses
            the first two, and negative ones whose energy exceeds 1e-4 of the total
            (below that they are integrated as they stand: lossy compression leaves
            some); ``"clamp"`` moves each to the nearest valid value (NaN to 0, infinity
            to the largest finite value); ``"zero"`` makes such pixels black; ``"keep"``
            changes nothing. The report says what was done.
        max_pixels: Larger images are refused before they are decoded.

    Returns:
        The environment map, float32, with its report.

    Raises:
        OSError: If the file cannot be opened.
        ValueError: If it cannot be read, or holds what ``invalid`` refuses; the message
            names the file.
    """
    if invalid not in INVALID_CHOICES:
        raise ValueError(
            f"invalid must be one of {', '.join(INVALID_CHOICES)}; got {invalid!r}."
        )
    path = Path(path)
    image, kind = read_with_format(path, max_pixels=max_pixels)
    height, width, _ = image.shape
    report = Report(path.name, kind, layout, False, height, width)
    try:
        found = make_envmap(image, layout=layout, report=report)
        return _treat_invalid(found, invalid)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _treat_invalid(envmap: EnvironmentMap, invalid: str) -> EnvironmentMap:
    radiance, _, weights = envmap.samples()
    radiance = np.asarray(radiance)
    non_finite = ~np.isfinite(radiance)
    negative = radiance < 0
    count, below = int(non_finite.sum()), int(negative.sum())
    if not count and not below:
        return envmap
    share = _negative_share(np.where(non_finite, 0, radiance), weights)
    if invalid == "error":
        _refuse(envmap, non_finite, share)
    done = {
        "error": "integrated as they stand",
        "keep": "kept",
        "clamp": "clamped",
        "zero": "made black",
    }[invalid]
    parts = [f"{count} NaN or infinite values"] * bool(count) + [
        f"{below} negative values ({share:.1e} of the energy)"
    ] * bool(below)
    report = dataclasses.replace(
        envmap.report,
        non_finite=count,
        negative=below,
        negative_energy=share,
        action=f"{' and '.join(parts)} {done}",
    )
    if invalid in ("error", "keep"):
        return dataclasses.replace(envmap, report=report)
    repaired = _repaired(np.asarray(envmap.image), invalid)
    return dataclasses.replace(
        make_envmap(repaired, layout=envmap.layout), report=report
    )


def _negative_share(radiance: np.ndarray, weights: np.ndarray) -> float:
    """Energy of the negative values as a share of all, both counted as positive."""
    flux = radiance.astype(np.float64) * weights[:, None]
    whole = np.abs(flux).sum()
    return float(-flux[flux < 0].sum() / whole) if whole > 0 else 0.0


def _refuse(envmap: EnvironmentMap, non_finite: np.ndarray, share: float) -> None:
    if non_finite.any():
        image = np.asarray(envmap.image)
        _, solid_angles = LAYOUTS[envmap.layout].pixels(*image.shape[:2])
        bad = ~np.isfinite(image) & (solid_angles > 0)[..., None]
        row, column, channel = (int(k) for k in np.argwhere(bad)[0])
        raise ValueError(
            f"{int(non_finite.sum())} values are NaN or infinite, the first at row "
            f"{row}, column {column}, channel {channel} (counted from 0); "
            f"invalid='clamp' or 'zero' reads it all the same."
        )
    if share > NEGATIVE_ENERGY_LIMIT:
        raise ValueError(
            f"negative values hold {share:.1e} of the energy, the limit is "
            f"{NEGATIVE_ENERGY_LIMIT:.0e}; invalid='clamp', 'zero' or 'keep' reads it "
            f"all the same."
        )


def _repaired(image: np.ndarray, invalid: str) -> np.ndarray:
    finite = np.isfinite(image)
    if invalid == "zero":
        bad = np.any(~finite | (image < 0), axis=-1, keepdims=True)
        return np.where(bad, np.float32(0), image)
    largest = image[finite].max(initial=0)
    known = np.nan_to_num(image, nan=0.0, posinf=largest, neginf=0.0)
    return np.maximum(known, 0).astype(image.dtype)
