"""Light from photographs of a gray sphere, and another object under it.

    python experiments/inverse_photographs.py [--out experiments/results]

Of each of 12 photographs (``photos/psm`` of the data folder): the light from every other
lit pixel of the sphere and its error over the rest; then the buddha under that light,
its normals and albedo from the other 11 photographs by photometric stereo (Woodham 1980)
with the lights of ``lights.txt``, beside its photograph.
"""

from __future__ import annotations

import sys
from pathlib import Path

import click
import jax
import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import OpenImageIO as oiio

import shjax
from experiments.data import data_folder
from experiments.versions import versions_line
from experiments.writing import markdown_table, write_result
from shjax.inverse import decode

CENTRE, RADIUS = (244.5, 144.5), 108


def photograph(path: Path) -> np.ndarray:
    """The stored bytes, ``(H, W, 3)``."""
    pixels = oiio.ImageBuf(str(path)).get_pixels(oiio.UINT8)
    assert pixels is not None, path
    return pixels[..., :3]


def linear(image: np.ndarray) -> np.ndarray:
    """Their radiance: the photographs are linear."""
    return np.asarray(decode(jnp.asarray(image), encoding="linear").radiance, float)


def sphere_normals(shape: tuple[int, int]) -> np.ndarray:
    """X right, y up, z towards the camera; zero where n.v < 0.2."""
    row, column = np.mgrid[: shape[0], : shape[1]]
    across, up = (column - CENTRE[0]) / RADIUS, -(row - CENTRE[1]) / RADIUS
    squared = 1 - across**2 - up**2
    normals = np.stack([across, up, np.sqrt(np.maximum(squared, 0))], axis=-1)
    return np.where((squared > 0.04)[..., None], normals, 0)


def lit(image: np.ndarray) -> np.ndarray:
    """Neither dark nor clipped, in every channel."""
    return np.all((image >= 5) & (image <= 250), axis=-1)


def stereo(radiance: np.ndarray, good: np.ndarray, lights: np.ndarray):
    """Normals and albedos, ``(N, 3)``, without the darkest: it may be in shadow."""
    gray = np.where(good, radiance.mean(axis=-1), 0)  # [k, n]
    order = np.argsort(-gray, axis=0)[:10]
    values = np.take_along_axis(gray, order, axis=0).T  # [n, 10]
    towards = lights[order.T]  # [n, 10, 3]
    gram = np.einsum("nki,nkj->nij", towards, towards) + 1e-6 * np.eye(3)
    scaled = np.linalg.solve(gram, np.einsum("nki,nk->ni", towards, values)[..., None])
    scaled = scaled[..., 0]
    length = np.linalg.norm(scaled, axis=-1, keepdims=True)
    normals = scaled / np.maximum(length, 1e-9)
    made = np.einsum("nki,ni->nk", towards, normals)
    seen = np.take_along_axis(radiance, order[..., None], axis=0).transpose(1, 0, 2)
    power = np.maximum(np.sum(made**2, axis=1), 1e-9)[:, None]
    return normals, np.einsum("nk,nkc->nc", made, seen) / power


@click.command()
@click.option("--out", type=click.Path(path_type=Path), help="Folder for the table.")
def main(out: Path | None) -> None:
    """Estimate each and print the table."""
    jax.config.update("jax_enable_x64", True)
    folder = data_folder() / "photos/psm"
    if not folder.is_dir():
        raise SystemExit(f"{folder} is missing; set SHJAX_DATA.")
    lights = np.loadtxt(folder / "lights.txt", skiprows=1)
    lights = lights / np.linalg.norm(lights, axis=1, keepdims=True)
    ball = [photograph(folder / f"gray/gray.{k}.png") for k in range(12)]
    statue = [photograph(folder / f"buddha/buddha.{k}.png") for k in range(12)]
    inside = photograph(folder / "buddha/buddha.mask.png")[..., 0] > 128
    normals = sphere_normals(ball[0].shape[:2])
    shown = np.any(normals != 0, axis=-1)
    row, column = np.nonzero(shown)
    half = (row + column) % 2 == 0
    sphere_errors, statue_errors, found = [], [], []
    for k in range(12):
        radiance, good = linear(ball[k])[shown], lit(ball[k])[shown]
        answer = shjax.estimate_lighting(
            radiance, normals[shown], mask=(good & half).astype(float)
        )
        found.append(answer.full_value)
        made = shjax.irradiance(answer.full_value, jnp.asarray(normals[shown])) / np.pi
        held = good & ~half
        apart = np.asarray(made)[held] - radiance[held]
        sphere_errors.append(np.sqrt(np.mean(apart**2)) / radiance[held].mean())
    for k in range(12):
        others = [j for j in range(12) if j != k]
        radiance = np.stack([linear(statue[j])[inside] for j in others])
        good = np.stack([lit(statue[j])[inside] for j in others])
        turned, albedo = stereo(radiance, good, lights[others])
        made = (
            np.asarray(shjax.irradiance(found[k], jnp.asarray(turned))) / np.pi * albedo
        )
        seen, use = linear(statue[k])[inside], lit(statue[k])[inside]
        # The sphere's albedo is not known: one scale, from the other photographs' lights.
        scale = _scale(found, others, turned, albedo, radiance, good)
        apart = (scale * made - seen)[use]
        statue_errors.append(np.sqrt(np.mean(apart**2)) / seen[use].mean())
    head = ["photograph", "sphere, held-out RMSE", "buddha, relative RMSE"]
    rows = [
        [str(k), f"{a:.2%}", f"{b:.2%}"]
        for k, (a, b) in enumerate(zip(sphere_errors, statue_errors, strict=True))
    ]
    text = "\n\n".join(
        [
            "# Light from photographs",
            markdown_table(head, rows),
            f"medians {np.median(sphere_errors):.2%} and {np.median(statue_errors):.2%}, "
            f"largest {max(sphere_errors):.2%} and {max(statue_errors):.2%}",
            versions_line(),
        ]
    )
    write_result(out, "inverse_photographs", text)


def _scale(found, others, normals, albedo, radiance, good) -> float:
    above = below = 0.0
    for i, j in enumerate(others):
        made = (
            np.asarray(shjax.irradiance(found[j], jnp.asarray(normals)))
            / np.pi
            * albedo
        )
        above += np.sum((made * radiance[i])[good[i]])
        below += np.sum((made**2)[good[i]])
    return above / below


if __name__ == "__main__":
    main()
