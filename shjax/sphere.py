"""Directions on the unit sphere and the lat-long pixel grid.

This module hides how a stored panorama's pixels map to directions. The frame is
right-handed with +z up and theta = 0: ``(x, y, z) = (sin t cos p, sin t sin p, cos t)``.
Row ``i`` lies at ``t = pi (i + 1/2) / n_theta`` and column ``j`` at
``p = pi - 2 pi (j + 1/2) / n_phi``: row 0 is up, the image centre looks along +x and
``u = 0.25`` along +y, as the panorama is seen from inside.
"""

from __future__ import annotations

import numpy as np


def latlong_theta(n_theta: int) -> np.ndarray:
    """Polar angles of the rows' centres, ``(n_theta,)``, radians."""
    return np.pi * (np.arange(n_theta) + 0.5) / n_theta


def latlong_phi(n_phi: int) -> np.ndarray:
    """Azimuths of the columns' centres, ``(n_phi,)``, radians, falling from pi."""
    return np.pi - 2 * np.pi * (np.arange(n_phi) + 0.5) / n_phi


def spherical_directions(theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Unit vectors of broadcastable polar angles and azimuths, ``(..., 3)``."""
    theta, phi = np.broadcast_arrays(theta, phi)
    sine = np.sin(theta)
    return np.stack([sine * np.cos(phi), sine * np.sin(phi), np.cos(theta)], axis=-1)


def latlong_directions(n_theta: int, n_phi: int) -> np.ndarray:
    """Unit vectors of the pixel centres, ``(n_theta, n_phi, 3)``, float64."""
    return spherical_directions(latlong_theta(n_theta)[:, None], latlong_phi(n_phi))


def latlong_solid_angles(n_theta: int, n_phi: int) -> np.ndarray:
    """Exact solid angle of a pixel in each row, ``(n_theta,)``, steradians.

    >>> float(latlong_solid_angles(4, 8).sum() * 8 / np.pi)
    4.0
    """
    # cos a - cos b as a product: no digits are lost in thin rows at the poles.
    half = np.pi / (2 * n_theta)
    return (2 * np.pi / n_phi) * 2 * np.sin(latlong_theta(n_theta)) * np.sin(half)


def latlong_pixels(
    directions: np.ndarray, n_theta: int, n_phi: int
) -> tuple[np.ndarray, np.ndarray]:
    """Fractional row and column of directions; a pixel's centre is an integer.

    Args:
        directions: Unit vectors, ``(..., 3)``.
        n_theta: Rows.
        n_phi: Columns.

    Returns:
        Row in [-1/2, n_theta - 1/2] and column in [-1/2, n_phi - 1/2], each ``(...)``.
    """
    x, y, z = np.moveaxis(np.asarray(directions, np.float64), -1, 0)
    theta, phi = np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)
    return pixel_coordinates(theta, phi, n_theta, n_phi)


def pixel_coordinates(theta, phi, n_theta, n_phi):
    """Fractional row and column of polar angles, arrays of NumPy or of JAX.

    The product comes last. A compiler may compute the row twice, for the pixel's number
    and for its weight; a sum that comes last is fused with the product in one of the two
    only, and on a pixel's centre the number and the weight then tell of different pixels.
    """
    row = (theta - np.pi / (2 * n_theta)) * (n_theta / np.pi)
    column = ((np.pi - np.pi / n_phi) - phi) * (n_phi / (2 * np.pi))
    return row, column


def fibonacci_directions(n: int) -> np.ndarray:
    """Nearly uniform unit vectors on a Fibonacci spiral, ``(n, 3)``, float64.

    Their mean estimates an average over the sphere with an error far below that of
    random points [Swinbank and Purser 2006].
    """
    z = 1 - (2 * np.arange(n) + 1) / n
    golden = np.pi * (3 - np.sqrt(5.0))
    return spherical_directions(np.arccos(z), golden * np.arange(n))


def cube_directions(size: int) -> np.ndarray:
    """Unit vectors of a cube map's pixels, ``(6, size, size, 3)``, float64.

    Faces +x, -x, +y, -y, +z, -z. Each is stored as seen from inside with the panorama's
    up: rows fall in z on the four sides; the top face's lower edge joins face +x, as the
    bottom face's upper edge does.
    """
    across = (np.arange(size) + 0.5) * (2 / size) - 1
    right, down = np.meshgrid(across, across)
    one = np.ones_like(right)
    faces = [
        (one, -right, -down),
        (-one, right, -down),
        (right, one, -down),
        (-right, -one, -down),
        (down, -right, one),
        (-down, -right, -one),
    ]
    vectors = np.stack([np.stack(face, axis=-1) for face in faces]) + 0.0  # no -0
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def icosahedron() -> np.ndarray:
    """Vertices of an icosahedron, two at the poles: ``(12, 3)``, float64."""
    turn = 2 * np.pi * np.arange(5) / 5
    ring = np.arctan(2.0)
    upper = spherical_directions(np.full(5, ring), turn)
    lower = spherical_directions(np.full(5, np.pi - ring), turn + np.pi / 5)
    poles = np.array([[0.0, 0, 1], [0, 0, -1]])
    return np.concatenate([poles[:1], upper, lower, poles[1:]])


def yaw_pitch_roll(yaw: float, pitch: float, roll: float) -> np.ndarray:
    """Rotation matrix of a light, ``(3, 3)``, from yaw, pitch and roll in radians.

    Applied in the order roll, pitch, yaw: roll about the panorama's centre (+x),
    clockwise as seen from inside; pitch raises the centre; yaw turns it to the left.
    """
    (cy, sy), (cp, sp), (cr, sr) = ((np.cos(a), np.sin(a)) for a in (yaw, pitch, roll))
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    about_y = np.array([[cp, 0, -sp], [0, 1, 0], [sp, 0, cp]])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return about_z @ about_y @ about_x
