"""Materials that a mesh brings along: glTF's metallic-roughness, by texture or factor."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np


@dataclasses.dataclass(frozen=True, eq=False)
class Surface:
    """A mesh's own material.

    Attributes:
        corners: Texture coordinates of each face's corners, ``(F, 3, 2)``; None without.
        albedo: Linear base colour, ``(H, W, 3)``; one pixel for a factor alone.
        roughness: ``(H, W)``.
        metallic: ``(H, W)``.
    """

    corners: np.ndarray | None
    albedo: np.ndarray
    roughness: np.ndarray
    metallic: np.ndarray

    def at(self, faces: np.ndarray, shares: np.ndarray) -> np.ndarray:
        """Base colour, roughness and metallic at points of faces, ``(n, 5)``.

        Args:
            faces: Which face each point is on, ``(n,)``.
            shares: Barycentric coordinates, ``(n, 3)``.
        """
        uv = np.zeros((faces.size, 2))
        if self.corners is not None:
            uv = np.einsum("nk,nki->ni", shares, self.corners[faces])
        parts = [
            _read(image.reshape(*image.shape[:2], -1), uv)
            for image in (self.albedo, self.roughness, self.metallic)
        ]
        return np.concatenate(parts, axis=1)


def surface_of(mesh: Any) -> Surface | None:
    """The material of a trimesh mesh before its vertices are merged; None without one."""
    visual = getattr(mesh, "visual", None)
    material = getattr(visual, "material", None)
    if material is None:
        return None
    if hasattr(material, "to_pbr"):
        material = material.to_pbr()
    uv = getattr(visual, "uv", None)
    corners = None if uv is None else np.asarray(uv, float)[np.asarray(mesh.faces)]
    colour = np.ones((1, 1, 3))
    if getattr(material, "baseColorTexture", None) is not None:
        colour = _decoded(_pixels(material.baseColorTexture)[..., :3])
    colour = colour * _factor(getattr(material, "baseColorFactor", None), 1.0)[:3]
    rough, metal = np.ones((1, 1)), np.ones((1, 1))
    if getattr(material, "metallicRoughnessTexture", None) is not None:
        packed = _pixels(material.metallicRoughnessTexture)
        rough, metal = packed[..., 1], packed[..., 2]
    rough = rough * _factor(getattr(material, "roughnessFactor", None), 1.0)[0]
    metal = metal * _factor(getattr(material, "metallicFactor", None), 1.0)[0]
    return Surface(corners, colour, rough, metal)


def _pixels(image: Any) -> np.ndarray:
    """A PIL image as RGB in [0, 1]."""
    return np.asarray(image.convert("RGB"), float) / 255


def _decoded(encoded: np.ndarray) -> np.ndarray:
    """SRGB to linear [IEC 61966-2-1]."""
    return np.where(
        encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4
    )


def _factor(value: Any, default: float) -> np.ndarray:
    """A factor as numbers in [0, 1]: trimesh keeps some as bytes."""
    if value is None:
        return np.full(4, default)
    array = np.atleast_1d(np.asarray(value))
    scale = 255 if np.issubdtype(array.dtype, np.integer) and array.size > 1 else 1
    return array.astype(float) / scale


def _read(image: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Linear interpolation, repeated beyond [0, 1]; v = 0 is the last row's end."""
    height, width, _ = image.shape
    row, column = (1 - uv[:, 1]) * height - 0.5, uv[:, 0] * width - 0.5
    top, left = np.floor(row).astype(int), np.floor(column).astype(int)
    total = np.zeros((uv.shape[0], image.shape[2]))
    for i, down in ((0, 1 - (row - top)), (1, row - top)):
        for j, right in ((0, 1 - (column - left)), (1, column - left)):
            texel = image[(top + i) % height, (left + j) % width]
            total += texel * (down * right)[:, None]
    return total
