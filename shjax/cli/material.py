"""``shjax reflect --material``: the lighting layer on a sphere, and its error."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from shjax import io, render
from shjax.adapted.ggx import LEAST_ALPHA
from shjax.angular import reference_reflection
from shjax.brdf import Brdf, metallic_roughness
from shjax.cli.options import Material
from shjax.cli.pictures import FRAME, compare, header
from shjax.envmap import EnvironmentMap
from shjax.ibl import PrefilteredLight, predicted_shading_error, prefilter_light, shade
from shjax.sampling import MeasuredError, draw_orientations, measured_error

PANELS = "by the lighting layer | by the exact integral | their difference"
_EXACT_ROWS = 128
_SAMPLES = 2048
_LEAST_ROUGHNESS = math.sqrt(LEAST_ALPHA)


def run_material(
    envmap: EnvironmentMap,
    material: Material,
    maps: int,
    out: Path,
    stem: str,
    *,
    size: int,
    step,
) -> dict:
    """Prefilter, measure, draw and write; returns the JSON's content."""
    step("prefiltering")
    small = envmap.to_latlong(_EXACT_ROWS)
    panorama = jnp.asarray(small.radiance)
    light = prefilter_light(envmap, maps=maps)
    values = {k: material.value(k) for k in ("albedo", "roughness", "metallic", "f0")}
    surface = metallic_roughness(**values)
    step("measuring")
    predicted = predicted_shading_error(light, **values)
    measured = _measured(light, panorama, surface, values)
    step("exact sphere")
    ball = render.sphere(size)
    exact = np.asarray(render.reference(ball, panorama, surface))
    coloured = dataclasses.replace(
        ball, albedo=jnp.broadcast_to(jnp.asarray(values["albedo"]), (size, size, 3))
    )
    drawn = render.metallic_roughness(
        coloured, light, roughness=values["roughness"], metallic=values["metallic"],
        f0=values["f0"],
    )  # fmt: skip
    pictures, shown = compare(np.asarray(drawn), exact, PANELS)
    why = describe(light, predicted)
    if values["roughness"] < _LEAST_ROUGHNESS:
        why += f"; drawn as roughness {_LEAST_ROUGHNESS:g}, where the maps end"
    about = header(envmap.report.source, units="radiance", model=why)
    names = ("reflection.exr", "reflection.png", "light.exr", "light.json")
    files = {name: str(out / f"{stem}_{name}") for name in names}
    io.write_image(
        files["reflection.exr"], pictures, attributes={**about, "panels": PANELS}
    )
    io.write_image(files["reflection.png"], shown)
    io.write_prefiltered(files["light.exr"], light)
    return {
        "report": dataclasses.asdict(envmap.report),
        "frame": FRAME,
        "model": "lighting layer",
        "maps": maps,
        "material": {k: np.asarray(v, float).tolist() for k, v in values.items()},
        "bytes": light.bytes,
        "predicted_rms_error": predicted,
        "predicted_energy_error": predicted**2,
        "measured_rms_error": measured.rms,
        "measured_standard_error": measured.standard_error,
        "measured_energy_error": measured.rms**2,
        "why": why,
        "lights": io.lights_as_json(light.lights),
        "files": files,
    }


def _measured(
    light: PrefilteredLight, panorama, surface: Brdf, values: dict
) -> MeasuredError:
    samples = draw_orientations(_SAMPLES, seed=0)
    normals, views = (
        jnp.asarray(a, panorama.dtype) for a in (samples.normals, samples.views)
    )
    exact = reference_reflection(panorama, surface, normals, views)
    return measured_error(
        shade(light, normals, views, **values), exact, samples.weights
    )


def describe(light: PrefilteredLight, predicted: float | None = None) -> str:
    """What draws, in words."""
    count = light.lights.heights.shape[-1]
    lights = "light" if count == 1 else "lights"
    what = (
        f"a lighting layer of {light.maps} maps and 9 coefficients for the diffuse part"
    )
    what += f", and {count} small {lights} shaded apart" if count else ""
    what += f": {light.bytes / 1e6:.3g} MB for every material"
    if predicted is None:
        return what
    return f"{what}; predicted error {predicted:.2%} rms ({predicted**2:.2%} energy)"
