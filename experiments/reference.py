"""The API reference from the docstrings, as web pages.

    python -m experiments.reference --out reference

Annotations are shown as they are written: they hold shapes, which are not Python types
that could be looked up.
"""

from __future__ import annotations

from pathlib import Path

import click
import pdoc
import pdoc.doc
import pdoc.doc_types
import pdoc.render


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
    pdoc.pdoc("shjax", output_directory=out)


@click.command()
@click.option("--out", required=True, type=click.Path(path_type=Path))
def main(out: Path) -> None:
    """Write the reference."""
    build(out)
    print(out / "shjax.html")


if __name__ == "__main__":
    main()
