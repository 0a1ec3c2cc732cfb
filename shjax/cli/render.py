"""``shjax render``: a mesh under a panorama, in a material of one's choice."""

from __future__ import annotations

import dataclasses
import json
import math
import warnings
from collections.abc import Callable
from pathlib import Path

import click
import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console

from shjax import io, render
from shjax.brdf import Brdf
from shjax.cli.many import alone, since, stamp
from shjax.cli.material import describe
from shjax.cli.options import (
    FiniteRange,
    Material,
    brdf_option,
    check_one_reflectance,
    invalid_option,
    layout_option,
    maps_option,
    material_option,
    max_bytes_option,
    primaries_option,
    rms_error_option,
)
from shjax.cli.pictures import FRAME, as_rgb, header, progress_display
from shjax.display import tone_map
from shjax.ibl import PrefilteredLight, prefilter_light
from shjax.io.writing import check_folder, json_text, protecting
from shjax.model import Model, choose_model
from shjax.render import Camera, GBuffer
from shjax.render.loading import load_mesh, not_drawn
from shjax.render.meshes import trace_mesh

SCHEMA = "shjax.render/1"
TURNS = {"z": np.eye(3), "y": np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])}


@click.command(short_help="A picture of a mesh under a panorama.")
@click.argument("mesh", type=click.Path(path_type=Path))
@click.argument("env", required=False, type=click.Path(path_type=Path))
@click.option(
    "-o", "--out", required=True, type=click.Path(path_type=Path), metavar="DIR",
    help="Folder for the results; made if it is missing.",
)  # fmt: skip
@brdf_option
@material_option
@maps_option
@rms_error_option
@max_bytes_option
@click.option(
    "--size", default=384, show_default=True, type=click.IntRange(8, 4096),
    metavar="PIXELS", help="Side of the picture.",
)  # fmt: skip
@click.option(
    "--up", default="y", show_default=True, type=click.Choice(sorted(TURNS)),
    help="Which axis of the mesh points up.",
)  # fmt: skip
@click.option(
    "--azimuth", default=30.0, show_default=True, metavar="DEGREES",
    type=FiniteRange(), help="Where the camera stands around the mesh.",
)  # fmt: skip
@click.option(
    "--elevation", default=12.0, show_default=True, metavar="DEGREES",
    type=FiniteRange(-89, 89), help="How far above its middle.",
)  # fmt: skip
@click.option(
    "--fov", default=35.0, show_default=True, metavar="DEGREES",
    type=FiniteRange(1, 120), help="The camera's horizontal field of view.",
)  # fmt: skip
@click.option(
    "--turntable", default=1, show_default=True, type=click.IntRange(1, 3600),
    metavar="FRAMES", help="Pictures of a whole turn of the camera.",
)  # fmt: skip
@click.option(
    "--background/--no-background", default=True, show_default=True,
    help="Whether the panorama is seen behind the mesh.",
)  # fmt: skip
@layout_option
@invalid_option
@primaries_option
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
@click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")
def render_command(
    mesh: Path,
    env: Path | None,
    out: Path,
    brdf: Brdf,
    material: Material | None,
    maps: str,
    rms_error: float,
    max_bytes: int,
    size: int,
    up: str,
    azimuth: float,
    elevation: float,
    fov: float,
    turntable: int,
    background: bool,
    layout: str,
    invalid: str,
    primaries: str,
    as_json: bool,
    quiet: bool,
) -> None:
    """Draw a mesh (OBJ, OFF, PLY, glTF) under an environment map.

    The mesh is centred and scaled to radius 1. The light is distant: nothing casts a
    shadow. --brdf is drawn by the least model for --rms-error; --material by the lighting
    layer, which takes textures (--material mesh). Needs trimesh and embreex (pip install
    'shjax[mesh]').

    \b
    DIR receives
      NAME.exr, NAME.png    the picture, linear and tone-mapped; of a turntable
                            NAME_0000.exr ... and one PNG each. A second run with the
                            same settings draws only what is missing
      NAME_render.json      the model that drew it, and the settings

    \b
    Examples:
      shjax render spot.obj --brdf "ggx alpha=0.3 f0=0.9" --out results
      shjax render bunny.off studio.exr --turntable 60 --out results \\
        --brdf "lambertian albedo=0.5,0.2,0.1 + ggx alpha=0.2 f0=0.04"
      shjax render helmet.glb --material mesh --out results
    """
    check_one_reflectance(material)
    path = env or io.shipped_panorama()
    check_folder(out)
    context = click.get_current_context()
    context.with_resource(protecting(path, mesh))
    context.with_resource(alone(out, mesh.stem))
    if any(part.model.centre == "tangent" for part in brdf.parts):
        raise click.UsageError("a mesh has no tangents for a BRDF of fibres.")
    geometry = _placed(load_mesh(mesh), up)
    envmap = io.read_envmap(
        path, layout=layout, invalid=invalid, primaries=primaries, isolate=True
    )
    panorama = jnp.asarray(_as_latlong(envmap))
    if material is None:
        model = choose_model(envmap, brdf, rms_error=rms_error, max_bytes=max_bytes)
        about, shading, textured = _of_model(model, brdf), _by_model(model), False
    else:
        light = prefilter_light(envmap, maps=int(maps))
        about, shading = _of_material(light, material), _by_material(light, material)
        textured = material.mesh
    settings = {
        "schema": SCHEMA, "mesh": str(mesh), "source": str(path),
        "report": dataclasses.asdict(envmap.report), "frame": FRAME, "size": size,
        "up": up, "azimuth": azimuth, "elevation": elevation, "fov": fov,
        "turntable": turntable, "background": background, **about,
        "inputs": [stamp(mesh), stamp(path)],
    }  # fmt: skip
    record = out / f"{mesh.stem}_render.json"
    again = _same(record, settings)
    io.write_text(record, json_text(settings, indent=1) + "\n")
    files, kept, white = [], [], None
    ignored = not_drawn(geometry) if textured else ()
    with progress_display(quiet) as progress:
        task = progress.add_task(f"{mesh.name}: drawing", total=turntable)
        for frame in range(turntable):
            stem = mesh.stem if turntable == 1 else f"{mesh.stem}_{frame:04d}"
            names = [str(out / f"{stem}{suffix}") for suffix in (".exr", ".png")]
            files += names
            if again and all(Path(name).exists() for name in names):
                kept += names
            else:
                angle = azimuth + 360 * frame / turntable
                camera = _camera(angle, elevation, fov)
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", UserWarning)  # said once, below
                    trace = trace_mesh(geometry, camera, size, material=textured)
                picture = draw(trace.gbuffer, shading, camera, panorama, background)
                white = white or _white(panorama, picture, background)
                notes = header(path.name, units="radiance", model=about["why"])
                io.write_image(names[0], picture, attributes=notes)
                io.write_image(names[1], as_rgb(tone_map(picture, white=white)))
            progress.update(task, advance=1)
    if as_json and not quiet:
        print(json_text({**settings, "files": files}), flush=True)
    elif not quiet:
        console = Console(soft_wrap=True)
        console.print(str(envmap.report), style="bold", markup=False)
        console.print(f"[bold]model[/]  {about['why']}", highlight=False)
        if ignored:
            text = f"not drawn of the mesh's material: {', '.join(ignored)}"
            console.print(text, highlight=False, markup=False)
        if kept:
            console.print(
                f"{len(kept) // 2} of {turntable} kept of a run with these settings, "
                f"from {since(kept)}",
                highlight=False,
            )
        console.print("written:", highlight=False)
        for name in [*files[:4], *(["..."] if len(files) > 4 else []), str(record)]:
            console.print(f"  {name}", highlight=False, markup=False)


