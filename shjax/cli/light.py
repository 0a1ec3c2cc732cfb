"""``shjax light``: a panorama in; coefficients, irradiance and spheres out."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable
from pathlib import Path

import click
import jax.numpy as jnp
import numpy as np
from rich.console import Console

import shjax
from shjax import io, render
from shjax.cli.light_report import print_line, print_result, write_results, write_split
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
    invalid_option,
    layout_option,
    light_of,
    primaries_option,
    rotate_option,
    window_option,
)
from shjax.cli.pictures import FRAME, progress_display
from shjax.envmap import EnvironmentMap
from shjax.io.writing import check_folder, json_text, protecting
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


@click.command(short_help="Lighting coefficients, irradiance and spheres.")
@click.argument("env", nargs=-1, type=click.Path(path_type=Path))
@click.option(
    "-o", "--out", required=True, type=click.Path(path_type=Path), metavar="DIR",
    help="Folder for the results; made if it is missing.",
)  # fmt: skip
@click.option(
    "--l-max", default=2, show_default=True, type=click.IntRange(min=0),
    help="Highest degree of the coefficients, inclusive.",
)  # fmt: skip
@click.option(
    "--size", default=192, show_default=True, type=click.IntRange(8, 512),
    metavar="PIXELS",
    help="Side of each rendered sphere; the exact one takes time by its square.",
)  # fmt: skip
@click.option(
    "--split", is_flag=True,
    help="Write the small bright lights and the rest of the map apart.",
)  # fmt: skip
@layout_option
@invalid_option
@primaries_option
@rotate_option
@window_option
@click.option("--force", is_flag=True, help="Do again what was done before.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object per ENV.")
@click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")
def light(
    env: tuple[Path, ...],
    out: Path,
    l_max: int,
    size: int,
    split: bool,
    layout: str,
    invalid: str,
    primaries: str,
    rotate: np.ndarray | None,
    window: str,
    force: bool,
    as_json: bool,
    quiet: bool,
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
                             small light (a sun, lamps), for sun lamps elsewhere
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
    options = {
        "l_max": l_max, "size": size, "layout": layout, "invalid": invalid,
        "window": window, "split": split, "primaries": primaries,
    }  # fmt: skip
    stdout = Console(quiet=quiet or as_json, soft_wrap=True)
    count = {"done": 0, "kept": 0, "refused": 0, "left to another run": 0}
    with protecting(*paths), progress_display(quiet) as progress:
        task = progress.add_task("", total=STEPS * len(paths))
        for number, (path, name) in enumerate(zip(paths, names, strict=True)):

            def step(what: str, file: str = path.name) -> None:
                progress.update(task, description=f"{file}: {what}", advance=1)

            try:
                with alone(out, name):
                    kept = None if force else already(path, out, name, options, rotate)
                    result = kept or run(
                        path, out, name=name, rotation=rotate, step=step, **options
                    )
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
                if as_json and not quiet:
                    print(json_text(result), flush=True)
                elif len(paths) == 1:
                    print_result(stdout, result)
                    if kept:
                        stdout.print(f"kept, from {when}; --force does it again")
                else:
                    print_line(stdout, result, kept=when)
            progress.update(task, completed=STEPS * (number + 1))
    if len(paths) > 1:
        words = ", ".join(f"{n} {word}" for word, n in count.items() if n)
        stdout.print(f"{len(paths)} files: {words}; results in {out}", markup=False)
    return 2 if count["refused"] else 0


def already(
    path: Path, out: Path, name: str, options: dict, rotation: np.ndarray | None
) -> dict | None:
    """The result of an earlier run with the same options on the same file, if whole.

    Raises:
        OSError: If the file is not there.
    """
    record = out / f"{name}_lighting.json"
    return stored(record, _job(path, options, rotation)) if record.exists() else None


def _job(path: Path, options: dict, rotation: np.ndarray | None) -> dict:
    """All that a result depends on."""
    turned = None if rotation is None else np.asarray(rotation).tolist()
    about = {"version": shjax.__version__, "source": str(path), "input": stamp(path)}
    return {**about, **options, "rotation": turned}


def run(
    path: Path,
    out: Path,
    *,
    name: str | None = None,
    l_max: int = 2,
    size: int = 192,
    layout: str = "auto",
    invalid: str = "error",
    primaries: str = "rec709",
    rotation: np.ndarray | None = None,
    window: str = "none",
    split: bool = False,
    step: Callable[[str], None] = lambda what: None,
) -> dict:
    """The whole job for one file; writes into ``out`` and returns what it found.

    Args:
        path: Environment map.
        out: Folder for the results.
        name: Start of the results' names; default the file's stem.
        l_max: Highest degree.
        size: Side of each sphere, pixels.
        layout: As in :func:`shjax.io.read_envmap`.
        invalid: As in :func:`shjax.io.read_envmap`.
        primaries: As there.
        rotation: Turns the light; ``(3, 3)``.
        window: A name in :data:`shjax.windows.NAMES`.
        split: Whether to write the small lights and the rest.
        step: Called with a few words at the start of each part.

    Raises:
        OSError: If a file cannot be opened or written.
        ValueError: If ``path`` cannot be read.
    """
    options = {
        "l_max": l_max, "size": size, "layout": layout, "invalid": invalid,
        "window": window, "split": split, "primaries": primaries,
    }  # fmt: skip
    job = _job(path, options, rotation)
    name = name or path.stem
    step("reading")
    envmap = io.read_envmap(
        path, layout=layout, invalid=invalid, primaries=primaries, isolate=True
    )
    if not np.all(np.isfinite(np.asarray(envmap.radiance))):
        raise ValueError(
            f"{path}: values that are not finite cannot be integrated; use "
            "invalid='clamp' or 'zero'."
        )
    step("coefficients")
    whole, quadrature = light_of(envmap, max(l_max, 2), rotation)
    nine = whole[:9]
    lighting = apply_window(whole[: (l_max + 1) ** 2], window)
    step("exact irradiance of 4000 normals")
    radiance, directions, weights = _reduced(envmap).samples()
    if rotation is not None:
        directions = directions @ rotation.T
    samples = [
        jnp.asarray(part, lighting.dtype) for part in (radiance, directions, weights)
    ]
    error = shjax.irradiance_error(lighting, *samples)
    step("exact sphere")
    ball = render.sphere(size)
    exact = render.lambertian_reference(ball, *samples)
    step("recovering the light")
    seen = ball.mask == 1
    from_nine = render.lambertian(ball, nine)
    recovered = {
        "self": shjax.estimate_lighting(from_nine, ball.normals, mask=seen, prior=None),
        "exact": shjax.estimate_lighting(exact, ball.normals, mask=seen, prior=None),
    }
    result = {
        "schema": SCHEMA,
        "job": job,
        "source": str(path),
        "report": dataclasses.asdict(envmap.report),
        "l_max": l_max,
        "quadrature": quadrature,
        "window": window,
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
    spheres = (np.asarray(render.lambertian(ball, lighting)), np.asarray(exact))
    more = {}
    if split:
        lights, more = write_split(out, name, envmap, rotation)
        result["lights"] = lights
    result["files"] = write_results(out, name, result, envmap, lighting, spheres, more)
    return result


def _relative_error(value, truth) -> float:
    norm = float(jnp.linalg.norm(truth))
    difference = float(jnp.linalg.norm(value - truth))
    return difference / norm if norm else difference


def _reduced(envmap: EnvironmentMap) -> EnvironmentMap:
    """A map that brute force can go through: at most 1024 rows, with its flux."""
    if envmap.layout != "latlong" or len(envmap.image) <= _ROWS:
        return envmap
    return envmap.to_latlong(_ROWS)
