"""Reading in a process of its own, so that no file can take the caller down.

Workers wait in a pool: each serves one request at a time, threads get one each, and a
forked process starts its own. A worker is started anew after a crash, an interrupt, or
when a file takes too long: 5 s of its processor's time, a second more for each 10 MB of
the file and for each million pixels that its header announces, and four times as long by
the clock. Pixels come back in memory that both processes can open, written a band at a
time, so that the worker never holds them twice. The worker's memory is bounded by the
limit on pixels.
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
import threading
import time
from pathlib import Path
from typing import IO, Any

import numpy as np

from shjax.io import readers
from shjax.io.decoded import Decoded, from_array, telling_size

SECONDS = 5.0
BYTES_PER_SECOND = 1e7
PIXELS_PER_SECOND = 1e6
_WAIT = 4.0  # seconds by the clock for each of work: other processes want the processor
_START_SECONDS = 60.0
_BYTES_PER_PIXEL = 48  # of the largest image: its channels, decoded and as a band
_LENGTH = struct.Struct("<Q")
_TICK = 0.25  # seconds between two looks at what a worker has used
# The package is found by its place and nothing else in the current folder is: a file
# there may be called as a module of the standard library.
_PROGRAM = """
import importlib.util, sys
place = sys.argv[1]
spec = importlib.util.spec_from_file_location(
    "shjax", place + "/__init__.py", submodule_search_locations=[place]
)
sys.modules["shjax"] = package = importlib.util.module_from_spec(spec)
spec.loader.exec_module(package)
from shjax.io.isolation import _serve
_serve()
"""


class _Gone(Exception):
    """The worker ended, or said nothing in time."""


class _Worker:
    """The other process, and the pipes to it."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", _PROGRAM, str(Path(__file__).parents[1])],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            bufsize=0,  # what a buffer holds, no selector sees
            env=os.environ | {"JAX_PLATFORMS": "cpu"},
        )
        self.ready = False

    def ask(self, request: Any, seconds: float) -> Any:
        """Send a request and wait for the answer."""
        try:
            if not self.ready:
                self._receive(_START_SECONDS, _START_SECONDS)
                self.ready = True
            _send(self._process.stdin, request)
        except (OSError, ValueError) as error:
            raise _Gone("ended") from error
        used = self._work()
        answer = self._receive(_WAIT * seconds, used + seconds)
        while isinstance(answer, _Size):
            seconds += answer.pixels / PIXELS_PER_SECOND
            answer = self._receive(_WAIT * seconds, used + seconds)
        return answer

    def _receive(self, seconds: float, work: float) -> Any:
        stream = self._process.stdout
        assert stream is not None
        end = time.monotonic() + seconds
        with selectors.DefaultSelector() as selector:
            selector.register(stream, selectors.EVENT_READ)
            while not selector.select(_TICK):
                if time.monotonic() > end or self._work() > work:
                    raise _Gone("too long")
        try:
            return _receive(stream)
        except (EOFError, pickle.UnpicklingError) as error:
            raise _Gone("ended") from error

    def _work(self) -> float:
        """Processor time that the worker has used, seconds; 0 where it is not told."""
        try:
            text = Path(f"/proc/{self._process.pid}/stat").read_text()
        except OSError:
            return 0.0
        user, system = text.rpartition(")")[2].split()[11:13]
        return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")

    def stop(self) -> int | None:
        """End the process; returns its exit status."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(0.2)
        status = self._process.poll()
        if status is None:
            self._process.kill()
            self._process.wait()
        self._close()
        return status

    def forget(self) -> None:
        """Let go of a worker that belongs to the process this one was forked from."""
        self._process.returncode = 0  # it is not this process's child
        self._close()

    def _close(self) -> None:
        for stream in (self._process.stdin, self._process.stdout):
            with contextlib.suppress(OSError):
                if stream is not None:
                    stream.close()


class _Pool:
    """Workers of this process: those that wait, and those that serve a thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._idle: list[_Worker] = []
        self._all: set[_Worker] = set()

    def take(self) -> _Worker:
        with self._lock:
            worker = self._idle.pop() if self._idle else None
        if worker is None:
            worker = _Worker()
            with self._lock:
                self._all.add(worker)
        return worker

    def give_back(self, worker: _Worker) -> None:
        with self._lock:
            self._idle.append(worker)

    def end(self, worker: _Worker) -> int | None:
        with self._lock:
            self._all.discard(worker)
        return worker.stop()

    def stop(self) -> None:
        with self._lock:
            workers, self._idle, self._all = list(self._all), [], set()
        for worker in workers:
            worker.stop()

    def forget(self) -> None:
        for worker in self._all:
            worker.forget()
        self.__init__()


_pool = _Pool()
atexit.register(_pool.stop)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_pool.forget)


def start() -> None:
    """Start a worker ahead of its first file; it gets ready beside the caller."""
    _pool.give_back(_pool.take())


def stop() -> None:
    """End the workers; the next file starts another."""
    _pool.stop()


def read(path: Path, **options: Any) -> Decoded:
    """Read an image in a worker process, as :func:`shjax.io.readers.read` does.

    Raises:
        OSError: If the file cannot be opened.
        ValueError: If it cannot be read, crashes the reader, or takes too long.
    """
    size = path.stat().st_size if path.is_file() else 0
    seconds = SECONDS + size / BYTES_PER_SECOND
    worker = _pool.take()
    with _shared_file() as shared:
        try:
            request = shared.name, str(path), os.path.abspath(path), options
            answer = worker.ask(request, seconds)
        except _Gone as gone:
            status = _pool.end(worker)
            if str(gone) == "too long":
                raise ValueError(
                    f"{path}: took longer than {seconds:.0f} s to read."
                ) from None
            raise ValueError(
                f"{path}: crashed the reader (exit status {status})."
            ) from None
        except BaseException:
            _pool.end(worker)  # an interrupt leaves an answer in the pipe
            raise
        _pool.give_back(worker)
        if isinstance(answer, Exception):
            raise answer
        shape, kind, layout, matrix = answer
        image = np.asarray(np.memmap(shared.path, np.float32, "c", 0, shape))
        found = from_array(image, kind, layout)
        return dataclasses.replace(found, whole=image, matrix=matrix)


@dataclasses.dataclass(frozen=True)
class _Size:
    """What a worker says when a header has told it the size of an image."""

    pixels: int


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
    left = memoryview(_LENGTH.pack(len(data)) + data)
    while left:
        left = left[stream.write(left) :]
    stream.flush()


def _receive(stream: IO[bytes]) -> Any:
    (length,) = _LENGTH.unpack(_exactly(stream, _LENGTH.size))
    return pickle.loads(_exactly(stream, length))


def _exactly(stream: IO[bytes], count: int) -> bytes:
    parts = bytearray()
    while len(parts) < count:
        part = stream.read(count - len(parts))
        if not part:
            raise EOFError
        parts += part
    return bytes(parts)


def _serve() -> None:
    """The worker's loop: a request in, an answer out, until the pipe closes."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is no answer
    _send(answers, "ready")
    while True:
        try:
            target, path, place, options = _receive(sys.stdin.buffer)
        except EOFError:
            return
        try:
            with (
                _bounded_memory(options["max_pixels"]),
                telling_size(lambda pixels: _send(answers, _Size(pixels))),
            ):
                image = readers.read(Path(place), called=path, **options)
                with readers.naming(path):
                    _write(target, image)
            answer: Any = image.shape, image.kind, image.layout, image.matrix
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
