"""Transforms and evaluation beside their peers, in one run, on 1 and on 2 threads.

    pip install -r experiments/benchmarks/requirements.txt
    python experiments/benchmarks/transforms.py --out experiments/results

RGB float32 unless a peer knows nothing else. Every row is a ratio of medians of
interleaved runs within one process; a peer that is not installed leaves its rows out.
SHTns works in float64 on its own Gauss grid of the same size, s2fft on its own sampling.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import click
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from experiments.versions import versions, versions_line
from experiments.writing import markdown_table, write_result

SUN = 1e5


class Rows:
    """Collects (work, quantity, what to reach, what was measured)."""

    def __init__(self, rounds: int) -> None:
        """Take ``rounds`` rounds for every median."""
        self.rounds = rounds
        self.rows: list[tuple[str, str, str, float]] = []

    def add(self, work: str, quantity: str, reach: str, value: float) -> None:
        """One row."""
        self.rows.append((work, quantity, reach, value))
        print(f"  {work}: {quantity} {value:.3g} (reach {reach})", file=sys.stderr)

    def times(self, candidates: dict[str, Callable[[], object]]) -> dict[str, float]:
        """Median seconds of each."""
        from experiments.timing import interleaved_medians

        return interleaved_medians(candidates, self.rounds)


def _peer(name: str):
    try:
        return __import__(name)
    except ImportError:
        print(f"  {name} is not installed: its rows are left out", file=sys.stderr)
        return None


def measure(threads: int, rounds: int) -> list[tuple[str, str, str, float]]:
    """All rows in this process, which must be pinned already."""
    import jax.numpy as jnp

    rows = Rows(rounds)
    rng = np.random.default_rng(0)

    def panorama(n_theta: int, *batch: int):
        shape = (*batch, n_theta, 2 * n_theta, 3)
        return jnp.asarray(rng.random(shape, np.float32))

    _nine(rows, panorama, threads)
    _analysis(rows, panorama, threads)
    _full_band(rows, rng)
    _batches(rows, panorama)
    _gradient(rows, panorama)
    _points(rows, rng)
    if threads == 1:
        _compile_times(rows, panorama)
        _errors(rows)
    return rows.rows


def _ducc(image, l_max: int, threads: int) -> Callable[[], object]:
    import ducc0

    planes = np.ascontiguousarray(np.moveaxis(np.asarray(image), -1, 0))

    def run() -> None:
        for plane in planes:
            ducc0.sht.experimental.analysis_2d(
                map=plane[None], spin=0, lmax=l_max, geometry="F1", nthreads=threads
            )

    return run


def _nine(rows: Rows, panorama, threads: int) -> None:
    import jax
    import jax.numpy as jnp

    import shjax

    total = jax.jit(jnp.sum)
    for n_theta, limits in ((1024, ("1.5", "10", "12")), (512, ("1.2", "9", "12"))):
        image = panorama(n_theta)
        work = f"nine coefficients of {2 * n_theta} x {n_theta}"
        candidates = {
            "sum": lambda image=image: total(image),
            "shjax": lambda image=image: shjax.analyze(image, l_max=2),
        }
        if _peer("ducc0"):
            candidates["ducc0"] = _ducc(image, 2, threads)
        if shtns := _peer("shtns"):
            sht = shtns.sht(2, 2)
            sht.set_grid(n_theta, 2 * n_theta)
            planes = np.moveaxis(np.asarray(image, np.float64), -1, 0).copy()
            candidates["SHTns"] = lambda sht=sht, p=planes: [sht.analys(x) for x in p]
        times = rows.times(candidates)
        rows.add(work, "over jnp.sum", f"<= {limits[0]}", times["shjax"] / times["sum"])
        for peer, reach in (("ducc0", limits[1]), ("SHTns", limits[2])):
            if peer in times:
                ratio = times[peer] / times["shjax"]
                rows.add(work, f"{peer} over shjax", f">= {reach}", ratio)


def _analysis(rows: Rows, panorama, threads: int) -> None:
    import jax.numpy as jnp

    import shjax

    if not (ducc0 := _peer("ducc0")):
        return
    small = "0.30" if threads == 1 else "0.40"
    for l_max, n_theta, reach in (
        (30, 512, small),
        (30, 1024, small),
        (64, 512, "0.5"),
        (128, 512, "0.8"),
    ):
        image = panorama(n_theta)
        candidates = {
            "shjax": lambda i=image, f=l_max: shjax.analyze(i, l_max=f),
            "ducc0": _ducc(image, l_max, threads),
        }
        if _peer("torch_harmonics") and n_theta == 512:
            candidates["torch-harmonics"] = _torch_harmonics(image, l_max, threads)
        times = rows.times(candidates)
        work = f"F = {l_max} analysis of {2 * n_theta} x {n_theta}"
        rows.add(work, "over ducc0", f"<= {reach}", times["shjax"] / times["ducc0"])
        if "torch-harmonics" in times:
            ratio = times["torch-harmonics"] / times["shjax"]
            rows.add(work, "torch-harmonics over shjax", "-", ratio)
    for n_theta in (512, 1024):
        coefs = jnp.asarray(np.random.default_rng(1).random((961, 3), np.float32))
        alm = np.ones((1, 31 * 32 // 2), np.complex64)
        size = {"n_theta": n_theta, "n_phi": 2 * n_theta}

        def synthesize(alm=alm, n_theta=n_theta, ducc0=ducc0) -> None:
            for _ in range(3):
                ducc0.sht.experimental.synthesis_2d(
                    alm=alm,
                    spin=0,
                    lmax=30,
                    geometry="F1",
                    ntheta=n_theta,
                    nphi=2 * n_theta,
                    nthreads=threads,
                )

        times = rows.times(
            {
                "shjax": lambda c=coefs, s=size: shjax.synthesize(c, **s),
                "ducc0": synthesize,
            }
        )
        work = f"F = 30 synthesis of {2 * n_theta} x {n_theta}"
        rows.add(work, "over ducc0", "<= 0.33", times["shjax"] / times["ducc0"])


def _torch_harmonics(image, l_max: int, threads: int) -> Callable[[], object]:
    import torch
    import torch_harmonics

    torch.set_num_threads(threads)
    planes = torch.tensor(np.moveaxis(np.asarray(image), -1, 0).copy())
    sht = torch_harmonics.RealSHT(
        planes.shape[1], planes.shape[2], lmax=l_max + 1, mmax=l_max + 1
    )

    def run() -> None:
        with torch.no_grad():
            sht(planes)

    return run


def _full_band(rows: Rows, rng) -> None:
    import jax.numpy as jnp

    import shjax

    if not _peer("s2fft"):
        return
    from s2fft.precompute_transforms.construct import spin_spherical_kernel_jax
    from s2fft.precompute_transforms.spherical import forward_transform_jax

    for band, l_max, reach in (
        (32, 31, "10"),
        (64, 63, "10"),
        (128, 127, "15"),
        (128, 30, "100"),
        (256, 30, "300"),
    ):
        theirs = jnp.asarray(rng.random((2 * band, 2 * band - 1), np.float32))
        theirs = theirs[:band]  # the "mw" sampling: L rings of 2 L - 1
        ours = jnp.asarray(rng.random((2 * band - 1, 2 * band - 1, 1), np.float32))
        kernel = spin_spherical_kernel_jax(L=band, reality=True, forward=True)
        kernel = jnp.asarray(kernel, jnp.float32)

        def transform(theirs=theirs, kernel=kernel, band=band):
            return forward_transform_jax(
                theirs,
                kernel=kernel,
                L=band,
                sampling="mw",
                reality=True,
                spin=0,
                nside=None,
            )

        candidates = {
            "shjax": lambda o=ours, f=l_max: shjax.analyze(o, l_max=f),
            "s2fft": transform,
        }
        times = rows.times(candidates)
        ratio = times["s2fft"] / times["shjax"]
        work = f"F = {l_max}, grey map of band limit {band}"
        rows.add(work, "s2fft (precomputed) over shjax", f">= {reach}", ratio)


def _batches(rows: Rows, panorama) -> None:
    import jax
    import jax.numpy as jnp

    import shjax

    maps = panorama(128, 16)
    one = maps[0]
    total = jax.jit(jnp.sum)
    candidates = {
        "sum": lambda: total(maps),
        "one": lambda: shjax.analyze(one, l_max=2),
        "F = 2": lambda: shjax.analyze(maps, l_max=2),
        "F = 12": lambda: shjax.analyze(maps, l_max=12),
    }
    if _peer("ducc0"):
        loops = [_ducc(image, 12, 1) for image in maps]
        candidates["ducc0"] = lambda: [loop() for loop in loops]
    times = rows.times(candidates)
    work = "16 maps of 256 x 128"
    rows.add(f"{work}, F = 2", "over jnp.sum", "<= 1.5", times["F = 2"] / times["sum"])
    rows.add(f"{work}, F = 2", "over one map", "<= 16", times["F = 2"] / times["one"])
    if "ducc0" in times:
        ratio = times["ducc0"] / times["F = 12"]
        rows.add(f"{work}, F = 12", "ducc0 loop over shjax", ">= 4.5", ratio)


def _gradient(rows: Rows, panorama) -> None:
    import jax
    import jax.numpy as jnp

    import shjax

    image = panorama(512)
    for l_max in (2, 30):
        weights = jnp.ones(((l_max + 1) ** 2, 3), jnp.float32)

        def loss(x, weights=weights, l_max=l_max):
            return jnp.sum(weights * shjax.analyze(x, l_max=l_max) ** 2)

        gradient = jax.jit(jax.grad(loss))
        times = rows.times(
            {
                "forward": lambda f=l_max: shjax.analyze(image, l_max=f),
                "gradient": lambda g=gradient: g(image),
            }
        )
        ratio = times["gradient"] / times["forward"]
        work = f"gradient in the map, F = {l_max}, 1024 x 512"
        rows.add(work, "over forward", "<= 1.8", ratio)


def _points(rows: Rows, rng) -> None:
    import jax
    import jax.numpy as jnp

    import shjax

    normals = rng.normal(size=(1_000_000, 3)).astype(np.float32)
    normals = jnp.asarray(normals / np.linalg.norm(normals, axis=-1, keepdims=True))
    lighting = jnp.asarray(rng.normal(size=(9, 3)).astype(np.float32))
    matrix = shjax.irradiance_matrix(lighting)

    @jax.jit
    def quadratic(m, n):
        n = jnp.concatenate([n, jnp.ones_like(n[:, :1])], axis=-1)
        return jnp.einsum("pi,ijc,pj->pc", n, m, n)

    @jax.jit
    def product(light, n):
        return shjax.basis(n, l_max=2) @ light

    times = rows.times(
        {
            "shjax": lambda: shjax.irradiance(lighting, normals),
            "einsum": lambda: quadratic(matrix, normals),
            "basis": lambda: product(lighting, normals),
        }
    )
    work = "nine coefficients at 1e6 normals"
    rows.add(work, "einsum n M n over shjax", ">= 6", times["einsum"] / times["shjax"])
    rows.add(
        work, "basis, product over shjax", ">= 10", times["basis"] / times["shjax"]
    )

    points, coefs = normals[:100_000], jnp.asarray(rng.normal(size=81), jnp.float32)

    def gradient(function):
        return jax.jit(jax.grad(lambda p: jnp.sum(function(p))))

    ours = gradient(lambda p: shjax.evaluate(coefs[:, None], p))
    candidates = {"shjax": lambda: ours(points)}
    if _peer("sphericart"):
        import sphericart.jax

        theirs = gradient(lambda p: sphericart.jax.spherical_harmonics(p, 8) @ coefs)
        candidates["sphericart"] = lambda: theirs(points)
    times = rows.times(candidates)
    if "sphericart" in times:
        ratio = times["sphericart"] / times["shjax"]
        work = "gradient in 1e5 directions, l_max 8, grey"
        rows.add(work, "sphericart over shjax", ">= 10", ratio)
    values = jax.jit(lambda p: shjax.basis(p, l_max=8))
    scipy = jax.jit(_scipy_basis)
    few = points[:2000]
    times = rows.times({"shjax": lambda: values(few), "scipy": lambda: scipy(few)})
    ratio = times["scipy"] / times["shjax"]
    rows.add("basis at 2000 directions, l_max 8", "jax.scipy over shjax", "-", ratio)


def _scipy_basis(points):
    import jax.numpy as jnp
    from jax.scipy.special import sph_harm_y

    l = np.repeat(np.arange(9), np.arange(9) + 1)
    m = np.concatenate([np.arange(k + 1) for k in range(9)])
    theta, phi = jnp.arccos(points[:, 2]), jnp.arctan2(points[:, 1], points[:, 0])
    n = points.shape[0]
    return sph_harm_y(
        jnp.repeat(jnp.asarray(l), n),
        jnp.repeat(jnp.asarray(m), n),
        jnp.tile(theta, l.size),
        jnp.tile(phi, l.size),
        n_max=8,
    )


def _compile_times(rows: Rows, panorama) -> None:
    import jax
    import jax.numpy as jnp

    import shjax
    from experiments.timing import first_call

    for l_max, n_theta in ((2, 512), (30, 512), (30, 1024), (128, 512)):
        image = panorama(n_theta)
        work = f"first call, F = {l_max}, {2 * n_theta} x {n_theta}"
        shjax.analyze(image, l_max=l_max)  # the tables
        forward = first_call(lambda i=image, f=l_max: shjax.analyze(i, l_max=f))
        rows.add(work, "forward, s", "<= 0.35", forward)

        def loss(x, l_max=l_max):
            return jnp.sum(shjax.analyze(x, l_max=l_max) ** 2)

        differentiated = jax.grad(loss)
        gradient = first_call(lambda i=image, g=differentiated: g(i))
        rows.add(work, "gradient, s", "<= 0.9", gradient)


def _errors(rows: Rows) -> None:
    """Float32 coefficients against the same sums in float64."""
    import shjax
    from shjax.harmonics import tables
    from shjax.harmonics.grid import make_grid

    rng = np.random.default_rng(2)
    noise = rng.random((512, 1024, 1)).astype(np.float32)
    sun = noise.copy()
    sun[100, 300] = SUN
    maps = {"noise": noise, "sun": sun, "constant": np.ones_like(noise)}
    grid, l_max = make_grid(512, 1024), 30
    rings = tables.ring_weights(grid, l_max)
    for name, image in maps.items():
        even_odd = np.split(np.einsum("kh,hwc->kwc", rings, image.astype(float)), [31])
        parts = []
        for part, azimuth, degree in zip(
            even_odd,
            tables.azimuth_weights(grid, l_max),
            tables.degree_tables(l_max),
            strict=True,
        ):
            waves = np.einsum("kwc,wms->mksc", part, azimuth)
            parts.append(np.einsum("mlk,mksc->mlsc", degree, waves))
        exact = np.concatenate(parts).reshape(-1, 1)[tables.flat_positions(l_max)]
        ours = np.asarray(shjax.analyze(image, l_max=l_max), float)
        error = np.linalg.norm(ours - exact) / np.linalg.norm(exact)
        reach = "<= 5e-7" if name == "noise" else "<= 3e-6"
        rows.add(f"float32 error, F = 30, {name}", "relative", reach, error)


def markdown(results: dict) -> str:
    """The table of all rows, one column a number of threads."""
    two = {(w, q): (r, v) for w, q, r, v in results["threads"].get("2", [])}
    rows = []
    for work, quantity, reach, value in results["threads"]["1"]:
        other = two.get((work, quantity))
        cell = f"{other[1]:.3g}" if other else ""
        if other and other[0] != reach:
            cell += f" (reach {other[0]})"
        rows.append([work, quantity, reach, f"{value:.3g}", cell])
    head = ["work", "ratio", "reach", "1 thread", "2 threads"]
    return "\n\n".join(
        [
            "# Transforms beside their peers",
            versions_line(results["versions"]),
            markdown_table(head, rows),
        ]
    )


@click.command()
@click.option("--threads", type=int, help="Measure in this process, on so many cores.")
@click.option("--rounds", default=15, show_default=True)
@click.option("--out", type=click.Path(path_type=Path), help="Folder for the results.")
def main(threads: int | None, rounds: int, out: Path | None) -> None:
    """Print the table; with --out also write transforms.md and transforms.json."""
    if threads is not None:
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[-threads:])
        os.environ["OMP_NUM_THREADS"] = str(threads)
        print(json.dumps(measure(threads, rounds)))
        return
    results: dict = {"versions": versions(), "threads": {}}
    for count in (1, 2):
        print(f"{count} thread(s)", file=sys.stderr)
        command = [sys.executable, __file__, f"--threads={count}", f"--rounds={rounds}"]
        run = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
        results["threads"][str(count)] = json.loads(run.stdout.splitlines()[-1])
    write_result(out, "transforms", markdown(results), results)


if __name__ == "__main__":
    main()