Shading = Callable[[GBuffer], jax.Array]


def _of_model(model: Model, brdf: Brdf) -> dict:
    """What the record says of a chosen model."""
    return {
        "model": model.kind,
        "l_max": model.l_max,
        "p_max": model.p_max,
        "why": model.message,
        "predicted_rms_error": model.predicted_rms_error,
        "met": model.met,
        "brdf": [part.model.name for part in brdf.parts],
        "parameters": [
            {
                name: np.asarray(value, float).ravel()[:64].tolist()
                for name, value in part.parameters.items()
            }
            for part in brdf.parts
        ],
    }


def _by_model(model: Model) -> Shading:
    return lambda gbuffer: render.shade(gbuffer, model)


def _of_material(light: PrefilteredLight, material: Material) -> dict:
    """What the record says of the lighting layer."""
    given = {k: np.asarray(v, float).tolist() for k, v in material.given.items()}
    return {
        "model": "lighting layer",
        "maps": light.maps,
        "why": describe(light),
        "material": given,
        "from_mesh": material.mesh,
    }


def _by_material(light: PrefilteredLight, material: Material) -> Shading:
    """Shade by what was given; the rest comes from the mesh, or is the default."""

    def shade(gbuffer: GBuffer) -> jax.Array:
        def chosen(name: str, own):
            if name in material.given or own is None or not material.mesh:
                return jnp.asarray(material.value(name))
            return own

        albedo = chosen("albedo", gbuffer.albedo)
        shape = (*gbuffer.mask.shape, light.texels.shape[-1])
        coloured = dataclasses.replace(gbuffer, albedo=jnp.broadcast_to(albedo, shape))
        return render.metallic_roughness(
            coloured,
            light,
            roughness=chosen("roughness", gbuffer.roughness),
            metallic=chosen("metallic", gbuffer.metallic),
            f0=material.value("f0"),
        )

    return shade


