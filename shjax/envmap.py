"""Environment maps: distant radiance on the pixels or at the samples it is stored on."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import jax
import numpy as np
from jax.core import Tracer
from jaxtyping import Float

from shjax.arrays import Array, check_channels, check_samples
from shjax.harmonics import analyze, project_samples
from shjax.harmonics.grid import Grid
from shjax.layouts import LAYOUTS, guess_layout
from shjax.layouts.resampling import resample
from shjax.sphere import latlong_directions

SAMPLES = "samples"


@dataclasses.dataclass(frozen=True)
class Report:
    """Record of what a reader found in an environment image and what it did about it.

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
    """Environment map: distant radiance over the sphere of directions.

    What every function that integrates over the light takes, in place of which a lat-long
    panorama array serves too. Made by :func:`shjax.io.read_envmap`, by
    :func:`shjax.make_envmap` from an image, or by :meth:`from_samples`.

    Attributes:
        radiance: ``(n_theta, n_phi, C)`` for lat-long, else pixels or samples ``(N, C)``.
        layout: Name in :data:`shjax.layouts.LAYOUTS`, or ``"samples"``.
        directions: Unit vectors to the pixels ``(N, 3)``; None for lat-long.
        solid_angles: Exact solid angles ``(N,)``, steradians; None for lat-long.
        image: The image ``(H, W, C)`` as it was stored; of samples their radiance.
        report: What was found and done.
    """

    radiance: Float[Array, ...]
    layout: str
    directions: Float[Array, "N 3"] | None
    solid_angles: Float[Array, " N"] | None
    image: Float[Array, ...]
    report: Report
    in_place_of_array: ClassVar[str] = (
        "its coefficients are envmap.lighting(l_max=2), its pixels envmap.radiance"
    )

    def __repr__(self) -> str:
        """What it is, how large and how bright, in three lines."""
        size = " x ".join(
            str(n) for n in (*self.image.shape[1::-1], *self.image.shape[2:])
        )
        lines = [f"EnvironmentMap: {size}, {self.layout}"]
        if isinstance(self.radiance, Tracer):
            return f"{lines[0]} (traced)"
        pixels = np.asarray(self.radiance)
        lines.append(
            f"  radiance {np.nanmin(pixels):.3g} to {np.nanmax(pixels):.3g}, "
            f"mean of the pixels {np.nanmean(pixels):.3g}, {pixels.dtype}"
        )
        return "\n".join([*lines, f"  {self.report}"])

    @classmethod
    def from_samples(
        cls,
        radiance: Float[Array, "N C"],
        directions: Float[Array, "N 3"],
        solid_angles: Float[Array, " N"],
    ) -> EnvironmentMap:
        """Environment map of radiance known at any directions, such as a renderer's rays.

        Args:
            radiance: Samples.
            directions: Unit vectors to them.
            solid_angles: Their quadrature weights, steradians.

        Raises:
            ValueError: If the shapes do not fit each other.
        """
        check_samples(radiance, directions, solid_angles, weights_name="solid_angles")
        report = Report(
            "samples", str(radiance.dtype), SAMPLES, False, radiance.shape[0], 1
        )
        return cls(radiance, SAMPLES, directions, solid_angles, radiance, report)

    def lighting(
        self, *, l_max: int, quadrature: str | None = None
    ) -> Float[jax.Array, "K C"]:
        """Radiance coefficients of spherical harmonics, ``((l_max + 1)^2, C)``.

        Of any degree and any map. The rule for a lat-long map of too few pixels for the
        degree, here and wherever the library takes a map: its radiance is constant over
        each pixel.

        Args:
            l_max: Highest degree, inclusive.
            quadrature: For a lat-long map, as in :func:`shjax.analyze`; default
                :meth:`quadrature`.

        Raises:
            ValueError: If ``l_max`` is out of range, or the quadrature that is named does
                not reach it.
        """
        if self.layout == "latlong":
            rule = quadrature or self.quadrature(l_max)
            return analyze(self.radiance, l_max=l_max, quadrature=rule)
        return project_samples(*self.samples(), l_max=l_max)

    def quadrature(self, l_max: int) -> str:
        """The quadrature by which :meth:`lighting` integrates to a degree, by name.

        ``"fejer"`` for a lat-long map of at least ``2 l_max + 1`` rows and columns,
        ``"pixel"`` for a smaller one, ``"samples"`` for all other layouts.
        """
        if self.layout != "latlong":
            return SAMPLES
        return "pixel" if min(self.radiance.shape[:2]) < 2 * l_max + 1 else "fejer"

    def samples(self) -> tuple[Array, Array, Array]:
        """Light samples: radiance ``(N, C)``, directions ``(N, 3)``, weights ``(N,)``.

        The quadrature weights of a lat-long map are Fejer's, those of others solid angles.
        """
        if self.directions is not None and self.solid_angles is not None:
            return self.radiance, self.directions, self.solid_angles
        return panorama_samples(self.radiance)

    def to_latlong(self, n_theta: int) -> EnvironmentMap:
        """Resample to a lat-long map of ``n_theta x 2 n_theta`` pixels.

        Raises:
            ValueError: If ``n_theta`` is not positive, or this is a map of samples.
        """
        return self.to_layout("latlong", n_theta)

    def to_layout(
        self,
        layout: str,
        side: int,
        *,
        rotation: Float[np.ndarray, "3 3"] | None = None,
    ) -> EnvironmentMap:
        """Resample to another layout, such as a cube map or an octahedral map.

        Between lat-long maps pixels are averaged (or repeated) over their exact overlap;
        otherwise the map is read between its pixels, without seams, and where it shrinks
        each new pixel is an average that keeps the flux of every old one.

        Args:
            layout: A name in :data:`shjax.layouts.LAYOUTS`.
            side: Rows of a lat-long map; pixels along a face, a disc or the square of
                the others.
            rotation: Rotates the light, ``(3, 3)``.

        Raises:
            ValueError: If the layout is unknown or cannot have such a side, or this is a
                map of samples, which have no pixels to read between.
        """
        rule = _side_rule(layout)
        if self.layout == SAMPLES:
            raise ValueError(
                "a map of samples has no pixels to read between; integrate it, or "
                "synthesize its lighting()."
            )
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
    """Environment map from the pixels of an image: a panorama, a cube map, a light probe.

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


def panorama_samples(
    radiance: Float[Array, "n_theta n_phi C"],
) -> tuple[Array, np.ndarray, np.ndarray]:
    """Light samples of a lat-long panorama, weighted by Fejer's rule.

    Returns:
        Radiance ``(N, C)``, directions ``(N, 3)`` and solid angles ``(N,)``.
    """
    n_theta, n_phi, channels = radiance.shape
    directions = latlong_directions(n_theta, n_phi).reshape(-1, 3)
    weights = np.repeat(Grid(n_theta, n_phi).weights, n_phi)
    return radiance.reshape(-1, channels), directions, weights
