"""``shjax light``: a panorama in; coefficients, irradiance and spheres out."""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Callable
from pathlib import Path

import click
import jax.numpy as jnp
import numpy as np
from rich.console import Console

import shjax
from shjax import io, render
from shjax.cli.light_report import print_result, write_results, write_split
from shjax.cli.options import (
    invalid_option,
    layout_option,
    light_of,
    rotate_option,
    window_option,
)
from shjax.cli.pictures import FRAME, progress_display
from shjax.io.writing import check_folder
from shjax.windows import apply_window

SCHEMA = "shjax.light/1"
BASIS = (
    "real orthonormal spherical harmonics without Condon-Shortley phase, "
    "row l (l + 1) + m"
)
UNITS = "radiance of the input, linear (W m^-2 sr^-1 if the input is absolute)"
RELATIVE_TO = "total radiance over the sphere, int L dw (Rec. 709 luminance)"
STEPS = 5


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
@rotate_option
@window_option
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
    rotate: np.ndarray | None,
    window: str,
    as_json: bool,
    quiet: bool,
) -> int:
    """Project environment maps on spherical harmonics and show what nine numbers hold.

    ENV is a lat-long panorama (EXR, Radiance .hdr), an angular map or a vertical cross;
    left out, a panorama that comes with shjax is used.

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
    """
    paths = list(env) or [io.shipped_panorama()]
    _check_names(paths)
    check_folder(out)
    stdout = Console(quiet=quiet or as_json)
    failed = False
    with progress_display(quiet) as progress:
        task = progress.add_task("", total=STEPS * len(paths))
        for number, path in enumerate(paths):

            def step(what: str, name: str = path.name) -> None:
                progress.update(task, description=f"{name}: {what}", advance=1)

            try:
                result = run(
                    path, out, l_max=l_max, size=size, layout=layout, invalid=invalid,
                    rotation=rotate, window=window, split=split, step=step,
                )  # fmt: skip
            except (ValueError, OSError) as error:
                if len(paths) == 1:
                    raise
                failed = True
                print("shjax: " + " ".join(str(error).split()), file=sys.stderr)
                progress.update(task, completed=STEPS * (number + 1))
                continue
            if as_json and not quiet:
                print(json.dumps(result), flush=True)
            print_result(stdout, result)
    return 2 if failed else 0


def run(
    path: Path,
    out: Path,
    *,
    l_max: int = 2,
    size: int = 192,
    layout: str = "auto",
    invalid: str = "error",
    rotation: np.ndarray | None = None,
    window: str = "none",
    split: bool = False,
    step: Callable[[str], None] = lambda what: None,
) -> dict:
    """The whole job for one file; writes into ``out`` and returns what it found.

    Args:
        path: Environment map.
        out: Folder for the results.
        l_max: Highest degree.
        size: Side of each sphere, pixels.
        layout: As in :func:`shjax.io.read_envmap`.
        invalid: As in :func:`shjax.io.read_envmap`.
        rotation: Turns the light; ``(3, 3)``.
        window: A name in :data:`shjax.windows.NAMES`.
        split: Whether to write the small lights and the rest.
        step: Called with a few words at the start of each part.

    Raises:
        OSError: If a file cannot be opened or written.
        ValueError: If ``path`` cannot be read.
    """
    step("reading")
    envmap = io.read_envmap(path, layout=layout, invalid=invalid)
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
    radiance, directions, weights = envmap.samples()
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
        lights, more = write_split(out, path.stem, envmap, rotation)
        result["lights"] = lights
    result["files"] = write_results(
        out, path.stem, result, envmap, lighting, spheres, more
    )
    return result


def _relative_error(value, truth) -> float:
    norm = float(jnp.linalg.norm(truth))
    difference = float(jnp.linalg.norm(value - truth))
    return difference / norm if norm else difference


def _check_names(paths: list[Path]) -> None:
    stems = [path.stem for path in paths]
    twice = sorted({stem for stem in stems if stems.count(stem) > 1})
    if twice:
        raise click.UsageError(
            f"several ENV are named {', '.join(twice)}; their results would overwrite "
            "each other. Run them with different --out."
        )
