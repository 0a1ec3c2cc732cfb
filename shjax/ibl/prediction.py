"""What shading by a prefiltered light is wrong by, before anything is drawn."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np

from shjax.adapted import family
from shjax.adapted.ggx import (
    DEGREES,
    Family,
    Roughness,
    locate,
    multiple_scattering,
    uniform_response,
    view_functions,
)
from shjax.adapted.ranks import orders_of
from shjax.adapted.single import view_kernels
from shjax.brdf import metallic_roughness
from shjax.brdf.quadrature import view_nodes
from shjax.ibl.prefiltering import PrefilteredLight

_VIEWS = 96
_HIGHEST_ORDER = 32
_IRRADIANCE_DEGREE = 2


def predicted_shading_error(
    light: PrefilteredLight, *, albedo, roughness, metallic=0.0, f0=0.04
) -> float:
    """The rms error of :func:`shjax.shade` for one material, relative to the rms radiance.

    Over all orientations and views, exact for a light of this power spectrum: each
    degree's kernel ``G_lq(theta_o)`` against what the maps and nine coefficients hold.
    Reading between texels comes on top (below 1 %); lights that are shaded exactly count
    in the radiance alone.

    Args:
        light: One light, concrete.
        albedo: A number or one a channel.
        roughness: A number.
        metallic: A number.
        f0: A number or one a channel.

    Raises:
        ValueError: If a parameter is outside its range.
    """
    surface = metallic_roughness(albedo, roughness, metallic, f0)
    theta, weights = view_nodes(_VIEWS)
    spectra = light.spectra
    l_max, channels = spectra.whole.shape[-2] - 1, spectra.whole.shape[-1]
    exact = view_kernels(surface, tuple(theta.tolist()), l_max, _HIGHEST_ORDER)
    exact = np.broadcast_to(exact, (*exact.shape[:-1], channels))
    held = _held(channels, light.maps, theta, l_max, albedo, roughness, metallic, f0)
    lost = exact.copy()
    lost[:, :, : held.shape[2]] -= held
    times = np.where(np.arange(_HIGHEST_ORDER + 1) == 0, 1, 2)
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
    fit, dtype = family(maps), jnp.result_type(float)
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
def _functions(fit: Family, rough: Roughness, cosine: jax.Array):
    functions = view_functions(fit, rough, cosine)
    base, slope = uniform_response(fit, rough, functions)
    return *functions, base + slope
