"""``shjax light``: a panorama in; coefficients, irradiance and spheres out."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable
from pathlib import Path

import click
import jax.numpy as jnp
import numpy as np

import shjax
from shjax import io, render
from shjax.cli.light_report import (
    LightResult,
    print_line,
    print_result,
    split_of,
    write_results,
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
from shjax.cli.options import (
    Output,
    Reading,
    light_of,
    number,
    out_option,
    output_options,
    packed,
    reading_options,
    rotate_option,
    window_option,
)
from shjax.cli.pictures import FRAME, progress_display
from shjax.envmap import EnvironmentMap
from shjax.io.writing import check_folder, protecting
from shjax.reference import irradiance_error
from shjax.windows import apply_window

SCHEMA = "shjax.light/1"
BASIS = (
    "real orthonormal spherical harmonics without Condon-Shortley phase, "
    "row l (l + 1) + m"
)
UNITS = "radiance of the input, linear (W m^-2 sr^-1 if the input is absolute)"
RELATIVE_TO = "total radiance over the sphere, int L dw (Rec. 709 luminance)"
STEPS = 5
_ROWS = 1024


@dataclasses.dataclass(frozen=True)
class Settings:
    """What is made of each map."""

    l_max: int = 2
    size: int = 192
    split: bool = False
    rotate: np.ndarray | None = None
    window: str = "none"


settings_options = packed(
    "settings",
    Settings,
    number("--l-max", 2, click.IntRange(min=0), "Highest degree of the coefficients."),
    number(
        "--size",
        192,
        click.IntRange(8, 512),
        "Side of each rendered sphere; the exact one takes time by its square.",
        metavar="PIXELS",
    ),
    click.option(
        "--split",
        is_flag=True,
        help="Write the brightest light sources and the rest of the map apart.",
    ),
    rotate_option,
    window_option,
)


@click.command(short_help="Lighting coefficients, irradiance and spheres.")
@click.argument("env", nargs=-1, type=click.Path(path_type=Path))
@out_option
@settings_options
@reading_options
@click.option("--force", is_flag=True, help="Do again what was done before.")
@output_options
def light(
    env: tuple[Path, ...],
    out: Path,
    settings: Settings,
    reading: Reading,
    force: bool,
    output: Output,
) -> int:
    """Project environment maps on spherical harmonics and show what nine numbers hold.

    ENV is an environment map of any layout (EXR, Radiance .hdr, PFM, .npy, TIFF, PNG,
    JPEG), a folder of them, or a folder of the six faces of a cube; left out, a panorama
    that comes with shjax is used. Of many, one that cannot be read does not stop the
    rest, and what an earlier run has done is kept. Two runs on one folder share the work.

    \b
    For each ENV, DIR receives
      NAME_lighting.json     coefficients, errors, what was recovered
      NAME_irradiance.exr    irradiance map, lat-long (and .png, tone-mapped)
      NAME_spheres.exr       white sphere: from the coefficients; by the exact
                             integral; their difference (.png: red too bright,
                             blue too dark, full colour at a tenth of white)
      NAME_lights.json       with --split: direction, half angle and colour of each
                             light source (a sun, lamps), for sun lamps elsewhere
      NAME_rest.exr          with --split: the map without them; the flux is kept

    \b
    Examples:
      shjax light --out results
      shjax light studio.exr sunset.hdr --l-max 4 --out results
      shjax light sunset.hdr --split --out results
      shjax light panoramas/ --out results
    """
    paths = expand(list(env)) or [io.shipped_panorama()]
    names = output_names(paths)
    check_folder(out)
    stdout = output.console()
    count = {"done": 0, "kept": 0, "refused": 0, "left to another run": 0}
    with protecting(*paths), progress_display(output.quiet) as progress:
        task = progress.add_task("", total=STEPS * len(paths))
        for position, (path, name) in enumerate(zip(paths, names, strict=True)):

            def step(what: str, file: str = path.name) -> None:
                progress.update(task, description=f"{file}: {what}", advance=1)

            try:
                with alone(out, name):
                    job = job_of(path, settings, reading)
                    kept = None if force else already(out, name, job)
                    if kept is None:
                        found = run(path, settings, reading, step=step)
                        result = write_results(out, name, found)
                    else:
                        result = kept
            except BusyError:
                if len(paths) == 1:
                    raise
                count["left to another run"] += 1
            except (ValueError, OSError) as error:
                if len(paths) == 1:
                    raise
                count["refused"] += 1
                print("shjax: " + " ".join(str(error).split()), file=sys.stderr)
            else:
                count["kept" if kept else "done"] += 1
                when = since(kept["files"].values()) if kept else ""
                if output.print_json(result):
                    pass
                elif len(paths) == 1:
                    print_result(stdout, result)
                    if kept:
                        stdout.print(f"kept, from {when}; --force does it again")
                else:
                    print_line(stdout, result, kept=when)
            progress.update(task, completed=STEPS * (position + 1))
    if len(paths) > 1:
        words = ", ".join(f"{n} {word}" for word, n in count.items() if n)
        stdout.print(f"{len(paths)} files: {words}; results in {out}", markup=False)
    return 2 if count["refused"] else 0


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
) -> LightResult:
    """Coefficients, exact irradiance, spheres and the light recovered from them.

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
    nine = whole[:9]
    lighting = apply_window(whole[: (l_max + 1) ** 2], settings.window)
    step("exact irradiance of 4000 normals")
    exact_light = _exact_light(envmap, rotation, lighting.dtype)
    error = irradiance_error(lighting, exact_light)
    step("exact sphere")
    ball = render.sphere(settings.size)
    exact = render.reference(ball, exact_light)
    step("recovering the light")
    seen = ball.mask == 1
    from_nine = render.image(ball, nine)
    recovered = {
        "self": shjax.estimate_lighting(from_nine, ball.normals, mask=seen, prior=None),
        "exact": shjax.estimate_lighting(exact, ball.normals, mask=seen, prior=None),
    }
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
        "coefficients": np.asarray(lighting, float).tolist(),
        "irradiance_error": {
            "mean": float(error["mean"]),
            "max": float(error["max"]),
            "relative_to": RELATIVE_TO,
            "smallest_over_mean": float(error["ringing"]),
        },
        "recovered_error": {
            name: _relative_error(estimate.value, nine)
            for name, estimate in recovered.items()
        },
        "recovered": {
            "coefficients": np.asarray(recovered["exact"].value, float).tolist(),
            "condition_number": recovered["exact"].condition_number,
            "message": recovered["exact"].message,
        },
    }
    spheres = (np.asarray(render.image(ball, lighting)), np.asarray(exact))
    split = split_of(envmap, rotation) if settings.split else None
    return LightResult(summary, envmap.report.source, lighting, spheres, split)


def _relative_error(value, truth) -> float:
    norm = float(jnp.linalg.norm(truth))
    difference = float(jnp.linalg.norm(value - truth))
    return difference / norm if norm else difference


def _exact_light(
    envmap: EnvironmentMap, rotation: np.ndarray | None, dtype
) -> EnvironmentMap:
    """A map that brute force can go through: at most 1024 rows, with its flux."""
    if envmap.layout == "latlong" and len(envmap.image) > _ROWS:
        envmap = envmap.to_latlong(_ROWS)
    radiance, directions, weights = envmap.samples()
    if rotation is not None:
        directions = directions @ rotation.T
    return EnvironmentMap.from_samples(
        *(jnp.asarray(part, dtype) for part in (radiance, directions, weights))
    )
