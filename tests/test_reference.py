"""The API reference is built from the docstrings without a warning."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.slow
def test_the_reference_builds_without_warnings(tmp_path):
    run = subprocess.run(
        [
            sys.executable,
            "-W",
            "error",
            "-m",
            "experiments.reference",
            "--out",
            str(tmp_path),
        ],
        capture_output=True,
        text=True,
        cwd=ROOT,
    )
    assert run.returncode == 0, run.stderr[-2000:]
    assert "Warn" not in run.stderr, run.stderr[-2000:]
    page = (tmp_path / "shjax.html").read_text()
    assert "estimate_lighting" in page
    assert len(list(tmp_path.rglob("*.html"))) > 60
