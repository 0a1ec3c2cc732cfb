"""What a result was measured with."""

from __future__ import annotations

import os
import platform
import time
from importlib import metadata
from pathlib import Path


def versions() -> dict[str, str]:
    """What ran, and where."""
    names = (
        "jax",
        "jaxlib",
        "numpy",
        "scipy",
        "mpmath",
        "ducc0",
        "s2fft",
        "shtns",
        "sphericart-jax",
        "torch",
        "torch-harmonics",
    )
    found = {}
    for name in names:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    processor = platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        models = [
            x for x in cpuinfo.read_text().splitlines() if x.startswith("model name")
        ]
        processor = models[0].partition(":")[2].strip() if models else processor
    return {
        "date": time.strftime("%Y-%m-%d"),
        "machine": f"{processor}, {os.cpu_count()} cores",
        "python": platform.python_version(),
        **found,
    }


def versions_line(found: dict[str, str] | None = None) -> str:
    """What ran, and where, in one line; of a result where its versions are given."""
    return ", ".join(f"{k} {v}" for k, v in (found or versions()).items())
