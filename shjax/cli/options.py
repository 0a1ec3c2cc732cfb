"""Options, and the step from a map to coefficients, that several commands share."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import click
import jax
import numpy as np
from click.core import ParameterSource

import shjax
from shjax.adapted import RANKS
from shjax.brdf.parse import MODELS, parse
from shjax.envmap import EnvironmentMap
from shjax.io.envmaps import INVALID_CHOICES
from shjax.layouts import LAYOUTS
from shjax.sphere import yaw_pitch_roll
from shjax.windows import NAMES


class FiniteRange(click.FloatRange):
    """A finite number within limits; click's own lets NaN pass, which no limit stops."""

    def _describe_range(self) -> str:
        """The limits in words; click's own says ``x<=None`` where there is none."""
        if self.min is None and self.max is None:
            return "any finite number"
        return super()._describe_range()

    def convert(self, value, param, ctx):
        """Text to a float."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number", param, ctx)
        return number


class _Angles(click.ParamType):
    name = "YAW,PITCH,ROLL"

    def convert(self, value, param, ctx):
        """Three numbers in degrees to a rotation matrix."""
        if isinstance(value, np.ndarray):
            return value
        try:
            angles = [float(part) for part in value.split(",")]
        except ValueError:
            angles = []
        if len(angles) != 3 or not np.all(np.isfinite(angles)):
            self.fail(f"{value!r} is not three numbers like 90,0,0", param, ctx)
        return yaw_pitch_roll(*np.radians(angles))


class _Axes(click.ParamType):
    name = "AXES"

    def convert(self, value, param, ctx):
        """Signed letters such as 'x,z,-y' to a matrix of axes."""
        if isinstance(value, np.ndarray):
            return value
        rows = []
        for word in value.replace(",", " ").split():
            letter = word.lstrip("+-").lower()
            if letter not in ("x", "y", "z"):
                self.fail(f"{value!r} is not three signed axes like x,z,-y", param, ctx)
            row = np.eye(3)["xyz".index(letter)]
            rows.append(-row if word.startswith("-") else row)
        matrix = np.array(rows)
        if matrix.shape != (3, 3) or abs(np.linalg.det(matrix)) != 1:
            self.fail(f"{value!r} does not name each axis once", param, ctx)
        return matrix


class BrdfText(click.ParamType):
    """A reflectance in words (:func:`shjax.brdf.parse.parse`)."""

    name = "MODEL"

    def convert(self, value, param, ctx):
        """A description to a BRDF."""
        if not isinstance(value, str):
            return value
        try:
            return parse(value)
        except (ValueError, OSError, TypeError) as error:
            self.fail(str(error), param, ctx)


brdf_option = click.option(
    "--brdf",
    default="ggx alpha=0.4 f0=1",
    show_default=True,
    type=BrdfText(),
    help="Terms joined by ' + ', each a model and its parameters, a factor and * before "
    "it: " + ", ".join(MODELS) + ".",
)


@dataclasses.dataclass(frozen=True)
class Material:
    """A metallic-roughness material; ``mesh`` says that the mesh's own comes first.

    Attributes:
        given: albedo, roughness, metallic and f0, as far as they were given.
        mesh: Whether to take the rest from the mesh's file.
    """

    given: dict[str, np.ndarray]
    mesh: bool

    def value(self, name: str) -> Any:
        """What was given, or the default."""
        return self.given.get(name, np.float32(_MATERIAL[name]))


_MATERIAL = {"albedo": 0.8, "roughness": 0.5, "metallic": 0.0, "f0": 0.04}


class _MaterialText(click.ParamType):
    name = "MATERIAL"

    def convert(self, value, param, ctx):
        """``roughness=0.4,albedo=0.9,0.6,0.3`` or ``mesh`` to a :class:`Material`."""
        if not isinstance(value, str):
            return value
        given: dict[str, list[str]] = {}
        mesh, last = False, None
        for word in (part.strip() for part in value.split(",")):
            key, equals, text = word.partition("=")
            if equals and key in _MATERIAL:
                last, given[key] = key, [text]
            elif word == "mesh" and last is None:
                mesh = True
            elif not equals and last is not None:
                given[last].append(word)
            else:
                known = ", ".join(f"{k}=..." for k in _MATERIAL)
                self.fail(f"{word!r} is not one of mesh, {known}", param, ctx)
        numbers = {}
        for key, words in given.items():
            try:
                array = np.array([float(word) for word in words], np.float32)
            except ValueError:
                self.fail(f"{key}={','.join(words)} is not a number", param, ctx)
            single = key in ("roughness", "metallic")
            if array.size not in ((1,) if single else (1, 3)):
                rule = "one number" if single else "one number or three"
                self.fail(f"{key} takes {rule}; got {','.join(words)}", param, ctx)
            if not np.all((array >= 0) & (array <= 1)):
                self.fail(
                    f"{key} must lie in [0, 1]; got {','.join(words)}", param, ctx
                )
            numbers[key] = array if array.size > 1 else array[0]
        if numbers.get("roughness") == 0:
            self.fail("roughness must lie in (0, 1]; got 0", param, ctx)
        return Material(numbers, mesh)


material_option = click.option(
    "--material",
    type=_MaterialText(),
    help="glTF's metallic-roughness material in place of --brdf, drawn by the lighting "
    "layer: some of roughness=R, metallic=M, albedo=A or R,G,B and f0=F, joined by "
    "commas; else 0.5, 0, 0.8 and 0.04. On a mesh, 'mesh' takes the file's own "
    "textures and factors.",
)

maps_option = click.option(
    "--maps",
    default="9",
    show_default=True,
    type=click.Choice([str(n) for n in RANKS]),
    help="Maps of the lighting layer, for --material: many are accurate.",
)

rms_error_option = click.option(
    "--rms-error",
    default=0.1,
    show_default=True,
    type=FiniteRange(0, 1, min_open=True),
    help="Error over all orientations and views, relative to the rms radiance; its "
    "square is the error in energy.",
)

max_bytes_option = click.option(
    "--max-bytes",
    default=2**28,
    show_default=True,
    type=click.IntRange(1),
    help="Larger models are not considered.",
)

rotate_option = click.option(
    "--rotate",
    type=_Angles(),
    help="Turn the light, degrees: yaw to the left, pitch raises the panorama's centre, "
    "roll clockwise.",
)

window_option = click.option(
    "--window",
    default="none",
    show_default=True,
    type=click.Choice(NAMES),
    help="Damp the high degrees; automatic: the least that keeps irradiance >= 0.",
)

axes_option = click.option(
    "--axes",
    type=_Axes(),
    help="The other tool's x, y and z as signed axes of shjax (z up, x the panorama's "
    "centre), like x,z,-y.",
)

layout_option = click.option(
    "--layout",
    default="auto",
    show_default=True,
    type=click.Choice(["auto", *LAYOUTS]),
    help="How an environment map covers the sphere.",
)

invalid_option = click.option(
    "--invalid",
    default="error",
    show_default=True,
    type=click.Choice(INVALID_CHOICES),
    help="What to do with NaN, infinite and negative pixels.",
)


primaries_option = click.option(
    "--primaries",
    default="rec709",
    show_default=True,
    type=click.Choice(("rec709", "keep")),
    help="Of the results' colours: other primaries (ACEScg, XYZ) are converted, or kept.",
)


def check_one_reflectance(material: Material | None) -> None:
    """Refuse ``--material`` beside a ``--brdf`` that was given.

    Raises:
        click.UsageError: If both were.
    """
    source = click.get_current_context().get_parameter_source("brdf")
    if material is not None and source is not ParameterSource.DEFAULT:
        raise click.UsageError(
            "--material takes the place of --brdf: give one of them."
        )


def light_of(
    envmap: EnvironmentMap, l_max: int, rotation: np.ndarray | None
) -> tuple[jax.Array, str]:
    """Coefficients of a map, turned, and by which quadrature.

    A lat-long map too small for the degree is taken as constant over each pixel.
    """
    rows, columns = envmap.image.shape[:2]
    small = envmap.layout == "latlong" and min(rows, columns) < 2 * l_max + 1
    quadrature = "pixel" if small else "fejer"
    if envmap.layout != "latlong":
        quadrature = "pixel centres, exact solid angles"
        lighting = envmap.lighting(l_max=l_max)
    else:
        lighting = envmap.lighting(l_max=l_max, quadrature=quadrature)
    if not np.all(np.isfinite(np.asarray(lighting))):
        brightest = np.max(np.abs(np.asarray(envmap.image)))
        raise ValueError(
            f"{envmap.report.source}: the light overflows float32; its largest value is "
            f"{brightest:.3g}."
        )
    if rotation is not None:
        lighting = shjax.rotate(lighting, rotation)
    return lighting, quadrature


def quadrature_note(quadrature: str, l_max: int) -> str:
    """What to say of a map that is too small for its degree; empty otherwise."""
    if quadrature != "pixel":
        return ""
    return (
        f"fewer than {2 * l_max + 1} rows or columns: taken as constant over each pixel "
        "(quadrature 'pixel')"
    )
