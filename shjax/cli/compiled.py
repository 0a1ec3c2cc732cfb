"""Compiled programs kept in the user's cache folder: JAX's persistent cache.

Only commands keep them: the library never touches JAX's settings. JAX reads its own
variables when it is imported; a folder that the user has named there stands.
"""

from __future__ import annotations

import hashlib
import os
import platform
import warnings
from importlib import metadata
from pathlib import Path

CACHE_VARIABLE = "SHJAX_CACHE"
_BYTES = 2**29


def keep_compiled() -> Path | None:
    """Let JAX keep what it compiles from now on; returns the folder, or None if it is off.

    ``SHJAX_CACHE`` names another folder, or is ``off``. The oldest programs leave when
    the folder holds more than 512 MiB.
    """
    if "JAX_COMPILATION_CACHE_DIR" in os.environ:  # the user keeps it where they like
        return Path(os.environ["JAX_COMPILATION_CACHE_DIR"])
    folder = cache_folder()
    if folder is None:
        return None
    folder = folder / _machine()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:  # a home that cannot be written: nothing is kept
        return None
    # A command that was killed may leave half a program: it is compiled again.
    half = "Error (reading|writing) persistent compilation cache"
    warnings.filterwarnings("ignore", message=half)
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(folder)
    os.environ.setdefault("JAX_COMPILATION_CACHE_MAX_SIZE", str(_BYTES))
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")
    return folder


def cache_folder() -> Path | None:
    """Folder in which commands keep compiled programs; None if ``SHJAX_CACHE`` is off."""
    chosen = os.environ.get(CACHE_VARIABLE, "")
    if chosen.lower() in ("off", "0", "no", "false"):
        return None
    if chosen:
        return Path(chosen)
    import platformdirs

    return Path(platformdirs.user_cache_dir("shjax", appauthor=False))


def _machine() -> str:
    """A name for what compiled programs depend on: this processor and this jaxlib.

    A home folder may be shared by machines that cannot run each other's programs.
    """
    try:
        text = Path("/proc/cpuinfo").read_text()
        about = next(
            line for line in text.splitlines() if line[:5] in ("flags", "Featu")
        )
    except (OSError, StopIteration):
        about = platform.processor()
    about = f"{platform.machine()} {about} {metadata.version('jaxlib')}"
    return hashlib.sha256(about.encode()).hexdigest()[:16]
