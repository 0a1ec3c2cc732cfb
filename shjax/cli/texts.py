"""Parameters of commands given as text: rotations, axes, reflectances, materials."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import click
import numpy as np


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


class Angles(click.ParamType):
    """Three angles in degrees: yaw, pitch and roll of a light."""

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
        from shjax.sphere import yaw_pitch_roll

        return yaw_pitch_roll(*np.radians(angles))


class Axes(click.ParamType):
    """Axes of another tool, signed letters in the library's frame."""

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
        from shjax.brdf.parse import parse

        try:
            return parse(value)
        except (ValueError, OSError, TypeError) as error:
            self.fail(str(error), param, ctx)


class AreaLightText(click.ParamType):
    """An area light in words (:func:`shjax.lights.parse`)."""

    name = "LIGHT"

    def convert(self, value, param, ctx):
        """A description to an area light; errors of a value are those of its maker."""
        if not isinstance(value, str):
            return value
        from shjax.lights.in_words import parse

        try:
            return value, parse(value)
        except (ValueError, TypeError) as error:
            self.fail(str(error), param, ctx)


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

    def values(self) -> dict[str, Any]:
        """All four parameters."""
        return {name: self.value(name) for name in _MATERIAL}


_MATERIAL = {"albedo": 0.8, "roughness": 0.5, "metallic": 0.0, "f0": 0.04}


class MaterialText(click.ParamType):
    """A metallic-roughness material in words."""

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


class Numbers(click.ParamType):
    """So many numbers with commas between."""

    def __init__(self, name: str, counts: tuple[int, ...]):
        self.name, self.counts = name, counts

    def convert(self, value, param, ctx):
        """Text to floats."""
        if not isinstance(value, str):
            return value
        try:
            numbers = tuple(float(part) for part in value.split(","))
        except ValueError:
            numbers = ()
        if len(numbers) not in self.counts or not np.all(np.isfinite(numbers)):
            self.fail(f"{value!r} is not {self.name}", param, ctx)
        return numbers
