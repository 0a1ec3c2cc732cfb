"""Hard cases: float32 beside float64, finite or refused, and the error.

    python experiments/hard_cases.py --out experiments/results

Each case is one call of the library on an input that breaks simpler code. The table says
what came of it in float32, how far that is from the same in float64 (relative to the
largest value), and, where the truth is known, how far float64 is from that.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import click
import jax
import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import shjax
from experiments.versions import versions_line
from experiments.writing import markdown_table, write_result
from shjax.sphere import fibonacci_directions, latlong_directions, latlong_solid_angles


class Case(NamedTuple):
    """One row.

    Attributes:
        name: In words.
        run: A dtype to the values that a user sees.
        truth: Their exact values, or None.
    """

    name: str
    run: Callable[[type], np.ndarray]
    truth: Callable[[], np.ndarray] | None = None


NORMALS = fibonacci_directions(256)


def _sky(rows: int = 64) -> np.ndarray:
    z = latlong_directions(rows, 2 * rows)[..., 2:]
    return np.where(z > 0, 1 + 0.3 * z, 0.2) * np.array([0.8, 0.9, 1.0])


def _sun() -> np.ndarray:
    image = _sky()
    image[12, 40] = 1e5
    return image


def _studio() -> np.ndarray:
    image = np.zeros((64, 128, 3))
    image[10:20, 20:40], image[12:16, 90:96] = 50, 200
    return image


def _night() -> np.ndarray:
    image = np.full((64, 128, 3), 1e-4)
    for row, column in ((20, 5), (25, 60), (30, 100), (33, 101)):
        image[row, column] = (900, 700, 300)
    return image


def _texel() -> np.ndarray:
    image = np.zeros((64, 128, 3))
    image[30, 77] = 1
    return image


def _nine(image: np.ndarray) -> Callable[[type], np.ndarray]:
    """Irradiance by nine coefficients of a panorama."""

    def run(dtype) -> np.ndarray:
        lighting = shjax.analyze(jnp.asarray(image, dtype), l_max=2)
        return np.asarray(shjax.irradiance(lighting, jnp.asarray(NORMALS, dtype)))

    return run


def _brute(image: np.ndarray) -> Callable[[], np.ndarray]:
    """Its nine-coefficient truth: the light's moments by a plain sum in float64."""

    def truth() -> np.ndarray:
        from shjax.harmonics.grid import Grid

        rows, columns, channels = image.shape
        weights = np.repeat(Grid(rows, columns).weights, columns)
        towards = latlong_directions(rows, columns).reshape(-1, 3)
        basis = np.asarray(shjax.basis(jnp.asarray(towards, jnp.float64), l_max=2))
        coefs = (basis * weights[:, None]).T @ image.reshape(-1, channels)
        gains = np.repeat([np.pi, 2 * np.pi / 3, np.pi / 4], [1, 3, 5])
        at = np.asarray(shjax.basis(jnp.asarray(NORMALS, jnp.float64), l_max=2))
        return at @ (gains[:, None] * coefs)

    return truth


def _layer(roughness: float) -> Callable[[type], np.ndarray]:
    """Shading of a metal through the lighting layer."""

    def run(dtype) -> np.ndarray:
        light = shjax.prefilter_light(shjax.make_envmap(_sun().astype(dtype)))
        views = NORMALS + 0.3 * np.roll(NORMALS, 1, axis=0)
        views /= np.linalg.norm(views, axis=1, keepdims=True)
        shaded = shjax.shade(
            light,
            jnp.asarray(NORMALS, dtype),
            jnp.asarray(views, dtype),
            albedo=[0.9] * 3,
            roughness=roughness,
            metallic=1.0,
        )
        return np.asarray(shaded)

    return run


def _grazing(dtype) -> np.ndarray:
    """A reflection map read at views a thousandth above the surface."""
    lighting = shjax.analyze(jnp.asarray(_sky(), dtype), l_max=16)
    rho = shjax.brdf_coefs(shjax.brdf.ggx(0.3, 0.04), l_max=16, p_max=8).astype(dtype)
    maps = shjax.prefilter(lighting, rho)
    tangent = np.cross(NORMALS, np.roll(NORMALS, 1, axis=0))
    views = tangent / np.linalg.norm(tangent, axis=1, keepdims=True) + 1e-3 * NORMALS
    views /= np.linalg.norm(views, axis=1, keepdims=True)
    n, v = jnp.asarray(NORMALS, dtype), jnp.asarray(views, dtype)
    return np.asarray(maps.radiance(n, v))


