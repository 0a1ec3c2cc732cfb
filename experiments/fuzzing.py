"""Mutated EXR and Radiance files: each is read or refused in one line, none takes us down.

    python -m experiments.fuzzing --count 100000 --out experiments/results

Valid files of many kinds (those of the tests) are damaged by seeded mutations: bits
flipped, bytes overwritten by telling values, pieces cut out, repeated, swapped between
files, cut off. Each is read by the worker that the commands use.
"""

from __future__ import annotations

import argparse
import json
import platform
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
import OpenEXR
from rich.progress import Progress

import shjax
from shjax import io
from shjax.io import isolation

_TELLING = (0, 1, 2, 127, 128, 255)
_WORDS = (0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x10000, 0x7FFF)
MAX_PIXELS = 2**22


def seeds() -> list[tuple[str, bytes]]:
    """The valid files that are damaged."""
    from tests.variants import VARIANTS, picture

    found = []
    with tempfile.TemporaryDirectory() as folder:
        for suffix, write, _, _ in VARIANTS.values():
            if suffix in (".exr", ".hdr"):
                path = Path(folder) / f"a{suffix}"
                write(path, picture())
                found.append((suffix, path.read_bytes()))
    return found


def mutated(rng: np.random.Generator, data: bytes, other: bytes) -> bytes:
    """A damaged copy; half of the damage is in the first 512 bytes, the header."""
    out = bytearray(data)
    for _ in range(int(rng.choice([1, 1, 2, 3, 8]))):
        if len(out) < 8:
            break
        end = min(len(out), 512) if rng.random() < 0.5 else len(out)
        at = int(rng.integers(0, max(end - 4, 1)))
        kind = rng.integers(0, 7)
        if kind == 0:
            out[at] ^= 1 << int(rng.integers(0, 8))
        elif kind == 1:
            out[at] = int(rng.choice(_TELLING))
        elif kind == 2:
            order = rng.choice(["little", "big"])
            out[at : at + 4] = int(rng.choice(_WORDS)).to_bytes(4, order)
        elif kind == 3:
            del out[at : at + int(rng.integers(1, 64))]
        elif kind == 4:
            piece = out[at : at + int(rng.integers(1, 64))]
            out[at:at] = piece * int(rng.integers(1, 4))
        elif kind == 5:
            start = int(rng.integers(0, max(len(other) - 64, 1)))
            piece = other[start : start + int(rng.integers(1, 64))]
            out[at : at + len(piece)] = piece
        else:
            del out[int(rng.integers(4, len(out))) :]
    return bytes(out)


def run(count: int, seed: int, folder: Path, progress=lambda done: None) -> dict:
    """Read ``count`` mutated files; what became of them.

    Raises:
        Exception: Anything but OSError and ValueError that a reader lets through.
    """
    files = seeds()
    outcomes: Counter[str] = Counter()
    worst, start = 0.0, time.perf_counter()
    crashed = []
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        suffix, data = files[number % len(files)]
        other = files[int(rng.integers(len(files)))][1]
        path = folder / f"a{suffix}"
        path.write_bytes(mutated(rng, data, other))
        begin = time.perf_counter()
        try:
            image = io.read_image(path, max_pixels=MAX_PIXELS, isolate=True)
        except (OSError, ValueError) as error:
            message = str(error)
            if path.name not in message or "\n" in message.strip():
                raise RuntimeError(f"file {number}: {message!r}") from error
            for word in ("crashed the reader", "took longer"):
                if word in message:
                    crashed.append([number, word])
                    outcomes[word] += 1
                    break
            else:
                outcomes["refused"] += 1
        else:
            if image.shape[0] * image.shape[1] > MAX_PIXELS:
                raise RuntimeError(f"file {number}: {image.shape} is over the limit")
            outcomes["read"] += 1
        worst = max(worst, time.perf_counter() - begin)
        if number % 100 == 0:
            progress(number)
    seconds = time.perf_counter() - start
    return {
        "files": count,
        "seed": seed,
        "kinds of file": len(files),
        **outcomes,
        "seconds": round(seconds, 1),
        "files per second": round(count / seconds, 1),
        "longest, seconds": round(worst, 2),
        "crashes and hangs": crashed[:50],
        "machine": f"{platform.machine()}, {platform.system()}, Python "
        f"{platform.python_version()}",
        "versions": {"shjax": shjax.__version__, "OpenEXR": OpenEXR.__version__},
    }


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, Progress(transient=True) as bar:
        task = bar.add_task("files", total=options.count)
        result = run(
            options.count,
            options.seed,
            Path(folder),
            lambda done: bar.update(task, completed=done),
        )
    isolation.stop()
    print(json.dumps(result, indent=1))
    if options.out is not None:
        io.write_text(options.out / "fuzzing.json", json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
