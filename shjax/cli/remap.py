"""``shjax remap``: an environment map in another layout, size or kind of file."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

import click

from shjax.cli import words
from shjax.cli.options import (
    Output,
    Reading,
    choice,
    number,
    output_options,
    packed,
    reading_options,
    rotate_option,
)
from shjax.cli.texts import FiniteRange
from shjax.io.exr_writing import COMPRESSIONS
from shjax.layouts import LAYOUTS

if TYPE_CHECKING:
    import numpy as np

SIX = "faces"


@dataclasses.dataclass(frozen=True)
class Settings:
    """What is written."""

    to: str
    size: int | None
    layer: str | None
    rotate: np.ndarray | None
    half: bool
    compression: str
    tone: str
    exposure: float


settings_options = packed(
    "settings",
    Settings,
    choice(
        "--to",
        [*LAYOUTS, SIX],
        "latlong",
        "Layout of TARGET; faces: six files TARGET_px, _nx, _py, _ny, _pz, _nz.",
    ),
    number(
        "--size",
        None,
        click.IntRange(1, 2**14),
        "Rows of a lat-long map, else pixels along a face or disc; default about as many "
        "pixels as SOURCE has.",
        metavar="PIXELS",
    ),
    click.option(
        "--layer", help="Part or layer of an EXR; default the first in colour."
    ),
    rotate_option,
    click.option("--half", is_flag=True, help="An EXR of 16 bits in place of 32."),
    choice("--compression", COMPRESSIONS, "zip", "Of an EXR."),
    choice(
        "--tone",
        words.OPERATORS,
        "reinhard",
        "How a PNG shows it; aces: ACES 2.0 for an SDR screen.",
    ),
    number(
        "--exposure",
        0.0,
        FiniteRange(-30, 30),
        "Brighten by powers of two.",
        metavar="STOPS",
    ),
)


@click.command(short_help="An environment map in another layout.")
@click.argument("source", type=click.Path(path_type=Path))
@click.argument("target", type=click.Path(path_type=Path))
@settings_options
@reading_options
@output_options
def remap(
    source: Path, target: Path, settings: Settings, reading: Reading, output: Output
) -> None:
    """Write the environment map SOURCE to TARGET (.exr, .hdr or .png).

    Any layout to any other, without seams; a map that shrinks keeps its energy, the sun's
    one pixel included. SOURCE may be a folder of six faces.

    \b
    Examples:
      shjax remap probe.hdr panorama.exr --layout angular --size 512
      shjax remap panorama.exr cube.exr --to vertical_cross --half
      shjax remap panorama.hdr sky.png --to faces --size 256 --tone aces
    """
    from shjax.io import isolation

    isolation.start()  # the reader gets ready while the rest is imported
    from shjax.cli import remap_run

    remap_run.main(source, target, settings, reading, output)
