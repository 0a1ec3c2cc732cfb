"""The API reference from the docstrings, as web pages.

    python -m experiments.reference --out reference

Annotations are shown as they are written: they hold shapes, which are not Python types
that could be looked up.
"""

from __future__ import annotations

import importlib
import pkgutil
import sys
from pathlib import Path

import click
import pdoc
import pdoc.doc
import pdoc.doc_types
import pdoc.render

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import shjax


def build(out: Path) -> None:
    """Write the pages of every module into a folder.

    Args:
        out: The folder.
    """

    def as_written(annotation, *_context):
        return annotation

    pdoc.doc_types.safe_eval_type = as_written
    pdoc.doc.safe_eval_type = as_written
    pdoc.render.configure(docformat="google")
    for name in dir(shjax):  # those that are imported late, too
        setattr(shjax, name, getattr(shjax, name))
    for room in pkgutil.walk_packages(shjax.__path__, "shjax."):
        parent, _, name = room.name.rpartition(".")
        listed = getattr(sys.modules[parent], "__all__", None)
        if listed is not None and name not in listed and "__" not in name:
            importlib.import_module(room.name)
            listed.append(name)  # pdoc writes pages of what is listed
    pdoc.pdoc("shjax", output_directory=out)


@click.command()
@click.option("--out", required=True, type=click.Path(path_type=Path))
def main(out: Path) -> None:
    """Write the reference."""
    build(out)
    print(out / "shjax.html")


if __name__ == "__main__":
    main()
