"""``shjax reflect``: a panorama and a BRDF in; the least model that an error allows out."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import click
import jax.numpy as jnp
import numpy as np
from rich.console import Console

from shjax import brdf as brdfs
from shjax import io, render
from shjax.brdf import Brdf
from shjax.cli.options import (
    brdf_option,
    invalid_option,
    layout_option,
    max_bytes_option,
    rms_error_option,
    rotate_option,
)
from shjax.cli.pictures import FRAME, compare, header, progress_display
from shjax.envmap import EnvironmentMap, Report
from shjax.harmonics.degrees import degrees, orders
from shjax.io.writing import check_folder
from shjax.model import Model, choose_model
from shjax.render.shading import panorama_at
from shjax.sphere import latlong_directions

SCHEMA = "shjax.reflect/1"
PANELS = "by the model | by the exact integral | their difference"
EXACT_ROWS = 128
STEPS = 4


@click.command(short_help="The least reflection model for an error, and spheres.")
@click.argument("env", required=False, type=click.Path(path_type=Path))
@click.option(
    "-o", "--out", required=True, type=click.Path(path_type=Path), metavar="DIR",
    help="Folder for the results; made if it is missing.",
)  # fmt: skip
@brdf_option
@rms_error_option
@max_bytes_option
@click.option(
    "--size", default=160, show_default=True, type=click.IntRange(8, 512),
    metavar="PIXELS", help="Side of each rendered sphere.",
)  # fmt: skip
@layout_option
@invalid_option
@rotate_option
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
@click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")
def reflect(
    env: Path | None,
    out: Path,
    brdf: Brdf,
    rms_error: float,
    max_bytes: int,
    size: int,
    layout: str,
    invalid: str,
    rotate: np.ndarray | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Choose the smallest model of the light reflected from a material.

    ENV is an environment map; left out, the panorama that comes with shjax. The model is
    the one that takes the fewest bytes among coefficients over the normal, a radial map,
    a map without azimuth and the spherical harmonic reflection map, with a predicted
    error over all orientations and views that is small enough. Its error is then measured
    against the integral (over ENV averaged to 256 x 128).

    \b
    DIR receives
      NAME_reflect.json   the model and why, errors predicted and measured
      NAME_shrm.exr       its map, a layer a coefficient (p1q-1.R, p1q-1.G, ...)
      NAME_spheres.exr    a sphere: by the model; by the exact integral; their
                          difference (.png: red too bright, blue too dark, full
                          colour at a tenth of white)

    \b
    Examples:
      shjax reflect --brdf "ggx alpha=0.4 f0=1" --rms-error 0.1 --out results
      shjax reflect studio.exr --out results \\
        --brdf "lambertian albedo=0.5 + 0.3 * phong_cosine exponent=30"
    """
    path = env or io.shipped_panorama()
    check_folder(out)
    with progress_display(quiet) as progress:
        task = progress.add_task("", total=STEPS)

        def step(what: str) -> None:
            progress.update(task, description=f"{path.name}: {what}", advance=1)

        step("reading")
        envmap = io.read_envmap(path, layout=layout, invalid=invalid)
        result, model = run(
            envmap, brdf, out, path.stem, rms_error=rms_error, max_bytes=max_bytes,
            size=size, rotation=rotate, step=step,
        )  # fmt: skip
    result = {"schema": SCHEMA, "source": str(path), **result}
    file = out / f"{path.stem}_reflect.json"
    result["files"]["reflect.json"] = str(file)
    io.write_text(file, json.dumps(result, indent=1) + "\n")
    if as_json and not quiet:
        print(json.dumps(result), flush=True)
    elif not quiet:
        _print(Console(), result, model, envmap.report)


