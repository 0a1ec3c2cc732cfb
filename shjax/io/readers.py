"""Which reader a file is for, told from its first bytes; errors that name the file."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from shjax.io import exr, other, radiance, raw
from shjax.io.decoded import Decoded, check_size, from_array
from shjax.layouts.cubes import FACES

SUFFIXES = (
    ".exr",
    ".hdr",
    ".pic",
    ".rgbe",
    ".xyze",
    ".pfm",
    ".npy",
    ".float",
    ".tif",
    ".tiff",
    ".png",
    ".jpg",
    ".jpeg",
)
PRIMARIES_CHOICES = ("rec709", "keep")
_FACE_NAMES = {
    "px": "px",
    "posx": "px",
    "right": "px",
    "nx": "nx",
    "negx": "nx",
    "left": "nx",
    "py": "py",
    "posy": "py",
    "top": "py",
    "up": "py",
    "ny": "ny",
    "negy": "ny",
    "bottom": "ny",
    "down": "ny",
    "pz": "pz",
    "posz": "pz",
    "front": "pz",
    "nz": "nz",
    "negz": "nz",
    "back": "nz",
}


def read(
    path: Path,
    *,
    max_pixels: int,
    layer: str | None = None,
    alpha: str = "drop",
    primaries: str = "rec709",
    vectors: bool = False,
    called: str | None = None,
) -> Decoded:
    """Read an image by the reader that its first bytes tell.

    Args:
        path: A file, or a folder that holds the six faces of a cube.
        max_pixels: Larger images are refused before they are decoded.
        layer: Part or layer of an EXR.
        alpha: One of :data:`shjax.io.exr.ALPHA_CHOICES`; an image whose colours were not
            multiplied by its alpha (PNG) is never divided by it.
        primaries: One of :data:`PRIMARIES_CHOICES`.
        vectors: Whether an EXR's channels are components of vectors, left as they are.
        called: The file's name in messages; default ``path``.

    Raises:
        OSError: If the file cannot be opened.
        ValueError: If it cannot be read; both name the file.
    """
    if alpha not in exr.ALPHA_CHOICES:
        raise ValueError(
            f"alpha must be one of {', '.join(exr.ALPHA_CHOICES)}; got {alpha!r}."
        )
    if primaries not in PRIMARIES_CHOICES:
        raise ValueError(
            f"primaries must be one of {', '.join(PRIMARIES_CHOICES)}; got {primaries!r}."
        )
    name = called or str(path)
    try:
        name.encode()
    except UnicodeEncodeError:
        raise ValueError(f"{name}: its name is not UTF-8; rename it.") from None
    if path.is_dir():
        faces = cube_faces(path)
        if faces is None:
            raise IsADirectoryError(
                f"{name}: is a folder, not an image (nor the six faces of a cube)."
            )
        return _six_faces(
            name, faces, max_pixels=max_pixels, alpha=alpha, primaries=primaries
        )
    with naming(name):
        if vectors and _is_exr(path):
            found = exr.read_vectors(path, max_pixels=max_pixels, layer=layer)
            return from_array(found, "OpenEXR vectors")
        return _read_file(path, max_pixels, layer, alpha, primaries)


def _is_exr(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(len(exr.MAGIC)) == exr.MAGIC


@contextlib.contextmanager
def naming(path: Path | str) -> Iterator[None]:
    """Turn whatever a reader raises into an OSError or ValueError with the file's name.

    Raises:
        OSError: If the file cannot be opened.
        ValueError: If it cannot be read.
    """
    try:
        yield
    except OSError as error:
        raise type(error)(f"{path}: {error.strerror or error}.") from None
    except MemoryError:
        raise ValueError(f"{path}: does not fit into memory.") from None
    except ValueError as error:
        raise ValueError(f"{path}: {str(error).rstrip('.')}.") from error
    except Exception as error:  # a damaged file may raise anything in a library
        raise ValueError(f"{path}: damaged ({error!r}).") from error


def _read_file(
    path: Path, max_pixels: int, layer: str | None, alpha: str, primaries: str
) -> Decoded:
    if not path.is_file() and path.exists():
        raise ValueError("is not a file")
    with path.open("rb") as file:
        start = file.read(16)
    if not start:
        raise ValueError("the file is empty")
    if start.startswith(exr.MAGIC):
        return exr.read_exr(
            path, max_pixels=max_pixels, layer=layer, alpha=alpha, primaries=primaries
        )
    if layer is not None:
        raise ValueError(f"layer {layer!r} was asked for, which only an EXR has")
    if start.startswith(radiance.MAGIC):
        return radiance.read_radiance(path, max_pixels=max_pixels, primaries=primaries)
    if start.startswith(raw.PFM_MAGIC):
        return raw.read_pfm(path, max_pixels=max_pixels)
    if start.startswith(raw.NPY_MAGIC):
        return raw.read_npy(path, max_pixels=max_pixels)
    if path.suffix.lower() == ".float":
        return raw.read_float(path, max_pixels=max_pixels)
    return other.read_other(path, max_pixels=max_pixels, alpha=alpha)


def cube_faces(folder: Path) -> list[Path] | None:
    """Find the six faces of a cube in a folder (px, nx, py, ...), or None."""
    found: dict[str, Path] = {}
    for path in sorted(folder.iterdir()):
        word = re.split(r"[^a-z]+", path.stem.lower())[-1]
        face = _FACE_NAMES.get(word)
        if path.suffix.lower() in SUFFIXES and face is not None:
            if face in found:
                return None
            found[face] = path
    return [found[face] for face in FACES] if set(found) == set(FACES) else None


def _six_faces(
    folder: str, paths: list[Path], *, max_pixels: int, **options: Any
) -> Decoded:
    """Six square images, one below the other."""
    names = [str(Path(folder) / path.name) for path in paths]
    faces = [
        read(path, max_pixels=max_pixels, called=name, **options)
        for path, name in zip(paths, names, strict=True)
    ]
    side, _, channels = faces[0].shape
    for path, face in zip(names, faces, strict=True):
        if face.shape != (side, side, channels):
            height, width, count = face.shape
            raise ValueError(
                f"{path}: the faces of a cube are square and alike; got {width} x "
                f"{height} x {count} beside {side} x {side} x {channels}."
            )
    with naming(folder):
        check_size((6 * side, side), max_pixels)

    def rows(start: int, stop: int) -> np.ndarray:
        parts = []
        for number, face in enumerate(faces):
            first = max(start - number * side, 0)
            last = min(stop - number * side, side)
            if first < last:
                parts.append(face.rows(first, last))
        return np.concatenate(parts)

    kind = f"six faces, {faces[0].kind}"
    return Decoded(
        (6 * side, side, channels), rows, kind, "vertical_strip", matrix=faces[0].matrix
    )
