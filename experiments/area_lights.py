"""Area lights: time against error of harmonics, LTC, quadrature and the usual tricks.

    python experiments/area_lights.py --out experiments/results

GGX of several roughnesses at 96 points of a floor, under a square, a disk, a sphere and
a tube at three distances, seen from 0 to 75 degrees; the error is rms over rms of the
integral (quadrature of 64 nodes, float64). Times are of float32, warm, per point, of one
light.
"""

from __future__ import annotations

import sys
from pathlib import Path

import click
import jax
import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from experiments.alternatives import area_lights as tricks
from experiments.timing import interleaved_medians
from experiments.versions import versions
from experiments.writing import markdown_table, write_result
from shjax import lights, ltc
from shjax.brdf import ggx

ALPHAS = (0.05, 0.1, 0.2, 0.4, 0.8, 1.0)
DISTANCES = (0.7, 1.5, 4.0)
DEGREES = (8, 16, 24, 32)
KINDS = ("square", "disk", "sphere", "tube")


def make(kind: str, distance: float):
    """A light of size about one over the floor's middle, facing down."""
    up = np.array([0.3, 0.2, 1.0])
    centre = distance * up / np.linalg.norm(up)
    if kind == "square":
        corners = np.array([[1, 1, 0], [1, -1, 0], [-1, -1, 0], [-1, 1, 0]]) * 0.4
        return lights.polygon(centre + corners, 1.0)
    if kind == "disk":
        return lights.disk(centre, np.array([0, 0, -1.0]), 0.45, 1.0)
    if kind == "sphere":
        return lights.sphere(centre, 0.4, 1.0)
    side = np.array([0.6, 0.2, 0.0])
    return lights.capsule(centre - side, centre + side, 0.05, 1.0)


def scene(count: int, seed: int = 0):
    """A floor's normal and views from 0 to 75 degrees."""
    rng = np.random.default_rng(seed)
    normals = np.tile([0.0, 0, 1], (count, 1))
    angle, phi = np.radians(75) * rng.random(count), 2 * np.pi * rng.random(count)
    views = np.stack(
        [np.sin(angle) * np.cos(phi), np.sin(angle) * np.sin(phi), np.cos(angle)], -1
    )
    return rng, normals, views


def _places(rng, normals, views, distance: float, count: int) -> np.ndarray:
    """Points whose reflected rays pass within half a unit of the light."""
    reflected = 2 * np.sum(normals * views, axis=1, keepdims=True) * normals - views
    up = np.array([0.3, 0.2, 1.0])
    centre = distance * up / np.linalg.norm(up)
    hit = centre + 0.5 * rng.normal(size=(count, 3)) * [1, 1, 0]
    return hit - reflected * (hit[:, 2:] / reflected[:, 2:])


def run(count: int = 96, rounds: int = 3, f0s=(1.0, 0.04), alphas=ALPHAS) -> dict:
    """Errors of every cell, and microseconds a point of every method."""
    errors: dict[str, dict[str, float]] = {}
    for kind in KINDS:
        for distance in DISTANCES:
            rng, normals, views = scene(count)
            points = _places(rng, normals, views, distance, count)
            for alpha in alphas:
                for f0 in f0s:
                    cell = f"{kind}, {distance:g}, {alpha:g}, {f0:g}"
                    given = (points, normals, views)
                    errors[cell] = _errors(kind, distance, alpha, f0, given, rng)
    return {"errors": errors, "microseconds": _times(count, rounds), **versions()}


def _errors(kind, distance, alpha, f0, given, rng) -> dict[str, float]:
    light, surface = make(kind, distance), ggx(np.float64(alpha), np.float64(f0))
    exact = np.asarray(lights.area_reflection(light, surface, *given, nodes=64))[:, 0]
    size = np.sqrt(np.mean(exact**2))
    found = {
        name: function(light, surface, given, alpha, f0, rng)
        for name, function in methods(kind, distance).items()
    }
    return {
        name: float(np.sqrt(np.mean((np.asarray(value) - exact) ** 2)) / size)
        for name, value in found.items()
    }


