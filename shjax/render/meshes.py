"""G-buffers of triangle meshes, by ray casting: embree through trimesh (extra ``mesh``).

Several rays a pixel give coverage and the mean normal of what a pixel shows. Nothing here
is differentiated; what is, starts from the G-buffer.
"""

from __future__ import annotations

import dataclasses
import os
import warnings
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from shjax.arrays import Array, check_count, check_vectors, picture_size
from shjax.render.camera import Camera, camera_rays, check_camera
from shjax.render.gbuffer import GBuffer
from shjax.render.loading import load_mesh, material_of

_MIN_COSINE = 0.02  # interpolated normals that turn away are bent to be seen
_RAYS_AT_ONCE = 2**20


@dataclasses.dataclass(frozen=True, eq=False)
class Trace:
    """Mesh seen by a camera: G-buffer, positions and geometry.

    Attributes:
        gbuffer: What the picture shows.
        positions: Mean point of what a pixel shows, ``(H, W, 3)``; zero where nothing.
        geometry: The mesh, as trimesh holds it.
    """

    gbuffer: GBuffer
    positions: Float[np.ndarray, "H W 3"]
    geometry: Any


def mesh(
    path: str | os.PathLike,
    camera: Camera,
    size: int | tuple[int, int],
    *,
    samples: int = 4,
    albedo: float = 1.0,
    material: bool = False,
) -> GBuffer:
    """Render the G-buffer of a mesh by ray casting.

    Args:
        path: OBJ, OFF or PLY.
        camera: In the file's own coordinates.
        size: Pixels of a square picture, or (height, width).
        samples: Rays along each side of a pixel.
        albedo: Of the whole mesh.
        material: Whether albedo, roughness and metallic come from the file: glTF's
            textures and factors, or what trimesh makes of others.

    Raises:
        ImportError: If trimesh is not installed.
        OSError: If the file cannot be opened.
        ValueError: If it cannot be read, a size is not positive, or it has no material.
    """
    return trace_mesh(
        path, camera, size, samples=samples, albedo=albedo, material=material
    ).gbuffer


def trace_mesh(
    path: str | os.PathLike | Any,
    camera: Camera,
    size: int | tuple[int, int],
    *,
    samples: int = 4,
    albedo: float = 1.0,
    material: bool = False,
) -> Trace:
    """Cast ``samples x samples`` rays through every pixel at a mesh.

    Args:
        path: A file, or a ``trimesh.Trimesh``.
        camera: In the mesh's own coordinates.
        size: Pixels of a square picture, or (height, width).
        samples: Rays along each side of a pixel.
        albedo: Of the whole mesh.
        material: Whether albedo, roughness and metallic come from the file: glTF's
            textures, factors and vertex colours, what trimesh makes of others, or the
            colours of vertices and faces alone (sRGB in PLY and OBJ, which have no
            other word for it). What else a material says is named in a warning.

    Returns:
        G-buffer (in JAX's default floating-point type), positions and the mesh.

    Raises:
        ImportError: If trimesh is not installed.
        OSError: If the file cannot be opened.
        ValueError: If it cannot be read, a size is not positive, or it has no material.
    """
    height, width = picture_size(size)
    check_count("samples", samples)
    check_camera(camera)
    geometry = load_mesh(path) if isinstance(path, (str, os.PathLike)) else path
    surface = material_of(geometry) if material else None
    if material and surface is None:
        raise ValueError(f"material must be in the file; {path} has none.")
    if surface is not None and surface.ignored:
        warnings.warn(
            f"not drawn of the mesh's material: {', '.join(surface.ignored)}.",
            stacklevel=2,
        )
    normals, positions = np.zeros((height * width, 3)), np.zeros((height * width, 3))
    own = np.zeros((height * width, 5))
    hits = np.zeros(height * width)
    offsets = (np.arange(samples) + 0.5) / samples - 0.5
    for down in offsets:
        for right in offsets:
            rays = camera_rays(height, width, camera, (float(down), float(right)))
            origins, directions = (np.asarray(a, float).reshape(-1, 3) for a in rays)
            found = _first_hits(geometry, origins, directions)
            normals[found.rays] += found.normals
            positions[found.rays] += found.points
            hits[found.rays] += 1
            if surface is not None:
                own[found.rays] += surface.at(found.faces, found.shares)
    _, centre = camera_rays(height, width, camera)
    views = -np.asarray(centre, float).reshape(-1, 3)
    seen = hits > 0
    normals = np.where(seen[:, None], _facing(normals, views), 0)
    positions /= np.maximum(hits, 1)[:, None]
    dtype = jnp.result_type(float)

    def picture(values):
        return jnp.asarray(values.reshape(height, width, *values.shape[1:]), dtype)

    own = picture(own / np.maximum(hits, 1)[:, None])
    plain = jnp.full((height, width, 1), albedo, dtype)
    gbuffer = GBuffer(
        picture(normals),
        picture(hits / samples**2),
        picture(np.where(seen[:, None], views, 0)),
        plain if surface is None else own[..., :3],
        positions=picture(positions),
        roughness=None if surface is None else own[..., 3],
        metallic=None if surface is None else own[..., 4],
    )
    return Trace(gbuffer, positions.reshape(height, width, 3), geometry)


