"""What ``shjax render`` does."""

from __future__ import annotations

import dataclasses
import json
import warnings
from collections.abc import Callable
from pathlib import Path

import click
import jax
import jax.numpy as jnp
import numpy as np

from shjax import io, render
from shjax.cli.drawing import Drawing, drawing_of, with_area_lights
from shjax.cli.many import alone, since, stamp
from shjax.cli.options import Output, Reading, Reflectance
from shjax.cli.pictures import FRAME, as_rgb, header, progress_display
from shjax.cli.render import View
from shjax.cli.stage import as_latlong, camera_at, placed
from shjax.display import tone_map
from shjax.envmap import EnvironmentMap
from shjax.io.writing import check_folder, json_text, protecting
from shjax.lights import AreaLight
from shjax.render import Camera, GBuffer
from shjax.render.loading import load_mesh, not_drawn
from shjax.render.meshes import trace_mesh

SCHEMA = "shjax.render/1"


def main(
    mesh: Path,
    env: Path | None,
    out: Path,
    reflectance: Reflectance,
    area_lights: tuple[tuple[str, AreaLight], ...],
    view: View,
    reading: Reading,
    output: Output,
) -> None:
    """Read, choose what draws, draw and write what is missing, show."""
    path = env or io.shipped_panorama()
    check_folder(out)
    context = click.get_current_context()
    context.with_resource(protecting(path, mesh))
    context.with_resource(alone(out, mesh.stem))
    if any(part.model.centre == "tangent" for part in reflectance.brdf.parts):
        raise click.UsageError("a mesh has no tangents for a BRDF of fibres.")
    geometry = placed(load_mesh(mesh), view.up)
    envmap = reading.read(path)
    drawing = drawing_of(envmap, reflectance)
    drawing = with_area_lights(drawing, reflectance, area_lights)
    settings = {
        "schema": SCHEMA,
        "mesh": str(mesh),
        "source": str(path),
        "report": dataclasses.asdict(envmap.report),
        "frame": FRAME,
        **dataclasses.asdict(view),
        **drawing.about,
        "inputs": [stamp(mesh), stamp(path)],
    }
    record = out / f"{mesh.stem}_render.json"
    again = _same(record, settings)
    io.write_text(record, json_text(settings, indent=1) + "\n")
    panorama = jnp.asarray(as_latlong(envmap))
    with progress_display(output.quiet) as progress:
        task = progress.add_task(f"{mesh.name}: drawing", total=view.turntable)
        stems = [mesh.stem]
        if view.turntable > 1:
            stems = [f"{mesh.stem}_{frame:04d}" for frame in range(view.turntable)]
        found = run(
            geometry,
            drawing,
            view,
            panorama,
            [out / stem for stem in stems],
            keep=again,
            attributes=header(path.name, units="radiance", model=drawing.about["why"]),
            step=lambda: progress.update(task, advance=1),
        )
    if output.print_json({**settings, "files": found.files}):
        return
    ignored = not_drawn(geometry) if drawing.textured else ()
    show(output, envmap, drawing, found, [*ignored], record)


@dataclasses.dataclass(frozen=True)
class Frames:
    """Files of the pictures, and those of them that an earlier run had made."""

    files: list[str]
    kept: list[str]


def run(
    geometry,
    drawing: Drawing,
    view: View,
    panorama: jax.Array,
    places: list[Path],
    *,
    keep: bool,
    attributes: dict[str, str],
    step: Callable[[], None],
) -> Frames:
    """Draw and write the frames that are missing.

    Args:
        geometry: The mesh, in its place.
        drawing: What draws.
        view: The cameras.
        panorama: Behind the mesh.
        places: Of the files, without a suffix, one per frame.
        keep: Whether files that are there are of a run with these settings.
        attributes: Of the files.
        step: Called after each frame.
    """
    files, kept, white = [], [], None
    for frame, place in enumerate(places):
        names = [f"{place}{suffix}" for suffix in (".exr", ".png")]
        files += names
        if keep and all(Path(name).exists() for name in names):
            kept += names
        else:
            angle = view.azimuth + 360 * frame / len(places)
            camera = camera_at(angle, view.elevation, view.fov)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # said once, at the end
                trace = trace_mesh(
                    geometry, camera, view.size, material=drawing.textured
                )
            picture = _draw(trace.gbuffer, drawing, camera, panorama, view.background)
            white = white or _white(panorama, picture, view.background)
            io.write_image(names[0], picture, attributes=attributes)
            io.write_image(names[1], as_rgb(tone_map(picture, white=white)))
        step()
    return Frames(files, kept)


def show(
    output: Output,
    envmap: EnvironmentMap,
    drawing: Drawing,
    found: Frames,
    ignored: list[str],
    record: Path,
) -> None:
    """Show what drew, what was not drawn, what was kept, and the files."""
    console = output.console()
    console.print(str(envmap.report), style="bold", markup=False)
    console.print(f"[bold]model[/]  {drawing.about['why']}", highlight=False)
    if ignored:
        text = f"not drawn of the mesh's material: {', '.join(ignored)}"
        console.print(text, highlight=False, markup=False)
    if found.kept:
        console.print(
            f"{len(found.kept) // 2} of {len(found.files) // 2} kept of a run with these "
            f"settings, from {since(found.kept)}",
            highlight=False,
        )
    console.print("written:", highlight=False)
    more = ["..."] if len(found.files) > 4 else []
    for name in [*found.files[:4], *more, str(record)]:
        console.print(f"  {name}", highlight=False, markup=False)


def _draw(
    gbuffer: GBuffer, drawing: Drawing, camera: Camera, panorama, behind: bool
) -> np.ndarray:
    """One linear picture, ``(size, size, C)``."""
    picture = drawing.shading(gbuffer)
    if behind:
        height, width = gbuffer.mask.shape
        light = render.background(panorama, camera, (height, width))
        picture = picture + light * (1 - gbuffer.mask[..., None])
    return np.asarray(picture, np.float32)


def _white(panorama, picture: np.ndarray, behind: bool) -> float:
    """One white for all frames: of the light where it is seen, else of the mesh."""
    values = np.asarray(panorama if behind else picture).mean(axis=-1)
    return float(np.quantile(values[values > 0], 0.97)) if np.any(values > 0) else 1.0


def _same(record: Path, settings: dict) -> bool:
    try:
        return json.loads(record.read_text()) == json.loads(json_text(settings))
    except (OSError, ValueError):
        return False
