"""Outputs are written beside their final name and renamed: whole or not at all."""

from __future__ import annotations

import contextlib
import os
import re
import tempfile
from collections.abc import Iterator
from contextvars import ContextVar
from pathlib import Path

_inputs: ContextVar[tuple[Path, ...]] = ContextVar("inputs", default=())


@contextlib.contextmanager
def protecting(*paths: Path) -> Iterator[None]:
    """Within it, nothing is written over these files."""
    token = _inputs.set((*_inputs.get(), *paths))
    try:
        yield
    finally:
        _inputs.reset(token)


@contextlib.contextmanager
def replacing(path: str | os.PathLike) -> Iterator[Path]:
    """A temporary file in the same folder that becomes ``path`` on success.

    What a killed process left of the same file is removed.

    Raises:
        OSError: If the folder cannot be written to, or ``path`` is an input.
    """
    target = Path(path)
    make_folder(target.parent)
    if target.is_dir():
        raise IsADirectoryError(f"{target}: is a folder, not a file to write.")
    if target.exists() and any(
        kept.exists() and target.samefile(kept) for kept in _inputs.get()
    ):
        raise FileExistsError(f"{target}: is an input, which is not written over.")
    _remove_leftovers(target)
    handle, name = tempfile.mkstemp(
        prefix=f".{target.stem}-{os.getpid()}-", suffix=target.suffix, dir=target.parent
    )
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o666 & ~_umask())
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)


def _remove_leftovers(target: Path) -> None:
    """Temporaries of this target whose process is no more."""
    stem, suffix = re.escape(target.stem), re.escape(target.suffix)
    pattern = re.compile(rf"\.{stem}-(\d+)-[^.]+{suffix}")
    for entry in os.scandir(target.parent):
        found = pattern.fullmatch(entry.name)
        if found and not _alive(int(found[1])):
            with contextlib.suppress(OSError):
                os.unlink(entry.path)


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def check_folder(path: Path) -> None:
    """Refuse a folder that cannot be made or written to, before any work is done.

    Raises:
        OSError: If something else stands there, or the permission is missing.
    """
    nearest = path.absolute()
    while not nearest.exists() and nearest != nearest.parent:
        nearest = nearest.parent
    if not nearest.is_dir():
        raise NotADirectoryError(f"{path}: cannot be a folder, {nearest} is a file.")
    if not os.access(nearest, os.W_OK):
        raise PermissionError(f"{path}: {nearest} cannot be written to.")


def make_folder(path: Path) -> None:
    """Make a folder, with those above it; an existing one is fine.

    Raises:
        OSError: If it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise type(error)(
            f"{path}: cannot be made a folder ({error.strerror})."
        ) from None


def write_text(path: str | os.PathLike, text: str) -> None:
    """Write a text file, whole or not at all.

    Raises:
        OSError: If it cannot be written.
    """
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
