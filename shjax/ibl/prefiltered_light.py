"""Prefiltered lights: a light prefiltered once for every roughness and reflectance."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Float

from shjax.arrays import Array, as_float
from shjax.clamped_cosine import irradiance_coefs
from shjax.envmap import EnvironmentMap
from shjax.harmonics import power_spectrum
from shjax.harmonics.degrees import degree_of_coefs
from shjax.harmonics.orientations import maps_on_grid, series_tables
from shjax.harmonics.tables import on_device
from shjax.ibl.ggx_tables import DEGREES, LEVELS, ggx_tables
from shjax.light import Light, as_light
from shjax.lights import CapLights, cap_coefs, split_lights
from shjax.reflection.ranks import check_maps
from shjax.sphere import latlong_theta

if TYPE_CHECKING:
    from shjax.ibl.material import LitMaterial


def level_shape(level: int) -> tuple[int, int]:
    """Rows and columns of a level: four columns to the shortest wave, read linearly."""
    return 2 * (DEGREES[level] + 1), 4 * (DEGREES[level] + 1)


def level_starts() -> list[int]:
    """Offset of each level among the texels, and at last their number."""
    starts = [0]
    for level in range(LEVELS):
        starts.append(starts[-1] + math.prod(level_shape(level)))
    return starts


class Spectra(NamedTuple):
    """Power spectra of a light and of what is split off it, each ``(..., L, C)``.

    Attributes:
        whole: Of the light.
        rest: Of what the maps are made from, the light sources taken out.
        missed: Of what the caps are not of the light sources: pixels are no discs.
        cross: Of rest and missed together.
    """

    whole: jax.Array
    rest: jax.Array
    missed: jax.Array
    cross: jax.Array


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True, repr=False)
class PrefilteredLight:
    """Prefiltered environment light for image-based lighting of any material.

    What :func:`shjax.shade` shades by. A pytree. Axes in front are several lights; each
    shades every point.

    Attributes:
        texels: The maps of all levels, one level after the other, ``(..., maps, T, C)``.
        irradiance: Irradiance coefficients of the rest, ``(..., 9, C)``.
        lights: Light sources split off, which are in neither.
        spectra: Power spectra, from which errors are predicted.
    """

    texels: Float[Array, "*lights Q T C"]
    irradiance: Float[Array, "*lights 9 C"]
    lights: CapLights
    spectra: Spectra

    def __repr__(self) -> str:
        """What it holds, in two lines."""
        *front, _, _, channels = self.texels.shape
        many = f"{math.prod(front)} lights of " if front else ""
        count = self.lights.heights.shape[-1]
        return (
            f"PrefilteredLight: {many}{self.maps} maps at {LEVELS} roughnesses, {channels} "
            f"channels, {self.bytes / 1e6:.3g} MB\n"
            f"  9 coefficients for the diffuse part, {count} light sources shaded apart"
        )

    @property
    def maps(self) -> int:
        """Number of maps per level."""
        return self.texels.shape[-3]

    @property
    def bytes(self) -> int:
        """Memory of the maps and coefficients, in their own type."""
        return self.texels.nbytes + self.irradiance.nbytes

    def with_material(
        self, *, albedo=None, roughness=None, metallic=None, f0=0.04
    ) -> LitMaterial:
        """Reflector of glTF's metallic-roughness material under this light.

        Args:
            albedo: Base colour, a number, ``(C,)`` or one per point; default the
                G-buffer's that it is drawn on.
            roughness: In [0, 1], a number or one per point; default the G-buffer's.
            metallic: The same; default the G-buffer's, or 0.
            f0: Reflectance of the dielectric at normal incidence.
        """
        from shjax.ibl.material import LitMaterial

        return LitMaterial(self, albedo, roughness, metallic, f0)

    def level(self, level: int) -> Float[jax.Array, "*lights n_theta n_phi Q C"]:
        """Maps of one roughness, alpha = 2^-level, as images.

        Args:
            level: 0 (alpha 1) to 4 (alpha 1/16).

        Raises:
            IndexError: If there is no such level.
        """
        if not 0 <= level < LEVELS:
            raise IndexError(f"level must lie in [0, {LEVELS - 1}]; got {level}.")
        start, end = level_starts()[level : level + 2]
        texels = jnp.asarray(self.texels)[..., start:end, :]
        texels = jnp.moveaxis(texels, -3, -2)
        *lights, _, maps, channels = texels.shape
        return texels.reshape(*lights, *level_shape(level), maps, channels)


def prefilter_light(
    light_or_lighting: Light | Float[Array, "*lights K C"],
    *,
    maps: int = 9,
    max_lights: int = 4,
) -> PrefilteredLight:
    """Prefilter a light for image-based lighting at every roughness and reflectance.

    What a renderer does once per environment map for split-sum shading, with the error
    known beforehand. Jits and differentiates: in coefficients, or in the pixels of a
    lat-long panorama, whose light sources then keep their places.

    Args:
        light_or_lighting: An environment map or a lat-long panorama; or radiance
            coefficients, several lights in front. An array ``(n, 2 n, C)`` of at least 16
            rows is a panorama: n lights of 2 n coefficients each take one axis more in
            front. What lies beyond degree 128 is not used.
        maps: 4, 9, 16 or 21: few are small and fast, many are accurate. Static.
        max_lights: At most so many suns and lamps of a lat-long map are split off and
            shaded exactly (:func:`shjax.split_lights`). Coefficients have none. Static.

    Returns:
        The prefiltered light; 21 MB in float32 at 9 maps and three channels.

    Raises:
        ValueError: If there is no set of so many maps, ``max_lights`` is negative, or a
            shape is wrong.
    """
    check_maps(maps)
    if max_lights < 0:
        raise ValueError(f"max_lights must be >= 0; got {max_lights}.")
    envmap = as_light(light_or_lighting)
    if not isinstance(envmap, EnvironmentMap):
        coefs = as_float("light_or_lighting", envmap)
        degree_of_coefs(coefs, "light_or_lighting")
        return _prefiltered(coefs, coefs, _no_lights(coefs), maps=maps)
    whole = envmap.lighting(l_max=DEGREES[-1])
    if envmap.layout != "latlong" or not max_lights:
        return _prefiltered(whole, whole, _no_lights(whole), maps=maps)
    lights, rest = split_lights(envmap, max_lights=max_lights)
    return _prefiltered(whole, rest.lighting(l_max=DEGREES[-1]), lights, maps=maps)


def _no_lights(coefs: jax.Array) -> CapLights:
    front = coefs.shape[:-2]
    return CapLights(
        jnp.zeros((*front, 0, 3), coefs.dtype),
        jnp.zeros((*front, 0), coefs.dtype),
        jnp.zeros((*front, 0, coefs.shape[-1]), coefs.dtype),
    )


def _prefiltered(
    whole: jax.Array, rest: jax.Array, lights: CapLights, *, maps: int
) -> PrefilteredLight:
    """From coefficients of all the light and of what the light sources leave."""
    held = degree_of_coefs(rest)
    fit = ggx_tables(maps)
    tables = tuple(
        on_device(series_tables, min(degree, held), fit.orders, dtype=rest.dtype)
        for degree in DEGREES
    )
    return _on_grids(whole, rest, lights, tables, maps=maps)


@functools.partial(jax.jit, static_argnames=("maps",))
def _on_grids(
    whole: jax.Array,
    rest: jax.Array,
    lights: CapLights,
    tables: tuple[tuple[jax.Array, ...], ...],
    *,
    maps: int,
) -> PrefilteredLight:
    front, kept = whole.shape[:-2], (DEGREES[-1] + 1) ** 2
    if front:
        count = math.prod(front)
        flat = jax.tree.map(
            lambda a: a.reshape(count, *a.shape[len(front) :]), (whole, rest, lights)
        )
        many = jax.lax.map(
            lambda one: _one_light(one[0], one[1], one[2], tables, maps), flat
        )
        return jax.tree.map(lambda a: a.reshape(*front, *a.shape[1:]), many)
    return _one_light(whole[:kept], rest[:kept], lights, tables, maps)


def _one_light(
    whole: jax.Array,
    rest: jax.Array,
    lights: CapLights,
    tables: tuple[tuple[jax.Array, ...], ...],
    maps: int,
) -> PrefilteredLight:
    whole, rest = (a[: (DEGREES[-1] + 1) ** 2] for a in (whole, rest))
    channels, fit = rest.shape[-1], ggx_tables(maps)
    held = degree_of_coefs(rest)
    texels = []
    for level in range(LEVELS):
        degree = min(DEGREES[level], held)
        rows, columns = level_shape(level)
        kernels = jnp.asarray(fit.kernels(level)[: degree + 1], rest.dtype)
        found = maps_on_grid(
            rest[: (degree + 1) ** 2],
            jnp.broadcast_to(kernels[..., None], (*kernels.shape, channels)),
            fit.orders,
            latlong_theta(rows),
            columns,
            tables[level],
        )
        texels.append(jnp.moveaxis(found, 2, 0).reshape(maps, -1, channels))
    nine = jnp.pad(rest[:9], [(0, max(9 - rest.shape[0], 0)), (0, 0)])
    return PrefilteredLight(
        jnp.concatenate(texels, axis=1),
        irradiance_coefs(nine),
        lights,
        _spectra(whole, rest, lights, held),
    )


def _spectra(
    whole: jax.Array, rest: jax.Array, lights: CapLights, l_max: int
) -> Spectra:
    missed = whole - rest - cap_coefs(lights, l_max=l_max).astype(rest.dtype)
    every, left, not_caps = (power_spectrum(a) for a in (whole, rest, missed))
    cross = (power_spectrum(rest + missed) - left - not_caps) / 2
    return Spectra(every, left, not_caps, cross)
