"""Project the panorama with Filament's cmgen.

python run_cmgen.py panorama.exr rows output.json, with cmgen on the PATH.
"""

import json
import re
import shutil
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

# Name of the variant: (options, row of the table of scales).
VARIANTS = {
    "radiance": (["--sh=3"], "cmgen --sh=3"),
    "irradiance": (["--sh=3", "--sh-irradiance"], "cmgen --sh=3 -i"),
    "shader": (["--sh-shader"], "cmgen --sh-shader"),
    "deploy": (
        ["--format=ktx", "--size=64", "--ibl-samples=16"],
        "cmgen --sh-shader",
    ),
}
NUMBER = r"\s*([-+.\deE]+)\s*"
LINE = re.compile(rf"\({NUMBER},{NUMBER},{NUMBER}\); // L(\d)(-?\d)")


def version() -> str:
    """Version of the installed package: cmgen itself does not tell."""
    query = shutil.which("dpkg-query")
    if query is None:
        return "unknown"
    command = [query, "-W", "-f", "${Version}", "libfilament-tools"]
    answer = subprocess.run(command, capture_output=True, text=True)
    return f"libfilament-tools {answer.stdout}" if answer.stdout else "unknown"


def parse(text: str) -> list[list[float]]:
    """The coefficients of a cmgen text, which must be in the order of l (l + 1) + m."""
    matches = [LINE.match(line) for line in text.splitlines()]
    names = [(int(match[4]), int(match[5])) for match in matches]
    if names != [(l, m) for l in range(3) for m in range(-l, l + 1)]:
        raise ValueError(f"cmgen wrote the harmonics {names}")
    return [[float(match[channel]) for channel in (1, 2, 3)] for match in matches]


def ktx_metadata(data: bytes) -> dict[str, str]:
    """The key-value pairs of a little-endian KTX 1 file, as text."""
    (size,) = struct.unpack_from("<I", data, 60)
    pairs, position = {}, 64
    while position < 64 + size:
        (length,) = struct.unpack_from("<I", data, position)
        pair = data[position + 4 : position + 4 + length]
        key, value = pair.split(b"\0", 1)
        pairs[key.decode()] = value.rstrip(b"\0").decode()
        position += 4 + (length + 3) // 4 * 4
    return pairs


def record(panorama: Path, rows: int, name: str, *, mirror: bool) -> dict:
    """Run one variant."""
    options, convention = VARIANTS[name]
    options = ["--sh-window=no", *options, *([] if mirror else ["--no-mirror"])]
    extra = {}
    with tempfile.TemporaryDirectory() as folder:
        if name == "deploy":
            target = Path(folder, "deployed")
            options = [*options, "-x", target.name]
            text = target / "sh.txt"
        else:
            text = Path(folder, "sh.txt")
            options = [*options, f"--sh-output={text.name}"]
        command = ["cmgen", "--quiet", *options, str(panorama.resolve())]
        subprocess.run(command, check=True, cwd=folder, stdout=subprocess.DEVNULL)
        if name == "deploy":
            ktx = (target / "deployed_ibl.ktx").read_bytes()
            extra["ktx_sh"] = ktx_metadata(ktx)["sh"]
        written = text.read_text()
    frame = "cmgen default" if mirror else "cmgen --no-mirror"
    return {
        "tool": "Filament cmgen",
        "version": version(),
        "command": f"cmgen {' '.join(options)} panorama.exr, {rows} rows",
        "convention": convention,
        "frame": frame,
        "variant": name if mirror else f"{name}, --no-mirror",
        "order": "sh.txt: L00, L1-1, L10, L11, L2-2, L2-1, L20, L21, L22; RGB each",
        "output": parse(written),
        "tolerance": {
            "value": 3e-3,
            "why": "the step from lat-long to cube reads the nearest pixel",
        },
        "text": written,
        **extra,
    }


def main(panorama: Path, rows: int, output: Path) -> None:
    """Run every variant, mirrored as by default and not mirrored."""
    records = {}
    for name in VARIANTS:
        for mirror in (True, False):
            key = f"cmgen_{name}" if mirror else f"cmgen_{name}_no_mirror"
            records[key] = record(panorama, rows, name, mirror=mirror)
    output.write_text(json.dumps(records))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3]))
