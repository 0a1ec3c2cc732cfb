"""The environment map: distant radiance on whatever pixels it was stored on."""

from __future__ import annotations

import dataclasses

import jax
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array, check_channels
from shjax.harmonics import analyze, project_samples
from shjax.harmonics.grid import Grid
from shjax.layouts import LAYOUTS, guess_layout
from shjax.sphere import latlong_directions, spherical_directions


@dataclasses.dataclass(frozen=True)
class Report:
    """What was found in an environment image and what was done about it.

    Attributes:
        source: The file's name, or ``"array"``.
        format: How it was stored, in words.
        layout: Name in :data:`shjax.layouts.LAYOUTS`.
        layout_guessed: Whether the layout was told from the image's shape.
        height: Rows of the image.
        width: Columns of the image.
        non_finite: Values that are NaN or infinite.
        negative: Values below zero.
        negative_energy: Their share of the radiance over the sphere, in magnitude.
        action: What was done with invalid values, in words; empty if there were none.
    """

    source: str
    format: str
    layout: str
    layout_guessed: bool
    height: int
    width: int
    non_finite: int = 0
    negative: int = 0
    negative_energy: float = 0.0
    action: str = ""

    def __str__(self) -> str:
        """One line."""
        guessed = " (told from its shape)" if self.layout_guessed else ""
        line = (
            f"{self.source}: {self.width} x {self.height} {self.format}, "
            f"{self.layout}{guessed}"
        )
        return f"{line}; {self.action}" if self.action else line


@dataclasses.dataclass(frozen=True, eq=False)
class EnvironmentMap:
    """Distant radiance.

    Attributes:
        radiance: ``(n_theta, n_phi, C)`` for lat-long, else the map's pixels ``(N, C)``.
        layout: Name in :data:`shjax.layouts.LAYOUTS`.
        directions: Unit vectors of the pixels ``(N, 3)``; None for lat-long.
        solid_angles: Exact solid angles ``(N,)``, steradians; None for lat-long.
        image: The image ``(H, W, C)`` as it was stored.
        report: What was found and done.
    """

    radiance: Float[Array, ...]
    layout: str
    directions: Float[Array, "N 3"] | None
    solid_angles: Float[Array, " N"] | None
    image: Float[Array, "H W C"]
    report: Report

    def lighting(
        self, *, l_max: int, quadrature: str = "fejer"
    ) -> Float[jax.Array, "K C"]:
        """Radiance coefficients, ``((l_max + 1)^2, C)``.

        Args:
            l_max: Highest degree, inclusive.
            quadrature: For a lat-long map, as in :func:`shjax.analyze`.

        Raises:
            ValueError: If a lat-long map has fewer than ``2 l_max + 1`` rows or columns
                and the quadrature is not ``"pixel"``.
        """
        if self.layout == "latlong":
            return analyze(self.radiance, l_max=l_max, quadrature=quadrature)
        return project_samples(*self.samples(), l_max=l_max)

    def samples(self) -> tuple[Array, np.ndarray, np.ndarray]:
        """Radiance ``(N, C)``, directions ``(N, 3)`` and quadrature weights ``(N,)``.

        The weights of a lat-long map are Fejer's, those of other layouts solid angles.
        """
        if self.directions is not None and self.solid_angles is not None:
            return (
                self.radiance,
                np.asarray(self.directions),
                np.asarray(self.solid_angles),
            )
        n_theta, n_phi, channels = self.radiance.shape
        directions = latlong_directions(n_theta, n_phi).reshape(-1, 3)
        weights = np.repeat(Grid(n_theta, n_phi).weights, n_phi)
        return self.radiance.reshape(-1, channels), directions, weights

    def to_latlong(self, n_theta: int) -> EnvironmentMap:
        """The same light on ``n_theta x 2 n_theta`` lat-long pixels.

        A lat-long map is averaged (or repeated) over the exact overlap of the pixels, so
        its total radiance is kept; other layouts are read bilinearly at several points of
        each new pixel.

        Raises:
            ValueError: If ``n_theta`` is not positive.
        """
        if n_theta < 1:
            raise ValueError(f"n_theta must be positive; got {n_theta}.")
        image = np.asarray(self.image)
        remap = _average_latlong if self.layout == "latlong" else _resample
        radiance = remap(image, self.layout, n_theta).astype(image.dtype)
        report = dataclasses.replace(
            self.report, layout="latlong", height=n_theta, width=2 * n_theta
        )
        return dataclasses.replace(
            self,
            radiance=radiance,
            image=radiance,
            layout="latlong",
            directions=None,
            solid_angles=None,
            report=report,
        )


