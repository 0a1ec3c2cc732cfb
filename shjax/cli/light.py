"""``shjax light``: a panorama in; coefficients, irradiance and spheres out."""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Callable
from pathlib import Path

import click
import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.padding import Padding
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
)
from rich.table import Table

import shjax
from shjax import io, render
from shjax.cli.options import rotate_option, window_option
from shjax.display import show_difference, tone_map
from shjax.envmap import EnvironmentMap
from shjax.harmonics.degrees import degrees, orders
from shjax.io.envmaps import INVALID_CHOICES
from shjax.layouts import LAYOUTS
from shjax.windows import apply_window

SCHEMA = "shjax.light/1"
FRAME = (
    "right-handed, +z up (row 0 of a lat-long image), +x at the image centre, "
    "+y at u = 0.25"
)
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
    "--size", default=192, show_default=True, type=click.IntRange(8, 4096),
    metavar="PIXELS", help="Side of each rendered sphere.",
)  # fmt: skip
@click.option(
    "--layout", default="auto", show_default=True,
    type=click.Choice(["auto", *LAYOUTS]), help="How ENV covers the sphere.",
)  # fmt: skip
@click.option(
    "--invalid", default="error", show_default=True,
    type=click.Choice(INVALID_CHOICES),
    help="What to do with NaN, infinite and negative pixels.",
)  # fmt: skip
@rotate_option
@window_option
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object per ENV.")
@click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")
def light(
    env: tuple[Path, ...],
    out: Path,
    l_max: int,
    size: int,
    layout: str,
    invalid: str,
    rotate: np.ndarray | None,
    window: str,
    as_json: bool,
    quiet: bool,
) -> int:
    r"""Project environment maps on spherical harmonics and show what nine numbers hold.

    ENV is a lat-long panorama (EXR, Radiance .hdr), an angular map or a vertical cross;
    left out, a panorama that comes with shjax is used.

    \b
    For each ENV, DIR receives
      NAME_lighting.json     coefficients, errors, what was recovered
      NAME_irradiance.exr    irradiance map, lat-long (and .png, tone-mapped)
      NAME_spheres.exr       white sphere from the coefficients, by the exact
                             integral, and their difference (and .png)

    \b
    Examples:
      shjax light --out results
      shjax light studio.exr sunset.hdr --l-max 4 --out results
    """
    paths = list(env) or [io.shipped_panorama()]
    _check_names(paths)
    stdout = Console(quiet=quiet or as_json)
    failed = False
    with _progress(quiet) as progress:
        task = progress.add_task("", total=STEPS * len(paths))
        for number, path in enumerate(paths):

            def step(what: str, name: str = path.name) -> None:
                progress.update(task, description=f"{name}: {what}", advance=1)

            try:
                result = run(
                    path, out, l_max=l_max, size=size, layout=layout, invalid=invalid,
                    rotation=rotate, window=window, step=step,
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
            _print(stdout, result)
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
        step: Called with a few words at the start of each part.

    Raises:
        OSError: If a file cannot be opened or written.
        ValueError: If ``path`` cannot be read.
    """
    step("reading")
    envmap = io.read_envmap(path, layout=layout, invalid=invalid)
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
        "self": shjax.estimate_lighting(from_nine, ball.normals, mask=seen),
        "exact": shjax.estimate_lighting(exact, ball.normals, mask=seen),
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
    result["files"] = _write(out, path.stem, result, envmap, lighting, spheres)
    return result


def light_of(
    envmap: EnvironmentMap, l_max: int, rotation: np.ndarray | None
) -> tuple[jax.Array, str]:
    """Coefficients of a map, turned, and by which quadrature.

    A lat-long map too small for the degree is taken as constant over each pixel.
    """
    rows, columns = envmap.image.shape[:2]
    small = envmap.layout == "latlong" and min(rows, columns) < 2 * l_max + 1
    quadrature = "pixel" if small else "fejer"
    if envmap.layout != "latlong":
        quadrature = "pixel centres, exact solid angles"
        lighting = envmap.lighting(l_max=l_max)
    else:
        lighting = envmap.lighting(l_max=l_max, quadrature=quadrature)
    if rotation is not None:
        lighting = shjax.rotate(lighting, rotation)
    return lighting, quadrature


def _relative_error(value, truth) -> float:
    norm = float(jnp.linalg.norm(truth))
    difference = float(jnp.linalg.norm(value - truth))
    return difference / norm if norm else difference


def _write(
    out: Path,
    stem: str,
    result: dict,
    envmap: EnvironmentMap,
    lighting,
    spheres: tuple[np.ndarray, np.ndarray],
) -> dict[str, str]:
    about = {
        "software": f"shjax {shjax.__version__}",
        "source": envmap.report.source,
        "frame": FRAME,
    }
    irradiance = np.asarray(
        shjax.synthesize(shjax.irradiance_coefs(lighting), n_theta=64, n_phi=128)
    )
    approximate, exact = spheres
    difference = approximate - exact
    # One white for both spheres; the difference at a tenth of it in full colour.
    white = float(np.quantile(exact.mean(axis=-1), 0.99)) or 1.0
    panels = np.concatenate([approximate, exact, difference], axis=1)
    shown = [_as_rgb(tone_map(part, white=white)) for part in (approximate, exact)]
    coloured = show_difference(difference, white / 10)
    pictures = {
        "irradiance.exr": (irradiance, {**about, "units": "irradiance, W m^-2"}),
        "irradiance.png": (_as_rgb(tone_map(irradiance)), {}),
        "spheres.exr": (panels, {**about, "units": "radiance", "albedo": "1"}),
        "spheres.png": (np.concatenate([*shown, coloured], axis=1), {}),
    }
    files = {name: str(out / f"{stem}_{name}") for name in pictures}
    for name, (image, attributes) in pictures.items():
        io.write_image(files[name], image, attributes=attributes)
    files["lighting.json"] = str(out / f"{stem}_lighting.json")
    # Last, so that its presence says that all the others are there.
    io.write_text(
        files["lighting.json"], json.dumps({**result, "files": files}, indent=1) + "\n"
    )
    return files


def _as_rgb(image: np.ndarray) -> np.ndarray:
    return np.broadcast_to(image[..., :3], (*image.shape[:2], 3))


def _check_names(paths: list[Path]) -> None:
    stems = [path.stem for path in paths]
    twice = sorted({stem for stem in stems if stems.count(stem) > 1})
    if twice:
        raise click.UsageError(
            f"several ENV are named {', '.join(twice)}; their results would overwrite "
            "each other. Run them with different --out."
        )


def _progress(quiet: bool) -> Progress:
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=Console(stderr=True),
        transient=True,
        disable=quiet or not sys.stderr.isatty(),
    )


def _print(console: Console, result: dict) -> None:
    report = result["report"]
    console.print(f"[bold]{report['source']}[/]  {_report_line(report)}")
    if result["quadrature"] == "pixel":
        console.print(
            f"  fewer than {2 * max(result['l_max'], 2) + 1} rows or columns: taken as "
            "constant over each pixel (quadrature 'pixel')"
        )
    table = Table(title="Lighting coefficients L_lm", title_justify="left")
    coefs = result["coefficients"]
    names = ("R", "G", "B") if len(coefs[0]) == 3 else range(len(coefs[0]))
    for heading in ("l", "m", *names):
        table.add_column(str(heading), justify="right")
    rows = zip(degrees(result["l_max"]), orders(result["l_max"]), coefs, strict=True)
    for l, m, values in rows:
        table.add_row(str(l), str(m), *(f"{value:.5g}" for value in values))
    console.print(table)
    console.print(
        f"frame: {result['frame']}\nbasis: {result['basis']}", highlight=False
    )
    error, recovered = result["irradiance_error"], result["recovered_error"]
    console.print(
        f"\n[bold]irradiance_error[/]  mean {error['mean']:.2%}, max {error['max']:.2%} "
        f"of the {error['relative_to']}"
    )
    if error["smallest_over_mean"] < 0:
        console.print(
            "  the expansion rings: its irradiance falls to "
            f"{error['smallest_over_mean']:.1%} of its mean"
        )
    console.print(
        f"[bold]recovered_error[/]   self {recovered['self']:.1e}, "
        f"exact {recovered['exact']:.1%}"
    )
    for paragraph in (
        "self: nine numbers from the sphere that nine numbers drew, a check of the code.",
        "exact: from the exact sphere, as from a photograph. One view shows half the "
        "normals, where light of degree 4, 6, ... looks like degrees 0 to 2; "
        f"{result['recovered']['message']}.",
    ):
        console.print(Padding(paragraph, (0, 0, 0, 2)), highlight=False)
    console.print("\nwritten:")
    for name in result["files"].values():
        console.print(f"  {name}", highlight=False)


def _report_line(report: dict) -> str:
    guessed = " (told from its shape)" if report["layout_guessed"] else ""
    line = f"{report['width']} x {report['height']} {report['format']}, "
    line += f"{report['layout']}{guessed}"
    return f"{line}; {report['action']}" if report["action"] else line