def methods(kind: str, distance: float):
    """Each as a function of light, surface, points, and what tricks need."""
    every = {}
    for degree in DEGREES:
        every[f"harmonics, F = {degree}"] = lambda l, s, g, a, f, r, degree=degree: (
            lights.area_shade(l, s, *g, l_max=degree)[:, 0]
        )
    for nodes in (6, 12):
        every[f"quadrature, {nodes}"] = lambda l, s, g, a, f, r, nodes=nodes: (
            lights.area_reflection(l, s, *g, nodes=nodes)[:, 0]
        )

    def by_ltc(light, surface, given, alpha, f0, rng):
        if kind == "tube":
            light = lights.line(light.ends[0], light.ends[1], light.radius, 1.0)
        return ltc.fit(surface).radiance(light, *given)[:, 0]

    every["LTC"] = by_ltc
    if kind in ("sphere", "tube"):
        every |= _tricks(kind)
    return every


def _tricks(kind: str):
    def solid(light, points):
        zero = lights.area_coefs(light, points, l_max=0)[:, 0, 0]
        return zero * np.sqrt(4 * np.pi)

    def middle(light):
        return light.centre if kind == "sphere" else jnp.mean(light.ends, axis=0)

    def of_point(light, surface, given, alpha, f0, rng):
        return tricks.point_light(
            middle(light), solid(light, given[0]), alpha, f0, *map(jnp.asarray, given)
        )

    def of_roughness(light, surface, given, alpha, f0, rng):
        points, normals, views = map(jnp.asarray, given)
        own = solid(light, given[0])
        return tricks.roughened(
            middle(light), light.radius, own, alpha, f0, points, normals, views
        )

    def of_nearest(light, surface, given, alpha, f0, rng):
        n, v = jnp.asarray(given[1]), jnp.asarray(given[2])
        points, own, r = jnp.asarray(given[0]), solid(light, given[0]), light.radius
        if kind == "sphere":
            return tricks.representative_point(
                light.centre, r, own, alpha, f0, points, n, v
            )
        start, end = light.ends
        return tricks.representative_point_of_a_tube(
            start, end, r, own, alpha, f0, points, n, v
        )

    found = {
        "a point": of_point,
        "roughness modified": of_roughness,
        "representative point": of_nearest,
    }
    if kind == "sphere":
        for count in (16, 256):
            found[f"Monte Carlo, {count}"] = _monte_carlo(count, solid)
    return found


def _monte_carlo(count: int, solid):
    def by_samples(light, surface, given, alpha, f0, rng):
        points, normals, views = map(jnp.asarray, given)
        apart = np.asarray(light.centre) - np.asarray(points)
        distance = np.linalg.norm(apart, axis=1, keepdims=True)
        ratio = (np.asarray(light.radius) / distance[:, 0]) ** 2
        height = ratio / (1 + np.sqrt(1 - ratio))
        drawn = tricks.draw_cap(rng, apart / distance, height, count)
        own = solid(light, points)
        return tricks.monte_carlo(jnp.asarray(drawn), own, alpha, f0, normals, views)

    return by_samples


def _times(count: int, rounds: int) -> dict[str, float]:
    """Of the square, GGX 0.2, in single precision: a warm call, per point."""
    rng, normals, views = scene(count)
    points = _places(rng, normals, views, 1.5, count)
    given = [jnp.asarray(a, jnp.float32) for a in (points, normals, views)]
    light, surface = make("square", 1.5), ggx(np.float32(0.2), np.float32(1.0))
    light = jax.tree.map(lambda a: jnp.asarray(a, jnp.float32), light)
    table = ltc.fit(surface)
    work = {"LTC": lambda: table.radiance(light, *given)}
    for degree in DEGREES:
        work[f"harmonics, F = {degree}"] = lambda degree=degree: lights.area_shade(
            light, surface, *given, l_max=degree
        )
    for nodes in (6, 12, 64):
        work[f"quadrature, {nodes}"] = lambda nodes=nodes: lights.area_reflection(
            light, surface, *given, nodes=nodes
        )
    for degree in (2, 4, 8, 16):
        work[f"coefficients, F = {degree}"] = lambda degree=degree: lights.area_coefs(
            light, given[0], l_max=degree
        )
    for function in work.values():
        jax.block_until_ready(function())
    medians = interleaved_medians(work, rounds)
    return {name: 1e6 * seconds / count for name, seconds in medians.items()}


