"""What is installed, not what lies in the checkout: the wheel holds the panorama."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.slow
def test_the_main_job_runs_from_the_wheel(tmp_path):
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    build = [*pip, "wheel", "--no-deps", "--no-build-isolation", "-w", tmp_path, ROOT]
    subprocess.run(build, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("shjax-*.whl")
    target = tmp_path / "installed"
    install = [*pip, "install", "--no-deps", "--target", target, wheel]
    subprocess.run(install, check=True, capture_output=True)
    environment = {**os.environ, "PYTHONPATH": str(target)}
    where = subprocess.run(
        [sys.executable, "-c", "import shjax; print(shjax.__file__)"],
        env=environment,
        cwd=tmp_path,
        check=True,
        capture_output=True,
        text=True,
    )
    assert Path(where.stdout.strip()).is_relative_to(target)
    finished = subprocess.run(
        [
            sys.executable,
            "-m",
            "shjax",
            "light",
            "--out",
            "out",
            "--json",
            "--size",
            "16",
        ],
        env=environment,
        cwd=tmp_path,
        check=True,
        capture_output=True,
        text=True,
    )
    assert json.loads(finished.stdout)["recovered_error"]["self"] <= 1e-4
    packaged = {path.name for path in (target / "shjax").rglob("*") if path.is_file()}
    assert {"py.typed", "city.exr", "LICENSE-city.txt"} <= packaged
