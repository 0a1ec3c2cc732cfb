"""Outputs are written beside their final name and renamed: whole or not at all."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def replacing(path: str | os.PathLike) -> Iterator[Path]:
    """A temporary file in the same folder that becomes ``path`` on success.

    Raises:
        OSError: If the folder cannot be written to.
    """
    target = Path(path)
    make_folder(target.parent)
    if target.is_dir():
        raise IsADirectoryError(f"{target}: is a folder, not a file to write.")
    handle, name = tempfile.mkstemp(
        prefix=f".{target.stem}-", suffix=target.suffix, dir=target.parent
    )
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o666 & ~_umask())
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)


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
