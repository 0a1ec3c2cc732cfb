"""Speed against error: every way to irradiance and to glossy reflection in one run.

    python experiments/speed_vs_error.py --out experiments/results/speed_vs_error
    python experiments/speed_vs_error.py --quick --out out

Panoramas averaged to 256 x 128, 2048 seeded orientations and views, RGB float32, one
thread. Times are medians, warm, compilation apart; building (once a light) and evaluating
(2048 points) apart. What a material needs once, whatever the light, is not timed.
Errors are relative to one converged reference, the sum over every pixel, whose own error
is that of halving the grid. The folder receives report.html, report.md, results.json and
plots. An interrupted run goes on where it stopped; references are kept in its cache.
"""

from __future__ import annotations

import dataclasses
import json
import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from experiments.speed import methods

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))


def one_thread() -> None:
    """Keep this process, and XLA in it, on one core; before JAX is loaded."""
    flags = os.environ.get("XLA_FLAGS", "")
    os.environ["XLA_FLAGS"] = f"{flags} --xla_cpu_multi_thread_eigen=false".strip()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


def run(
    out: Path,
    *,
    panoramas: tuple[str, ...],
    materials: tuple[str, ...] | None = None,
    rows: int = 128,
    pairs: int = 2048,
    rounds: int = 3,
    steps: methods.Steps | None = None,
    memory: bool = True,
    full_size: bool = True,
    progress=lambda text: None,
) -> dict:
    """Measure what is missing in ``out/results.json``; returns all of it.

    Args:
        out: The report's folder.
        panoramas: Names.
        materials: Names; None for all.
        rows: Of the panoramas.
        pairs: Orientations and views.
        rounds: Timed runs of each method.
        steps: Of each family of methods; None for all.
        full_size: Whether to measure under the whole panorama, too.
        memory: Whether to start a process a method for its memory.
        progress: Called with a line of text.

    Raises:
        click.UsageError: If ``out`` holds results of other settings or versions.
    """
    from experiments.speed import matte, measure, methods, scenes
    from experiments.versions import versions
    from shjax import io

    file, cache = out / "results.json", out / "cache"
    steps = steps or methods.ALL
    about = {
        "rows": rows, "pairs": pairs, "rounds": rounds, "seed": scenes.SEED,
        "steps": dataclasses.asdict(steps), "versions": versions(),
    }  # fmt: skip
    result = {"about": about, "irradiance": {}, "glossy": {}, "memory": {}}
    if file.exists():
        result = json.loads(file.read_text())
        if _settings(result["about"]) != _settings(json.loads(json.dumps(about))):
            raise click.UsageError(
                f"out must be a new folder or hold results of the same settings and "
                f"versions; {file} has others."
            )
    measuring = measure.Measure(rounds)

    def keep() -> None:
        io.write_text(file, json.dumps(result, separators=(",", ":")) + "\n")

    def all_of(known, where, exact, own, weights, material="") -> dict:
        rows_ = {}
        for method in known:
            found = measuring(method, where, exact, weights=weights, material=material)
            rows_[method.name] = {**found, "family": method.family, "ours": method.ours}
        return {"reference's own error": own, "methods": rows_}

    chosen = [m for m in scenes.materials() if materials is None or m.name in materials]
    places = {name: scenes.scene(name, rows=rows, pairs=pairs) for name in panoramas}
    for panorama, where in places.items():
        if panorama not in result["irradiance"]:
            start = time.perf_counter()
            exact, own = scenes.irradiance_reference(where, cache)
            known = matte.irradiance_methods(where)
            ones = where.samples.weights * 0 + 1
            result["irradiance"][panorama] = all_of(known, where, exact, own, ones)
            keep()
            progress(f"{panorama}, irradiance: {time.perf_counter() - start:.0f} s")
    for material in chosen:
        missing = [
            panorama
            for panorama in panoramas
            if material.name not in result["glossy"].setdefault(panorama, {})
        ]
        if not missing:
            continue
        prepared = methods.Prepared(material, cache, steps)
        for panorama in missing:
            where = places[panorama]
            start = time.perf_counter()
            exact, own = scenes.glossy_reference(where, material, cache)
            known = methods.glossy_methods(where, prepared)
            weights = where.samples.weights
            result["glossy"][panorama][material.name] = all_of(
                known, where, exact, own, weights, material.name
            )
            keep()
            seconds = time.perf_counter() - start
            progress(f"{panorama}, {material.name}: {seconds:.0f} s")
        measuring.forget(material.name)
    if full_size and "full size" not in result:
        result["full size"] = _full_size(cache, pairs)
        keep()
        progress("the whole panorama")
    if memory:
        _memory(result, panoramas[0], chosen, cache, keep, progress)
    return result


