"""The environment map: distant radiance on whatever pixels it was stored on."""

from __future__ import annotations

import dataclasses

import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import Float

from shjax.arrays import Array, check_channels
from shjax.harmonics import analyze, project_samples
from shjax.harmonics.grid import Grid
from shjax.layouts import LAYOUTS, guess_layout
from shjax.layouts.resampling import resample
from shjax.sphere import latlong_directions


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


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
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

    def __repr__(self) -> str:
        """What it is, how large and how bright, in three lines."""
        height, width, channels = self.image.shape
        lines = [f"EnvironmentMap: {width} x {height} x {channels}, {self.layout}"]
        if isinstance(self.radiance, Tracer):
            return f"{lines[0]} (traced)"
        pixels = np.asarray(self.radiance)
        lines.append(
            f"  radiance {np.nanmin(pixels):.3g} to {np.nanmax(pixels):.3g}, "
            f"mean of the pixels {np.nanmean(pixels):.3g}, {pixels.dtype}"
        )
        return "\n".join([*lines, f"  {self.report}"])

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

        Raises:
            ValueError: If ``n_theta`` is not positive.
        """
        return self.to_layout("latlong", n_theta)

    def to_layout(
        self,
        layout: str,
        side: int,
        *,
        rotation: Float[np.ndarray, "3 3"] | None = None,
    ) -> EnvironmentMap:
        """The same light on the pixels of another layout.

        Between lat-long maps pixels are averaged (or repeated) over their exact overlap;
        otherwise the map is read between its pixels, without seams, and where it shrinks
        each new pixel is an average that keeps the flux of every old one.

        Args:
            layout: A name in :data:`shjax.layouts.LAYOUTS`.
            side: Rows of a lat-long map; pixels along a face, a disc or the square of
                the others.
            rotation: Turns the light.

        Raises:
            ValueError: If the layout is unknown or cannot have such a side.
        """
        rule = _side_rule(layout)
        if side < rule[0] or side % rule[1]:
            name = "n_theta" if layout == "latlong" else "side"
            raise ValueError(f"{name} must be {rule[2]}; got {side}.")
        shape = LAYOUTS[layout].shape(side)
        image = resample(np.asarray(self.image), self.layout, layout, shape, rotation)
        report = dataclasses.replace(
            self.report, layout=layout, height=shape[0], width=shape[1]
        )
        return _with_pixels(image, layout, report)


def _side_rule(layout: str) -> tuple[int, int, str]:
    """Least side, what it is a multiple of, and both in words."""
    _check_layout(layout)
    if LAYOUTS[layout].even:
        return 2, 2, f"positive and even for layout {layout!r}"
    if layout.startswith("openexr"):
        return 2, 1, f"at least 2 for layout {layout!r}"
    return 1, 1, "positive"


def _check_layout(layout: str) -> None:
    if layout not in LAYOUTS:
        raise ValueError(f"layout must be one of {', '.join(LAYOUTS)}; got {layout!r}.")


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
    check_channels("image", image, "H, W, C", 3, batch=False)
    height, width, _channels = image.shape
    guessed = layout == "auto"
    name = guess_layout(height, width) if guessed else layout
    _check_layout(name)
    if name != "latlong" and not LAYOUTS[name].fits(height, width):
        across, down = LAYOUTS[name].aspect
        even = " and an even side" if LAYOUTS[name].even else ""
        raise ValueError(
            f"image must have the aspect {across}:{down}{even} of layout {name!r}; "
            f"got {width} x {height}."
        )
    report = report or Report("array", str(image.dtype), name, guessed, height, width)
    report = dataclasses.replace(report, layout=name, layout_guessed=guessed)
    return _with_pixels(image, name, report)


def _with_pixels(
    image: Float[Array, "H W C"], layout: str, report: Report
) -> EnvironmentMap:
    if layout == "latlong":
        return EnvironmentMap(image, layout, None, None, image, report)
    directions, solid_angles = LAYOUTS[layout].pixels(*image.shape[:2])
    inside = solid_angles > 0
    pixels = np.asarray(image)[inside]
    return EnvironmentMap(
        pixels, layout, directions[inside], solid_angles[inside], image, report
    )
