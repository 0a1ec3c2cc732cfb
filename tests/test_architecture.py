"""The house rules that a machine can hold: imports point left, names are documented."""

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import shjax

PACKAGE = Path(shjax.__file__).parent

# Each module may import those of the same or of an earlier line, never a later one.
LAYERS = [
    ["shjax.arrays"],
    ["shjax.estimate"],
    ["shjax.sphere"],
    ["shjax.harmonics"],
    ["shjax.layouts", "shjax.irradiance"],
    ["shjax.reference"],
    ["shjax.brdf"],
    ["shjax.kernels"],
    ["shjax.orders", "shjax.view_basis", "shjax.sampling"],
    ["shjax.convolution"],
    ["shjax.shrm", "shjax.angular", "shjax.adapted"],
    ["shjax.envmap", "shjax.windows"],
    ["shjax.conventions"],
    ["shjax.lights"],
    ["shjax.ibl"],
    ["shjax.model"],
    ["shjax.io"],
    ["shjax.render", "shjax.display"],
    ["shjax.inverse", "shjax.metrics", "shjax.plot"],
    ["shjax.cli"],
]


def layer(module):
    for level, names in enumerate(LAYERS):
        if any(module == name or module.startswith(f"{name}.") for name in names):
            return level
    raise AssertionError(f"{module} has no place in LAYERS")


def sources():
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
        module = ".".join(part for part in parts if part != "__init__")
        if module not in ("shjax", "shjax.__main__"):
            yield module, ast.parse(path.read_text())


SOURCES = list(sources())


def imports(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module == "shjax":
            yield from (f"shjax.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module


@pytest.mark.parametrize(("module", "tree"), SOURCES, ids=[m for m, _ in SOURCES])
def test_imports_point_left(module, tree):
    ours = [name for name in imports(tree) if name.startswith("shjax.")]
    for name in ours:
        assert layer(name) <= layer(module), f"{module} imports {name}"


@pytest.mark.parametrize(("module", "tree"), SOURCES, ids=[m for m, _ in SOURCES])
def test_public_functions_say_what_they_do(module, tree):
    assert ast.get_docstring(tree), module
    for node in tree.body:
        kinds = (ast.FunctionDef, ast.ClassDef)
        if isinstance(node, kinds) and not node.name.startswith("_"):
            assert ast.get_docstring(node), f"{module}.{node.name}"


def test_reexported_functions_name_their_arguments():
    for name in (n for n in dir(shjax) if not n.startswith("_")):
        value = getattr(shjax, name)
        if inspect.isfunction(value) or hasattr(value, "__wrapped__"):
            text = inspect.getdoc(value) or ""
            assert "Args:" in text, name


def test_import_loads_jax_and_numpy_only():
    script = (
        "import sys, shjax; heavy = {'optimistix', 'OpenEXR', 'OpenImageIO', 'rich', "
        "'click', 'scipy.special'} & set(sys.modules); print(sorted(heavy))"
    )
    run = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == "[]"


def test_lazy_names_arrive_and_unknown_ones_do_not():
    assert shjax.estimate_lighting.__module__ == "shjax.inverse.lighting"
    assert "estimate_lighting" in dir(shjax)
    with pytest.raises(AttributeError, match="no attribute 'estimate_everything'"):
        _ = shjax.estimate_everything
