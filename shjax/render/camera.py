"""Cameras and the rays through their pixels."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from shjax.vectors import normalize

Number = float | int | np.floating | np.integer
Vector = Sequence[Number] | np.ndarray


@dataclasses.dataclass(frozen=True)
class Camera:
    """Camera, perspective or orthographic, that looks from ``origin`` at ``target``.

    Attributes:
        origin: Where it stands.
        target: What the image's centre shows.
        up: Points up in the image; not along the line of sight.
        width: Width of the view of an orthographic camera, scene units.
        fov: Horizontal field of view of a perspective one, radians; None: orthographic.

    Vectors may be any three numbers, in a tuple, a list or an array.

    Raises:
        ValueError: If a vector is not three finite numbers, or a size is no number.
    """

    origin: Vector = (-4.0, 0.0, 0.0)
    target: Vector = (0.0, 0.0, 0.0)
    up: Vector = (0.0, 0.0, 1.0)
    width: Number = 2.1
    fov: Number | None = None

    def __post_init__(self) -> None:
        """Numbers of any kind become floats: a camera is a key of compiled programs."""
        for name in ("origin", "target", "up"):
            object.__setattr__(self, name, _floats(name, getattr(self, name), 3))
        for name in ("width", "fov"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, _floats(name, value, 0))


def _floats(name: str, value: Any, size: int) -> Any:
    """A number (size 0) or so many numbers as floats, whatever holds them."""
    rule = f"camera.{name} must be {size or 'a'} finite number{'s' * bool(size)}"
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        array = np.asarray(None)
    if array.dtype.kind not in "iuf" or array.shape != ((size,) if size else ()):
        raise ValueError(f"{rule}; got {value!r}.")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{rule}; got {value!r}.")
    return tuple(array.astype(float).tolist()) if size else float(array)


def check_camera(camera: Camera) -> None:
    """Refuse a camera that sees nothing.

    Raises:
        ValueError: If it looks along its own up, or a size is out of range.
    """
    line = [t - o for t, o in zip(camera.target, camera.origin, strict=True)]
    up = camera.up
    cross = [
        line[1] * up[2] - line[2] * up[1],
        line[2] * up[0] - line[0] * up[2],
        line[0] * up[1] - line[1] * up[0],
    ]
    if math.hypot(*cross) <= 1e-6 * math.hypot(*line) * math.hypot(*up):
        raise ValueError(f"camera must not look along its up vector; got {camera}.")
    if camera.fov is not None and not 0 < camera.fov < math.pi:
        raise ValueError(f"camera.fov must lie between 0 and pi; got {camera.fov}.")
    if camera.width <= 0:
        raise ValueError(f"camera.width must be positive; got {camera.width}.")


def camera_rays(
    height: int,
    width: int,
    camera: Camera,
    offset: tuple[float, float] | jax.Array = (0.0, 0.0),
) -> tuple[jax.Array, jax.Array]:
    """Origins and unit directions of the rays through the pixels.

    Args:
        height: Rows.
        width: Columns.
        camera: The camera.
        offset: Down and right from each pixel's centre, in pixels.

    Returns:
        Origins and directions, each ``(H, W, 3)``.
    """
    dtype = jnp.result_type(float)
    origin, target, up = (
        jnp.asarray(v, dtype) for v in (camera.origin, camera.target, camera.up)
    )
    forward = normalize(target - origin)
    right = normalize(jnp.cross(forward, up))
    up = jnp.cross(right, forward)
    half = camera.width / 2 if camera.fov is None else math.tan(camera.fov / 2)
    # From the middle of the picture, so that both halves round alike.
    across = jnp.asarray(np.arange(width) + 0.5 - width / 2, dtype) + offset[1]
    down = jnp.asarray(np.arange(height) + 0.5 - height / 2, dtype) + offset[0]
    across, down = (pixels * (2 * half / width) for pixels in (across, down))
    origin, forward, right, up = (v[None, None] for v in (origin, forward, right, up))
    plane = across[None, :, None] * right - down[:, None, None] * up
    if camera.fov is None:
        return origin + plane, jnp.broadcast_to(forward, plane.shape)
    return jnp.broadcast_to(origin, plane.shape), normalize(forward + plane)
