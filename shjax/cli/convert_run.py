"""What ``shjax convert`` does."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import click
import numpy as np

import shjax
from shjax import io
from shjax.cli.coefficients import light_of, quadrature_note
from shjax.cli.convert import Settings
from shjax.cli.options import Output, Reading
from shjax.harmonics.degrees import degree_of_coefs
from shjax.io.coefs import FORMATS
from shjax.windows import apply_window

SCHEMA = "shjax.convert/1"


@dataclasses.dataclass(frozen=True)
class ConvertResult:
    """Coefficients ``(K, C)`` to be written, and what there is to say of them."""

    coefs: np.ndarray
    notes: list[str]


def main(
    source: Path, target: Path, settings: Settings, reading: Reading, output: Output
) -> int:
    """Read, write, show; returns the exit status."""
    if target.exists() and source.exists() and target.samefile(source):
        raise click.UsageError("TARGET is SOURCE; it would be overwritten.")
    own = settings.convention.lower() == "shjax"
    if (
        settings.axes is not None
        and own
        and FORMATS[settings.format].convention is None
    ):
        raise click.UsageError("--axes are a tool's: --convention must name it.")
    found = run(source, settings, reading)
    io.write_coefs(
        target,
        found.coefs,
        format=settings.format,
        convention=settings.convention,
        axes=settings.axes,
    )
    result = {"schema": SCHEMA, "source": str(source), "target": str(target)}
    result |= {"format": settings.format, "l_max": degree_of_coefs(found.coefs)}
    if not output.print_json({**result, "notes": found.notes}):
        print(*found.notes, sep="\n", end="\n" if found.notes else "")
        print(f"{target}: {found.coefs.shape[0]} coefficients, {settings.format}")
    return 0


def run(source: Path, settings: Settings, reading: Reading) -> ConvertResult:
    """Read coefficients, or project a map on them, and window them."""
    found = None
    if not source.is_dir():
        found = io.read_coefs(source, no_mirror=settings.no_mirror)
    notes = []
    if found is None:
        if settings.no_mirror:
            raise click.UsageError("--no-mirror belongs to an sh.txt; SOURCE is a map.")
        envmap = reading.read(source)
        degree = 2 if settings.l_max is None else settings.l_max
        coefs, quadrature = light_of(envmap, degree, settings.rotate)
        notes = [str(envmap.report), quadrature_note(quadrature, degree)]
    else:
        coefs = _cut(source, found, settings.l_max)
        if settings.rotate is not None:
            coefs = shjax.rotate(coefs, settings.rotate)
    coefs = np.asarray(apply_window(coefs, settings.window))
    return ConvertResult(coefs, [note for note in notes if note])


def _cut(source: Path, coefs: np.ndarray, l_max: int | None) -> np.ndarray:
    """The coefficients of a file up to a degree that it must have."""
    known = degree_of_coefs(coefs)
    if l_max is not None and l_max > known:
        raise click.UsageError(f"--l-max must be at most {known}, {source} ends there.")
    return coefs if l_max is None else coefs[: (l_max + 1) ** 2]
