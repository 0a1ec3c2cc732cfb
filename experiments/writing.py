"""How the experiments write what they found: markdown tables, and files beside it."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from shjax import io


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; ends without a line break."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def write_result(out: Path | None, name: str, text: str, numbers: Any = None) -> None:
    """Print a page; write it and its numbers into a folder where one is given."""
    print(text)
    if out is None:
        return
    out.mkdir(parents=True, exist_ok=True)
    io.write_text(out / f"{name}.md", text.rstrip("\n") + "\n")
    if numbers is not None:
        io.write_text(out / f"{name}.json", json.dumps(numbers, indent=1) + "\n")
