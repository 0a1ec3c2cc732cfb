"""Options that several commands share."""

from __future__ import annotations

import click
import numpy as np

from shjax.sphere import yaw_pitch_roll
from shjax.windows import NAMES


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