@dataclasses.dataclass(frozen=True)
class _Hits:
    rays: np.ndarray
    points: np.ndarray
    normals: np.ndarray
    faces: np.ndarray
    shares: np.ndarray  # barycentric


def _first_hits(geometry, origins: np.ndarray, directions: np.ndarray) -> _Hits:
    """Points and smooth normals where rays first meet the mesh."""
    faces, rays, points = geometry.ray.intersects_id(
        origins, directions, multiple_hits=False, return_locations=True
    )
    faces, rays = np.asarray(faces, int), np.asarray(rays, int)
    if not rays.size:
        none = np.zeros((0, 3))
        return _Hits(rays, none, none, faces, none)
    corners = np.asarray(geometry.triangles)[faces]
    shares = _barycentric(corners, np.asarray(points))
    smooth = np.asarray(geometry.vertex_normals)[np.asarray(geometry.faces)[faces]]
    normals = np.einsum("nk,nki->ni", shares, smooth)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    flat = np.asarray(geometry.face_normals)[faces]
    normals = np.where(length > 1e-6, normals / np.maximum(length, 1e-6), flat)
    # A sheet is seen from both sides.
    behind = np.sum(flat * directions[rays], axis=1) > 0
    normals = np.where(behind[:, None], -normals, normals)
    return _Hits(rays, np.asarray(points), normals, faces, shares)


def _barycentric(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    c = points - corners[:, 0]
    aa, ab, bb = (np.sum(x * y, axis=1) for x, y in ((a, a), (a, b), (b, b)))
    ca, cb = np.sum(c * a, axis=1), np.sum(c * b, axis=1)
    area = np.maximum(aa * bb - ab * ab, 1e-300)
    v, w = (bb * ca - ab * cb) / area, (aa * cb - ab * ca) / area
    shares = np.clip(np.stack([1 - v - w, v, w], axis=1), 0, 1)
    return shares / np.maximum(shares.sum(axis=1, keepdims=True), 1e-12)


def _facing(normals: np.ndarray, views: np.ndarray) -> np.ndarray:
    """Unit normals; those that turn away from the viewer bent to just face it."""
    normals = normals / np.maximum(
        np.linalg.norm(normals, axis=1, keepdims=True), 1e-12
    )
    cosine = np.sum(normals * views, axis=1, keepdims=True)
    bent = normals + np.maximum(_MIN_COSINE - cosine, 0) * views
    return bent / np.maximum(np.linalg.norm(bent, axis=1, keepdims=True), 1e-12)


def visibility(
    trace: Trace, directions: Float[Array, "N 3"]
) -> Bool[np.ndarray, "H W N"]:
    """Visibility of directions from each pixel's surface past the rest of the mesh.

    Args:
        trace: From :func:`trace_mesh`.
        directions: Unit vectors.

    Returns:
        True where nothing is in the way; False below the pixel's own horizon, and where
        a pixel shows nothing.

    Raises:
        ValueError: If the shape is wrong.
    """
    check_vectors("directions", directions)
    towards = np.asarray(directions, float).reshape(-1, 3)
    rows, columns = np.nonzero(np.asarray(trace.gbuffer.mask) > 0)
    points = trace.positions[rows, columns]
    normals = np.asarray(trace.gbuffer.normals, float)[rows, columns]
    extent = float(np.linalg.norm(np.ptp(np.asarray(trace.geometry.vertices), axis=0)))
    points = points + 1e-4 * extent * normals  # off the surface itself
    free = normals @ towards.T > 0
    point, direction = np.nonzero(free)
    for start in range(0, point.size, _RAYS_AT_ONCE):
        some = slice(start, start + _RAYS_AT_ONCE)
        blocked = trace.geometry.ray.intersects_any(
            points[point[some]], towards[direction[some]]
        )
        free[point[some], direction[some]] = ~np.asarray(blocked)
    seen = np.zeros((*trace.gbuffer.mask.shape, towards.shape[0]), bool)
    seen[rows, columns] = free
    return seen
