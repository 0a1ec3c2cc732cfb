"""Discs: the angular map, the mirror ball, and the dual paraboloid.

A disc is a radial map ``theta(rho)`` of the unit circle, theta from the disc's axis.
What lies outside the circle is not part of the map. A pixel that the circle cuts has the
solid angle of its part within; where its own centre lies outside, that part is given to
the nearest pixel within, so that the whole is 4 pi.

References:
    [Debevec 1998] Rendering synthetic objects into real scenes: angular maps.
    [HS98] Heidrich, Seidel. View-independent environment maps: dual paraboloids.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from shjax.layouts.layout import (
    Layout,
    Place,
    from_view_axes,
    to_view_axes,
    unit_square,
)


def _angular_theta(rho):
    return np.pi * rho


def _mirror_theta(rho):
    # The mirror image of a direction: twice the normal's angle. Beyond the rim the map
    # comes back on the other side.
    theta = 2 * np.arcsin(np.clip(np.minimum(rho, 2 - rho), -1, 1))
    return np.where(rho > 1, 2 * np.pi - theta, theta)


def _paraboloid_theta(rho):
    return 2 * np.arctan(rho)


def _on_disc(right, up, theta: Callable) -> np.ndarray:
    rho = np.hypot(right, up)
    angle = theta(rho)
    scale = np.sin(angle) / np.where(rho == 0, 1, rho)
    return from_view_axes(right * scale, up * scale, np.cos(angle))


def _single(theta: Callable, rho_of_theta: Callable, density: Callable) -> Layout:
    """A layout that is one disc, forward at its centre."""

    def charts(height: int, width: int) -> np.ndarray:
        return _membership(height)

    def towards(chart, row, column, height: int, width: int) -> np.ndarray:
        return _on_disc(*unit_square(row, column, height), theta)

    def locate(directions: np.ndarray, height: int, width: int) -> Place:
        right, up, forward = to_view_axes(directions)
        across = np.hypot(right, up)
        rho = rho_of_theta(np.arctan2(across, forward))
        scale = rho / np.where(across == 0, 1, across)
        # Exactly behind, any point of the rim will do.
        right = np.where((across == 0) & (forward < 0), 1.0, right * scale)
        chart = np.zeros(rho.shape, np.int32)
        return chart, *_in_tile(right, up * scale, height)

    def solid_angles(height: int, width: int) -> np.ndarray:
        return _disc_solid_angles(height, density, 4 * np.pi)

    return Layout((1, 1), charts, towards, locate, solid_angles)


def _in_tile(right, up, side: int) -> tuple[np.ndarray, np.ndarray]:
    return (1 - up) * (side / 2) - 0.5, (1 + right) * (side / 2) - 0.5


def _membership(side: int) -> np.ndarray:
    right, up = unit_square(np.arange(side)[:, None], np.arange(side), side)
    return np.where(np.hypot(right, up) < 1, 0, -1).astype(np.int32)


def _both_charts(height: int, width: int) -> np.ndarray:
    front = _membership(height)
    return np.concatenate([front, np.where(front < 0, front, 1)], axis=1)


def _both_towards(chart, row, column, height: int, width: int) -> np.ndarray:
    column = np.asarray(column) - np.asarray(chart) * height
    front = _on_disc(*unit_square(row, column, height), _paraboloid_theta)
    # The second disc is seen when one has turned round: about the vertical.
    turned = front * np.array([-1.0, -1.0, 1.0])
    return np.where((np.asarray(chart) == 1)[..., None], turned, front)


def _both_locate(directions: np.ndarray, height: int, width: int) -> Place:
    right, up, forward = to_view_axes(directions)
    behind = forward < 0
    scale = 1 / (1 + np.abs(forward))
    row, column = _in_tile(np.where(behind, -right, right) * scale, up * scale, height)
    chart = behind.astype(np.int32)
    return chart, row, column + chart * height


def _both_solid_angles(height: int, width: int) -> np.ndarray:
    one = _disc_solid_angles(height, lambda rho: 4 / (1 + rho**2) ** 2, 2 * np.pi)
    return np.concatenate([one, one], axis=1)


def _disc_solid_angles(side: int, density: Callable, total: float) -> np.ndarray:
    """Integrals of a density over each pixel within the unit circle."""
    step = 2 / side
    nodes, weights = np.polynomial.legendre.leggauss(3)
    right, up = unit_square(np.arange(side)[:, None], np.arange(side), side)
    whole = np.zeros((side, side))
    for dv, wv in zip(nodes, weights, strict=True):
        for du, wu in zip(nodes, weights, strict=True):
            rho = np.hypot(right + du * step / 2, up + dv * step / 2)
            whole += wu * wv / 4 * density(np.minimum(rho, 1)) * step**2
    far = np.hypot(np.abs(right) + step / 2, np.abs(up) + step / 2)
    near = np.hypot(
        np.maximum(np.abs(right) - step / 2, 0), np.maximum(np.abs(up) - step / 2, 0)
    )
    angles = np.where(far <= 1, whole, 0.0)
    rows, columns = np.nonzero((far > 1) & (near < 1))
    x, y = right[0, columns], up[rows, 0]
    cut = _cut_pixels(x, y, step, density)
    # A pixel whose centre lies outside holds no light of the map: its part within the
    # circle goes to a pixel towards the middle.
    rho = np.hypot(x, y)
    far_in = np.maximum(rho - 1.5 * step, 0) / np.maximum(rho, 1)
    inward = np.where(rho < 1, 1.0, far_in)
    at_row, at_column = (
        np.clip(np.round(place).astype(int), 0, side - 1)
        for place in _in_tile(x * inward, y * inward, side)
    )
    np.add.at(angles, (at_row, at_column), cut)
    return angles * (total / angles.sum())


def _cut_pixels(x, y, step: float, density: Callable) -> np.ndarray:
    """The same integral over the parts within the circle of pixels that it cuts."""
    nodes, weights = np.polynomial.legendre.leggauss(24)
    heights, shares = np.polynomial.legendre.leggauss(3)
    total = np.zeros(x.shape)
    for node, weight in zip(nodes, weights, strict=True):
        at = x + node * step / 2
        edge = np.sqrt(np.maximum(1 - at**2, 0))
        low, high = np.maximum(y - step / 2, -edge), np.minimum(y + step / 2, edge)
        length = np.maximum(high - low, 0)
        for height, share in zip(heights, shares, strict=True):
            rho = np.hypot(at, (low + high) / 2 + height * length / 2)
            total += weight * share / 4 * step * length * density(np.minimum(rho, 1))
    return total


ANGULAR = _single(
    _angular_theta,
    lambda theta: theta / np.pi,
    lambda rho: np.pi**2 * np.sinc(rho),  # sin(theta) / theta, theta = pi rho
)
MIRROR_BALL = _single(
    _mirror_theta,
    lambda theta: np.sin(theta / 2),
    lambda rho: np.full_like(rho, 4.0),  # the mirror ball keeps area
)
DUAL_PARABOLOID = Layout(
    (2, 1), _both_charts, _both_towards, _both_locate, _both_solid_angles
)
