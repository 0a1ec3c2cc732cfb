"""What draws a mesh: a chosen model, or a material under a prefiltered light."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import click
import jax
import jax.numpy as jnp
import numpy as np

from shjax import render
from shjax.brdf import metallic_roughness
from shjax.cli.kept_energies import kept_energies
from shjax.cli.options import Reflectance
from shjax.cli.texts import Material
from shjax.envmap import EnvironmentMap
from shjax.ibl import PrefilteredLight, prefilter_light
from shjax.lights import AreaLight
from shjax.lights.area import add_channels
from shjax.reflection import ReflectionModel, choose_model
from shjax.render import GBuffer

Shading = Callable[[GBuffer], jax.Array]


@dataclasses.dataclass(frozen=True)
class Drawing:
    """What draws, what its record says of it, and whether the mesh's textures are used."""

    shading: Shading
    about: dict[str, Any]
    textured: bool


def drawing_of(envmap: EnvironmentMap, reflectance: Reflectance) -> Drawing:
    """Choose a model, or prefilter the light, for what the mesh is made of."""
    material = reflectance.material
    if material is not None:
        light = prefilter_light(envmap, maps=int(reflectance.maps))
        about = _about_material(light, material)
        return Drawing(_by_material(light, material), about, material.mesh)
    model = choose_model(
        envmap,
        reflectance.brdf,
        rms_error=reflectance.rms_error,
        max_bytes=reflectance.max_bytes,
        energies=kept_energies,
    )
    about = _about_model(model)
    return Drawing(lambda gbuffer: render.image(gbuffer, model), about, False)


def with_area_lights(
    drawing: Drawing,
    reflectance: Reflectance,
    area_lights: tuple[tuple[str, AreaLight], ...],
) -> Drawing:
    """Add area lights, by their integral, to what draws under the panorama.

    Raises:
        click.UsageError: If the material is a mesh's own, which changes over it.
    """
    if not area_lights:
        return drawing
    material = reflectance.material
    if material is not None and material.mesh:
        raise click.UsageError(
            "--light takes one material for the whole mesh: --brdf, or --material with "
            "numbers."
        )
    brdf = reflectance.brdf
    if material is not None:
        brdf = metallic_roughness(**material.values())
    made = [light for _, light in area_lights]
    texts = [text for text, _ in area_lights]

    def shade(gbuffer: GBuffer) -> jax.Array:
        near = render.area_lit(gbuffer, made, brdf)
        return add_channels(drawing.shading(gbuffer), near)

    about = drawing.about | {"area_lights": texts}
    return dataclasses.replace(drawing, shading=shade, about=about)


def _about_model(model: ReflectionModel) -> dict[str, Any]:
    """What the record says of a chosen model."""
    return {
        "model": model.label,
        "l_max": model.l_max,
        "p_max": model.p_max,
        "why": model.message,
        "predicted_rms_error": model.predicted_rms_error,
        "met": model.met,
        "brdf": [part.model.name for part in model.brdf.parts],
        "parameters": [
            {
                name: np.asarray(value, float).ravel()[:64].tolist()
                for name, value in part.parameters.items()
            }
            for part in model.brdf.parts
        ],
    }


def _about_material(light: PrefilteredLight, material: Material) -> dict[str, Any]:
    """What the record says of the lighting layer."""
    given = {k: np.asarray(v, float).tolist() for k, v in material.given.items()}
    return {
        "model": "lighting layer",
        "maps": light.maps,
        "why": light.with_material().message,
        "material": given,
        "from_mesh": material.mesh,
    }


def _by_material(light: PrefilteredLight, material: Material) -> Shading:
    """Shade by what was given; the rest comes from the mesh, or is the default."""

    def shade(gbuffer: GBuffer) -> jax.Array:
        chosen = {}
        for name in ("albedo", "roughness", "metallic"):
            own = getattr(gbuffer, name) if material.mesh else None
            if name in material.given or own is None:
                own = jnp.asarray(material.value(name))
            chosen[name] = own
        lit = light.with_material(**chosen, f0=material.value("f0"))
        return render.image(gbuffer, lit)

    return shade