def draw(
    gbuffer: GBuffer, shading: Shading, camera: Camera, panorama, behind: bool
) -> np.ndarray:
    """One linear picture, ``(size, size, C)``."""
    picture = shading(gbuffer)
    if behind:
        height, width = gbuffer.mask.shape
        light = render.background(panorama, camera, (height, width))
        picture = picture + light * (1 - gbuffer.mask[..., None])
    return np.asarray(picture, np.float32)


def _white(panorama, picture: np.ndarray, behind: bool) -> float:
    """One white for all frames: of the light where it is seen, else of the mesh."""
    values = np.asarray(panorama if behind else picture).mean(axis=-1)
    return float(np.quantile(values[values > 0], 0.97)) if np.any(values > 0) else 1.0


def _camera(azimuth: float, elevation: float, fov: float) -> Camera:
    a, e, angle = (math.radians(v) for v in (azimuth, elevation, fov))
    distance = 1.08 / math.sin(angle / 2)
    origin = (
        distance * math.cos(e) * math.cos(a),
        distance * math.cos(e) * math.sin(a),
        distance * math.sin(e),
    )
    return Camera(origin=origin, fov=angle)


def _placed(geometry, up: str):
    """Centred on its box, radius 1, z up; the file's own normals are turned with it."""
    vertices = np.asarray(geometry.vertices) @ TURNS[up].T
    centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    scale = 1 / (float(np.linalg.norm(vertices - centre, axis=1).max()) or 1.0)
    place = np.eye(4)
    place[:3, :3], place[:3, 3] = scale * TURNS[up], -scale * centre
    return geometry.apply_transform(place)


def _as_latlong(envmap) -> np.ndarray:
    if envmap.layout == "latlong" and envmap.image.shape[1] % 2 == 0:
        return np.asarray(envmap.radiance)
    return np.asarray(envmap.to_latlong(512).radiance)


def _same(record: Path, settings: dict) -> bool:
    try:
        return json.loads(record.read_text()) == json.loads(json_text(settings))
    except (OSError, ValueError):
        return False
