"""Outputs are written beside their final name and renamed: whole or not at all.

A link is followed, and its target is replaced. What is no plain file (a named pipe, a
device) is written through, when the output is whole.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import secrets
import shutil
import tempfile
from collections.abc import Iterator
from contextvars import ContextVar
from pathlib import Path

_inputs: ContextVar[tuple[Path, ...]] = ContextVar("inputs", default=())


@contextlib.contextmanager
def protecting(*paths: Path) -> Iterator[None]:
    """Protect files from being overwritten, within it."""
    token = _inputs.set((*_inputs.get(), *paths))
    try:
        yield
    finally:
        _inputs.reset(token)


@contextlib.contextmanager
def replacing(path: str | os.PathLike) -> Iterator[Path]:
    """Write to a temporary file beside ``path`` that becomes it on success.

    What a killed process left of the same file is removed.

    Raises:
        OSError: If the folder cannot be written to, or ``path`` is an input.
    """
    given = Path(path)
    make_folder(given.parent)
    if given.is_dir():
        raise IsADirectoryError(f"{given}: is a folder, not a file to write.")
    if given.exists() and any(
        kept.exists() and given.samefile(kept) for kept in _inputs.get()
    ):
        raise FileExistsError(f"{given}: is an input, which is not written over.")
    if given.exists() and not given.is_file():
        with _written_through(given) as temporary:
            yield temporary
        return
    target = Path(os.path.realpath(given)) if given.is_symlink() else given
    _remove_leftovers(target)
    temporary = target.with_name(
        f".{_stem(target)}-{os.getpid()}-{secrets.token_hex(4)}{target.suffix}"
    )
    try:
        with _telling(given, temporary):
            os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
            yield temporary
            temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)


@contextlib.contextmanager
def _written_through(target: Path) -> Iterator[Path]:
    """A temporary file whose content goes into a pipe or a device when it is whole."""
    with tempfile.TemporaryDirectory(prefix="shjax-") as folder:
        temporary = Path(folder) / f"output{target.suffix}"
        with _telling(target, temporary):
            temporary.touch()
            yield temporary
            with temporary.open("rb") as source, target.open("wb") as sink:
                shutil.copyfileobj(source, sink)


@contextlib.contextmanager
def _telling(target: Path, temporary: Path) -> Iterator[None]:
    """Let errors name the file that was asked for, not the temporary one."""
    try:
        yield
    except OSError as error:
        words = (error.strerror or str(error)).replace(str(temporary), str(target))
        text = words if words.startswith(str(target)) else f"{target}: {words}"
        raise type(error)(text if text.endswith(".") else f"{text}.") from error


def _stem(target: Path) -> str:
    """The name's stem as far as every library can open it."""
    return target.stem.encode("utf-8", "replace").decode()[:100]


def _remove_leftovers(target: Path) -> None:
    """Temporaries of this target whose process is no more."""
    stem, suffix = re.escape(_stem(target)), re.escape(target.suffix)
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


def json_text(content, *, indent: int | None = None) -> str:
    """Encode JSON that every reader takes: infinity becomes null, NaN is refused.

    Raises:
        ValueError: If a number is NaN: a result that is none.
    """
    return json.dumps(_plain(content, "result"), indent=indent, allow_nan=False)


def _plain(content, place: str):
    if isinstance(content, dict):
        return {key: _plain(value, f"{place}.{key}") for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_plain(value, place) for value in content]
    if isinstance(content, float) and math.isnan(content):
        raise ValueError(f"{place} is not a number (NaN): nothing is written.")
    return None if isinstance(content, float) and math.isinf(content) else content
