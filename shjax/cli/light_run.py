"""What ``shjax light`` does: first what was asked, then the checks."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from rich.console import Console

import shjax
from shjax import io
from shjax.cli import light_checks
from shjax.cli.coefficients import light_of
from shjax.cli.light import Settings
from shjax.cli.light_report import (
    Light,
    print_checks,
    print_coefficients,
    print_files,
    print_line,
    split_of,
    write_checks,
    write_light,
)
from shjax.cli.many import (
    BusyError,
    alone,
    expand,
    output_names,
    since,
    stamp,
    stored,
)
from shjax.cli.options import Output, Reading
from shjax.cli.pictures import BASIS, FRAME, progress_display
from shjax.envmap import EnvironmentMap
from shjax.io.writing import check_folder, protecting
from shjax.windows import apply_window

SCHEMA = "shjax.light/2"
UNITS = "radiance of the input, linear (W m^-2 sr^-1 if the input is absolute)"
STEPS = 3


def main(
    env: tuple[Path, ...],
    out: Path,
    settings: Settings,
    reading: Reading,
    force: bool,
    output: Output,
) -> int:
    """Do all maps, one after the other; returns the exit status."""
    paths = expand(list(env)) or [io.shipped_panorama()]
    names = output_names(paths)
    check_folder(out)
    if settings.checks is None:
        settings = dataclasses.replace(settings, checks=len(paths) == 1)
    work = _Work(out, settings, reading, force, light_checks.Ahead(settings.size))
    stdout, single = output.console(), len(paths) == 1
    count = {"done": 0, "kept": 0, "refused": 0, "left to another run": 0}
    with protecting(*paths), progress_display(output.quiet) as progress:
        task = progress.add_task("", total=STEPS * len(paths))
        for position, (path, name) in enumerate(zip(paths, names, strict=True)):

            def step(what: str, file: str = path.name) -> None:
                progress.update(task, description=f"{file}: {what}", advance=1)

            try:
                with alone(out, name):
                    result, kept = work.do(path, name, stdout if single else None, step)
            except (BusyError, ValueError, OSError) as error:
                if single:
                    raise
                if isinstance(error, BusyError):
                    count["left to another run"] += 1
                else:
                    count["refused"] += 1
                    print("shjax: " + " ".join(str(error).split()), file=sys.stderr)
            else:
                count["kept" if kept else "done"] += 1
                _show(output, stdout, result, kept=kept, single=single)
            progress.update(task, completed=STEPS * (position + 1))
    if not single:
        words = ", ".join(f"{n} {word}" for word, n in count.items() if n)
        stdout.print(f"{len(paths)} files: {words}; results in {out}", markup=False)
    return 2 if count["refused"] else 0


@dataclasses.dataclass(frozen=True)
class _Work:
    """What is done with each map."""

    out: Path
    settings: Settings
    reading: Reading
    force: bool
    ahead: light_checks.Ahead

    def do(
        self,
        path: Path,
        name: str,
        console: Console | None,
        step: Callable[[str], None],
    ) -> tuple[dict, bool]:
        """Do one map, or find it done: the record, and whether it was kept.

        The coefficients are shown on a console, if there is one, before the checks.
        """
        job = job_of(path, self.settings, self.reading)
        kept = None if self.force else already(self.out, name, job)
        if kept is not None:
            if console is not None:
                print_coefficients(console, kept)
            return kept, True
        if self.settings.checks:
            self.ahead.start()
        found, envmap = run(path, self.settings, self.reading, step=step)
        result = write_light(self.out, name, found)
        if console is not None:
            print_coefficients(console, result)
        if self.settings.checks:
            step("checking")
            checks = light_checks.check(envmap, found, self.settings, self.ahead)
            result = write_checks(self.out, name, found, checks, result)
        return result, False


def _show(
    output: Output, console: Console, result: dict, *, kept: bool, single: bool
) -> None:
    """Show what is left to be shown of one map."""
    when = since(result["files"].values()) if kept else ""
    if output.print_json(result):
        return
    if not single:
        print_line(console, result, kept=when)
        return
    print_checks(console, result)
    print_files(console, result)
    if kept:
        console.print(f"kept, from {when}; --force does it again")


def already(out: Path, name: str, job: dict) -> dict | None:
    """The result of an earlier run with the same options on the same file, if whole."""
    record = out / f"{name}_lighting.json"
    return stored(record, job) if record.exists() else None


def job_of(path: Path, settings: Settings, reading: Reading) -> dict:
    """All that a result depends on.

    Raises:
        OSError: If the file is not there.
    """
    about = {"version": shjax.__version__, "source": str(path), "input": stamp(path)}
    options = {**dataclasses.asdict(reading), **dataclasses.asdict(settings)}
    rotation = options.pop("rotate")
    turned = None if rotation is None else np.asarray(rotation).tolist()
    return {**about, **options, "rotation": turned}


def run(
    path: Path,
    settings: Settings,
    reading: Reading,
    *,
    step: Callable[[str], None] = lambda what: None,
) -> tuple[Light, EnvironmentMap]:
    """Coefficients of a map, and its light sources if they are to be split off.

    Args:
        path: Environment map.
        settings: What is made of it.
        reading: How it is read.
        step: Called with a few words at the start of each part.

    Raises:
        OSError: If the file cannot be opened.
        ValueError: If it cannot be read or integrated.
    """
    job = job_of(path, settings, reading)
    step("reading")
    envmap = reading.read(path)
    if not np.all(np.isfinite(np.asarray(envmap.radiance))):
        raise ValueError(
            f"{path}: values that are not finite cannot be integrated; use "
            "invalid='clamp' or 'zero'."
        )
    step("coefficients")
    l_max, rotation = settings.l_max, settings.rotate
    whole, quadrature = light_of(envmap, max(l_max, 2), rotation)
    whole = np.asarray(whole)
    lighting = np.asarray(apply_window(whole[: (l_max + 1) ** 2], settings.window))
    summary = {
        "schema": SCHEMA,
        "job": job,
        "source": str(path),
        "report": dataclasses.asdict(envmap.report),
        "l_max": l_max,
        "quadrature": quadrature,
        "window": settings.window,
        "frame": FRAME,
        "basis": BASIS,
        "units": UNITS,
        "coefficients": lighting.astype(float).tolist(),
    }
    split = split_of(envmap, rotation) if settings.split else None
    return Light(summary, envmap.report.source, lighting, whole[:9], split), envmap
