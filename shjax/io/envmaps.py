"""Environment maps from files: the image, its layout, and what is wrong with it."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import numpy as np

from shjax.envmap import EnvironmentMap, Report, make_envmap
from shjax.harmonics.grid import Grid
from shjax.io.images import MAX_PIXELS, decode, in_memory
from shjax.layouts import LAYOUTS

INVALID_CHOICES = ("error", "clamp", "zero", "keep")
NEGATIVE_ENERGY_LIMIT = 1e-4
_BAND = 2**20  # values at a time


def shipped_panorama() -> Path:
    """Path of the 1024 x 512 panorama that comes with shjax: a city (CC0, Greg Zaal)."""
    return Path(__file__).parent.parent / "data" / "city.exr"


def read_envmap(
    path: str | os.PathLike,
    *,
    layout: str = "auto",
    invalid: str = "error",
    max_pixels: int = MAX_PIXELS,
    layer: str | None = None,
    alpha: str = "drop",
    primaries: str = "rec709",
    isolate: bool = False,
) -> EnvironmentMap:
    """Read an environment map of any layout from an image file or six faces.

    Args:
        path: A file, or a folder of six faces, as in :func:`shjax.io.read_image`.
        layout: A name in :data:`shjax.layouts.LAYOUTS`, or ``"auto"``: what the file
            itself says, else told from the image's aspect, and said in the report.
        invalid: What to do with NaN, infinite and negative values. ``"error"`` refuses
            the first two, and negative ones whose energy exceeds 1e-4 of the total
            (below that they are integrated as they stand: lossy compression leaves
            some, and a conversion from wider primaries makes them, which are never
            refused: the energy is counted in the file's own primaries);
            ``"clamp"`` moves each to the nearest valid value (NaN to 0, infinity to the
            largest finite value); ``"zero"`` makes such pixels black; ``"keep"``
            changes nothing. The report says what was done.
        max_pixels: Larger images are refused before they are decoded.
        layer: Part or layer of an EXR, as in :func:`shjax.io.read_image`.
        alpha: As in :func:`shjax.io.read_image`.
        primaries: As in :func:`shjax.io.read_image`.
        isolate: As in :func:`shjax.io.read_image`.

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
    decoded = decode(
        path,
        max_pixels=max_pixels,
        layer=layer,
        alpha=alpha,
        primaries=primaries,
        isolate=isolate,
    )
    image = in_memory(path, decoded)
    report = Report(path.name, decoded.kind, layout, False, *decoded.shape[:2])
    if layout == "auto" and decoded.layout is not None:
        layout = decoded.layout
    try:
        found = make_envmap(image, layout=layout, report=report)
        return _treat_invalid(found, invalid, decoded.matrix)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


@dataclasses.dataclass
class _Invalid:
    """What is wrong with a map's values, counted a band of rows at a time."""

    non_finite: int = 0
    negative: int = 0
    below: float = 0.0
    whole: float = 0.0
    own_below: float = 0.0
    own_whole: float = 0.0
    first: tuple[int, int, int] | None = None

    def add(
        self,
        band: np.ndarray,
        weights: np.ndarray,
        start: int,
        back: np.ndarray | None,
    ) -> None:
        """Count rows of the image; weights ``(n, W or 1)`` are 0 outside the map.

        ``back`` takes colours to the file's own primaries.
        """
        finite = np.isfinite(band)
        flux = np.abs(np.where(finite, band, 0)) * weights[..., None]
        self.whole += float(flux.sum(dtype=np.float64))
        known = np.broadcast_to((weights > 0)[..., None], band.shape)
        negative = (band < 0) & known
        if negative.any():
            self.negative += int(negative.sum())
            self.below += float(flux[negative].sum(dtype=np.float64))
        if back is not None:
            own = np.where(finite, band, 0) @ back.T
            rounding = 1e-5 * np.max(np.abs(own), axis=-1, keepdims=True)
            power = np.abs(own) * weights[..., None]
            self.own_whole += float(power.sum(dtype=np.float64))
            self.own_below += float(power[own < -rounding].sum(dtype=np.float64))
        bad = ~finite & known
        if bad.any():
            self.non_finite += int(bad.sum())
            row, column, channel = (int(k) for k in np.argwhere(bad)[0])
            self.first = self.first or (start + row, column, channel)

    @property
    def share(self) -> float:
        """Energy of the negative values as a share of all, both counted as positive."""
        return self.below / self.whole if self.whole > 0 else 0.0

    @property
    def own_share(self) -> float:
        """Share of negative energy in the file's own primaries, without a conversion's."""
        if not self.own_whole:
            return self.share
        return self.own_below / self.own_whole


def _count_invalid(envmap: EnvironmentMap, matrix: np.ndarray | None) -> _Invalid:
    image = np.asarray(envmap.image)
    height, width, channels = image.shape
    if envmap.layout == "latlong":
        weights = Grid(height, width).weights[:, None]
    else:
        weights = LAYOUTS[envmap.layout].solid_angles(height, width)
    weights = weights.astype(np.float32)
    found = _Invalid()
    back = None if matrix is None else np.linalg.inv(matrix).astype(np.float32)
    step = max(_BAND // (width * channels), 1)
    for start in range(0, height, step):
        rows = slice(start, start + step)
        found.add(image[rows], weights[rows], start, back)
    return found


def _treat_invalid(
    envmap: EnvironmentMap, invalid: str, matrix: np.ndarray | None
) -> EnvironmentMap:
    found = _count_invalid(envmap, matrix)
    if not found.non_finite and not found.negative:
        return envmap
    if invalid == "error":
        _refuse(found)
    done = {
        "error": "integrated as they stand",
        "keep": "kept",
        "clamp": "clamped",
        "zero": "made black",
    }[invalid]
    parts = [f"{found.non_finite} NaN or infinite values"] * bool(found.non_finite) + [
        f"{found.negative} negative values ({found.share:.1e} of the energy"
        + (", colours outside Rec. 709)" if matrix is not None else ")")
    ] * bool(found.negative)
    report = dataclasses.replace(
        envmap.report,
        non_finite=found.non_finite,
        negative=found.negative,
        negative_energy=found.share,
        action=f"{' and '.join(parts)} {done}",
    )
    if invalid in ("error", "keep"):
        return dataclasses.replace(envmap, report=report)
    repaired = _repaired(np.asarray(envmap.image), invalid)
    return dataclasses.replace(
        make_envmap(repaired, layout=envmap.layout), report=report
    )


def _refuse(found: _Invalid) -> None:
    if found.first is not None:
        row, column, channel = found.first
        raise ValueError(
            f"{found.non_finite} values are NaN, infinite or beyond float32, the first at "
            f"row {row}, column {column}, channel {channel} (counted from 0); "
            f"invalid='clamp' or 'zero' (--invalid) reads it all the same."
        )
    if found.own_share > NEGATIVE_ENERGY_LIMIT:
        raise ValueError(
            f"negative values hold {found.own_share:.1e} of the energy, the limit is "
            f"{NEGATIVE_ENERGY_LIMIT:.0e}; invalid='clamp', 'zero' or 'keep' (--invalid) "
            f"reads it all the same."
        )


def _repaired(image: np.ndarray, invalid: str) -> np.ndarray:
    finite = np.isfinite(image)
    if invalid == "zero":
        bad = np.any(~finite | (image < 0), axis=-1, keepdims=True)
        return np.where(bad, np.float32(0), image)
    largest = image[finite].max(initial=0)
    known = np.nan_to_num(image, nan=0.0, posinf=largest, neginf=0.0)
    return np.maximum(known, 0).astype(image.dtype)
