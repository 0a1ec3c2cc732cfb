"""shjax on whatever device JAX finds: times, float32 errors, memory, compile times.

    python experiments/benchmarks/accelerator.py --out experiments/results

Needs JAX, NumPy and this repository; estimates also optimistix, torch-harmonics torch: what
is not there is left out and said. Inputs are made here. Errors are of float32 results on
the device against float64 on the host, over the norm: a device that rounds factors to TF32
would show 1e-3. The share of the bandwidth is that of a copy of 256 MB.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import importlib.util
import json
import math
import os
import subprocess
import sys
import tempfile
import time
import types
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

if importlib.util.find_spec("jaxtyping") is None:

    class _Shapes(types.ModuleType):
        """Stands in for jaxtyping, whose shapes are text that nothing evaluates here."""

        def __getattr__(self, name: str) -> Any:
            return object

    sys.modules["jaxtyping"] = _Shapes("jaxtyping")

import shjax
from experiments.alternatives import split_sum
from shjax import brdf, ibl

ROUNDS = 9
DEGREES = (2, 12, 30, 64, 128)


@dataclasses.dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes:
        work: What was done.
        milliseconds: Median of warm calls.
        first: Seconds of the first call less a warm one: tracing and compiling.
        error: Of float32 against float64 on the host, relative; None where not compared.
        note: Ratios, shares.
    """

    work: str
    milliseconds: float
    first: float
    error: float | None = None
    note: str = ""


@dataclasses.dataclass(frozen=True)
class Work:
    """A piece of work: a function of arrays, and what is to be said of its time."""

    name: str
    function: Callable[..., Any]
    arguments: tuple
    compared: bool = True
    note: Callable[[float], str] = lambda seconds: ""


def timed(function: Callable[..., Any], *arguments) -> tuple[float, float, Any]:
    """Median seconds of warm calls, seconds of the first beyond one, and the result."""
    start = time.perf_counter()
    found = jax.block_until_ready(function(*arguments))
    first = time.perf_counter() - start
    times = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        jax.block_until_ready(function(*arguments))
        times.append(time.perf_counter() - start)
    warm = float(np.median(times))
    return warm, max(first - warm, 0.0), found


