"""The house rules that a machine can hold: imports point left, names are documented."""

import ast
import importlib
import importlib.util
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import shjax
import shjax.inverse
from shjax.cli import Commands

PACKAGE = Path(shjax.__file__).parent


def _index_equations():
    place = PACKAGE.parent / "docs" / "index_equations.py"
    spec = importlib.util.spec_from_file_location("index_equations", place)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


index_equations = _index_equations()

# Each module may import those of the same or of an earlier line, never a later one.
LAYERS = [
    ["shjax.lazy", "shjax.arrays", "shjax.texts"],
    ["shjax.colour", "shjax.sphere", "shjax.srgb", "shjax.vectors"],
    ["shjax.harmonics", "shjax.display"],
    ["shjax.layouts", "shjax.clamped_cosine"],
    ["shjax.envmap", "shjax.windows", "shjax.brdf"],
    ["shjax.light", "shjax.conventions"],
    ["shjax.reference"],
    ["shjax.lights"],
    ["shjax.ltc"],
    ["shjax.reflection"],
    ["shjax.ibl"],
    ["shjax.io"],
    ["shjax.render"],
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


@pytest.mark.parametrize(
    ("statement", "heavy"),
    [
        ("import shjax", {"jax", "numpy", "scipy"}),
        ("import shjax.io.isolation", {"jax", "OpenEXR", "OpenImageIO", "scipy"}),
        ("import shjax; shjax.shade; shjax.choose_model", {"optimistix", "OpenEXR"}),
        ("import shjax.cli", {"jax", "numpy", "rich"}),
        *(
            (f"from shjax.cli.{name} import {function}", {"jax", "rich", "scipy"})
            for name, (function, _) in Commands.known.items()
        ),
    ],
)
def test_what_is_not_needed_is_not_imported(statement, heavy):
    script = f"import sys; {statement}; print(sorted({heavy!r} & set(sys.modules)))"
    run = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == "[]"


def test_lazy_names_arrive_and_unknown_ones_do_not():
    assert shjax.estimate_lighting.__module__ == "shjax.inverse.lighting"
    assert "estimate_lighting" in dir(shjax)
    with pytest.raises(AttributeError, match="no attribute 'estimate_everything'"):
        _ = shjax.estimate_everything


@pytest.mark.parametrize("package", ["", "io"])
def test_types_name_what_is_imported_late(package):
    folder = PACKAGE / package
    tree = ast.parse((folder / "__init__.pyi").read_text())
    typed = {
        (node.module or "", alias.name)
        for node in tree.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    module = importlib.import_module(f"shjax.{package}".rstrip("."))
    named = {(home, name) for home, some in module._NAMES.items() for name in some}
    assert typed == named | {("", name) for name in getattr(module, "_MODULES", ())}


def test_the_front_is_narrow():
    """At most 40 names beside the rooms; what they take, at most nine parameters."""
    assert len(shjax.__all__) == len(set(shjax.__all__))
    names = [n for n in shjax.__all__ if not inspect.ismodule(getattr(shjax, n))]
    assert len(names) <= 40
    assert set(dir(shjax)) == set(shjax.__all__)
    for name in shjax.__all__:
        assert getattr(shjax, name) is not None, name
    for module, tree in SOURCES:
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                taken = [*node.args.args, *node.args.kwonlyargs]
                taken = [a for a in taken if a.arg not in ("self", "cls")]
                inner = module.startswith("shjax.inverse.") and len(taken) < 12
                assert len(taken) <= 9 or inner, f"{module}.{node.name}"
    for name in (n for n in dir(shjax.inverse) if not n.startswith("_")):
        value = getattr(shjax.inverse, name)
        if inspect.isfunction(value):
            assert len(inspect.signature(value).parameters) <= 9, name


def test_files_are_short_and_left_to_the_formatter():
    long = {"isolation.py": 345}  # one story: a pool of processes that may die
    skipped = 0
    root = PACKAGE.parent
    for path in [
        p
        for d in ("shjax", "tests", "experiments", "docs")
        for p in (root / d).rglob("*.py")
    ]:
        text = path.read_text()
        skipped += text.count("# fmt: " + "skip")
        if path.is_relative_to(PACKAGE):
            assert text.count("\n") <= long.get(path.name, 300), path
    assert skipped < 20


def test_no_two_files_of_one_name_hold_different_things():
    """But for what a command and a room of the library share."""
    names = [path.stem for path in PACKAGE.rglob("*.py") if "cli" not in path.parts]
    twice = {n for n in names if names.count(n) > 1 and n != "__init__"}
    assert twice == {"coefficients"} & twice, twice


# Words that lean on a sentence before, which a search for a function does not show.
LEANING = ("Of ", "The same", "As ", "It ", "This ", "How ", "Where ", "Whether it")


@pytest.mark.parametrize(("module", "tree"), SOURCES, ids=[m for m, _ in SOURCES])
def test_first_sentences_stand_alone(module, tree):
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and node.name[0] != "_":
            text = ast.get_docstring(node) or ""
            assert not text.startswith(LEANING), f"{module}.{node.name}: {text[:60]}"


def test_citations_have_an_entry_and_the_index_holds_them():
    missing = []
    for module, tree in index_equations.modules():
        known = index_equations.references(tree)
        found = index_equations.citations(module, tree)
        missing += [one for one in found if one.key not in known]
    assert not missing, missing
    index = PACKAGE.parent / "docs" / "equations.md"
    assert index.read_text() == index_equations.markdown(), (
        "run docs/index_equations.py"
    )
