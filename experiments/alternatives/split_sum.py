"""Split-sum: one prefiltered map and a table of the BRDF [Karis 2013].

``L = map(R, roughness) (f0 A + B)``: the map filters the light by the lobe of a view along
the normal, whatever the view; the table holds the albedo of the view. What is read, and
how, is shared with the lighting layer, so that the two differ by the method alone.

References:
    B. Karis, Real Shading in Unreal Engine 4, SIGGRAPH 2013 course notes.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from shjax.brdf import ggx
from shjax.clamped_cosine import irradiance
from shjax.harmonics.orientations import maps_on_grid, series_tables
from shjax.harmonics.tables import on_device
from shjax.ibl.ggx_tables import DEGREES, LEVELS, locate
from shjax.ibl.prefiltered_light import level_shape
from shjax.ibl.shading import taps
from shjax.ibl.texels import Weights, read_maps
from shjax.reflection.low_rank import view_kernels
from shjax.sphere import latlong_theta
from shjax.vectors import mirror

_COSINES, _ALPHAS = 64, 17


class Light(NamedTuple):
    """Maps of all roughnesses ``(1, T, C)`` and nine coefficients ``(9, C)``."""

    texels: jax.Array
    coefs: jax.Array


@functools.lru_cache
def lobe(alpha: float, l_max: int) -> np.ndarray:
    """Gains of the lobe of a view along the normal, 1 for degree 0, ``(l_max + 1,)``."""
    with jax.ensure_compile_time_eval():
        surface = ggx(np.float32(alpha), np.float32(1))
        gains = view_kernels(surface, (1e-3,), l_max, 0)[0, :, 0, 0]
    l = np.arange(l_max + 1)
    return gains / gains[0] / np.sqrt(2 * l + 1)


@functools.lru_cache
def table() -> np.ndarray:
    """Albedo without f0 and times f0, by alpha (octaves / 4) and n.v: ``(17, 64, 2)``."""
    cosines = (np.arange(_COSINES) + 0.5) / _COSINES
    angles = tuple((2 * np.arccos(cosines)).tolist())
    rows = []
    for k in range(_ALPHAS):
        with jax.ensure_compile_time_eval():
            pair = np.array([0.0, 1.0], np.float32)
            both = ggx(np.float32(2.0 ** (-k / 4)), f0=pair)
            flux = view_kernels(both, angles, 0, 0)[:, 0, 0] * np.sqrt(4 * np.pi)
        rows.append(np.stack([flux[:, 0], flux[:, 1] - flux[:, 0]], axis=-1))
    return np.stack(rows)


@jax.jit
def prefilter(coefs: jax.Array) -> Light:
    """The maps of a light from its coefficients ``(K, C)`` to degree 128 at most."""
    held = int(np.sqrt(coefs.shape[0])) - 1
    texels = []
    for level in range(LEVELS):
        degree, (rows, columns) = min(DEGREES[level], held), level_shape(level)
        l = np.arange(degree + 1)
        # The kernel of one map over the light's degree, as maps_on_grid has it.
        kernel = lobe(2.0**-level, degree) * np.sqrt((2 * l + 1) / (4 * np.pi))
        kernel = jnp.asarray(kernel, coefs.dtype)[:, None, None]
        found = maps_on_grid(
            coefs[: (degree + 1) ** 2],
            jnp.broadcast_to(kernel, (degree + 1, 1, coefs.shape[-1])),
            (0,),
            latlong_theta(rows),
            columns,
            on_device(series_tables, degree, (0,), dtype=coefs.dtype),
        )
        texels.append(found.reshape(1, -1, coefs.shape[-1]))
    return Light(jnp.concatenate(texels, axis=1), coefs[:9])


@functools.partial(jax.jit, static_argnames=("fit", "shift"))
def shade(
    light: Light,
    normals,
    views,
    *,
    albedo,
    roughness,
    metallic,
    f0=0.04,
    fit: str = "table",
    shift: bool = False,
):
    """Radiance ``(n, C)`` at points ``(n, 3)``; colours ``(n, C)``, the rest ``(n,)``.

    Args:
        light: From :func:`prefilter`.
        normals: Unit normals.
        views: Unit vectors to the viewer.
        albedo: Base colour.
        roughness: Square root of alpha.
        metallic: In [0, 1].
        f0: Of the dielectric.
        fit: ``"table"``, or ``"analytic"``: Karis's fit for mobiles, after Lazarov.
        shift: Whether the lookup moves towards the normal [Lagarde, de Rousiers 2014].
    """
    metal = metallic[:, None]
    specular = (f0 * (1 - metal) + albedo * metal).T
    rough = locate(roughness**2)
    cosine = jnp.clip(jnp.sum(normals * views, axis=-1), 0, 1)
    if fit == "table":
        base, slope = _looked_up(rough.place * 4, cosine * _COSINES - 0.5)
    else:
        base, slope = _analytic(roughness, cosine)
    towards = mirror(normals, views)
    if shift:
        smooth = (1 - roughness**2)[:, None]
        share = smooth * (jnp.sqrt(smooth) + (roughness**2)[:, None])
        towards = normals + (towards - normals) * share
        towards = towards / jnp.linalg.norm(towards, axis=-1, keepdims=True)
    places, shares = taps(rough, towards)
    glossy = read_maps(
        (0,), light.texels, places, shares, Weights(base[None], slope[None], specular)
    )
    return irradiance(light.coefs, normals) * albedo * (1 - metal) / np.pi + glossy.T


def _analytic(roughness: jax.Array, cosine: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Without f0 and times f0: Karis's fit for mobiles (2014)."""
    r0, r1, r2, r3 = (
        roughness * c0 + c1
        for c0, c1 in ((-1.0, 1.0), (-0.0275, 0.0425), (-0.572, 1.04), (0.022, -0.04))
    )
    a = jnp.minimum(r0 * r0, 2 ** (-9.28 * cosine)) * r0 + r1
    return 1.04 * a + r3, -1.04 * a + r2


def _looked_up(along: jax.Array, across: jax.Array) -> tuple[jax.Array, jax.Array]:
    values = jnp.asarray(table(), along.dtype).reshape(-1, 2)
    across = jnp.clip(across, 0, _COSINES - 1)
    i = jnp.clip(jnp.floor(along), 0, _ALPHAS - 2).astype(jnp.int32)
    k = jnp.clip(jnp.floor(across), 0, _COSINES - 2).astype(jnp.int32)
    s, t = along - i.astype(along.dtype), across - k.astype(across.dtype)
    total = jnp.zeros((along.shape[0], 2), along.dtype)
    for down, a in ((0, 1 - s), (1, s)):
        for right, b in ((0, 1 - t), (1, t)):
            row = jnp.take(values, (i + down) * _COSINES + k + right, axis=0)
            total = total + row * (a * b)[:, None]
    return total[:, 0], total[:, 1]
