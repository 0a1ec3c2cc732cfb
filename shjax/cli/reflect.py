"""``shjax reflect``: a panorama and a BRDF in; the least model that an error allows out."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import click
import jax.numpy as jnp
import numpy as np
from rich.console import Console

from shjax import brdf as brdfs
from shjax import io, render
from shjax.brdf import Brdf
from shjax.cli.many import alone
from shjax.cli.material import run_material
from shjax.cli.options import (
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
    rotate_option,
)
from shjax.cli.pictures import FRAME, compare, header, progress_display, turned
from shjax.envmap import EnvironmentMap, Report
from shjax.harmonics.degrees import degrees, orders
from shjax.io.writing import check_folder, json_text, protecting
from shjax.model import Model, choose_model

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
@material_option
@maps_option
@rms_error_option
@max_bytes_option
@click.option(
    "--size", default=160, show_default=True, type=click.IntRange(8, 512),
    metavar="PIXELS", help="Side of each rendered sphere.",
)  # fmt: skip
@layout_option
@invalid_option
@primaries_option
@rotate_option
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
@click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")
def reflect(
    env: Path | None,
    out: Path,
    brdf: Brdf,
    material: Material | None,
    maps: str,
    rms_error: float,
    max_bytes: int,
    size: int,
    layout: str,
    invalid: str,
    primaries: str,
    rotate: np.ndarray | None,
    as_json: bool,
    quiet: bool,
) -> None:
    """Choose the least model of the light reflected from a material.

    ENV is an environment map; left out, the panorama that comes with shjax. The model is
    the one that is read the fastest among coefficients over the normal, a radial map, a
    map without azimuth, the spherical harmonic reflection map and one in a view basis
    fitted to the material, each with as many small suns apart as help, whose predicted
    error over all orientations and views is small enough. Its error is then measured
    against the integral (over ENV averaged to 256 x 128).

    With --material the light is prefiltered once for every roughness and reflectance
    (the lighting layer), and --rms-error and --max-bytes do not count.

    \b
    DIR receives
      NAME_reflect.json   the model and why, errors predicted and measured
      NAME_shrm.exr       its map, a layer a coefficient (p1q-1.R, p1q-1.G, ...)
      NAME_light.exr      with --material: the prefiltered light; with NAME_light.json
                          it is all that a shader needs, which that file describes
      NAME_reflection.exr a sphere: by the model; by the exact integral; their
                          difference (.png: red too bright, blue too dark, full
                          colour at a tenth of white)

    \b
    Examples:
      shjax reflect --brdf "ggx alpha=0.4 f0=1" --rms-error 0.1 --out results
      shjax reflect studio.exr --out results \\
        --brdf "lambertian albedo=0.5 + 0.3 * phong_cosine exponent=30"
      shjax reflect --material roughness=0.4,metallic=1,albedo=1,0.8,0.4 --out results
    """
    check_one_reflectance(material)
    if material is not None and material.mesh:
        raise click.UsageError("--material mesh needs a mesh; use shjax render.")
    path = env or io.shipped_panorama()
    check_folder(out)
    context = click.get_current_context()
    context.with_resource(protecting(path))
    context.with_resource(alone(out, path.stem))
    with progress_display(quiet) as progress:
        task = progress.add_task("", total=STEPS)

        def step(what: str) -> None:
            progress.update(task, description=f"{path.name}: {what}", advance=1)

        step("reading")
        envmap = io.read_envmap(
            path, layout=layout, invalid=invalid, primaries=primaries, isolate=True
        )
        if rotate is not None:
            envmap = turned(envmap, rotate)
        if material is None:
            result = run(
                envmap, brdf, out, path.stem, rms_error=rms_error, max_bytes=max_bytes,
                size=size, step=step,
            )  # fmt: skip
        else:
            result = run_material(
                envmap, material, int(maps), out, path.stem, size=size, step=step
            )
    result = {"schema": SCHEMA, "source": str(path), **result}
    file = out / f"{path.stem}_reflect.json"
    result["files"]["reflect.json"] = str(file)
    io.write_text(file, json_text(result, indent=1) + "\n")
    if as_json and not quiet:
        print(json_text(result), flush=True)
    elif not quiet:
        _print(Console(soft_wrap=True), result, envmap.report)


def run(
    envmap: EnvironmentMap,
    brdf: Brdf,
    out: Path,
    stem: str,
    *,
    rms_error: float,
    max_bytes: int,
    size: int,
    step,
) -> dict:
    """Choose, measure, draw and write; returns the JSON's content."""
    step("choosing")
    small = envmap.to_latlong(EXACT_ROWS)
    panorama = jnp.asarray(small.radiance)
    model = choose_model(envmap, brdf, rms_error=rms_error, max_bytes=max_bytes)
    step("measuring")
    measured = model.check(panorama)
    step("exact sphere")
    ball = render.sphere(size, tangents=model.about_tangent)
    exact = np.asarray(render.reference(ball, panorama, brdf))
    values, shown = compare(np.asarray(render.shade(ball, model)), exact, PANELS)
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
    lights = model.lights
    result["lights"] = [] if lights is None else io.lights_as_json(lights)
    about = header(envmap.report.source, units="radiance", model=model.message)
    files = {
        name: str(out / f"{stem}_{name}")
        for name in ("reflection.exr", "reflection.png")
    }
    io.write_image(
        files["reflection.exr"], values, attributes={**about, "panels": PANELS}
    )
    io.write_image(files["reflection.png"], shown)
    if model.maps is not None:
        files["shrm.exr"] = str(out / f"{stem}_shrm.exr")
        maps = np.asarray(model.maps)
        io.write_image(
            files["shrm.exr"],
            maps.reshape(*maps.shape[:2], -1),
            attributes={**about, "coefficients": "over the view in R's frame"},
            channels=layer_names(model),
        )
    return {**result, "files": files}


def layer_names(model: Model) -> list[str]:
    """Channels of the map's EXR: ``p1q-1.R`` and so on, in the order of its axes."""
    if model.kind == "adapted":
        layers = [f"k{k}q{q}" for k, q in enumerate(model.view_basis.orders)]
    elif model.kind == "shrm":
        pairs = zip(degrees(model.p_max), orders(model.p_max), strict=True)
        layers = [f"p{p}q{q}" for p, q in pairs]
    else:
        layers = [f"p{p}q0" for p in range(model.p_max + 1)]
    channels = model.lighting.shape[-1]
    names = {1: ("Y",), 3: ("R", "G", "B")}.get(channels) or [
        f"c{k:03d}" for k in range(channels)
    ]
    return [f"{layer}.{name}" for layer in layers for name in names]


def _print(console: Console, result: dict, report: Report) -> None:
    console.print(str(report), style="bold", markup=False)
    if "brdf" in result:
        console.print(f"BRDF: {result['brdf']}", highlight=False, markup=False)
    console.print(f"\n[bold]model[/]  {result['why']}", highlight=False)
    rms, own = result["measured_rms_error"], result["measured_standard_error"]
    console.print(
        f"[bold]measured[/]  {rms:.2%} +- {own:.2%} rms ({rms**2:.2%} energy) at 2048 "
        "orientations and views, against the integral",
        highlight=False,
    )
    console.print(
        "\nspheres: by the model | by the exact integral | their difference\nwritten:",
        highlight=False,
    )
    for name in result["files"].values():
        console.print(f"  {name}", highlight=False, markup=False)