def _settings(about: dict) -> dict:
    """What two parts of a run must have in common: all but the day."""
    return {**about, "versions": {**about["versions"], "date": None}}


def _full_size(cache: Path, pairs: int) -> dict:
    """Errors of some methods under the shipped panorama as it is and averaged."""
    from experiments.speed import measure, methods, scenes

    material = next(m for m in scenes.materials() if m.name == "GGX 0.2 f0 0.04")
    prepared = methods.Prepared(material, cache)
    some = ("radial map F=64", "layer 9 maps, 4 lights", "split-sum, table")
    some = (*some, "filtered importance sampling, 256")
    found: dict[str, dict[str, float]] = {name: {} for name in some}
    sizes = {"small": 128, "full": 512}
    for size, rows in sizes.items():
        where = scenes.scene("city", rows=rows, pairs=min(pairs, 256))
        exact, _ = scenes.glossy_reference(where, material, cache)
        for method in methods.glossy_methods(where, prepared):
            if method.name in found:
                row = measure.Measure(1)(
                    method, where, exact, weights=where.samples.weights
                )
                found[method.name][size] = row["rms"]
    return {
        "panorama": "city", "columns": 2 * sizes["full"], "rows": sizes["full"],
        "material": material.name, "pairs": min(pairs, 256), "methods": found,
    }  # fmt: skip


def _memory(result, panorama: str, materials, cache: Path, keep, progress) -> None:
    """A process for each method, under one light and with one material."""
    from experiments.speed import measure

    shown = next((m.name for m in materials if m.name.startswith("GGX")), None)
    groups = [("", result["irradiance"][panorama]["methods"])]
    if shown is not None:
        groups.append((shown, result["glossy"][panorama][shown]["methods"]))
    for material, known in groups:
        for name in known:
            if name not in result["memory"]:
                found = measure.child_memory(panorama, material, name, cache)
                result["memory"][name] = found
                keep()
                progress(f"memory of {name}: {(found or 0) / 1e6:.0f} MB")


@click.command()
@click.option("--out", required=True, type=click.Path(path_type=Path))
@click.option(
    "--quick", is_flag=True, help="One panorama, four materials, some of the methods."
)
@click.option("--plots/--no-plots", default=True)
def main(out: Path, quick: bool, plots: bool) -> None:
    """Measure, and write the report."""
    one_thread()
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    from experiments.data import data_folder
    from experiments.speed import methods, report, scenes

    out.mkdir(parents=True, exist_ok=True)
    full = not quick
    panoramas = scenes.FULL_PANORAMAS if full else scenes.FULL_PANORAMAS[:1]
    if full and not (data_folder() / "hdri").is_dir():
        raise click.UsageError(
            f"the panoramas are not in {data_folder()}; use --quick."
        )
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns) as bar:
        task = bar.add_task("measuring")

        def progress(text: str) -> None:
            bar.console.print(text, markup=False, highlight=False)
            bar.update(task, description=text)

        options = {} if full else {
            "materials": scenes.QUICK_MATERIALS, "pairs": 512, "rounds": 1,
            "steps": methods.FEW, "memory": False, "full_size": False,
        }  # fmt: skip
        result = run(out, panoramas=panoramas, progress=progress, **options)
        bar.update(task, description="writing the report")
        report.write(out, result, plots=plots)
    print(f"{out / 'report.html'}")


if __name__ == "__main__":
    main()
