"""Panoramas, materials, orientations, and the converged reference of each pair."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
from pathlib import Path

import jax.numpy as jnp
import numpy as np

import shjax
from experiments.data import data_folder
from shjax import brdf, io
from shjax.io.writing import replacing
from shjax.reference.random_orientations import Orientations, draw_orientations

ROWS, PAIRS, SEED = 128, 2048, 1
FULL_PANORAMAS = ("city", "sunrise", "night")


@dataclasses.dataclass(frozen=True)
class Scene:
    """A panorama averaged to 256 x 128, and where it is looked at.

    Attributes:
        name: Of the panorama.
        envmap: The map, lat-long.
        radiance: The same, ``(128, 256, 3)`` float32.
        samples: Orientations and views with their weights.
        normals: Of the samples, float32.
        views: Of the samples, float32.
    """

    name: str
    envmap: shjax.EnvironmentMap
    radiance: jnp.ndarray
    samples: Orientations
    normals: jnp.ndarray
    views: jnp.ndarray


@functools.cache
def scene(name: str, *, rows: int = ROWS, pairs: int = PAIRS) -> Scene:
    """A panorama by name; ``city`` comes with the package, the rest from the data folder.

    Raises:
        OSError: If its file is not there.
    """
    path = io.shipped_panorama()
    if name != "city":
        path = next(
            data_folder().glob(f"hdri/{name}*.*"), data_folder() / f"{name}.exr"
        )
    envmap = io.read_envmap(path, invalid="clamp").to_latlong(rows)
    samples = draw_orientations(pairs, seed=SEED)
    normals, views = (
        jnp.asarray(a, jnp.float32) for a in (samples.normals, samples.views)
    )
    return Scene(name, envmap, jnp.asarray(envmap.radiance), samples, normals, views)


@dataclasses.dataclass(frozen=True)
class Material:
    """A reflectance and what methods that know only its kind need.

    Attributes:
        name: In words.
        brdf: The reflectance.
        kind: ``"phong"``, ``"ggx"``, ``"microfacet"`` or ``"other"``.
        parameter: Exponent, alpha or sigma; of others an exponent to draw by.
        f0: Of GGX.
    """

    name: str
    brdf: shjax.brdf.Brdf
    kind: str
    parameter: float
    f0: float = 1.0


@functools.cache
def materials() -> tuple[Material, ...]:
    """All of them; those of measured data only where the data are there."""
    found = [
        Material(f"Phong {s}", brdf.phong(float(s)), "phong", s)
        for s in (8, 32, 128, 512)
    ]
    found += [
        Material(
            f"GGX {alpha} f0 {f0:g}",
            brdf.ggx(alpha, f0, multiscatter=True),
            "ggx",
            alpha,
            f0,
        )
        for f0 in (0.04, 1.0)
        for alpha in (0.1, 0.2, 0.4)
    ]
    found += [
        Material(
            f"microfacet {sigma}", brdf.gaussian_microfacet(sigma), "microfacet", sigma
        )
        for sigma in (0.1, 0.2, 0.3, 0.4, 0.5)
    ]
    folder = data_folder() / "brdf"
    if folder.is_dir():
        known = json.loads((folder / "cornell_lafortune.json").read_text())["materials"]
        for name in ("bluepaint", "primer"):
            cxy, cz, exponent = (
                np.array([lobe[k] for lobe in known[name]["lobes"]])
                for k in ("cxy", "cz", "n")
            )
            diffuse = np.array(known[name]["diffuse"])
            surface = brdf.lafortune(cxy, cz, exponent, diffuse)
            found.append(Material(f"Lafortune {name}", surface, "other", 20.0))
        curet = folder / "curet"
        for sample in (15, 42):
            surface = brdf.read_curet(curet / "abrdf.dat", curet / "table.txt", sample)
            found.append(Material(f"CUReT {sample}", surface, "other", 20.0))
    return tuple(found)


QUICK_MATERIALS = ("Phong 32", "GGX 0.2 f0 0.04", "GGX 0.4 f0 1", "microfacet 0.3")


def glossy_reference(
    where: Scene, material: Material, cache: Path
) -> tuple[np.ndarray, float]:
    """Radiance by the sum over every pixel ``(n, C)``, and its own relative rms error.

    The error is that of halving the grid, at the first 128 orientations: each pixel as
    four of the same light.
    """

    def compute():
        exact = shjax.reference_reflection(
            where.radiance, material.brdf, where.normals, where.views
        )
        finer = jnp.asarray(finer_light(np.asarray(where.radiance)))
        some = shjax.reference_reflection(
            finer, material.brdf, where.normals[:128], where.views[:128]
        )
        exact, some = (np.asarray(a, np.float64) for a in (exact, some))
        own = relative_rms(exact[:128], some, where.samples.weights[:128])
        return exact, own

    return _cached(
        cache,
        (
            "glossy",
            where.name,
            material.name,
            where.normals.shape,
            where.radiance.shape,
        ),
        compute,
    )


def irradiance_reference(where: Scene, cache: Path) -> tuple[np.ndarray, float]:
    """Irradiance of the normals by the sum over every pixel, and its own error."""

    def compute():
        exact = shjax.reference_irradiance(where.radiance, where.normals)
        finer = jnp.asarray(finer_light(np.asarray(where.radiance)))
        some = shjax.reference_irradiance(finer, where.normals[:128])
        exact, some = (np.asarray(a, np.float64) for a in (exact, some))
        return exact, relative_rms(exact[:128], some, np.ones(len(some)))

    return _cached(
        cache,
        ("irradiance", where.name, where.normals.shape, where.radiance.shape),
        compute,
    )


def finer_light(image: np.ndarray) -> np.ndarray:
    """A panorama on a grid of half the step."""
    return np.repeat(np.repeat(image, 2, axis=0), 2, axis=1)


def relative_rms(value, truth, weights) -> float:
    """Weighted rms of the difference over that of the truth."""
    w = np.asarray(weights)[:, None]
    return float(
        np.sqrt(np.sum(w * (value - truth) ** 2) / np.sum(w * np.asarray(truth) ** 2))
    )


def _cached(folder: Path, key: tuple, compute) -> tuple[np.ndarray, float]:
    name = hashlib.sha256(repr((shjax.__version__, SEED, *key)).encode()).hexdigest()[
        :16
    ]
    path = folder / f"{key[0]}_{name}.npz"
    if path.exists():
        with np.load(path) as held:
            return held["exact"], float(held["own"])
    exact, own = compute()
    folder.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        np.savez(temporary, exact=exact, own=own)
    return exact, own
