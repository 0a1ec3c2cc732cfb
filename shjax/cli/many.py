"""Many inputs: folders, names of outputs, and what was done before."""

from __future__ import annotations

import contextlib
import datetime
import json
import os
from collections.abc import Iterable
from pathlib import Path

import click
import filelock

from shjax.io.readers import SUFFIXES, cube_faces, naming

_ENDINGS = tuple(
    f"_{name}"
    for name in (
        "irradiance.exr",
        "irradiance.png",
        "spheres.exr",
        "spheres.png",
        "rest.exr",
        "reflection.exr",
        "reflection.png",
        "shrm.exr",
        "light.exr",
        "light.png",
        "pictures.exr",
        "pictures.png",
    )
)


def expand(paths: list[Path]) -> list[Path]:
    """List the environment maps that are named one by one or by their folder.

    A folder that holds the six faces of a cube is one map.

    Raises:
        click.UsageError: If a folder holds none.
    """
    found: list[Path] = []
    for path in paths:
        inside = [path]
        if path.is_dir() and cube_faces(path) is None:
            own = _results(path)
            inside = [
                entry
                for entry in sorted(path.iterdir())
                if _is_map(entry) and entry.name not in own
            ]
            if not inside:
                raise click.UsageError(
                    f"{path}: holds no environment map ({', '.join(SUFFIXES)})"
                    + (", only results of shjax." if own else ".")
                )
        found += inside
    return list(dict.fromkeys(found))


def _results(folder: Path) -> set[str]:
    """Names in a folder that are results of ours: told by a record, or beside a map."""
    names = {entry.name for entry in folder.iterdir()}
    found = set()
    for name in names:
        if name.endswith(".json"):
            found |= _recorded(folder / name)
    stems = {Path(name).stem for name in names}
    for name in names:
        # Of a run that was interrupted before it wrote its record.
        for ending in _ENDINGS:
            if name.endswith(ending) and name.removesuffix(ending) in stems:
                found.add(name)
    return found & names


def _recorded(record: Path) -> set[str]:
    try:
        content = json.loads(record.read_text(encoding="utf-8"))
        if not str(content["schema"]).startswith("shjax."):
            return set()
        return {Path(name).name for name in content["files"].values()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return set()


def _is_map(path: Path) -> bool:
    if path.name.startswith("."):
        return False
    if path.is_dir():
        return cube_faces(path) is not None
    return path.suffix.lower() in SUFFIXES


def output_names(paths: list[Path]) -> list[str]:
    """Names of each map's outputs: its stem, with the suffix where it must.

    Raises:
        click.UsageError: If two would overwrite each other's outputs.
    """
    stems = [path.stem for path in paths]
    names = [
        path.stem if stems.count(path.stem) == 1 else path.name.replace(".", "_")
        for path in paths
    ]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise click.UsageError(
            f"several ENV are named {', '.join(twice)}; their results would overwrite "
            "each other. Run them with different --out."
        )
    return names


def stamp(path: Path) -> list:
    """Size and time of an input, by which a changed one is done again.

    Raises:
        OSError: If it is not there.
    """
    if path.is_dir():
        return [stamp(entry) for entry in sorted(path.iterdir()) if entry.is_file()]
    with naming(path):
        found = os.stat(path)
    return [found.st_size, found.st_mtime_ns]


@contextlib.contextmanager
def alone(out: Path, name: str):
    """Lock the results of one name: no other run writes them meanwhile.

    Args:
        out: Folder of the results.
        name: Start of their names.

    Raises:
        BusyError: If another run is at them.
        OSError: If the folder cannot be written.
    """
    path = out / f".{name}.lock"
    made = [folder for folder in (out, *out.parents) if not folder.exists()]
    try:
        lock = filelock.FileLock(path, timeout=0).acquire()
    except filelock.Timeout:
        raise BusyError(
            f"another run is writing the results named {name} in {out}; wait for it, or "
            "choose another --out."
        ) from None
    except OSError as error:  # of the folder: nobody asked for a lock
        raise OSError(error.errno, error.strerror, str(out)) from error
    with lock:
        try:
            yield
        finally:
            # Nothing was written: nothing stays. Windows keeps what is locked.
            with contextlib.suppress(OSError):
                path.unlink(missing_ok=True)
                for folder in made:
                    folder.rmdir()


class BusyError(ValueError):
    """Another run writes the same results."""


def since(files: Iterable[str | Path]) -> str:
    """Time at which the oldest of some files was written, to the minute."""
    oldest = min(Path(name).stat().st_mtime for name in files)
    return f"{datetime.datetime.fromtimestamp(oldest):%Y-%m-%d %H:%M}"


def stored(record: Path, job: dict) -> dict | None:
    """Content of a JSON file whose ``job`` is this one and whose files are there."""
    try:
        content = json.loads(record.read_text())
        whole = all(Path(name).exists() for name in content["files"].values())
    except (OSError, ValueError, KeyError, AttributeError):
        return None
    same = content.get("job") == json.loads(json.dumps(job))
    return content if whole and same else None
