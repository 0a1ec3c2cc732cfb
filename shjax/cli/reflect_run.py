"""What ``shjax reflect`` does."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import jax.numpy as jnp
import numpy as np
from rich.console import Console

from shjax import brdf as brdfs
from shjax import io, render
from shjax.brdf import Brdf, metallic_roughness
from shjax.cli.kept_energies import kept_energies
from shjax.cli.many import alone
from shjax.cli.options import Output, Reading, Reflectance
from shjax.cli.pictures import FRAME, compare, header, progress_display, rotated
from shjax.cli.texts import Material
from shjax.envmap import EnvironmentMap, Report
from shjax.harmonics.degrees import degrees, orders
from shjax.ibl import LitMaterial, PrefilteredLight, prefilter_light
from shjax.io.writing import check_folder, json_text, protecting
from shjax.reflection import ReflectionModel, Reflector, choose_model
from shjax.reflection.reflector import CHECK_ROWS

SCHEMA = "shjax.reflect/1"
PANELS = "by the model | by the exact integral | their difference"
STEPS = 4


@dataclasses.dataclass(frozen=True)
class ReflectResult:
    """What ``shjax reflect`` found.

    Attributes:
        summary: For the JSON file and the terminal, without the files' names.
        reflector: What draws.
        pictures: A sphere by it and by the integral.
    """

    summary: dict
    reflector: ReflectionModel | LitMaterial
    pictures: tuple[np.ndarray, np.ndarray]


def main(
    env: Path | None,
    out: Path,
    reflectance: Reflectance,
    size: int,
    rotate: np.ndarray | None,
    reading: Reading,
    output: Output,
) -> None:
    """Read, choose, measure, write, show."""
    path = env or io.shipped_panorama()
    check_folder(out)
    context = click.get_current_context()
    context.with_resource(protecting(path))
    context.with_resource(alone(out, path.stem))
    with progress_display(output.quiet) as progress:
        task = progress.add_task("", total=STEPS)

        def step(what: str) -> None:
            progress.update(task, description=f"{path.name}: {what}", advance=1)

        step("reading")
        envmap = reading.read(path)
        if rotate is not None:
            envmap = rotated(envmap, rotate)
        found = run(envmap, reflectance, size=size, step=step)
        result = write(out, path.stem, str(path), found)
    if not output.print_json(result):
        show(Console(soft_wrap=True), result, envmap.report)


def run(
    envmap: EnvironmentMap,
    reflectance: Reflectance,
    *,
    size: int,
    step: Callable[[str], None],
) -> ReflectResult:
    """Choose or prefilter, measure, and draw a sphere.

    Args:
        envmap: The light.
        reflectance: What the sphere is made of.
        size: Side of the pictures.
        step: Called with a few words at the start of each part.
    """
    panorama = jnp.asarray(envmap.to_latlong(CHECK_ROWS).radiance)
    about = {"report": dataclasses.asdict(envmap.report), "frame": FRAME}
    if reflectance.material is None:
        step("choosing")
        brdf = reflectance.brdf
        reflector = choose_model(
            envmap,
            brdf,
            rms_error=reflectance.rms_error,
            max_bytes=reflectance.max_bytes,
            energies=kept_energies,
        )
        about |= _about_model(reflector, brdf)
        ball = render.sphere(size, tangents=reflector.about_tangent)
    else:
        step("prefiltering")
        values = reflectance.material.values()
        light = prefilter_light(envmap, maps=int(reflectance.maps))
        reflector, brdf = light.with_material(**values), metallic_roughness(**values)
        about |= _about_material(light, reflectance.material)
        ball = render.sphere(size)
    about |= {"why": reflector.message}
    step("measuring")
    measured, predicted = reflector.check(panorama), reflector.predicted_rms_error
    about |= {
        "predicted_rms_error": predicted,
        "predicted_energy_error": predicted**2,
        "measured_rms_error": measured.rms,
        "measured_standard_error": measured.standard_error,
        "measured_energy_error": measured.rms**2,
    }
    step("exact sphere")
    exact = np.asarray(render.reference(ball, panorama, brdf))
    drawn = np.asarray(render.image(ball, reflector))
    return ReflectResult(about, reflector, (drawn, exact))


def _about_model(model: ReflectionModel, brdf: Brdf) -> dict[str, Any]:
    diffuse = None if model.diffuse is None else model.diffuse.coefs
    return {
        "model": model.label,
        "l_max": model.l_max,
        "p_max": model.p_max,
        "diffuse_l_max": model.diffuse_l_max,
        "resolution": model.resolution,
        "bytes": model.bytes,
        "asked_rms_error": model.asked_rms_error,
        "met": model.met,
        "brdf": brdfs.check(brdf).message,
        "diffuse_coefficients": None
        if diffuse is None
        else np.asarray(diffuse, float).tolist(),
        "lights": [] if model.lights is None else io.lights_as_json(model.lights),
    }


def _about_material(light: PrefilteredLight, material: Material) -> dict[str, Any]:
    values = material.values()
    return {
        "model": "lighting layer",
        "maps": light.maps,
        "material": {k: np.asarray(v, float).tolist() for k, v in values.items()},
        "bytes": light.bytes,
        "lights": io.lights_as_json(light.lights),
    }


def write(out: Path, stem: str, source: str, found: ReflectResult) -> dict:
    """Write the pictures and the map, then the JSON; returns its content."""
    name = found.summary["report"]["source"]
    about = header(name, units="radiance", model=found.summary["why"])
    panels = PANELS
    if isinstance(found.reflector, LitMaterial):
        panels = PANELS.replace("by the model", "by the lighting layer")
    values, shown = compare(*found.pictures, panels)
    files = {n: str(out / f"{stem}_{n}") for n in ("reflection.exr", "reflection.png")}
    notes = {**about, "panels": panels}
    io.write_image(files["reflection.exr"], values, attributes=notes)
    io.write_image(files["reflection.png"], shown)
    files |= _write_maps(out, stem, found.reflector, about)
    file = out / f"{stem}_reflect.json"
    files["reflect.json"] = str(file)
    result = {"schema": SCHEMA, "source": source, **found.summary, "files": files}
    io.write_text(file, json_text(result, indent=1) + "\n")
    return result


def _write_maps(
    out: Path, stem: str, reflector: Reflector, about: dict[str, str]
) -> dict[str, str]:
    if isinstance(reflector, LitMaterial):
        files = {n: str(out / f"{stem}_{n}") for n in ("light.exr", "light.json")}
        io.write_prefiltered(files["light.exr"], reflector.light)
        return files
    assert isinstance(reflector, ReflectionModel)
    if reflector.specular is None:
        return {}
    file = str(out / f"{stem}_shrm.exr")
    maps = np.asarray(reflector.specular.coefs)
    io.write_image(
        file,
        maps.reshape(*maps.shape[:2], -1),
        attributes={**about, "coefficients": "over the view in R's frame"},
        channels=layer_names(reflector),
    )
    return {"shrm.exr": file}


def layer_names(model: ReflectionModel) -> list[str]:
    """Channels of the map's EXR: ``p1q-1.R`` and so on, in the order of its axes."""
    assert model.specular is not None
    basis = model.specular.view_basis
    if basis.label == "low-rank":
        layers = [f"k{k}q{q}" for k, q in enumerate(basis.orders)]
    elif basis.label == "harmonic":
        pairs = zip(degrees(basis.p_max), orders(basis.p_max), strict=True)
        layers = [f"p{p}q{q}" for p, q in pairs]
    else:
        layers = [f"p{p}q0" for p in range(basis.p_max + 1)]
    channels = model.lighting.shape[-1]
    names = {1: ("Y",), 3: ("R", "G", "B")}.get(channels) or [
        f"c{k:03d}" for k in range(channels)
    ]
    return [f"{layer}.{name}" for layer in layers for name in names]


def show(console: Console, result: dict, report: Report) -> None:
    """Show the model, its predicted and its measured error, and the files."""
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