def make_envmap(
    image: Float[Array, "H W C"], *, layout: str = "auto", report: Report | None = None
) -> EnvironmentMap:
    """An environment map from the pixels of an image.

    Args:
        image: Linear radiance.
        layout: A name in :data:`shjax.layouts.LAYOUTS`, or ``"auto"``: told from the
            image's aspect.
        report: What a reader found; made here if not given.

    Raises:
        ValueError: If the layout is unknown, cannot be told, or does not fit the image.
    """
    check_channels("image", image.shape, "H, W, C", 3)
    height, width, _channels = image.shape
    guessed = layout == "auto"
    name = guess_layout(height, width) if guessed else layout
    if name not in LAYOUTS:
        raise ValueError(f"layout must be one of {', '.join(LAYOUTS)}; got {layout!r}.")
    aspect = LAYOUTS[name].aspect
    if name != "latlong" and width * aspect[1] != height * aspect[0]:
        raise ValueError(
            f"image must have the aspect {aspect[0]}:{aspect[1]} of layout {name!r}; "
            f"got {width} x {height}."
        )
    report = report or Report("array", str(image.dtype), name, guessed, height, width)
    report = dataclasses.replace(report, layout=name, layout_guessed=guessed)
    if name == "latlong":
        return EnvironmentMap(image, name, None, None, image, report)
    directions, solid_angles = LAYOUTS[name].pixels(height, width)
    inside = solid_angles > 0
    pixels = np.asarray(image)[inside]
    return EnvironmentMap(
        pixels, name, directions[inside], solid_angles[inside], image, report
    )


def _average_latlong(image: np.ndarray, layout: str, n_theta: int) -> np.ndarray:
    """Average over the overlap of old and new pixels, which separates in rows, columns."""
    height, width, _ = image.shape
    # In z = cos t the area is uniform; rows are counted from the top.
    rows = _overlap(
        *(1 - np.cos(np.pi * np.arange(n + 1) / n) for n in (n_theta, height))
    )
    columns = _overlap(*(np.arange(n + 1) / n for n in (2 * n_theta, width)))
    wide = np.einsum("ih,hwc->iwc", rows, image.astype(np.float64), optimize=True)
    return np.einsum("jw,iwc->ijc", columns, wide, optimize=True)


def _overlap(new: np.ndarray, old: np.ndarray) -> np.ndarray:
    """Share of each old interval in each new one, ``(len(new) - 1, len(old) - 1)``."""
    lower = np.maximum(new[:-1, None], old[:-1])
    upper = np.minimum(new[1:, None], old[1:])
    return np.maximum(upper - lower, 0) / np.diff(new)[:, None]


def _resample(image: np.ndarray, layout: str, n_theta: int) -> np.ndarray:
    """Average bilinear readings at k x k points of each lat-long pixel."""
    height, width, channels = image.shape
    _, solid_angles = LAYOUTS[layout].pixels(height, width)
    source_pixels = np.count_nonzero(solid_angles)
    k = 1 + int(np.ceil(np.sqrt(source_pixels / (2 * n_theta**2))))
    total = np.zeros((n_theta, 2 * n_theta, channels))
    weight = np.zeros((n_theta, 1, 1))
    for offset in (np.arange(k) + 0.5) / k:
        theta = np.pi * (np.arange(n_theta) + offset) / n_theta
        for across in (np.arange(k) + 0.5) / k:
            phi = np.pi - np.pi * (np.arange(2 * n_theta) + across) / n_theta
            directions = spherical_directions(theta[:, None], phi)
            row, column = LAYOUTS[layout].lookup(directions, height, width)
            area = np.sin(theta)[:, None, None]
            total += area * _bilinear(image, solid_angles > 0, row, column)
            weight += area
    return total / weight


def _bilinear(
    image: np.ndarray, inside: np.ndarray, row: np.ndarray, column: np.ndarray
) -> np.ndarray:
    """Read between pixel centres; pixels that are not part of the map do not count."""
    height, width, _ = image.shape
    top, left = np.floor(row).astype(int), np.floor(column).astype(int)
    total, weight = 0.0, 0.0
    for i in (0, 1):
        for j in (0, 1):
            r = np.clip(top + i, 0, height - 1)
            c = np.clip(left + j, 0, width - 1)
            share = np.abs(1 - i - (row - top)) * np.abs(1 - j - (column - left))
            share = share * inside[r, c] + 1e-12 * inside[r, c]
            total = total + share[..., None] * np.where(
                inside[r, c, None], image[r, c], 0
            )
            weight = weight + share[..., None]
    return total / np.where(weight == 0, 1, weight)
