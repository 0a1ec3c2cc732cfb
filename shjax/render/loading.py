"""Mesh files by trimesh (extra ``mesh``), with their own normals and materials."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from shjax.render.textures import Surface, surface_of

_SURFACE = "shjax_surface"  # where a mesh's own material is kept


def load_mesh(path: str | os.PathLike) -> Any:
    """Load a mesh: OBJ, OFF, PLY, glTF or what else trimesh reads, as one.

    Normals are the file's own, hard edges included; smooth ones are made where it gives
    none. Its material is kept beside it, see :func:`trace_mesh`.

    Raises:
        ImportError: If trimesh is not installed.
        OSError: If the file cannot be opened.
        ValueError: If it holds no triangles; the message names the file.
    """
    path = Path(path)
    trimesh = _trimesh()
    with path.open("rb") as file:
        header = _gltf_header(file)
    try:
        loaded = _scene(trimesh, path, header)
        parts = []
        for node in loaded.graph.nodes_geometry:
            place, name = loaded.graph[node]
            part = loaded.geometry[name]
            if isinstance(part, trimesh.Trimesh):
                parts.append((_placed(trimesh, part, place), part.visual))
        surface = surface_of([(mesh.faces, visual) for mesh, visual in parts], header)
        for mesh, _ in parts:
            if not _own_normals(mesh):
                mesh.merge_vertices(merge_tex=True, merge_norm=True)
        mesh = trimesh.util.concatenate([mesh for mesh, _ in parts]) if parts else None
    except Exception as error:  # readers of many formats raise what they like
        raise ValueError(f"{path}: trimesh cannot read it ({error}).") from error
    if mesh is None or not len(mesh.faces) or not np.all(np.isfinite(mesh.vertices)):
        raise ValueError(
            f"{path}: holds no triangles, or vertices that are not finite."
        )
    mesh.metadata[_SURFACE] = surface
    return mesh


def not_drawn(mesh: Any) -> tuple[str, ...]:
    """List what a mesh's material says and is not drawn."""
    surface = material_of(mesh)
    return () if surface is None else surface.ignored


def material_of(mesh: Any) -> Surface | None:
    """Material of a mesh from :func:`load_mesh`; None if its file has none."""
    return mesh.metadata.get(_SURFACE)


def _scene(trimesh: Any, path: Path, header: dict) -> Any:
    """The file as trimesh's scene; colours without a material keep all their bits."""
    if not header:
        return trimesh.load_scene(path, process=False)
    gltf, looks = trimesh.exchange.gltf, trimesh.visual
    with path.open("rb") as file:
        read = gltf.load_glb if file.read(4) == b"glTF" else gltf.load_gltf
        file.seek(0)
        resolver = trimesh.resolvers.FilePathResolver(path)
        found = read(file, resolver=resolver, process=False)
    for mesh in found["geometry"].values():
        if "faces" in mesh and "vertex_colors" in mesh:
            colours = mesh.pop("vertex_colors")
            mesh["visual"] = looks.TextureVisuals(material=looks.material.PBRMaterial())
            mesh["visual"].vertex_attributes["color"] = colours
    return trimesh.load_scene(found)


def _own_normals(mesh: Any) -> bool:
    """Whether a trimesh mesh holds normals that were given, not computed."""
    return "vertex_normals" in mesh._cache


def _placed(trimesh: Any, mesh: Any, place: np.ndarray) -> Any:
    """A copy without its looks, at its place in the scene."""
    normals = mesh.vertex_normals if _own_normals(mesh) else None
    copy = trimesh.Trimesh(
        np.array(mesh.vertices),
        np.array(mesh.faces),
        vertex_normals=normals,
        process=False,
    )
    return copy.apply_transform(place)


def _gltf_header(file: BinaryIO) -> dict:
    """The JSON of a glTF file, binary or not; {} of any other."""
    start = file.read(20)
    try:
        if start[:4] == b"glTF":
            text = file.read(int.from_bytes(start[12:16], "little"))
        elif start.lstrip()[:1] == b"{":
            text = start + file.read()
        else:
            return {}
        found = json.loads(text)
    except ValueError:
        return {}  # trimesh says what is wrong with it
    return found if isinstance(found, dict) else {}


def _trimesh() -> Any:
    try:
        import embreex  # noqa: F401  # trimesh takes it for its rays where it is found
        import trimesh
    except ImportError as error:
        raise ImportError(
            "meshes need trimesh and embreex: pip install 'shjax[mesh]'"
        ) from error
    return trimesh
