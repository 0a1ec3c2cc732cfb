"""Libraries that print what they also raise are kept from printing.

Standard output and error are one for all threads of a process: the first thread that asks
for quiet puts them away, and the last one that is done brings them back.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
import threading
from collections.abc import Iterator
from io import StringIO


class _Silence:
    """Output put away, and for how many threads."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.depth = 0
        self.held = contextlib.ExitStack()

    def begin(self) -> None:
        sys.stdout.flush()
        sys.stderr.flush()
        sink = os.open(os.devnull, os.O_WRONLY)
        for stream in (1, 2):
            kept = os.dup(stream)
            self.held.callback(os.close, kept)
            self.held.callback(os.dup2, kept, stream)
            os.dup2(sink, stream)
        os.close(sink)
        self.held.callback(_flush_libraries)
        self.held.enter_context(contextlib.redirect_stdout(StringIO()))
        self.held.enter_context(contextlib.redirect_stderr(StringIO()))

    def end(self) -> None:
        self.held.close()

    def forget(self) -> None:
        """In a forked process: the threads that asked for quiet are not in it."""
        if self.depth:
            self.end()
        self.__init__()


_silence = _Silence()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_silence.forget)


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keep the library, and its binding, from printing beside what they raise."""
    with _silence.lock:
        if not _silence.depth:
            _silence.begin()
        _silence.depth += 1
    try:
        yield
    finally:
        with _silence.lock:
            _silence.depth -= 1
            if not _silence.depth:
                _silence.end()


def _flush_libraries() -> None:
    with contextlib.suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).fflush(None)  # what the library holds back goes there too
