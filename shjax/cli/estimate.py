"""``shjax estimate``: the light from one picture of a known object."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import click
import jax.numpy as jnp
import numpy as np

import shjax
from shjax.cli import surface
from shjax.cli.estimate_options import Fitting, Shape, fitting_options, shape_options
from shjax.cli.estimate_report import EstimateResult, show, words, write
from shjax.cli.light import BASIS
from shjax.cli.many import alone
from shjax.cli.options import (
    Output,
    out_option,
    output_options,
)
from shjax.cli.pictures import FRAME
from shjax.colour import decode_srgb, encode_srgb
from shjax.inverse import Estimate, Surface, nonnegative
from shjax.io.images import MAX_PIXELS, decode, in_memory
from shjax.io.writing import check_folder, protecting
from shjax.render import Camera
from shjax.render.pictures import covered

SCHEMA = "shjax.estimate/1"
_LDR = (".png", ".jpg", ".jpeg")


@click.command(short_help="The light from a picture of a known object.")
@click.argument("image", type=click.Path(path_type=Path))
@out_option
@shape_options
@fitting_options
@output_options
def estimate(
    image: Path, out: Path, shape: Shape, fitting: Fitting, output: Output
) -> int:
    """Estimate the light from a picture of an object whose shape is known.

    IMAGE is linear (EXR, HDR) or an 8- or 16-bit picture, decoded as sRGB unless
    --transfer linear says that it is not; values
    at its white count as "at least that". Say what it shows by one of --sphere, --normals
    or --mesh. A sphere and normals of the camera's frame are seen along +x with +z up:
    that frame is the light's.

    \b
    DIR receives
      NAME_light.json       coefficients, standard deviations, what is determined
                            (shjax convert and shjax score read it)
      NAME_light.exr, .png  the estimated light as a panorama
      NAME_pictures.exr     drawn from the estimate; the picture; their difference
                            (.png: full colour at a tenth of white)

    \b
    Examples:
      shjax estimate ball.png --sphere 244.5,144.5,108 --out results
      shjax estimate photo.exr --normals normals.exr --normals-frame camera \\
        --normals-range signed --albedo 0.6,0.5,0.4 --out results
      shjax estimate bunny.exr --mesh bunny.ply --camera 0,0,4 --up 0,1,0 --out results
    """
    check_folder(out)
    click.get_current_context().with_resource(protecting(image))
    _check(shape, fitting)
    with alone(out, image.stem):
        result = write(out, image.stem, run(image, shape, fitting))
    if not output.print_json(result):
        show(output.console(), result)
    return 0


def _check(shape: Shape, fitting: Fitting) -> None:
    ways = [n for n in ("sphere", "normals", "mesh") if getattr(shape, n) is not None]
    if len(ways) != 1:
        raise click.UsageError(
            "say what the picture shows by one of --sphere, --normals and --mesh; got "
            f"{' and '.join(ways) or 'none'}."
        )
    named = shape.normals_frame and shape.normals_range
    if ways == ["normals"] and not named:
        raise click.UsageError(
            "--normals needs --normals-frame (world or camera) and --normals-range "
            "(signed or unsigned): neither can be told from the numbers."
        )
    if ways == ["mesh"] and shape.camera is None:
        raise click.UsageError("--mesh needs --camera.")
    if fitting.brdf is not None and ways == ["mesh"]:
        raise click.UsageError("--brdf does not go with --mesh: its shadows are matte.")
    unseen = shape.normals_frame not in surface.SEEN_FRAMES
    if fitting.brdf is not None and ways == ["normals"] and unseen:
        raise click.UsageError(
            "--brdf needs views, which normals in the world's frame do not tell."
        )


def run(image: Path, shape: Shape, fitting: Fitting) -> EstimateResult:
    """Decode the picture, estimate the light, and draw the picture again.

    Args:
        image: The picture.
        shape: What it shows.
        fitting: How the light is fitted.

    Raises:
        OSError: If a file cannot be opened.
        ValueError: If one cannot be read, or the picture does not fit the shape.
    """
    picture, transfer = _light_of(image, fitting.transfer)
    ldr = image.suffix.lower() in _LDR
    clipped = picture >= 1 - 1e-6 if ldr else np.zeros(picture.shape, bool)
    picture = picture / fitting.exposure
    picture, clipped, shown = _shown(picture, clipped, shape, fitting)
    mask, seen = shown.mask, shown.surface()
    if fitting.brdf is not None:
        normals = np.asarray(shown.gbuffer.normals)
        inside = (np.asarray(shown.gbuffer.mask) == 1).astype(float)
        mask = inside if mask is None else mask * inside
        seen = Surface.glossy(normals, shown.gbuffer.views, fitting.brdf)
    albedo = np.array(fitting.albedo)
    found = shjax.estimate_lighting(
        picture,
        seen,
        mask=mask,
        albedo=albedo,
        l_max=fitting.l_max,
        prior=None if fitting.plain else "picture",
        clipped=clipped if clipped.any() else None,
        loss=fitting.loss,
    )
    if fitting.nonnegative:
        found = nonnegative(found)
    again = _again(found, shown, albedo)
    summary = {
        "schema": SCHEMA,
        "source": str(image),
        "shows": shown.about,
        "transfer": transfer,
        "l_max": fitting.l_max,
        "frame": FRAME if shape.mesh is None else "the mesh's own coordinates",
        "basis": BASIS,
        "convention": "shjax",
        "coefficients": np.asarray(found.value, float).tolist(),
        "standard_deviation": _finite(found.standard_deviation),
        "prior_fraction": np.asarray(found.prior_fraction, float).tolist(),
        "condition_number": found.condition_number,
        "ok": found.ok,
        "message": found.message,
        "clipped_share": float(clipped.mean()),
        "noise": _finite(found.noise),
        "residual_rms_over_mean": _residual(picture, again, shown),
    }
    summary["words"] = words(summary)
    seen_mask = np.asarray(shown.gbuffer.mask)
    return EstimateResult(summary, found, picture, again, seen_mask)


def _shown(
    picture: np.ndarray, clipped: np.ndarray, shape: Shape, fitting: Fitting
) -> tuple[np.ndarray, np.ndarray, surface.Shown]:
    """The part of the picture that counts, and what it shows."""
    size = picture.shape[:2]
    if shape.sphere is not None:
        window, factor, circle = surface.crop_to_sphere(size, shape.sphere)
        picture = surface.averaged(picture[window], factor)
        clipped = surface.averaged(clipped[window].astype(float), factor) > 0
        shown = surface.of_sphere(picture.shape[:2], circle)
        if shape.mask is not None:
            whole = surface.read_mask(shape.mask, size)[window][..., None]
            weights = (surface.averaged(whole, factor)[..., 0] == 1).astype(float)
            shown = dataclasses.replace(shown, mask=weights)
        return picture, clipped, shown
    if shape.normals is not None:
        assert shape.normals_frame is not None
        shown = surface.of_normals(
            size,
            shape.normals,
            shape.normals_frame,
            shape.normals_range == "signed",
            shape.mask,
            shape.layer,
        )
        return picture, clipped, shown
    assert shape.mesh is not None
    return picture, clipped, _of_mesh(size, shape.mesh, shape, fitting)


def _of_mesh(
    size: tuple[int, int], mesh: Path, shape: Shape, fitting: Fitting
) -> surface.Shown:
    x, y, z, *target = shape.camera or (0.0, 0.0, 0.0)
    tx, ty, tz = target or (0.0, 0.0, 0.0)
    camera = Camera(
        origin=(x, y, z),
        target=(tx, ty, tz),
        up=shape.up,
        width=shape.width,
        fov=None if shape.fov is None else float(np.radians(shape.fov)),
    )
    degree = fitting.l_max if fitting.plain else 10
    shown = surface.of_mesh(size, mesh, camera, degree)
    if shape.mask is None:
        return shown
    weights = surface.read_mask(shape.mask, size)
    weights = weights if shown.mask is None else weights * shown.mask
    return dataclasses.replace(shown, mask=weights)


def _light_of(image: Path, transfer: str) -> tuple[np.ndarray, str]:
    """A picture's linear light, and how it was decoded, in words."""
    decoded = decode(image, max_pixels=MAX_PIXELS, isolate=True)
    picture = in_memory(image, decoded).astype(float)
    if not np.all(np.isfinite(picture)):
        bad = int(np.sum(~np.isfinite(picture)))
        raise ValueError(f"{image}: {bad} values are NaN or infinite.")
    stored_as_srgb = "sRGB decoded" in decoded.kind
    if transfer == "linear" and stored_as_srgb:
        return encode_srgb(picture), "taken as linear, as --transfer says"
    if transfer == "srgb" and not stored_as_srgb:
        return decode_srgb(
            np.clip(picture, 0, 1)
        ), "decoded as sRGB, as --transfer says"
    if stored_as_srgb:
        return picture, "decoded as sRGB (--transfer linear if it is not)"
    return picture, "linear"


def _finite(values) -> list:
    array = np.asarray(values, float)
    finite = array.astype(object)
    finite[~np.isfinite(array)] = None
    return finite.tolist()


def _again(found: Estimate, shown: surface.Shown, albedo):
    """The picture drawn from the estimate."""
    if shown.rows is None:
        picture = np.asarray(found.predict(shown.gbuffer)[0])
        return picture * albedo
    made = jnp.asarray(shown.rows) @ found.full_value[: shown.rows.shape[-1]]
    return np.asarray(covered(shown.gbuffer, made)) * albedo


def _residual(picture, again, shown: surface.Shown) -> float:
    whole = np.asarray(shown.gbuffer.mask) == 1
    if shown.mask is not None:
        whole = whole & (shown.mask > 0)
    mean = picture[whole].mean()
    return float(np.sqrt(np.mean((picture - again)[whole] ** 2)) / (mean or 1.0))
