"""Run the tools on the known panorama and write, or check, their numbers.

python tests/clients/regenerate.py [--check] [--tool NAME]
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import panorama
import verify

HERE = Path(__file__).resolve().parent
DATA = HERE.parent / "data" / "clients"
TOOLS = ("three", "babylon", "cmgen", "mitsuba")
# Relative to the largest number of a field. cmgen reads the nearest pixel: the last bit of
# a cosine, which is not the same on every processor, reads the next one, and the numbers
# move by 3e-6.
LARGEST_MOVE = 1e-6
LARGEST_MOVES = {"Filament cmgen": 3e-5}


class Skipped(Exception):
    """The tool, or what it needs, is not there."""


def run(command: list[str], **options) -> None:
    """Run a command; its output is shown only if it fails."""
    result = subprocess.run(command, capture_output=True, text=True, **options)
    if result.returncode:
        sys.stderr.write(result.stdout + result.stderr)
        raise RuntimeError(f"{command[0]} ended with {result.returncode}")


def run_node(tool: str, work: Path, modules: Path) -> Path:
    """Run one of the .mjs scripts beside an installed node_modules folder."""
    if shutil.which("node") is None or shutil.which("npm") is None:
        raise Skipped("node and npm are not on the PATH")
    folder = modules.resolve()
    folder = folder.parent if folder.name == "node_modules" else folder
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(HERE / "package.json", folder)
    wanted = json.loads((HERE / "package.json").read_text())["dependencies"]
    for name, version in wanted.items():
        manifest = folder / "node_modules" / name / "package.json"
        if not manifest.exists() or (
            json.loads(manifest.read_text())["version"] != version
        ):
            command = ["npm", "install", "--no-audit", "--no-fund"]
            if subprocess.run(command, cwd=folder, capture_output=True).returncode:
                raise Skipped(f"npm install of {name} {version} failed")
    for script in HERE.glob("*.mjs"):
        shutil.copy(script, folder)
    rows = {"three": 1024, "babylon": 2048}[tool]
    image, output = work / f"{tool}.raw", work / f"{tool}.json"
    panorama.write_raw(image, panorama.picture(rows))
    run(["node", f"{tool}.mjs", str(image), str(rows), str(output)], cwd=folder)
    return output


def run_cmgen(work: Path) -> Path:
    """Run cmgen on an EXR file."""
    if shutil.which("cmgen") is None:
        raise Skipped("cmgen is not on the PATH (Debian: libfilament-tools)")
    rows = 2048
    image, output = work / "panorama.exr", work / "cmgen.json"
    try:
        panorama.write_exr(image, panorama.picture(rows))
    except ImportError as missing:
        raise Skipped("the panorama needs the OpenEXR package") from missing
    script = str(HERE / "run_cmgen.py")
    run([sys.executable, script, str(image), str(rows), str(output)])
    return output


def run_mitsuba(work: Path, python: str) -> Path:
    """Run Mitsuba in its own interpreter."""
    probe = subprocess.run([python, "-c", "import mitsuba"], capture_output=True)
    if probe.returncode:
        raise Skipped(f"{Path(python).name} has no mitsuba (see requirements.txt)")
    rows = 1024
    image, output = work / "mitsuba.raw", work / "mitsuba.json"
    panorama.write_raw(image, panorama.picture(rows, corners=True))
    script = str(HERE / "run_mitsuba.py")
    run([python, script, str(image), str(rows), str(output)])
    return output


def dump(record: dict) -> str:
    """A record as JSON, one line for each row of numbers."""
    lines = []
    for key, value in record.items():
        if isinstance(value, list) and isinstance(value[0], list):
            rows = ",\n".join(f"    {json.dumps(row)}" for row in value)
            lines.append(f"  {json.dumps(key)}: [\n{rows}\n  ]")
        else:
            lines.append(f"  {json.dumps(key)}: {json.dumps(value)}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def numbers(value: object) -> Iterator[float]:
    """Every number inside a JSON value, in order."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        for item in value:
            yield from numbers(item)
    elif isinstance(value, int | float):
        yield float(value)


def moved(new: dict, old: dict) -> list[str]:
    """The keys in which a number moved by more than its tool allows, and by how much."""
    if new.keys() != old.keys():
        return [f"keys {sorted(new.keys() ^ old.keys())}"]
    largest = LARGEST_MOVES.get(old["tool"], LARGEST_MOVE)
    found = []
    for key in new:
        a, b = (np.array([*numbers(record[key])]) for record in (new, old))
        if a.shape != b.shape:
            found.append(f"{key} has another shape")
        elif (change := np.abs(a - b) > largest * np.abs(b).max(initial=0)).any():
            worst = np.abs(a - b).max()
            found.append(f"{key}: {change.sum()} numbers, by up to {worst:.1e}")
    return found


def handle(name: str, record: dict, *, check: bool) -> bool:
    """Write or check one record; true if it is as it should be."""
    first = ("tool", "version", "command", "convention", "frame", "variant", "order")
    rest = {k: v for k, v in record.items() if k not in first}
    record = {k: record[k] for k in first}
    record |= {"input": panorama.COEFFICIENTS.tolist(), **rest}
    error, allowed = verify.error(record), record["tolerance"]["value"]
    good = error <= allowed
    print(f"{name}: error {error:.1e}, expected at most {allowed:.0e}")
    path = DATA / f"{name}.json"
    if not check:
        DATA.mkdir(parents=True, exist_ok=True)
        path.write_text(dump(record))
        return good
    if not path.exists():
        print(f"{name}: {path.name} is missing")
        return False
    old = json.loads(path.read_text())
    if old["version"] != record["version"]:
        print(f"{name}: {old['version']} is committed, this is {record['version']}")
    changes = moved(record, old)
    for change in changes:
        print(f"{name}: moved: {change}")
    return good and not changes


def main() -> int:
    """Run the tools that are found; 1 if a number is wrong or moved."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument(
        "--check", action="store_true", help="compare with the files, do not write"
    )
    parser.add_argument("--tool", choices=TOOLS, action="append", help="default: all")
    parser.add_argument(
        "--node-modules",
        type=Path,
        default=os.environ.get("SHJAX_NODE_MODULES"),
        help="folder to install the node packages in, kept (SHJAX_NODE_MODULES); "
        "default: a temporary folder",
    )
    parser.add_argument(
        "--mitsuba-python",
        default=os.environ.get("SHJAX_MITSUBA_PYTHON", sys.executable),
        help="interpreter that has mitsuba (SHJAX_MITSUBA_PYTHON); default: this one",
    )
    arguments = parser.parse_args()
    modules = arguments.node_modules and Path(arguments.node_modules)
    results = []
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        for tool in arguments.tool or TOOLS:
            try:
                if tool == "cmgen":
                    output = run_cmgen(work)
                elif tool == "mitsuba":
                    output = run_mitsuba(work, arguments.mitsuba_python)
                else:
                    if modules is None:
                        modules = work / "node"
                    output = run_node(tool, work, modules)
            except Skipped as reason:
                print(f"{tool}: skipped: {reason}")
                continue
            for name, record in json.loads(output.read_text()).items():
                results.append(handle(name, record, check=arguments.check))
    if not results:
        print("no tool was found")
        return 0 if arguments.check else 1
    return 0 if all(results) else 1


if __name__ == "__main__":
    sys.exit(main())
