"""Write the index of equations from the docstrings: which function holds which equation.

python docs/index_equations.py
"""

from __future__ import annotations

import ast
import collections
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).resolve().parent
PACKAGE = HERE.parent / "shjax"
KEY = r"[A-Z][A-Za-z]{0,8}\d{0,2}[a-z]?"
CITATION = re.compile(rf"\[({KEY}(?:, [^\[\]]*)?(?:; {KEY}(?:, [^\[\]]*)?)*)\]")
ENTRY = re.compile(rf"^\s*\[({KEY})\] (.+)", re.M)
NOT_KEYS = {
    "C",
    "N",
    "K",
    "L",
    "P",
    "Q",
    "J",
    "D",
    "E",
    "H",
    "W",
    "T",
    "M",
    "V",
    "X",
    "Y",
}


class Citation(NamedTuple):
    """A citation: the module, what cites (``""``: the module), the key, and where."""

    module: str
    name: str
    key: str
    place: str


def modules() -> Iterator[tuple[str, ast.Module]]:
    """Every module of the package and its syntax tree."""
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
        name = ".".join(part for part in parts if part != "__init__")
        yield name, ast.parse(path.read_text())


def references(tree: ast.Module) -> dict[str, str]:
    """Entries of the References list of a module, by key."""
    text = ast.get_docstring(tree) or ""
    _, _, listed = text.partition("References:")
    found, last = {}, None
    for line in listed.splitlines():
        entry = ENTRY.match(line)
        if entry:
            last = entry[1]
            found[last] = entry[2].strip()
        elif last is not None and line.strip():
            found[last] += " " + line.strip()
    return found


def citations(module: str, tree: ast.Module) -> Iterator[Citation]:
    """Citations in the docstrings of a module, its functions and its classes."""
    nodes = [("", tree)]
    kinds = (ast.FunctionDef, ast.ClassDef)
    for node in tree.body:
        if isinstance(node, kinds):
            nodes.append((node.name, node))
        if isinstance(node, ast.ClassDef):
            inner = [sub for sub in node.body if isinstance(sub, kinds)]
            nodes += [(f"{node.name}.{sub.name}", sub) for sub in inner]
    for name, node in nodes:
        text = (ast.get_docstring(node) or "").partition("References:")[0]
        for found in CITATION.finditer(re.sub(r"``[^`]*``", "", text)):
            for one in found[1].split("; "):
                key, _, place = one.partition(", ")
                if key not in NOT_KEYS:
                    yield Citation(module, name, key, place.removeprefix("Eq. "))


def markdown() -> str:
    """The index, one table per source."""
    by_key = collections.defaultdict(list)
    titles: dict[str, str] = {}
    for module, tree in modules():
        titles = references(tree) | titles
        for one in citations(module, tree):
            if one.place and one.name:
                by_key[one.key].append(one)
    lines = [
        "# Index of equations",
        "",
        "Made from the docstrings by `docs/index_equations.py`.",
    ]
    for key in sorted(by_key):
        lines += ["", f"## [{key}] {titles[key]}", "", "| | function |", "|---|---|"]
        rows = sorted(by_key[key], key=lambda one: (_order(one.place), one.module))
        lines += [f"| {one.place} | `{one.module}.{one.name}` |" for one in rows]
    return "\n".join(lines) + "\n"


def _order(place: str) -> tuple[float, ...]:
    return tuple(float(n) for n in re.findall(r"\d+", place)) or (0.0,)


if __name__ == "__main__":
    (HERE / "equations.md").write_text(markdown())
