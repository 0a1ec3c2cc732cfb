"""Reading in a process of its own, so that no file can take the caller down.

One worker serves all requests and is started anew after a crash or when a file takes too
long: 5 s, and a second more for each 10 MB of the file. Pixels come back in memory that
both processes can open, written a band at a time, so that the worker never holds them
twice. The worker's memory is bounded by the limit on pixels.
"""

from __future__ import annotations

import atexit
import contextlib
import dataclasses
import os
import pickle
import selectors
import struct
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import IO, Any

import numpy as np

from shjax.io import reading
from shjax.io.decoded import Decoded, from_array

SECONDS = 5.0
BYTES_PER_SECOND = 1e7
_START_SECONDS = 60.0
_BYTES_PER_PIXEL = 48  # of the largest image: its channels, decoded and as a band
_LENGTH = struct.Struct("<Q")


class _Gone(Exception):
    """The worker ended, or said nothing in time."""


class _Worker:
    """The other process, and the pipes to it."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "shjax.io.isolation"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | {"JAX_PLATFORMS": "cpu"},
        )
        self.ready = False

    def ask(self, request: Any, seconds: float) -> Any:
        """Send a request and wait for the answer."""
        try:
            if not self.ready:
                self._receive(_START_SECONDS)
                self.ready = True
            _send(self._process.stdin, request)
        except (OSError, ValueError) as error:
            raise _Gone("ended") from error
        return self._receive(seconds)

    def _receive(self, seconds: float) -> Any:
        stream = self._process.stdout
        assert stream is not None
        with selectors.DefaultSelector() as selector:
            selector.register(stream, selectors.EVENT_READ)
            if not selector.select(seconds):
                raise _Gone("too long")
        try:
            return _receive(stream)
        except (EOFError, pickle.UnpicklingError) as error:
            raise _Gone("ended") from error

    def stop(self) -> int | None:
        """End the process; returns its exit status."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(0.2)
        status = self._process.poll()
        if status is None:
            self._process.kill()
            self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            with contextlib.suppress(OSError):
                if stream is not None:
                    stream.close()
        return status


_worker: _Worker | None = None


def start() -> None:
    """Start the worker ahead of its first file; it gets ready beside the caller."""
    global _worker
    if _worker is None:
        _worker = _Worker()
        atexit.register(stop)


def stop() -> int | None:
    """End the worker; the next file starts another."""
    global _worker
    status = None
    if _worker is not None:
        status = _worker.stop()
    _worker = None
    atexit.unregister(stop)
    return status


def read(path: Path, **options: Any) -> Decoded:
    """As :func:`shjax.io.reading.read`, in the worker.

    Raises:
        OSError: If the file cannot be opened.
        ValueError: If it cannot be read, crashes the reader, or takes too long.
    """
    start()
    assert _worker is not None
    size = path.stat().st_size if path.is_file() else 0
    seconds = SECONDS + size / BYTES_PER_SECOND
    with _shared_file() as shared:
        try:
            answer = _worker.ask((shared.name, str(path), options), seconds)
        except _Gone as gone:
            status = stop()
            if str(gone) == "too long":
                raise ValueError(
                    f"{path}: took longer than {seconds:.0f} s to read."
                ) from None
            raise ValueError(
                f"{path}: crashed the reader (exit status {status})."
            ) from None
        except BaseException:
            stop()  # an interrupt leaves an answer in the pipe
            raise
        if isinstance(answer, Exception):
            raise answer
        shape, kind, layout = answer
        image = np.asarray(np.memmap(shared.path, np.float32, "c", 0, shape))
        return dataclasses.replace(from_array(image, kind, layout), whole=image)


class _SharedFile:
    """A file without a name that the worker opens by way of this process, or with one."""

    def __init__(self) -> None:
        if hasattr(os, "memfd_create"):
            self._handle = os.memfd_create("shjax")
            self.name = f"/proc/{os.getpid()}/fd/{self._handle}"
            self.path: Any = self.name
        else:
            self._handle, self.name = tempfile.mkstemp(prefix="shjax-")
            self.path = self.name

    def close(self) -> None:
        """Forget the file; what is mapped of it stays."""
        os.close(self._handle)
        if not self.name.startswith("/proc/"):
            with contextlib.suppress(OSError):
                os.unlink(self.name)


@contextlib.contextmanager
def _shared_file():
    shared = _SharedFile()
    try:
        yield shared
    finally:
        shared.close()


def _send(stream: IO[bytes] | None, message: Any) -> None:
    assert stream is not None
    data = pickle.dumps(message)
    stream.write(_LENGTH.pack(len(data)) + data)
    stream.flush()


def _receive(stream: IO[bytes] | None) -> Any:
    assert stream is not None
    head = stream.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        raise EOFError
    (length,) = _LENGTH.unpack(head)
    return pickle.loads(stream.read(length))


def _serve() -> None:
    """The worker's loop: a request in, an answer out, until the pipe closes."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is no answer
    _send(answers, "ready")
    while True:
        try:
            target, path, options = _receive(sys.stdin.buffer)
        except EOFError:
            return
        try:
            with _bounded_memory(options["max_pixels"]):
                image = reading.read(Path(path), **options)
                with reading.naming(Path(path)):
                    _write(target, image)
            answer: Any = image.shape, image.kind, image.layout
        except (OSError, ValueError) as error:
            answer = type(error)(*error.args)
        except MemoryError:
            answer = ValueError(f"{path}: does not fit into memory.")
        image = None
        _send(answers, answer)


def _write(target: str, image: Decoded) -> None:
    with open(target, "r+b", buffering=0) as file:
        for _, band in image.bands():
            view = band.data.cast("B")
            while view:
                view = view[file.write(view) :]


@contextlib.contextmanager
def _bounded_memory(max_pixels: int):
    """Let the process grow by what the largest image needs, and no more."""
    try:
        import resource

        held = int(Path("/proc/self/statm").read_text().split()[0])
        held *= resource.getpagesize()
    except (ImportError, OSError):
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    wanted = held + _BYTES_PER_PIXEL * max_pixels + 2**28
    bound = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
    resource.setrlimit(resource.RLIMIT_AS, (bound, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


if __name__ == "__main__":
    _serve()
