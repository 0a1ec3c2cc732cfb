"""The report: tables, plots and a page of prose, all from the numbers of one run."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from experiments.speed.plots import save_plots
from experiments.speed.prose import full_size, prose
from experiments.speed.results import entries
from experiments.speed.tables import (
    cheapest_table,
    choice_table,
    memory_table,
    method_table,
)
from experiments.versions import versions_line
from experiments.writing import markdown_table
from shjax import io

Block = tuple[str, Any]  # kind (h1, h2, p, table, image) and content


def write(out: Path, result: dict, *, plots: bool = True) -> None:
    """Write report.md, report.html and, where asked, the plots.

    Args:
        out: The folder.
        result: What :func:`experiments.speed_vs_error.run` returned.
        plots: Whether to draw; matplotlib is needed.
    """
    pictures = save_plots(out, result) if plots else {}
    blocks = list(_blocks(result, pictures))
    io.write_text(out / "report.md", _markdown(blocks))
    io.write_text(out / "report.html", _html(blocks, out))


def _blocks(result: dict, pictures: dict[str, list[str]]) -> Iterator[Block]:
    about = result["about"]
    yield "h1", "Speed against error"
    versions = versions_line(about["versions"])
    yield "p", _about(about, versions)
    yield "h2", "When which method wins"
    for line in prose(result):
        yield "p", line
    yield "h2", "Does the size of the panorama matter?"
    yield "p", full_size(result)
    names = {material for _, material, _ in entries(result)}
    for material in sorted(names, key=lambda m: (m != "irradiance", m)):
        yield "h2", material
        for picture in pictures.get(material, []):
            yield "image", picture
        yield "table", cheapest_table(result, material)
        yield "table", method_table(result, material)
        if len(choices := choice_table(result, material)) > 1:
            yield "table", choices
    if result["memory"]:
        yield "h2", "Memory"
        yield "p", _MEMORY
        yield "table", memory_table(result)


_MEMORY = (
    "Largest resident size of a process that does nothing but one method (Python and JAX, "
    "about 200 MB, included), and what its compiled evaluation needs."
)


_SHARED = ", other materials at the same time on the other cores"


def _about(about: dict, versions: str) -> str:
    return (
        f"Panoramas averaged to {2 * about['rows']} x {about['rows']}, "
        f"{about['pairs']} orientations and views, RGB float32, one thread, one run"
        f"{_SHARED if about['jobs'] > 1 else ''}. "
        "*Evaluate* is the time of all points, *build* what is done once for a light, "
        "both warm medians; what a material needs once for all lights is not timed. "
        "Errors are weighted rms over all orientations and views, relative to the rms of "
        f"the reference, which is the sum over every pixel. {versions}."
    )


def _markdown(blocks: list[Block]) -> str:
    lines: list[str] = []
    for kind, content in blocks:
        if kind == "table":
            lines.append(markdown_table(content[0], content[1:]))
        elif kind == "image":
            lines.append(f"![Pareto front]({content})")
        else:
            lines.append({"h1": "# ", "h2": "## ", "p": ""}[kind] + content)
        lines.append("")
    return "\n".join(lines)


_STYLE = """body{font:15px/1.5 system-ui,sans-serif;max-width:70em;margin:2em auto;
padding:0 1em}table{border-collapse:collapse;font-size:12px;margin:1em 0;display:block;
overflow-x:auto}td,th{padding:2px 8px;border-bottom:1px solid #ddd;text-align:right}
td:first-child,th:first-child{text-align:left}img{max-width:100%}"""


def _html(blocks: list[Block], out: Path) -> str:
    parts = []
    for kind, content in blocks:
        if kind == "table":
            head, *rest = content
            rows = ["".join(f"<th>{html.escape(c)}</th>" for c in head)]
            rows += ["".join(f"<td>{html.escape(c)}</td>" for c in row) for row in rest]
            parts.append(
                "<table>" + "".join(f"<tr>{r}</tr>" for r in rows) + "</table>"
            )
        elif kind == "image":
            data = base64.b64encode((out / content).read_bytes()).decode()
            parts.append(f'<img alt="Pareto front" src="data:image/png;base64,{data}">')
        else:
            text = html.escape(content)
            for mark, tag in (("**", "b"), ("*", "i")):
                pieces = text.split(mark)
                text = pieces[0] + "".join(
                    (f"<{tag}>" if k % 2 == 0 else f"</{tag}>") + piece
                    for k, piece in enumerate(pieces[1:])
                )
            parts.append(f"<{kind}>{text}</{kind}>")
    body = "\n".join(parts)
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8">'
        f"<title>Speed against error</title><style>{_STYLE}</style>\n{body}\n</html>\n"
    )
