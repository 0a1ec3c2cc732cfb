"""Every notebook runs from top to bottom in a fresh process, and is stored stripped."""

import re
import subprocess
import sys
from pathlib import Path

import nbclient
import nbformat
import pytest

NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("path", NOTEBOOKS, ids=[path.stem for path in NOTEBOOKS])
def test_notebook_runs(path, monkeypatch):
    monkeypatch.setenv("SHJAX_QUICK", "1")
    notebook = nbformat.read(path, as_version=4)
    for cell in notebook.cells:
        assert not cell.get("outputs"), "outputs are stored; strip them"
    nbclient.NotebookClient(
        notebook,
        timeout=120,
        kernel_name="python3",
        resources={"metadata": {"path": str(path.parent)}},
    ).execute()
    printed = [o for cell in notebook.cells for o in cell.get("outputs", [])]
    assert any(o.output_type == "display_data" for o in printed)


@pytest.mark.slow
def test_the_readme_runs(tmp_path):
    """Its Python, from top to bottom, as a reader would paste it."""
    text = (NOTEBOOKS[0].parents[1] / "README.md").read_text()
    blocks = re.findall(r"```python\n(.*?)```", text, re.S)
    assert len(blocks) > 3
    script = tmp_path / "readme.py"
    script.write_text("\n".join(blocks))
    command = [sys.executable, script]
    run = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "exponent" in run.stdout
