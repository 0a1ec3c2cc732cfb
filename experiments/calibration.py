"""Do error bars hold? Lighting from pictures that show little: boxes, planes, balls, faces.

    python experiments/calibration.py --out experiments/results

Matte objects under real panoramas, turned at random, drawn from coefficients to degree 40
and given noise. For each of the nine numbers of each channel, z is its error over its
standard deviation: of honest ones 95 % lie within 2, and their root mean square is 1.
What the data leave open counts too: the prior's own spread has to cover it.
"""

from __future__ import annotations

import sys
from pathlib import Path

import click
import jax
import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import shjax
from experiments.data import PANORAMAS, data_folder
from experiments.versions import versions
from experiments.writing import markdown_table, write_result
from shjax import io
from shjax.vectors import normalize

TRUTH = 40
NOISES = (0.003, 0.01, 0.03, 0.1)  # of the picture's mean
_BOX = np.array([[1.0, 0, 0], [0, 0, 1], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, -1]])


def shapes(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Unit normals of each object's pixels, ``(n, 3)``."""

    def cone(degrees: float, count: int) -> np.ndarray:
        """Normals within an angle of +x: a part of a ball, as a camera there sees it."""
        found = rng.normal(size=(40 * count, 3))
        found /= np.linalg.norm(found, axis=1, keepdims=True)
        return found[found[:, 0] > np.cos(np.radians(degrees))][:count]

    each = 150
    tilted = np.array([[0.8, 0.6, 0.0], [0.8, -0.6, 0.0], [0.5, 0.0, 0.866]])
    walls = np.repeat(tilted, each, axis=0)
    walls = walls + 0.03 * rng.normal(size=walls.shape)  # plaster is not flat
    made = {
        "plane": np.repeat(_BOX[:1], each, axis=0),
        "building": walls / np.linalg.norm(walls, axis=1, keepdims=True),
        "face": cone(65, 600) * [1, 0.8, 1],
        "half a ball": cone(90, 600),
        "ball": cone(180, 600),
    }
    for count in range(2, 7):
        made[f"box, {count} faces"] = np.repeat(_BOX[:count], each, axis=0)
    return {k: v / np.linalg.norm(v, axis=1, keepdims=True) for k, v in made.items()}


def lights(turns: int, rng: np.random.Generator) -> np.ndarray:
    """Coefficients of the panoramas, each turned at random, ``(n, K, 3)``."""
    found = []
    for name in PANORAMAS:
        envmap = io.read_envmap(data_folder() / "hdri" / name).to_latlong(128)
        coefs = envmap.lighting(l_max=TRUTH)
        for _ in range(turns):
            q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
            q = q * np.sign(np.linalg.det(q))
            found.append(np.asarray(shjax.rotate(coefs, jnp.asarray(q, coefs.dtype))))
    return np.stack(found)


@jax.jit
def _picture(coefs: jax.Array, normals: jax.Array) -> jax.Array:
    return shjax.irradiance(coefs, normals) / np.pi


@jax.jit
def _scores(picture: jax.Array, normals: jax.Array, truth: jax.Array) -> jax.Array:
    """Errors of the nine numbers over their deviations, ``(9, 3)``."""
    found = shjax.estimate_lighting(picture, normals)
    return jnp.asarray((found.value - truth) / jnp.asarray(found.standard_deviation))


def table(turns: int, seed: int) -> list[dict]:
    """One row for each object and noise."""
    rng = np.random.default_rng(seed)
    every, rows = lights(turns, rng), []
    for name, normals in shapes(rng).items():
        for noise in NOISES:
            z = []
            for coefs in every:
                points = normalize(jnp.asarray(normals))
                clean = np.asarray(_picture(jnp.asarray(coefs), points))
                sd = noise * clean.mean()
                noisy = clean + sd * rng.normal(size=clean.shape)
                found = _scores(
                    jnp.asarray(noisy, clean.dtype), points, jnp.asarray(coefs[:9])
                )
                z.append(np.asarray(found, float))
            z = np.abs(np.stack(z))
            rows.append(
                {
                    "object": name,
                    "noise": noise,
                    "within_2": float(np.mean(z < 2)),
                    "z_rms": float(np.sqrt(np.mean(z**2))),
                    "z_max": float(z.max()),
                    "beyond_4": float(np.mean(z.max(axis=(1, 2)) > 4)),
                }
            )
            print(rows[-1], flush=True)
    return rows


def as_markdown(rows: list[dict], turns: int) -> str:
    """The table as it is published."""
    cells = [
        [
            r["object"],
            f"{r['noise']:.1%}",
            f"{r['within_2']:.1%}",
            f"{r['z_rms']:.2f}",
            f"{r['z_max']:.1f}",
            f"{r['beyond_4']:.0%}",
        ]
        for r in rows
    ]
    head = ["object", "noise", "within 2 sd", "rms of z", "largest z"]
    return "\n\n".join(
        [
            "# Calibration of the error bars of recovered light",
            f"{len(PANORAMAS)} panoramas, each rotated {turns} times; z is the error of a "
            "coefficient over its standard deviation. Honest error bars have 95 % within "
            "2 and a root mean square of 1.",
            markdown_table([*head, "pictures with a z > 4"], cells),
        ]
    )


@click.command()
@click.option("--out", type=click.Path(path_type=Path), required=True)
@click.option("--turns", default=4, show_default=True)
@click.option("--seed", default=7, show_default=True)
def main(out: Path, turns: int, seed: int) -> None:
    """Write calibration.json and calibration.md."""
    rows = table(turns, seed)
    content = {"versions": versions(), "turns": turns, "seed": seed, "rows": rows}
    write_result(out, "calibration", as_markdown(rows, turns), content)


if __name__ == "__main__":
    main()
