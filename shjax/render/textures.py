"""Materials that a mesh brings along: glTF's metallic-roughness, by texture or factor."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np


@dataclasses.dataclass(frozen=True, eq=False)
class _Part:
    """The material of some of a mesh's faces.

    Attributes:
        count: How many faces it has.
        corners: Texture coordinates of each face's corners, ``(F, 3, 2)``; None without.
        colours: Linear colours of the corners, ``(F, 3, 3)``; None without.
        albedo: Linear base colour, ``(H, W, 3)``; one pixel for a factor alone.
        roughness: ``(H, W)``.
        metallic: ``(H, W)``.
        ignored: What the file says and is not drawn, in the file's own words.
    """

    count: int
    corners: np.ndarray | None
    colours: np.ndarray | None
    albedo: np.ndarray
    roughness: np.ndarray
    metallic: np.ndarray
    ignored: tuple[str, ...] = ()

    def at(self, faces: np.ndarray, shares: np.ndarray) -> np.ndarray:
        """Material at points of this part's faces, as :meth:`Surface.at`."""
        uv = np.zeros((faces.size, 2))
        if self.corners is not None:
            uv = np.einsum("nk,nki->ni", shares, self.corners[faces])
        colour, *rest = [
            _read(image.reshape(*image.shape[:2], -1), uv)
            for image in (self.albedo, self.roughness, self.metallic)
        ]
        if self.colours is not None:
            colour = colour * np.einsum("nk,nki->ni", shares, self.colours[faces])
        return np.concatenate([colour, *rest], axis=1)


@dataclasses.dataclass(frozen=True, eq=False)
class Surface:
    """Materials of a mesh, part by part, in the order of its faces."""

    parts: tuple[_Part, ...]

    @property
    def ignored(self) -> tuple[str, ...]:
        """Properties that the file gives and that are not drawn."""
        return tuple(sorted({name for part in self.parts for name in part.ignored}))

    def at(self, faces: np.ndarray, shares: np.ndarray) -> np.ndarray:
        """Base colour, roughness and metallic at points of faces, ``(n, 5)``.

        Args:
            faces: Which face each point is on, ``(n,)``.
            shares: Barycentric coordinates, ``(n, 3)``.
        """
        values, start = np.zeros((faces.size, 5)), 0
        for part in self.parts:
            own = (faces >= start) & (faces < start + part.count)
            values[own] = part.at(faces[own] - start, shares[own])
            start += part.count
        return values


def surface_of(parts: Any, header: dict) -> Surface | None:
    """Materials of trimesh meshes as they were loaded; None if there are none.

    Args:
        parts: Pairs of faces ``(F, 3)`` and the ``visual`` of their vertices.
        header: glTF's own JSON, for what trimesh keeps of it in 8 bits; {} of others.
    """
    made = [_part(np.asarray(faces), visual, header) for faces, visual in parts]
    if all(part is None for part in made):
        return None
    return Surface(
        tuple(
            _plain(len(faces)) if part is None else part
            for part, (faces, _) in zip(made, parts, strict=True)
        )
    )


def _plain(count: int) -> _Part:
    """White and matte, for what has no material beside something that has one."""
    one = np.ones((1, 1))
    return _Part(count, None, None, np.ones((1, 1, 3)), one, 0 * one)


def _part(faces: np.ndarray, visual: Any, header: dict) -> _Part | None:
    """One mesh's material; colours alone, as PLY and OBJ give them, are a picture's."""
    material = getattr(visual, "material", None)
    if material is None:
        if getattr(visual, "kind", None) not in ("vertex", "face"):
            return None
        if visual.kind == "vertex":
            colours = np.asarray(visual.vertex_colors)[faces]
        else:
            colours = np.repeat(np.asarray(visual.face_colors)[:, None], 3, axis=1)
        linear = _decoded(colours[..., :3] / 255)
        return dataclasses.replace(_plain(len(faces)), colours=linear)
    if hasattr(material, "to_pbr"):
        material = material.to_pbr()
    uv = getattr(visual, "uv", None)
    corners = None if uv is None else np.asarray(uv, float)[faces]
    colours = visual.vertex_attributes.get("color", None)
    if colours is not None:
        colours = _unit(np.asarray(colours))[faces][..., :3]
    colour = np.ones((1, 1, 3))
    if getattr(material, "baseColorTexture", None) is not None:
        colour = _decoded(_pixels(material.baseColorTexture)[..., :3])
    colour = colour * _base_factor(material, header)
    rough, metal = np.ones((1, 1)), np.ones((1, 1))
    if getattr(material, "metallicRoughnessTexture", None) is not None:
        packed = _pixels(material.metallicRoughnessTexture)
        rough, metal = packed[..., 1], packed[..., 2]
    rough = rough * _factor(getattr(material, "roughnessFactor", None), 1.0)[0]
    metal = metal * _factor(getattr(material, "metallicFactor", None), 1.0)[0]
    ignored = _ignored(material, header)
    return _Part(len(faces), corners, colours, colour, rough, metal, ignored)


def _base_factor(material: Any, header: dict) -> np.ndarray:
    """Linear base colour ``(3,)``: the file's own number where trimesh rounded it."""
    rounded = _factor(getattr(material, "baseColorFactor", None), 1.0)[:3]
    for own in _of_name(material, header):
        exact = own.get("pbrMetallicRoughness", {}).get("baseColorFactor", [1, 1, 1])
        exact = np.asarray(exact, float)[:3]
        if exact.shape == (3,) and np.max(np.abs(exact - rounded)) < 1 / 255:
            return exact
    return rounded


def _ignored(material: Any, header: dict) -> tuple[str, ...]:
    """What a material says beside base colour, roughness and metallic."""
    found = [
        name
        for name in ("normalTexture", "occlusionTexture", "emissiveTexture")
        if getattr(material, name, None) is not None
    ]
    if np.any(_factor(getattr(material, "emissiveFactor", None), 0.0)):
        found.append("emissiveFactor")
    if getattr(material, "alphaMode", None) in ("MASK", "BLEND"):
        found.append(f"alphaMode {material.alphaMode}")
    for own in _of_name(material, header):
        found += sorted(own.get("extensions", {}))
    return tuple(found)


def _of_name(material: Any, header: dict) -> list[dict]:
    name = getattr(material, "name", None)
    return [own for own in header.get("materials", []) if own.get("name") == name]


def _unit(values: np.ndarray) -> np.ndarray:
    """Whole numbers of a file as shares of their largest, floats as they are."""
    if np.issubdtype(values.dtype, np.integer):
        return values / np.iinfo(values.dtype).max
    return values.astype(float)


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