def _mean(errors, kind: str, alpha: str) -> dict[str, float]:
    """Root mean square over the cells of one kind of light and one roughness."""
    rows: dict[str, list[float]] = {}
    for cell, row in errors.items():
        if cell.split(", ")[0::2] == [kind, alpha]:
            for name, value in row.items():
                rows.setdefault(name, []).append(value)
    return {name: float(np.sqrt(np.mean(np.square(v)))) for name, v in rows.items()}


def _lost(errors, alphas: list[str]) -> str:
    """Where harmonics are the worse ones, said first."""
    told = []
    for degree in (16, 24):
        name, counts = f"harmonics, F = {degree}", []
        for alpha in alphas:
            rows = [row for cell, row in errors.items() if cell.split(", ")[2] == alpha]
            worse = sum(row["LTC"] < row[name] for row in rows)
            counts.append(f"{worse} of {len(rows)} at alpha {alpha}")
        told.append(f"Degree {degree}: {', '.join(counts)}.")
    worse = [cell for cell, row in errors.items() if row["LTC"] < row["quadrature, 12"]]
    where = f", in {'; '.join(worse)}" if worse else ""
    return (
        "Where linearly transformed cosines are closer than harmonics, among cells of "
        f"light, distance, roughness and f0. {' '.join(told)} They are the fastest "
        f"everywhere. They are closer than quadrature of 12 nodes about the lobe in "
        f"{len(worse)} of {len(errors)} cells{where}; that needs less time than harmonics "
        "of degree 16."
    )


def markdown(result: dict) -> str:
    """Tables: where harmonics lose first, then every roughness, then time."""
    errors = result["errors"]
    alphas = list(dict.fromkeys(cell.split(", ")[2] for cell in errors))
    parts = [f"# Area lights\n\n{__doc__ or ''}"]
    parts.append(_lost(errors, alphas))
    for kind in KINDS:
        by_alpha = {alpha: _mean(errors, kind, alpha) for alpha in alphas}
        names = list(by_alpha[alphas[0]])
        rows = [[n, *(f"{by_alpha[a][n]:.2%}" for a in alphas)] for n in names]
        head = [f"{kind}: rms error", *(f"alpha {a}" for a in alphas)]
        parts.append(markdown_table(head, rows))
    times = [[n, f"{t:.2f}"] for n, t in result["microseconds"].items()]
    parts.append(markdown_table(["a square, float32", "us per point"], times))
    return "\n\n".join(parts)


def plot(result: dict, path: Path) -> None:
    """Error over time at three roughnesses, of the square."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 3, figsize=(12, 4), sharey=True)
    for axis, alpha in zip(axes, ("0.1", "0.2", "0.4"), strict=True):
        own = _mean(result["errors"], "square", alpha)
        for family, mark in (("harmonics", "o-"), ("quadrature", "s-"), ("LTC", "D")):
            names = [n for n in own if n.startswith(family)]
            x = [result["microseconds"][n] for n in names]
            axis.loglog(x, [own[n] for n in names], mark, label=family)
        axis.set(title=f"GGX alpha {alpha}", xlabel="microseconds per point")
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("rms error, relative")
    axes[0].legend()
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


@click.command()
@click.option("--out", required=True, type=click.Path(path_type=Path))
def main(out: Path) -> None:
    """Write area_lights.md, .json and .png."""
    jax.config.update("jax_enable_x64", True)
    out.mkdir(parents=True, exist_ok=True)
    result = run()
    write_result(out, "area_lights", markdown(result), result)
    plot(result, out / "area_lights.png")


if __name__ == "__main__":
    main()
