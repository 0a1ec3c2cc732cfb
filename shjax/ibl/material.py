"""Lit materials: a prefiltered light in one material, a reflector, and its error."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Float

from shjax.arrays import Array
from shjax.brdf import metallic_roughness
from shjax.brdf.ggx import multiple_scattering
from shjax.brdf.quadrature import view_nodes
from shjax.ibl.ggx_tables import (
    DEGREES,
    MIN_ALPHA,
    GgxTables,
    Roughness,
    ggx_tables,
    locate,
    uniform_response,
    view_functions,
)
from shjax.ibl.prefiltered_light import PrefilteredLight
from shjax.ibl.shading import shade
from shjax.light import Light
from shjax.reference.random_orientations import MeasuredError
from shjax.reflection.low_rank import view_kernels
from shjax.reflection.ranks import orders_of
from shjax.reflection.reflector import check_against_integral

_VIEWS = 96
_MAX_ORDER = 32
_IRRADIANCE_DEGREE = 2
MIN_ROUGHNESS = math.sqrt(MIN_ALPHA)  # where the maps end


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True, repr=False)
class LitMaterial:
    """Metallic-roughness material under a prefiltered light, a reflector and a pytree.

    Made by :meth:`PrefilteredLight.with_material`. What is None is taken from the
    G-buffer that it is drawn on (:func:`shjax.render.image`).

    Attributes:
        light: The prefiltered light.
        albedo: Base colour, a number, ``(C,)`` or one per point.
        roughness: In [0, 1], a number or one per point.
        metallic: In [0, 1], a number or one per point.
        f0: Reflectance of the dielectric at normal incidence, as ``albedo``.
    """

    light: PrefilteredLight
    albedo: Any
    roughness: Any
    metallic: Any
    f0: Any
    in_place_of_brdf: ClassVar[str] = (
        "the same material without a light is shjax.brdf.metallic_roughness(...)"
    )

    def __repr__(self) -> str:
        """Description in one line; a gradient, whose values are none, has its type only."""
        try:
            return f"LitMaterial: {self.message}"
        except ValueError:
            return "LitMaterial with values out of range"

    def radiance(
        self,
        normals: Float[Array, "*points 3"],
        views: Float[Array, "*points 3"],
        *,
        tangents: Float[Array, "*points 3"] | None = None,
    ) -> Float[jax.Array, "*points C"]:
        """Reflected radiance at unit normals and views (:func:`shjax.shade`).

        Args:
            normals: Unit normals.
            views: Unit vectors to the viewer.
            tangents: Not used: the material is isotropic.

        Raises:
            ValueError: If a shape is wrong, or the material was left to a G-buffer.
        """
        del tangents
        if self.roughness is None:
            raise ValueError("roughness must be given: with_material(roughness=...).")
        return shade(
            self.light,
            normals,
            views,
            albedo=1.0 if self.albedo is None else self.albedo,
            roughness=self.roughness,
            metallic=0.0 if self.metallic is None else self.metallic,
            f0=self.f0,
        )

    def _one_material(self) -> dict[str, Any] | None:
        """The parameters, where they are one material's and known."""
        given = {
            "albedo": 1.0 if self.albedo is None else self.albedo,
            "roughness": self.roughness,
            "metallic": 0.0 if self.metallic is None else self.metallic,
            "f0": self.f0,
        }
        flat = all(np.ndim(v) <= (k in ("albedo", "f0")) for k, v in given.items())
        traced = any(
            isinstance(v, Tracer) for v in jax.tree.leaves((self.light, given))
        )
        whole = self.roughness is not None and self.light.texels.ndim == 3
        return given if flat and whole and not traced else None

    @property
    def predicted_rms_error(self) -> float:
        """Predicted rms error over all orientations and views, relative.

        Uniform in the reflected direction: a normal counts by n.v.
        Exact for a light of this power spectrum: each degree's kernel ``G_lq(theta_o)``
        against what the maps and nine coefficients hold. Reading between texels comes on
        top (below 1 %). NaN where the material differs from point to point, or is traced.
        """
        given = self._one_material()
        return math.nan if given is None else _predicted(self.light, **given)

    @property
    def bytes(self) -> int:
        """Memory of the prefiltered light, which serves every material."""
        return self.light.bytes

    @property
    def message(self) -> str:
        """Description in words, with the predicted error where it is known."""
        count = self.light.lights.heights.shape[-1]
        what = (
            f"a lighting layer of {self.light.maps} maps and 9 coefficients for the "
            "diffuse part"
        )
        if count:
            what += f", and {count} light source{'s' if count > 1 else ''} shaded apart"
        what += f": {self.bytes / 1e6:.3g} MB for every material"
        predicted = self.predicted_rms_error
        if not math.isnan(predicted):
            what += f"; predicted error {predicted:.2%} rms ({predicted**2:.2%} energy)"
            if float(self.roughness) < MIN_ROUGHNESS:
                what += f"; drawn as roughness {MIN_ROUGHNESS:g}, where the maps end"
        return what

    def check(
        self, light: Light | None = None, *, n: int = 2048, seed: int = 0
    ) -> MeasuredError:
        """Measure the rms error against the integral at random orientations and views.

        Args:
            light: The light as an environment map (one of more than 128 rows is averaged
                to 128) or a lat-long panorama.
            n: How many orientations and views.
            seed: Of their random numbers.

        Raises:
            ValueError: If no light is given, whose pixels a prefiltered light does not
                keep, or the material is not one for all points.
        """
        given = self._one_material()
        if light is None or given is None:
            raise ValueError(
                "check needs the light, and one material for all points that is known."
            )
        dtype = self.light.texels.dtype
        lighting = jnp.zeros((1, self.light.texels.shape[-1]), dtype)
        return check_against_integral(
            self, metallic_roughness(**given), light, lighting, n=n, seed=seed
        )


