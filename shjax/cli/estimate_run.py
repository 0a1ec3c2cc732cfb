"""What ``shjax estimate`` does."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import click
import jax.numpy as jnp
import numpy as np

import shjax
from shjax.cli import surface
from shjax.cli.estimate_options import Fitting, Shape
from shjax.cli.estimate_report import EstimateResult, show, words, write
from shjax.cli.many import alone
from shjax.cli.options import Output
from shjax.cli.pictures import BASIS, FRAME
from shjax.inverse import Estimate, Surface, nonnegative
from shjax.io.images import MAX_PIXELS, decode, in_memory
from shjax.io.writing import check_folder, protecting
from shjax.render import Camera
from shjax.render.pictures import covered
from shjax.srgb import decode_srgb, encode_srgb

SCHEMA = "shjax.estimate/1"
_LDR = (".png", ".jpg", ".jpeg")


def main(image: Path, out: Path, shape: Shape, fitting: Fitting, output: Output) -> int:
    """Read, estimate, write, show; returns the exit status."""
    check_folder(out)
    click.get_current_context().with_resource(protecting(image))
    with alone(out, image.stem):
        result = write(out, image.stem, run(image, shape, fitting))
    if not output.print_json(result):
        show(output.console(), result)
    return 0


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
        picture = found.forward(found.full_value, shown.gbuffer)
        return np.asarray(picture) * albedo
    made = jnp.asarray(shown.rows) @ found.full_value[: shown.rows.shape[-1]]
    return np.asarray(covered(shown.gbuffer, made)) * albedo


def _residual(picture, again, shown: surface.Shown) -> float:
    whole = np.asarray(shown.gbuffer.mask) == 1
    if shown.mask is not None:
        whole = whole & (shown.mask > 0)
    mean = picture[whole].mean()
    return float(np.sqrt(np.mean((picture - again)[whole] ** 2)) / (mean or 1.0))