def run(
    envmap: EnvironmentMap,
    brdf: Brdf,
    out: Path,
    stem: str,
    *,
    rms_error: float,
    max_bytes: int,
    size: int,
    rotation: np.ndarray | None,
    step,
) -> tuple[dict, Model]:
    """Choose, measure, draw and write; returns the JSON's content and the model."""
    step("choosing")
    if rotation is not None:
        envmap = _turned(envmap, rotation)
    small = envmap.to_latlong(EXACT_ROWS)
    panorama = jnp.asarray(small.radiance)
    model = choose_model(envmap, brdf, rms_error=rms_error, max_bytes=max_bytes)
    step("measuring")
    measured = model.check(panorama)
    step("exact sphere")
    ball = render.sphere(size, tangents=model.about_tangent)
    exact = np.asarray(render.reference(ball, panorama, brdf))
    values, shown = compare(np.asarray(render.shade(ball, model)), exact)
    result = {
        "report": dataclasses.asdict(envmap.report),
        "frame": FRAME,
        "model": model.kind,
        "l_max": model.l_max,
        "p_max": model.p_max,
        "diffuse_l_max": model.diffuse_l_max,
        "resolution": model.resolution,
        "bytes": model.bytes,
        "asked_rms_error": rms_error,
        "predicted_rms_error": model.predicted_rms_error,
        "predicted_energy_error": model.predicted_rms_error**2,
        "measured_rms_error": measured.rms,
        "measured_standard_error": measured.standard_error,
        "measured_energy_error": measured.rms**2,
        "met": model.met,
        "why": model.message,
        "brdf": brdfs.check(brdf).message,
        "diffuse_coefficients": None
        if model.diffuse is None
        else np.asarray(model.diffuse, float).tolist(),
    }
    result["lights"] = _lights(model)
    about = header(envmap.report.source, units="radiance", model=model.message)
    files = {
        name: str(out / f"{stem}_{name}") for name in ("spheres.exr", "spheres.png")
    }
    io.write_image(files["spheres.exr"], values, attributes={**about, "panels": PANELS})
    io.write_image(files["spheres.png"], shown)
    if model.maps is not None:
        files["shrm.exr"] = str(out / f"{stem}_shrm.exr")
        maps = np.asarray(model.maps)
        io.write_image(
            files["shrm.exr"],
            maps.reshape(*maps.shape[:2], -1),
            attributes={**about, "coefficients": "over the view in R's frame, Y_pq"},
            channels=layer_names(model),
        )
    return {**result, "files": files}, model


def _lights(model: Model) -> list[dict]:
    """The small lights that are in no map: centre, half angle in degrees, flux."""
    if model.lights is None:
        return []
    rows = zip(
        np.asarray(model.lights.directions, float).tolist(),
        np.degrees(np.asarray(model.lights.angles, float)).tolist(),
        np.asarray(model.lights.flux, float).tolist(),
        strict=True,
    )
    return [{"direction": d, "half_angle": a, "flux": f} for d, a, f in rows]


def layer_names(model: Model) -> list[str]:
    """Channels of the map's EXR: ``p1q-1.R`` and so on, in the order of its axes."""
    if model.kind == "shrm":
        pairs = zip(degrees(model.p_max), orders(model.p_max), strict=True)
        layers = [f"p{p}q{q}" for p, q in pairs]
    else:
        layers = [f"p{p}q0" for p in range(model.p_max + 1)]
    channels = model.lighting.shape[-1]
    names = {1: ("Y",), 3: ("R", "G", "B")}.get(channels) or [
        f"c{k:03d}" for k in range(channels)
    ]
    return [f"{layer}.{name}" for layer in layers for name in names]


def _turned(envmap: EnvironmentMap, rotation: np.ndarray) -> EnvironmentMap:
    """A lat-long map as it looks when its light is turned, read between pixels."""
    flat = envmap.to_latlong(min(len(envmap.image), 512))
    rows = len(flat.image)
    towards = latlong_directions(rows, 2 * rows) @ rotation  # R^T w
    image = np.asarray(panorama_at(jnp.asarray(flat.radiance), jnp.asarray(towards)))
    return dataclasses.replace(flat, radiance=image, image=image)


def _print(console: Console, result: dict, model: Model, report: Report) -> None:
    console.print(str(report), style="bold", markup=False)
    console.print(f"BRDF: {result['brdf']}", highlight=False, markup=False)
    console.print(f"\n[bold]model[/]  {model.message}", highlight=False)
    rms, own = result["measured_rms_error"], result["measured_standard_error"]
    console.print(
        f"[bold]measured[/]  {rms:.2%} +- {own:.2%} rms ({rms**2:.2%} energy) at 2048 "
        "orientations and views, against the integral",
        highlight=False,
    )
    console.print(f"\nspheres: {PANELS}\nwritten:", highlight=False)
    for name in result["files"].values():
        console.print(f"  {name}", highlight=False, markup=False)