def _predicted(light: PrefilteredLight, *, albedo, roughness, metallic, f0) -> float:
    surface = metallic_roughness(albedo, roughness, metallic, f0)
    theta, weights = view_nodes(_VIEWS)
    spectra = light.spectra
    l_max, channels = spectra.whole.shape[-2] - 1, spectra.whole.shape[-1]
    exact = view_kernels(surface, tuple(theta.tolist()), l_max, _MAX_ORDER)
    exact = np.broadcast_to(exact, (*exact.shape[:-1], channels))
    held = _held(channels, light.maps, theta, l_max, albedo, roughness, metallic, f0)
    lost = exact.copy()
    lost[:, :, : held.shape[2]] -= held
    times = np.where(np.arange(_MAX_ORDER + 1) == 0, 1, 2)
    degree = (2 * np.arange(l_max + 1) + 1)[:, None]

    def energy(a: np.ndarray, b: np.ndarray, power: jax.Array) -> float:
        by_degree = np.einsum("olqc,olqc,o,q->lc", a, b, weights, times, optimize=True)
        return float(np.sum(by_degree * np.asarray(power, np.float64) / degree))

    whole = energy(exact, exact, spectra.whole)
    error = (
        energy(lost, lost, spectra.rest)
        + 2 * energy(lost, exact, spectra.cross)
        + energy(exact, exact, spectra.missed)
    )
    return float(np.sqrt(max(error, 0) / whole)) if whole else 0.0


def _held(
    channels: int,
    maps: int,
    theta: np.ndarray,
    l_max: int,
    albedo,
    roughness,
    metallic,
    f0,
) -> np.ndarray:
    """``G_lq(theta_o)`` as maps and irradiance hold it, ``(O, L, Q, C)``."""
    fit, dtype = ggx_tables(maps), jnp.result_type(float)
    cosine = jnp.asarray(np.cos(theta / 2), dtype)
    rough = locate(jnp.full(theta.size, float(roughness) ** 2, dtype))
    base, slope, white = (
        np.asarray(a, np.float64) for a in _functions(fit, rough, cosine)
    )
    albedo, f0 = (
        np.broadcast_to(np.asarray(a, np.float64), channels) for a in (albedo, f0)
    )
    specular = f0 * (1 - metallic) + albedo * metallic
    gain = np.asarray(multiple_scattering(white[:, None], specular), np.float64)
    orders = np.array(orders_of(fit.ranks))
    rise = np.sin(theta / 2) ** orders[:, None]
    views = (base[..., None] + slope[..., None] * specular) * (rise[..., None] * gain)
    level, share = int(rough.level[0]), float(rough.share[0])
    mixed = np.zeros((max(DEGREES) + 1, orders.size))
    for step, part in ((0, 1 - share), (1, share)):
        profile = fit.profiles[level + step]
        mixed[: len(profile)] += part * profile
    mixed = np.pad(mixed, [(0, max(l_max + 1 - len(mixed), 0)), (0, 0)])[: l_max + 1]
    held = np.zeros((theta.size, l_max + 1, len(fit.ranks), channels))
    for q in range(len(fit.ranks)):
        mine = orders == q
        held[:, :, q] = np.einsum("lj,joc->olc", mixed[:, mine], views[mine])
    if np.any(albedo * (1 - metallic)):
        # Degrees to 2 of the diffuse part are exact, all its orders q about R.
        matte = metallic_roughness(albedo, 1.0, metallic, 0.0)
        diffuse = type(matte)(matte.parts[:1])
        top = min(_IRRADIANCE_DEGREE, l_max)
        angles = tuple(theta.tolist())
        kernel = view_kernels(diffuse, angles, top, _IRRADIANCE_DEGREE)
        count = max(held.shape[2], _IRRADIANCE_DEGREE + 1)
        held = np.pad(held, [(0, 0), (0, 0), (0, count - held.shape[2]), (0, 0)])
        held[:, : top + 1, : _IRRADIANCE_DEGREE + 1] += kernel
    return held


@functools.partial(jax.jit, static_argnames=("fit",))
def _functions(fit: GgxTables, rough: Roughness, cosine: jax.Array):
    functions = view_functions(fit, rough, cosine)
    base, slope = uniform_response(fit, rough, functions)
    return *functions, base + slope
