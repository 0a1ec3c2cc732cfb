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

import concurrent.futures
import dataclasses
import functools
import json
import multiprocessing
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from experiments.speed import methods

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))


# Before this process is bound to one of them.
_CORES = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []


def one_thread(core: int | None = None) -> None:
    """Keep this process, and XLA in it, on one core; before JAX is loaded."""
    flags = os.environ.get("XLA_FLAGS", "")
    os.environ["XLA_FLAGS"] = f"{flags} --xla_cpu_multi_thread_eigen=false".strip()
    if _CORES:
        os.sched_setaffinity(0, {_CORES[0] if core is None else core})


def run(
    out: Path,
    *,
    panoramas: tuple[str, ...],
    materials: tuple[str, ...] | None = None,
    rows: int = 128,
    pairs: int = 2048,
    rounds: int = 3,
    steps: methods.Steps | None = None,
    jobs: int = 1,
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
        jobs: Processes, each on a core of its own with its own materials.
        full_size: Whether to measure under the whole panorama, too.
        memory: Whether to start a process a method for its memory.
        progress: Called with a line of text.

    Raises:
        click.UsageError: If ``out`` holds results of other settings or versions.
    """
    from experiments.speed import methods, scenes
    from experiments.versions import versions
    from shjax import io

    file, cache = out / "results.json", out / "cache"
    steps = steps or methods.ALL
    about = {
        "rows": rows,
        "pairs": pairs,
        "rounds": rounds,
        "seed": scenes.SEED,
        "jobs": jobs,
        "steps": dataclasses.asdict(steps),
        "versions": versions(),
    }
    result = {"about": about, "irradiance": {}, "glossy": {}, "memory": {}}
    if file.exists():
        result = json.loads(file.read_text())
        if _settings(result["about"]) != _settings(json.loads(json.dumps(about))):
            raise click.UsageError(
                f"out must be a new folder or hold results of the same settings and "
                f"versions; {file} has others."
            )
    for panorama in panoramas:
        result["glossy"].setdefault(panorama, {})

    def keep() -> None:
        io.write_text(file, json.dumps(result, separators=(",", ":")) + "\n")

    how = {"rows": rows, "pairs": pairs, "rounds": rounds, "cache": cache}
    for panorama in panoramas:
        if panorama not in result["irradiance"]:
            result["irradiance"][panorama] = _irradiance(panorama, **how)
            keep()
            progress(f"{panorama}, irradiance")
    chosen = [m for m in scenes.materials() if materials is None or m.name in materials]
    tasks = {
        m.name: [p for p in panoramas if m.name not in result["glossy"][p]]
        for m in chosen
    }
    tasks = {name: missing for name, missing in tasks.items() if missing}
    for name, found in _each(tasks, jobs, {**how, "steps": steps}):
        for panorama, entry in found.items():
            result["glossy"][panorama][name] = entry
        keep()
        progress(f"{name}: {', '.join(found)}")
    if full_size and "full size" not in result:
        result["full size"] = _full_size(cache, pairs)
        keep()
        progress("the whole panorama")
    if memory:
        _memory(result, panoramas[0], chosen, cache, keep, progress)
    return result


def _each(
    tasks: dict[str, list[str]], jobs: int, how: dict
) -> Iterator[tuple[str, dict]]:
    """What was measured of each material, as it comes."""
    if jobs == 1 or len(tasks) < 2:
        for name, missing in tasks.items():
            yield name, _glossy(name, missing, **how)
        return
    context = multiprocessing.get_context("spawn")
    cores = context.SimpleQueue()
    for job in range(jobs):
        cores.put(_CORES[job % len(_CORES)] if _CORES else None)
    pool = concurrent.futures.ProcessPoolExecutor(
        jobs, context, initializer=_on_a_core, initargs=(cores,)
    )
    with pool:
        waiting = {pool.submit(_glossy, n, some, **how): n for n, some in tasks.items()}
        for done in concurrent.futures.as_completed(waiting):
            yield waiting[done], done.result()


def _on_a_core(cores) -> None:
    one_thread(cores.get())


@functools.cache
def _measuring(rounds: int):
    """Of this process: what is compiled for one material serves the next."""
    from experiments.speed import measure

    return measure.Measure(rounds)


def _all_of(known, where, exact, own, weights, rounds: int, material="") -> dict:
    found = {}
    for method in known:
        row = _measuring(rounds)(
            method, where, exact, weights=weights, material=material
        )
        found[method.name] = {**row, "family": method.family, "ours": method.ours}
    return {"reference's own error": own, "methods": found}


def _irradiance(
    panorama: str, *, rows: int, pairs: int, rounds: int, cache: Path
) -> dict:
    """Every method of irradiance under a panorama."""
    from experiments.speed import matte, scenes

    where = scenes.scene(panorama, rows=rows, pairs=pairs)
    exact, own = scenes.irradiance_reference(where, cache)
    ones = where.samples.weights * 0 + 1
    return _all_of(matte.irradiance_methods(where), where, exact, own, ones, rounds)


def _glossy(
    name: str,
    panoramas: list[str],
    *,
    rows: int,
    pairs: int,
    rounds: int,
    cache: Path,
    steps: methods.Steps,
) -> dict[str, dict]:
    """Every method of a material, under each panorama."""
    from experiments.speed import methods, scenes

    material = next(m for m in scenes.materials() if m.name == name)
    prepared = methods.Prepared(material, cache, steps)
    found = {}
    for panorama in panoramas:
        where = scenes.scene(panorama, rows=rows, pairs=pairs)
        exact, own = scenes.glossy_reference(where, material, cache)
        known = methods.glossy_methods(where, prepared)
        weights = where.samples.weights
        found[panorama] = _all_of(known, where, exact, own, weights, rounds, name)
    _measuring(rounds).forget(name)
    return found


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
        "panorama": "city",
        "columns": 2 * sizes["full"],
        "rows": sizes["full"],
        "material": material.name,
        "pairs": min(pairs, 256),
        "methods": found,
    }


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
@click.option(
    "--jobs",
    default=2,
    show_default=True,
    type=click.IntRange(1),
    help="Processes, each on a core of its own with its own materials.",
)
@click.option("--plots/--no-plots", default=True)
def main(out: Path, quick: bool, jobs: int, plots: bool) -> None:
    """Measure, and write the report."""
    jobs = min(jobs, len(_CORES) or os.cpu_count() or 1)
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

        options = (
            {}
            if full
            else {
                "materials": scenes.QUICK_MATERIALS,
                "pairs": 512,
                "rounds": 1,
                "steps": methods.FEW,
                "memory": False,
                "full_size": False,
            }
        )
        options["jobs"] = jobs
        result = run(out, panoramas=panoramas, progress=progress, **options)
        bar.update(task, description="writing the report")
        report.write(out, result, plots=plots)
    print(f"{out / 'report.html'}")


if __name__ == "__main__":
    main()
