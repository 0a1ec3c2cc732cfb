"""A table: kinds of file, and what shjax, cmgen, three.js and Mitsuba do with each.

    python -m experiments.kinds_of_file --mitsuba-python PYTHON --node-modules DIR

Every file holds one small picture, written by other means than these readers (the tests'
variants). three.js and Mitsuba hand over pixels, which are compared; of cmgen the nine
coefficients are compared with those that it makes of the plain file. A tool that is not
there is left out of the table, and said.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import shjax
from experiments.writing import markdown_table
from shjax import io

HERE = Path(__file__).resolve().parent
_SLACK = 2.0  # times the tolerance that the variant itself has


def write_files(folder: Path) -> dict[str, tuple[Path, float, float]]:
    """Every variant, by its name: the file, its tolerance, its factor."""
    from tests.variants import VARIANTS, picture

    found = {}
    for number, (name, (suffix, write, tolerance, factor)) in enumerate(
        VARIANTS.items()
    ):
        path = folder / f"{number:02d}{suffix}"
        write(path, picture())
        found[name] = path, max(tolerance, 2e-3), factor
    return found


def judged(pixels: np.ndarray | None, tolerance: float, factor: float) -> str:
    """In a word or two, how pixels compare with the picture."""
    from tests.variants import picture

    if pixels is None:
        return "refused"
    truth = picture() * np.float32(factor)
    if pixels.shape[:2] != truth.shape[:2]:
        return f"wrong: {pixels.shape[1]} x {pixels.shape[0]} pixels"
    pixels = pixels[..., :3].astype(float)
    if not np.all(np.isfinite(pixels)):
        return "wrong: not finite"
    error = float(np.max(np.abs(pixels / truth - 1)))
    if error <= _SLACK * tolerance:
        return "right"
    for flip, words in ((np.s_[::-1], "upside down"), (np.s_[:, ::-1], "mirrored")):
        if np.max(np.abs(pixels[flip] / truth - 1)) <= _SLACK * tolerance:
            return f"wrong: {words}"
    return f"wrong: off by {error:.0%}"


def by_shjax(files) -> dict[str, str]:
    """Our own reader."""
    found = {}
    for name, (path, tolerance, factor) in files.items():
        try:
            pixels = io.read_image(path)
        except (ValueError, OSError):
            pixels = None
        found[name] = judged(pixels, tolerance, factor)
    return found


def by_process(files, command: list[str], **options) -> dict[str, str]:
    """A script that prints one JSON object for each file."""
    found = {}
    for name, (path, tolerance, factor) in files.items():
        run = subprocess.run(
            [*command, str(path)],
            capture_output=True,
            text=True,
            timeout=120,
            **options,
        )
        lines = run.stdout.strip().splitlines()
        if run.returncode or not lines:
            found[name] = "crashed"
            continue
        answer = json.loads(lines[-1])
        pixels = None
        if "data" in answer:
            shape = answer["height"], answer["width"], -1
            pixels = np.array(answer["data"], float).reshape(shape)
            pixels = pixels[::-1] if answer["flipped"] else pixels
        found[name] = judged(pixels, tolerance, factor)
    return found


def by_cmgen(files) -> dict[str, str]:
    """Coefficients beside those of the plain float EXR."""
    number = re.compile(r"\(\s*([^,]+),\s*([^,]+),\s*([^)]+)\)")

    def coefficients(path: Path) -> np.ndarray | None:
        target = path.with_suffix(".txt")
        target.unlink(missing_ok=True)
        command = ["cmgen", "--quiet", "--sh-window=no", "--sh=3"]
        command += [f"--sh-output={target.name}", str(path)]
        run = subprocess.run(
            command, capture_output=True, text=True, timeout=120, cwd=path.parent
        )
        if run.returncode < 0:
            raise RuntimeError
        if run.returncode or not target.exists():
            return None
        rows = [[float(x) for x in row] for row in number.findall(target.read_text())]
        return np.array(rows) if len(rows) == 9 else None

    truth = coefficients(files["exr float"][0])
    assert truth is not None, "cmgen does not read its plain file"
    found = {}
    for name, (path, tolerance, factor) in files.items():
        try:
            ours = coefficients(path)
        except RuntimeError:
            found[name] = "crashed"
            continue
        if ours is None:
            found[name] = "refused"
            continue
        error = np.max(np.abs(ours / factor - truth)) / np.max(np.abs(truth))
        # A scale of its own is no fault: only the colours among each other count.
        found[name] = (
            "right" if error <= _SLACK * tolerance else f"wrong: off by {error:.0%}"
        )
    return found


def markdown(table: dict[str, dict[str, str]], versions: dict[str, str]) -> str:
    """The table, one row for each kind."""
    tools = list(table)
    about = (
        "Made by `python -m experiments.kinds_of_file` on "
        f"{datetime.date.today().isoformat()} with "
        + ", ".join(f"{tool} {version}" for tool, version in versions.items())
        + ". *right*: within twice the format's own error; a refusal is not wrong. "
        "three.js reads .hdr by its HDRLoader, all else by its EXRLoader."
    )
    rows = [[name, *(table[tool][name] for tool in tools)] for name in table["shjax"]]
    counts = [
        ", ".join(
            f"{sum(v.startswith(word) for v in table[tool].values())} {word}"
            for word in ("right", "wrong", "refused", "crashed")
        )
        for tool in tools
    ]
    page = markdown_table(["kind", *tools], [*rows, ["*in all*", *counts]])
    return f"# Kinds of file, and what tools do with them\n\n{about}\n\n{page}\n"


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--mitsuba-python",
        default=os.environ.get("SHJAX_MITSUBA_PYTHON", sys.executable),
    )
    parser.add_argument(
        "--node-modules",
        type=Path,
        default=Path(os.environ.get("SHJAX_NODE_MODULES", "node_modules")),
    )
    parser.add_argument("--out", type=Path, default=Path("experiments/results"))
    options = parser.parse_args()
    modules = options.node_modules
    modules = modules if modules.name == "node_modules" else modules / "node_modules"
    with tempfile.TemporaryDirectory() as folder:
        files = write_files(Path(folder))
        table, versions = {"shjax": by_shjax(files)}, {"shjax": shjax.__version__}
        if shutil.which("cmgen"):
            table["cmgen"] = by_cmgen(files)
            query = ["dpkg-query", "-W", "-f", "${Version}", "libfilament-tools"]
            answer = subprocess.run(query, capture_output=True, text=True)
            versions["cmgen"] = answer.stdout or "of unknown version"
        else:
            print("cmgen is not on the PATH: left out")
        if shutil.which("node") and (modules / "three").is_dir():
            script = modules.parent / "kinds_of_file.mjs"
            shutil.copy(HERE / "three.mjs", script)
            table["three.js"] = by_process(files, ["node", str(script)])
            script.unlink()
            package = json.loads((modules / "three" / "package.json").read_text())
            versions["three.js"] = package["version"]
        else:
            print("node or three.js is not there: left out")
        probe = [
            options.mitsuba_python,
            "-c",
            "import mitsuba; print(mitsuba.__version__)",
        ]
        answer = subprocess.run(probe, capture_output=True, text=True)
        if answer.returncode == 0:
            command = [options.mitsuba_python, str(HERE / "run_mitsuba.py")]
            table["Mitsuba 3"] = by_process(files, command)
            versions["Mitsuba 3"] = answer.stdout.strip()
        else:
            print("mitsuba is not there: left out")
    text = markdown(table, versions)
    print(text)
    io.write_text(options.out / "kinds_of_file.md", text)


if __name__ == "__main__":
    main()