def _beyond(dtype) -> np.ndarray:
    return np.asarray(shjax.analyze(jnp.ones((8, 16, 3), dtype), l_max=9))


def _small(dtype) -> np.ndarray:
    return np.asarray(shjax.analyze(jnp.asarray(_sky(4), dtype), l_max=1))


def _huge(dtype) -> np.ndarray:
    image = np.repeat(np.repeat(_sky(512), 8, axis=0), 8, axis=1).astype(np.float32)
    return np.asarray(shjax.analyze(jnp.asarray(image, dtype), l_max=8))


def _constant(dtype) -> np.ndarray:
    return np.asarray(shjax.analyze(jnp.ones((512, 1024, 3), dtype), l_max=30))


def _exact_constant() -> np.ndarray:
    exact = np.zeros((31**2, 3))
    exact[0] = np.sqrt(4 * np.pi)
    return exact


def _negative() -> np.ndarray:
    image = _sky()
    image[5:9, 10:20] = -0.3
    return image


def _one_texel_truth() -> np.ndarray:
    """A light on one texel is a direction with a solid angle (to the order of Fejer)."""
    return _brute(_texel())()


CASES = [
    Case("sun 10^5 times the sky", _nine(_sun()), _brute(_sun())),
    Case("black studio with softboxes", _nine(_studio()), _brute(_studio())),
    Case("night lamps", _nine(_night()), _brute(_night())),
    Case("light on one texel", _nine(_texel()), _one_texel_truth),
    Case("negative pixels", _nine(_negative()), _brute(_negative())),
    Case("constant map to degree 30", _constant, _exact_constant),
    Case("8 x 4 panorama, degree 1", _small),
    Case("8192 x 4096 panorama, degree 8", _huge),
    Case("degree 9 of 16 x 8 pixels", _beyond),
    Case("roughness 0.25 under that sun", _layer(0.25)),
    Case("roughness 0.02 under that sun", _layer(0.02)),
    Case("views at n.v = 0.001", _grazing),
]


def run(cases: list[Case] = CASES) -> list[dict]:
    """Every case in both precisions; JAX's 64 bits must be enabled."""
    found = []
    for case in cases:
        row: dict = {"case": case.name}
        try:
            single = case.run(np.float32)
            double = case.run(np.float64)
            truth = None if case.truth is None else case.truth()
        except ValueError as error:
            found.append(row | {"result": f"refused: {str(error).split(';')[0]}"})
            continue
        size = float(np.max(np.abs(double))) or 1.0
        row["result"] = "finite" if np.all(np.isfinite(single)) else "NOT FINITE"
        row["float32 - float64"] = float(np.max(np.abs(single - double))) / size
        if truth is not None:
            row["float64 - exact"] = float(np.max(np.abs(double - truth))) / size
        found.append(row)
    return found


def markdown(rows: list[dict]) -> str:
    """The page."""
    names = ("float32 - float64", "float64 - exact")
    cells = (
        [
            row["case"],
            row["result"],
            *(f"{row[key]:.1e}" if key in row else "" for key in names),
        ]
        for row in rows
    )
    pole = latlong_solid_angles(4096, 8192)[0]
    return "\n\n".join(
        [
            "# Hard cases",
            (__doc__ or "").split("\n\n")[2],
            versions_line(),
            markdown_table(["case", "result", *names], cells),
            "Below roughness 0.25 the lighting layer draws what it draws at 0.25. A polar "
            f"pixel of the largest panorama covers {pole:.1e} steradians.",
        ]
    )


@click.command()
@click.option("--out", required=True, type=click.Path(path_type=Path))
def main(out: Path) -> None:
    """Write hard_cases.md."""
    jax.config.update("jax_enable_x64", True)
    write_result(out, "hard_cases", markdown(run()))


if __name__ == "__main__":
    main()
