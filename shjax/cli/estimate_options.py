"""Options of ``shjax estimate``: what the picture shows, and how the light is fitted."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

import click

from shjax.cli import words
from shjax.cli.options import (
    choice,
    number,
    packed,
)
from shjax.cli.texts import BrdfText, FiniteRange, Numbers

if TYPE_CHECKING:
    from shjax.brdf import Brdf


def _path(name: str, metavar: str, text: str):
    kind = click.Path(path_type=Path)
    return click.option(name, type=kind, metavar=metavar, help=text)


@dataclasses.dataclass(frozen=True)
class Shape:
    """What the picture shows: a sphere, normals or a mesh."""

    sphere: tuple[float, float, float] | None
    normals: Path | None
    normals_frame: str | None
    layer: str | None
    normals_range: str | None
    mesh: Path | None
    camera: tuple[float, ...] | None
    up: tuple[float, float, float]
    fov: float | None
    width: float
    mask: Path | None


shape_options = packed(
    "shape",
    Shape,
    click.option(
        "--sphere",
        type=Numbers("CX,CY,R", (3,)),
        help="The picture shows a sphere: middle and radius in pixels from the upper "
        "left corner (the first pixel's middle is 0.5,0.5).",
    ),
    _path("--normals", "EXR", "The pixels' normals; 0,0,0 where nothing is seen."),
    click.option(
        "--normals-frame",
        type=click.Choice(words.NORMAL_FRAMES),
        help="camera: x right, y up, z towards the camera; opencv: y down, z away; "
        "world: shjax's; blender: the same; mitsuba: y up. Needed with --normals.",
    ),
    click.option(
        "--layer", help="Layer of the normals' EXR, like nn or ViewLayer.Normal."
    ),
    click.option(
        "--normals-range",
        type=click.Choice(["signed", "unsigned"]),
        help="[-1, 1] or [0, 1]. Needed with --normals.",
    ),
    _path(
        "--mesh",
        "MESH",
        "The picture shows this mesh (OBJ, OFF, PLY, glTF), its own shadows included.",
    ),
    click.option(
        "--camera",
        type=Numbers("X,Y,Z[,TX,TY,TZ]", (3, 6)),
        help="Where the mesh's camera stands, and what it looks at (0,0,0).",
    ),
    number(
        "--up", "0,0,1", Numbers("X,Y,Z", (3,)), "Up in the picture, of that camera."
    ),
    number(
        "--fov",
        None,
        FiniteRange(0.1, 170),
        "Horizontal field of view of that camera; orthographic without.",
        metavar="DEGREES",
    ),
    number(
        "--width",
        2.1,
        FiniteRange(0, min_open=True),
        "Width of an orthographic camera's view.",
    ),
    _path("--mask", "PICTURE", "Pixels to use: those above one half."),
)


@dataclasses.dataclass(frozen=True)
class Fitting:
    """Options of the decoding of the picture and of the fit."""

    albedo: tuple[float, ...]
    brdf: Brdf | None
    l_max: int
    exposure: float
    transfer: str
    nonnegative: bool
    loss: str
    plain: bool


fitting_options = packed(
    "fitting",
    Fitting,
    number("--albedo", "1", Numbers("A or R,G,B", (1, 3)), "Of the object."),
    click.option(
        "--brdf", type=BrdfText(), help="A reflectance in place of the matte one."
    ),
    number("--l-max", 2, click.IntRange(0, 10), "Highest degree that is returned."),
    number(
        "--exposure",
        1.0,
        FiniteRange(0, min_open=True),
        "What the picture was multiplied by.",
    ),
    choice(
        "--transfer",
        ["auto", "srgb", "linear"],
        "auto",
        "How an 8- or 16-bit picture stores light; auto: sRGB unless the file says "
        "otherwise.",
    ),
    click.option(
        "--nonnegative", is_flag=True, help="Allow no light of negative radiance."
    ),
    choice(
        "--loss",
        ["squares", "huber", "cauchy"],
        "squares",
        "Of the residuals; huber and cauchy bear outliers.",
    ),
    click.option(
        "--plain",
        is_flag=True,
        help="Least squares of these degrees alone: light of higher ones is an error "
        "of them.",
    ),
)