def some_of(found: Any) -> np.ndarray:
    """Values of all floating-point leaves in a row, a million of each at most."""
    leaves = [np.asarray(leaf, float).ravel() for leaf in jax.tree.leaves(found)]
    return np.concatenate([leaf[:: -(-leaf.size // 10**6) or 1] for leaf in leaves])


def row(work: Work, exact: Mapping[str, np.ndarray]) -> Row:
    """Time a piece of work, and compare it with what the host found."""
    warm, first, found = timed(work.function, *work.arguments)
    error = None
    if work.name in exact:
        other = exact[work.name]
        error = float(np.linalg.norm(some_of(found) - other) / np.linalg.norm(other))
    return Row(work.name, 1e3 * warm, first, error, work.note(warm))


def on_host(pixels: int) -> dict[str, np.ndarray]:
    """Results in float64 on the CPU, by a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "exact.npz"
        settings = {"JAX_PLATFORMS": "cpu", "JAX_ENABLE_X64": "1"}
        call = [sys.executable, __file__, "--pixels", str(pixels), "--exact", str(file)]
        subprocess.run(call, env=os.environ | settings, check=True)
        with np.load(file) as stored:
            return dict(stored)


def write_exact(file: Path, pixels: int) -> None:
    """Do all works once, and write what they give."""
    found = {
        work.name: some_of(work.function(*work.arguments))
        for work in all_works(pixels, math.inf)
        if work.compared
    }
    np.savez(file, allow_pickle=False, **found)


def all_works(pixels: int, rate: float) -> Iterator[Work]:
    """Everything that is timed, one after the other."""
    yield from transforms(rate)
    yield from layer(pixels)
    yield from maps(pixels)
    yield from estimate()


def given(value: Any) -> Any:
    """Arrays on the device, in its widest type."""
    return jax.tree.map(lambda a: jnp.asarray(a, jnp.result_type(float)), value)


def panorama(n_theta: int, *batch: int) -> np.ndarray:
    """A sky with a sun of a thousand times its mean, ``(..., n_theta, 2 n_theta, 3)``."""
    rng = np.random.default_rng(0)
    image = rng.random((*batch, n_theta, 2 * n_theta, 3), np.float32) + 0.5
    image[..., n_theta // 4, n_theta // 2, :] += 1000
    return image


def bandwidth() -> float:
    """Bytes per second of a copy of 256 MB."""
    block = jnp.ones(2**26, jnp.float32)
    warm, _, _ = timed(jax.jit(lambda x: x + 1), block)
    return 2 * block.nbytes / warm


def transforms(rate: float) -> Iterator[Work]:
    """Analysis and synthesis of 1024 x 512, degree 2 to 128, and a batch."""
    image = panorama(512)
    there = given(image)

    def said(seconds: float, l_max: int) -> str:
        share = there.nbytes / seconds / rate
        return f"{share:.0%} of the bandwidth{_torch_harmonics(image, l_max, seconds)}"

    for l_max in DEGREES:
        analyze = functools.partial(shjax.analyze, l_max=l_max)
        note = functools.partial(said, l_max=l_max)
        yield Work(f"analysis, degree {l_max}", analyze, (there,), note=note)
        back = functools.partial(shjax.synthesize, n_theta=512, n_phi=1024)
        rng = np.random.default_rng(4)
        coefs = given(rng.normal(size=((l_max + 1) ** 2, 3)).astype(np.float32))
        yield Work(f"synthesis, degree {l_max}", back, (coefs,))
    nine = functools.partial(shjax.analyze, l_max=2)
    yield Work("16 maps of 256 x 128, degree 2", nine, (given(panorama(128, 16)),))
    slope = jax.jit(jax.grad(lambda x: jnp.sum(shjax.analyze(x, l_max=30) ** 2)))
    yield Work("gradient in the map, degree 30", slope, (there,))


def _torch_harmonics(image: np.ndarray, l_max: int, ours: float) -> str:
    """Our seconds over those of torch-harmonics on the same device, in words."""
    if importlib.util.find_spec("torch_harmonics") is None:
        return ""
    import torch
    import torch_harmonics

    place = "cuda" if torch.cuda.is_available() else "cpu"
    planes = torch.tensor(np.moveaxis(image, -1, 0).copy(), device=place)
    sht = torch_harmonics.RealSHT(
        *planes.shape[1:], lmax=l_max + 1, mmax=l_max + 1, grid="equiangular"
    ).to(place)

    def run() -> float:
        start = time.perf_counter()
        with torch.no_grad():
            sht(planes)
        if place == "cuda":
            torch.cuda.synchronize()
        return time.perf_counter() - start

    run()
    theirs = float(np.median([run() for _ in range(ROUNDS)]))
    return f"; {ours / theirs:.2f} of torch-harmonics"


def _points(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals, and views within 80 degrees of them."""
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    views = normals + 0.8 * rng.normal(size=(count, 3)) / np.sqrt(3)
    views /= np.linalg.norm(views, axis=-1, keepdims=True)
    return normals.astype(np.float32), views.astype(np.float32)


def layer(count: int) -> Iterator[Work]:
    """The lighting layer beside split-sum, and both gradients."""
    envmap = shjax.make_envmap(given(panorama(256)))
    normals, views = given(_points(count))
    rng = np.random.default_rng(2)
    material = given(
        {
            "albedo": rng.random((count, 3), np.float32),
            "roughness": rng.uniform(0.3, 0.9, count).astype(np.float32),
            "metallic": rng.random(count, np.float32),
        }
    )
    build = lambda: ibl.prefilter_light(envmap).texels  # noqa: E731
    yield Work("layer: build", build, ())
    light = ibl.prefilter_light(envmap)
    simple = split_sum.prefilter(envmap.lighting(l_max=128))
    base = []

    def peer(normals, views, material):
        return split_sum.shade(simple, normals, views, **material)

    def shade(light, normals, views, material):
        return ibl.shade(light, normals, views, **material)

    def over(seconds: float) -> str:
        base.append(seconds)
        theirs, _, _ = timed(peer, normals, views, material)
        return f"{seconds / theirs:.2f} of split-sum's shade"

    everything = (light, normals, views, material)
    yield Work(f"layer: shade, {count} pixels", shade, everything, note=over)

    def loss(texels, normals, views, material):
        with_them = dataclasses.replace(light, texels=texels)
        return jnp.mean(shade(with_them, normals, views, material) ** 2)

    for what, position in (("pixels' inputs", (1, 2, 3)), ("maps", 0)):
        slope = jax.jit(jax.grad(loss, argnums=position))
        given_to = (light.texels, normals, views, material)
        said = lambda seconds: f"{seconds / base[0]:.1f} times shade"  # noqa: E731
        yield Work(f"layer: gradient in the {what}", slope, given_to, note=said)


def maps(count: int) -> Iterator[Work]:
    """A spherical harmonic reflection map, and what choose_model picks."""
    envmap = shjax.make_envmap(given(panorama(128)))
    normals, views = given(_points(count))
    metal = given(brdf.ggx(0.4, f0=1.0))
    rho = shjax.brdf_coefs(metal, l_max=16, p_max=4)
    reflection = shjax.prefilter(envmap.lighting(l_max=16), rho)

    def read(reflector, normals, views):
        return reflector.radiance(normals, views)

    points = f"{count} points"
    yield Work(f"SHRM: read at {points}", read, (reflection, normals, views))
    start = time.perf_counter()
    model = shjax.choose_model(envmap, metal, rms_error=0.1)
    said = f"{model.label}; chosen in {time.perf_counter() - start:.1f} s"
    yield Work(
        f"choose_model's pick, {points}",
        read,
        (model, normals, views),
        compared=False,  # of float64 another may be chosen
        note=lambda _: said,
    )


def estimate() -> Iterator[Work]:
    """Light from a picture of 11 000 pixels under the default prior."""
    if importlib.util.find_spec("optimistix") is None:
        return
    normals, _ = _points(11_000)
    normals[:, 0] = -np.abs(normals[:, 0])
    lighting = np.asarray(shjax.make_envmap(panorama(64)).lighting(l_max=20))
    noise = 1e-2 * np.random.default_rng(3).normal(size=(11_000, 3))
    image = np.asarray(shjax.irradiance(lighting, normals)) / np.pi + noise
    image = image.astype(np.float32)

    def found(image, normals):
        return shjax.estimate_lighting(image, normals).value

    yield Work("estimate_lighting, 11 000 pixels", found, given((image, normals)))


def table(rows: list[Row]) -> str:
    """The rows in Markdown."""
    lines = [
        "| | ms, warm | first call, s more | error of float32 | |",
        "|---|---|---|---|---|",
    ]
    for one in rows:
        error = "" if one.error is None else f"{one.error:.1e}"
        cells = (
            one.work,
            f"{one.milliseconds:.3g}",
            f"{one.first:.2f}",
            error,
            one.note,
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    """Print the table; write accelerator_DEVICE.md and .json where a folder is named."""
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--out", type=Path)
    options.add_argument("--pixels", type=int, default=10**6)
    options.add_argument("--exact", type=Path, help=argparse.SUPPRESS)
    asked = options.parse_args()
    if asked.exact:
        write_exact(asked.exact, asked.pixels)
        return
    device = jax.devices()[0]
    start, rate = time.perf_counter(), bandwidth()
    exact = on_host(asked.pixels)
    rows = [row(work, exact) for work in all_works(asked.pixels, rate)]
    memory = (device.memory_stats() or {}).get("peak_bytes_in_use")
    peak = "not told" if memory is None else f"{memory / 2**20:.0f} MiB"
    about = (
        f"{device.device_kind} ({device.platform}), jax {jax.__version__}, shjax "
        f"{shjax.__version__}; a copy moves {rate / 1e9:.0f} GB/s; peak device memory "
        f"{peak}; {time.perf_counter() - start:.0f} s in all"
    )
    text = (
        f"# Accelerator: {device.device_kind}\n\n{__doc__}\n{about}.\n\n{table(rows)}\n"
    )
    print(text)
    if asked.out:
        asked.out.mkdir(parents=True, exist_ok=True)
        name = f"accelerator_{device.platform}"
        (asked.out / f"{name}.md").write_text(text)
        numbers = {"about": about, "rows": [dataclasses.asdict(one) for one in rows]}
        (asked.out / f"{name}.json").write_text(json.dumps(numbers, indent=1) + "\n")


if __name__ == "__main__":
    main()
