"""What ``shjax remap`` does."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from shjax import io
from shjax.cli.options import Output, Reading
from shjax.cli.pictures import as_rgb, header
from shjax.cli.remap import SIX, Settings
from shjax.display import tone_map
from shjax.envmap import EnvironmentMap
from shjax.io.writing import protecting
from shjax.layouts import LAYOUTS
from shjax.layouts.cubes import FACES

SCHEMA = "shjax.remap/1"


@dataclasses.dataclass(frozen=True)
class RemapResult:
    """Pictures by their files, and what there is to say of them."""

    pictures: dict[Path, np.ndarray]
    said: list[str]
    shape: tuple[int, int]


def main(
    source: Path, target: Path, settings: Settings, reading: Reading, output: Output
) -> None:
    """Read, resample, write, show."""
    envmap = reading.read(source, layer=settings.layer)
    found = run(envmap, target, settings)
    inputs = sorted(source.iterdir()) if source.is_dir() else [source]
    about = header(envmap.report.source, units="radiance", layout=settings.to)
    with protecting(*inputs):
        for path, picture in found.pictures.items():
            io.write_image(
                path,
                picture,
                attributes=about,
                half=settings.half,
                compression=settings.compression,
                layout=_layout(settings),
            )
    height, width = found.shape
    result = {"schema": SCHEMA, "source": str(source), "layout": settings.to}
    result |= {"width": width, "height": height, "report": "; ".join(found.said)}
    files = [str(path) for path in found.pictures]
    if not output.print_json({**result, "files": files}):
        print("\n".join(found.said))
        for path, picture in found.pictures.items():
            print(f"{path}: {picture.shape[1]} x {picture.shape[0]}, {settings.to}")


def _layout(settings: Settings) -> str:
    return "vertical_strip" if settings.to == SIX else settings.to


def run(envmap: EnvironmentMap, target: Path, settings: Settings) -> RemapResult:
    """Resample, brighten and tone-map a map."""
    name = _layout(settings)
    side = settings.size or default_side(envmap, name)
    unchanged = settings.size is None and settings.rotate is None
    found = envmap
    if name != envmap.layout or not unchanged:
        found = envmap.to_layout(name, side, rotation=settings.rotate)
    image = np.asarray(found.image, np.float32) * np.float32(2.0**settings.exposure)
    if target.suffix.lower() == ".png":
        image = as_rgb(tone_map(image, operator=settings.tone))
    pictures = {target: image}
    if settings.to == SIX:
        pictures = {
            target.with_name(f"{target.stem}_{face}{target.suffix}"): part
            for face, part in zip(FACES, np.split(image, 6), strict=True)
        }
    said = [str(envmap.report)]
    if target.suffix.lower() == ".hdr" and np.any(image < 0):
        share = -np.sum(np.minimum(image, 0)) / np.sum(np.abs(image))
        said.append(f"negative values, {share:.2g} of the light, are black in .hdr")
        pictures = {path: np.maximum(part, 0) for path, part in pictures.items()}
    return RemapResult(pictures, said, image.shape[:2])


def default_side(envmap: EnvironmentMap, layout: str) -> int:
    """The side at which a layout has about as many pixels as a map, and is even."""
    held = LAYOUTS[envmap.layout].solid_angles(*envmap.image.shape[:2])
    some = np.count_nonzero(LAYOUTS[layout].solid_angles(*LAYOUTS[layout].shape(64)))
    side = 64 * np.sqrt(np.count_nonzero(held) / some)
    return max(2 * round(side / 2), 2)
