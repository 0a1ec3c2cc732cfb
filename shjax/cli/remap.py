"""``shjax remap``: an environment map in another layout, size or kind of file."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np

from shjax import io
from shjax.cli.options import (
    FiniteRange,
    invalid_option,
    layout_option,
    primaries_option,
    rotate_option,
)
from shjax.cli.pictures import as_rgb, header
from shjax.display import OPERATORS, tone_map
from shjax.envmap import EnvironmentMap
from shjax.io.exr import COMPRESSIONS
from shjax.io.writing import json_text, protecting
from shjax.layouts import LAYOUTS
from shjax.layouts.cubes import FACES

SCHEMA = "shjax.remap/1"
_SIX = "faces"


@click.command(short_help="An environment map in another layout.")
@click.argument("source", type=click.Path(path_type=Path))
@click.argument("target", type=click.Path(path_type=Path))
@click.option(
    "--to", "layout_to", default="latlong", show_default=True,
    type=click.Choice([*LAYOUTS, _SIX]),
    help="Layout of TARGET; faces: six files TARGET_px, _nx, _py, _ny, _pz, _nz.",
)  # fmt: skip
@click.option(
    "--size", type=click.IntRange(1, 2**14), metavar="PIXELS",
    help="Rows of a lat-long map, else pixels along a face or disc; default about as "
    "many pixels as SOURCE has.",
)  # fmt: skip
@layout_option
@click.option("--layer", help="Part or layer of an EXR; default the first in colour.")
@invalid_option
@primaries_option
@rotate_option
@click.option("--half", is_flag=True, help="An EXR of 16 bits in place of 32.")
@click.option(
    "--compression", default="zip", show_default=True, type=click.Choice(COMPRESSIONS),
    help="Of an EXR.",
)  # fmt: skip
@click.option(
    "--tone", default="reinhard", show_default=True, type=click.Choice(OPERATORS),
    help="How a PNG shows it; aces: ACES 2.0 for an SDR screen.",
)  # fmt: skip
@click.option(
    "--exposure", default=0.0, show_default=True, metavar="STOPS",
    type=FiniteRange(-30, 30), help="Brighten by powers of two.",
)  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
@click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")
def remap(
    source: Path,
    target: Path,
    layout_to: str,
    size: int | None,
    layout: str,
    layer: str | None,
    invalid: str,
    primaries: str,
    rotate: np.ndarray | None,
    half: bool,
    compression: str,
    tone: str,
    exposure: float,
    as_json: bool,
    quiet: bool,
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
    envmap = io.read_envmap(
        source,
        layout=layout,
        layer=layer,
        invalid=invalid,
        primaries=primaries,
        isolate=True,
    )
    name = "vertical_strip" if layout_to == _SIX else layout_to
    side = size or default_side(envmap, name)
    same = name == envmap.layout and size is None and rotate is None
    found = envmap if same else envmap.to_layout(name, side, rotation=rotate)
    image = np.asarray(found.image, np.float32) * np.float32(2.0**exposure)
    if target.suffix.lower() == ".png":
        image = as_rgb(tone_map(image, operator=tone))
    pictures = {target: image}
    if layout_to == _SIX:
        pictures = {
            target.with_name(f"{target.stem}_{face}{target.suffix}"): part
            for face, part in zip(FACES, np.split(image, 6), strict=True)
        }
    about = header(envmap.report.source, units="radiance", layout=layout_to)
    said = [str(envmap.report)]
    if target.suffix.lower() == ".hdr" and np.any(image < 0):
        share = -np.sum(np.minimum(image, 0)) / np.sum(np.abs(image))
        said.append(f"negative values, {share:.2g} of the light, are black in .hdr")
        pictures = {path: np.maximum(part, 0) for path, part in pictures.items()}
    inputs = sorted(source.iterdir()) if source.is_dir() else [source]
    with protecting(*inputs):
        for path, picture in pictures.items():
            io.write_image(
                path, picture, attributes=about, half=half, compression=compression,
                layout=name,
            )  # fmt: skip
    if as_json and not quiet:
        height, width = image.shape[:2]
        result = {"schema": SCHEMA, "source": str(source), "layout": layout_to}
        result |= {"width": width, "height": height, "report": "; ".join(said)}
        print(json_text({**result, "files": [str(path) for path in pictures]}))
    elif not quiet:
        print("\n".join(said))
        for path, picture in pictures.items():
            print(f"{path}: {picture.shape[1]} x {picture.shape[0]}, {layout_to}")


def default_side(envmap: EnvironmentMap, layout: str) -> int:
    """The side at which a layout has about as many pixels as a map, and is even."""
    held = LAYOUTS[envmap.layout].solid_angles(*envmap.image.shape[:2])
    some = np.count_nonzero(LAYOUTS[layout].solid_angles(*LAYOUTS[layout].shape(64)))
    side = 64 * np.sqrt(np.count_nonzero(held) / some)
    return max(2 * round(side / 2), 2)
