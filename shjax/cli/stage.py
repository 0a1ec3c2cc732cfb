"""Where the mesh of ``shjax render`` stands, and the camera before it."""

from __future__ import annotations

import math

import numpy as np

from shjax.render import Camera

TURNS = {"z": np.eye(3), "y": np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])}


def camera_at(azimuth: float, elevation: float, fov: float) -> Camera:
    """Camera at angles around the mesh and above its middle, degrees."""
    a, e, angle = (math.radians(v) for v in (azimuth, elevation, fov))
    distance = 1.08 / math.sin(angle / 2)
    origin = (
        distance * math.cos(e) * math.cos(a),
        distance * math.cos(e) * math.sin(a),
        distance * math.sin(e),
    )
    return Camera(origin=origin, fov=angle)


def placed(geometry, up: str):
    """Centred on its box, radius 1, z up; the file's own normals are turned with it."""
    vertices = np.asarray(geometry.vertices) @ TURNS[up].T
    centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    scale = 1 / (float(np.linalg.norm(vertices - centre, axis=1).max()) or 1.0)
    place = np.eye(4)
    place[:3, :3], place[:3, 3] = scale * TURNS[up], -scale * centre
    return geometry.apply_transform(place)


def as_latlong(envmap) -> np.ndarray:
    """Lat-long panorama of a map, of an even number of columns."""
    if envmap.layout == "latlong" and envmap.image.shape[1] % 2 == 0:
        return np.asarray(envmap.radiance)
    return np.asarray(envmap.to_latlong(512).radiance)
