"""What the pixels of a given picture show: normals, views, weights, or rows."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import click
import jax.numpy as jnp
import numpy as np

from shjax import io, render
from shjax.cli import words
from shjax.inverse import Surface, visible_cosine
from shjax.render import Camera, GBuffer
from shjax.render.meshes import trace_mesh

# A camera looks along +x with +z up: its right, up and towards itself, one a column.
CAMERA_TO_WORLD = np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]])
# Frames of normals by name: x, y and z of each in the library's frame, one a column.
NORMAL_FRAMES = {
    "world": np.eye(3),
    "blender": np.eye(3),
    "mitsuba": np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]),
    "camera": CAMERA_TO_WORLD,
    "opencv": CAMERA_TO_WORLD * np.array([1, -1, -1]),
}
_PARTS = (
    8 * 61
)  # parts of a pixel's side times the radius: with half as many, a ball of
# radius 61 gave light off by 15 % in place of 0.4 %, by its outline alone
_MAX_RADIUS = 256  # pixels; a larger sphere is averaged over blocks of pixels
_FACING = 0.2  # n.v below which one normal does not stand for a pixel


@dataclasses.dataclass(frozen=True)
class Shown:
    """Surface that a picture shows, and its G-buffer.

    Attributes:
        gbuffer: For the picture drawn again.
        normals: Given to the estimate: one per pixel, or those of its parts.
        mask: Weights ``(H, W)``, or None.
        rows: In place of normals, or None.
        about: In words.
    """

    gbuffer: GBuffer
    normals: np.ndarray | None
    mask: np.ndarray | None
    rows: np.ndarray | None
    about: str

    def surface(self) -> Surface:
        """The Lambertian surface that the estimate takes."""
        if self.rows is not None:
            return Surface.rows(self.rows)
        assert self.normals is not None
        return Surface.matte(self.normals)


def crop_to_sphere(
    size: tuple[int, int], circle: tuple[float, float, float]
) -> tuple[tuple[slice, slice], int, tuple[float, float, float]]:
    """Crop a picture to a sphere, and how many of its pixels become one.

    Returns:
        Rows and columns, the side of the blocks that are averaged (more than 1 for a
        sphere of more than 256 pixels in radius), and the circle in that picture.
    """
    cx, cy, radius = circle
    if radius <= 0:
        raise click.UsageError(f"--sphere needs a radius > 0; got {radius:g}.")
    factor = int(np.ceil(radius / _MAX_RADIUS))
    window, corner = [], []
    for middle, length in ((cy, size[0]), (cx, size[1])):
        first = int(np.clip(np.floor(middle - radius) - 1, 0, length))
        last = int(np.clip(np.ceil(middle + radius) + 1, 0, length))
        last = first + (last - first) // factor * factor
        if last <= first:
            raise click.UsageError(
                f"--sphere {cx:g},{cy:g},{radius:g} covers no pixel of the {size[1]} x "
                f"{size[0]} picture."
            )
        window.append(slice(first, last))
        corner.append(first)
    inside = (cx - corner[1]) / factor, (cy - corner[0]) / factor, radius / factor
    return (window[0], window[1]), factor, inside


def averaged(image: np.ndarray, factor: int) -> np.ndarray:
    """Average a picture over square blocks of pixels, ``(H, W, C)``."""
    height, width, channels = image.shape
    blocks = (height // factor, factor, width // factor, factor, channels)
    return image.reshape(blocks).mean(axis=(1, 3))


def of_sphere(size: tuple[int, int], circle: tuple[float, float, float]) -> Shown:
    """Surface of a sphere seen from afar, whose outline is a circle in pixels."""
    cx, cy, radius = circle
    height, width = size
    parts = int(np.clip(np.ceil(_PARTS / radius), 2, 8))
    offsets = (np.arange(parts) + 0.5) / parts
    x = (np.arange(width)[:, None] + offsets - cx) / radius  # [w, part]
    y = -(np.arange(height)[:, None] + offsets - cy) / radius
    shape = (height, width, parts, parts)
    right = np.broadcast_to(x[None, :, None, :], shape)
    up = np.broadcast_to(y[:, None, :, None], shape)
    squared = 1 - right**2 - up**2
    inside = squared > 0
    local = np.stack([right, up, np.sqrt(np.maximum(squared, 0))], axis=-1)
    local = np.where(inside[..., None], local, 0).reshape(height, width, -1, 3)
    normals = local @ CAMERA_TO_WORLD.T
    mask = inside.reshape(height, width, -1).mean(axis=-1)
    if not np.any(mask == 1):
        raise click.UsageError(
            f"--sphere {cx:g},{cy:g},{radius:g} covers no pixel of the {width} x "
            f"{height} picture."
        )
    mean = normals.sum(axis=2)
    return Shown(
        _gbuffer(mean, mask),
        normals,
        None,
        None,
        f"a sphere of radius {radius:g} pixels about ({cx:g}, {cy:g})",
    )


def of_normals(
    size: tuple[int, int],
    path: Path,
    frame: str,
    signed: bool,
    mask: Path | None,
    layer: str | None,
) -> Shown:
    """Surface of given normals, in a frame and a range that are named."""
    if path.suffix.lower() in (".png", ".jpg", ".jpeg"):
        raise click.UsageError(
            f"{path}: an 8-bit picture is decoded as light; give normals as EXR."
        )
    normals = io.read_vectors(path, layer=layer, isolate=True).astype(float)
    if normals.shape != (*size, 3):
        raise click.UsageError(
            f"--normals must have the picture's size {size[1]} x {size[0]} and three "
            f"channels; got {normals.shape[1]} x {normals.shape[0]}, {normals.shape[2]}."
        )
    chosen = np.ones(size) if mask is None else read_mask(mask, size)
    unknown = ~np.all(np.isfinite(normals), axis=-1)
    if mask is not None and np.any(unknown & (chosen > 0)):
        raise click.UsageError(
            f"--normals holds {int(np.sum(unknown & (chosen > 0)))} normals that are not "
            "finite where --mask is white."
        )
    normals = np.where(unknown[..., None], 0, normals)
    nothing = np.all(normals == 0, axis=-1)
    if not signed:
        if normals.min() < 0:
            raise click.UsageError(
                "--normals-range unsigned is for values in [0, 1]; got "
                f"{normals.min():.3g}. Is it signed?"
            )
        normals = 2 * normals - 1
    length = np.linalg.norm(normals, axis=-1)
    odd = ~nothing & (np.abs(length - 1) > 0.1)
    if odd.mean() > 0.2:
        raise click.UsageError(
            f"{odd.mean():.0%} of the normals are not of unit length as "
            f"{'signed' if signed else 'unsigned'} values; is --normals-range right?"
        )
    seen = ~nothing & ~odd
    unit = normals / np.where(seen, length, 1)[..., None]
    unit = np.where(seen[..., None], unit, 0)
    world = unit @ NORMAL_FRAMES[frame].T
    facing = seen
    if frame in words.SEEN_FRAMES:
        facing = world @ CAMERA_TO_WORLD[:, 2] > _FACING
    weights = (seen & facing).astype(float) * chosen
    if not weights.any():
        raise click.UsageError(
            f"no normal of {path} faces the camera in a pixel that counts; is "
            f"--normals-frame {frame} right? camera: z towards the camera, opencv: z away."
        )
    about = (
        f"normals of {path.name}, {frame} frame, {'signed' if signed else 'unsigned'}"
    )
    return Shown(_gbuffer(world, weights), world, weights, None, about)


def of_mesh(size: tuple[int, int], path: Path, camera: Camera, fit_l_max: int) -> Shown:
    """Surface of a mesh in its file's coordinates, with the shadows it casts on itself."""
    trace = trace_mesh(path, camera, size)
    ball = trace.gbuffer
    facing = np.sum(np.asarray(ball.normals * ball.views), axis=-1) > _FACING
    mask = ((np.asarray(ball.mask) == 1) & facing).astype(float)
    if not mask.any():
        raise click.UsageError(f"--camera does not see {path}.")
    rows = visible_cosine(trace, l_max=fit_l_max, directions=1024)
    return Shown(ball, None, mask, rows, f"{path.name} with its own shadows")


def read_mask(path: Path, size: tuple[int, int]) -> np.ndarray:
    """Read weights from a picture's first channel."""
    image = io.read_image(path, isolate=True)
    if image.min() == image.max() and path.suffix.lower() in (".png", ".tif", ".tiff"):
        image = io.read_image(
            path, alpha="only", isolate=True
        )  # no mask in its colours
    mask = image[..., 0]
    if mask.shape != size:
        raise click.UsageError(
            f"--mask must have the picture's size {size[1]} x {size[0]}; got "
            f"{mask.shape[1]} x {mask.shape[0]}."
        )
    if not np.any(mask > 0):
        raise click.UsageError(f"--mask {path} is black: it leaves no pixel.")
    return (mask > 0.5 * mask.max()).astype(float)  # white may be stored as 1


def _gbuffer(normals: np.ndarray, mask: np.ndarray) -> GBuffer:
    views = np.where(
        np.any(normals != 0, axis=-1, keepdims=True), CAMERA_TO_WORLD[:, 2], 0.0
    )
    return render.make_gbuffer(
        jnp.asarray(normals), mask=jnp.asarray(mask), views=jnp.asarray(views)
    )
