"""Options that several commands share, packed into one argument each.

Each command parses in a module that knows words only, so that its help costs nothing; it
runs to a dataclass, writes and shows in another.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from shjax.cli import words
from shjax.cli.texts import Angles, Axes, BrdfText, FiniteRange, Material, MaterialText
from shjax.layouts import LAYOUTS

if TYPE_CHECKING:
    from rich.console import Console

    from shjax.brdf import Brdf
    from shjax.envmap import EnvironmentMap

brdf_option = click.option(
    "--brdf",
    default="ggx alpha=0.4 f0=1",
    show_default=True,
    type=BrdfText(),
    help="Terms joined by ' + ', each a model and its parameters, a factor and * before "
    "it: " + ", ".join(words.BRDFS) + ".",
)


material_option = click.option(
    "--material",
    type=MaterialText(),
    help="glTF's metallic-roughness material in place of --brdf, drawn by the lighting "
    "layer: some of roughness=R, metallic=M, albedo=A or R,G,B and f0=F, joined by "
    "commas; else 0.5, 0, 0.8 and 0.04. On a mesh, 'mesh' takes the file's own "
    "textures and factors.",
)

maps_option = click.option(
    "--maps",
    default="9",
    show_default=True,
    type=click.Choice(words.MAPS),
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


def packed(name: str, cls: type, *options: Callable) -> Callable:
    """Decorator that gives a command some options as one dataclass.

    Args:
        name: The command's argument.
        cls: A dataclass whose fields are the options' names.
        options: Of click.
    """
    fields = [field.name for field in dataclasses.fields(cls)]

    def decorate(command: Callable) -> Callable:
        @functools.wraps(command)
        def called(**given):
            own = cls(**{field: given.pop(field) for field in fields})
            return command(**given, **{name: own})

        for option in reversed(options):
            called = option(called)
        return called

    return decorate


def choice(name: str, choices, default: str, text: str) -> Callable:
    """An option that takes one of some words."""
    kind = click.Choice(list(choices))
    return click.option(name, default=default, show_default=True, type=kind, help=text)


def number(
    name: str, default: Any, kind: click.ParamType, text: str, **more
) -> Callable:
    """An option that takes a number."""
    shown = more.pop("show_default", default is not None)
    return click.option(
        name, default=default, show_default=shown, type=kind, help=text, **more
    )


@dataclasses.dataclass(frozen=True)
class Reading:
    """Options by which environment maps are read."""

    layout: str
    invalid: str
    primaries: str

    def read(self, path: Path, *, layer: str | None = None) -> EnvironmentMap:
        """Read an environment map in a process of its own."""
        from shjax import io

        return io.read_envmap(
            path,
            layout=self.layout,
            layer=layer,
            invalid=self.invalid,
            primaries=self.primaries,
            isolate=True,
        )


layout_option = choice(
    "--layout",
    ["auto", *LAYOUTS],
    "auto",
    "How an environment map covers the sphere.",
)
invalid_option = choice(
    "--invalid",
    words.INVALID,
    "error",
    "What to do with NaN, infinite and negative pixels.",
)
primaries_option = choice(
    "--primaries",
    ("rec709", "keep"),
    "rec709",
    "Of the results' colours: other primaries (ACEScg, XYZ) are converted, or kept.",
)
reading_options = packed(
    "reading", Reading, layout_option, invalid_option, primaries_option
)


@dataclasses.dataclass(frozen=True)
class Output:
    """What a command prints."""

    as_json: bool
    quiet: bool

    def print_json(self, content: dict, *, flush: bool = True) -> bool:
        """Print one JSON object if that was asked for; True if nothing is left to say."""
        from shjax.io.writing import json_text

        if self.as_json and not self.quiet:
            print(json_text(content), flush=flush)
        return self.as_json or self.quiet

    def console(self) -> Console:
        """Console on which a command shows its results."""
        from rich.console import Console

        silent = self.quiet or self.as_json
        return Console(quiet=silent, soft_wrap=True)


json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON.")
output_options = packed(
    "output",
    Output,
    json_option,
    click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors."),
)

out_option = click.option(
    "-o",
    "--out",
    required=True,
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Folder for the results; made if it is missing.",
)


@dataclasses.dataclass(frozen=True)
class Reflectance:
    """What a surface is made of and how accurately it is drawn."""

    brdf: Brdf
    material: Material | None
    maps: str
    rms_error: float
    max_bytes: int

    def __post_init__(self) -> None:
        """Refuse ``--material`` beside a ``--brdf`` that was given.

        Raises:
            click.UsageError: If both were.
        """
        source = click.get_current_context().get_parameter_source("brdf")
        if self.material is not None and source is not ParameterSource.DEFAULT:
            raise click.UsageError(
                "--material takes the place of --brdf: give one of them."
            )


reflectance_options = packed(
    "reflectance",
    Reflectance,
    brdf_option,
    material_option,
    maps_option,
    rms_error_option,
    max_bytes_option,
)

rotate_option = click.option(
    "--rotate",
    type=Angles(),
    help="Rotate the light, degrees: yaw to the left, pitch raises the panorama's "
    "centre, roll clockwise.",
)

window_option = choice(
    "--window",
    words.WINDOWS,
    "none",
    "Damp the high degrees; automatic: the least that keeps irradiance >= 0.",
)

axes_option = click.option(
    "--axes",
    type=Axes(),
    help="The other tool's x, y and z as signed axes of shjax (z up, x the panorama's "
    "centre), like x,z,-y.",
)
