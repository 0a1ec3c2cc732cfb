"""The report: tables, plots and a page of prose, all from the numbers of one run."""

from __future__ import annotations

import base64
import html
import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from shjax import io

ERRORS = (0.3, 0.1, 0.03, 0.01, 0.003)
_NOT_A_METHOD = "brute force"  # the reference itself

Block = tuple[str, Any]  # kind (h1, h2, p, table, image) and content


def write(out: Path, result: dict, *, plots: bool = True) -> None:
    """Write report.md, report.html and, where asked, the plots.

    Args:
        out: The folder.
        result: What :func:`experiments.speed_vs_error.run` returned.
        plots: Whether to draw; matplotlib is needed.
    """
    pictures = _plots(out, result) if plots else {}
    blocks = list(_blocks(result, pictures))
    io.write_text(out / "report.md", _markdown(blocks))
    io.write_text(out / "report.html", _html(blocks, out))


def entries(result: dict) -> Iterator[tuple[str, str, dict]]:
    """Panorama, material (or ``irradiance``) and what was measured there."""
    for panorama, entry in result["irradiance"].items():
        yield panorama, "irradiance", entry
    for panorama, group in result["glossy"].items():
        for material, entry in group.items():
            yield panorama, material, entry


def front(methods: dict[str, dict], key: str = "seconds") -> list[str]:
    """Names of the methods that no other beats in both time and error, fastest first."""
    best, found = np.inf, []
    for name, row in sorted(methods.items(), key=lambda item: item[1][key]):
        if name != _NOT_A_METHOD and row["rms"] < best:
            best = row["rms"]
            found.append(name)
    return found


def cheapest(
    methods: dict[str, dict], error: float, *, whole: bool = False
) -> str | None:
    """The fastest method within an error; with ``whole``, building counted."""
    within = {
        name: row["seconds"] + whole * row["build seconds"]
        for name, row in methods.items()
        if row["rms"] <= error and name != _NOT_A_METHOD
    }
    return min(within, key=within.__getitem__) if within else None


def _blocks(result: dict, pictures: dict[str, list[str]]) -> Iterator[Block]:
    about = result["about"]
    yield "h1", "Speed against error"
    versions = ", ".join(f"{k} {v}" for k, v in about["versions"].items())
    yield "p", _about(about, versions)
    yield "h2", "When which method wins"
    for line in prose(result):
        yield "p", line
    yield "h2", "Does the size of the panorama matter?"
    yield "p", _full_size(result)
    names = {material for _, material, _ in entries(result)}
    for material in sorted(names, key=lambda m: (m != "irradiance", m)):
        yield "h2", material
        for picture in pictures.get(material, []):
            yield "image", picture
        yield "table", _cheapest_table(result, material)
        yield "table", _method_table(result, material)
    if result["memory"]:
        yield "h2", "Memory"
        yield "p", _MEMORY
        yield "table", _memory_table(result)


_MEMORY = (
    "Largest resident size of a process that does nothing but one method (Python and JAX, "
    "about 200 MB, included), and what its compiled evaluation needs."
)


def _about(about: dict, versions: str) -> str:
    return (
        f"Panoramas averaged to {2 * about['rows']} x {about['rows']}, "
        f"{about['pairs']} orientations and views, RGB float32, one thread, one run. "
        "*Evaluate* is the time of all points, *build* what is done once for a light, "
        "both warm medians; what a material needs once for all lights is not timed. "
        "Errors are weighted rms over all orientations and views, relative to the rms of "
        f"the reference, which is the sum over every pixel. {versions}."
    )


def prose(result: dict) -> list[str]:
    """A page of words about who wins where, generated from the numbers."""
    lines = []
    groups = {
        "irradiance": [e for _, m, e in entries(result) if m == "irradiance"],
        "glossy reflection": [e for _, m, e in entries(result) if m != "irradiance"],
    }
    for what, group in groups.items():
        for error in ERRORS:
            wins = Counter(
                entry["methods"][name]["family"]
                for entry in group
                if (name := cheapest(entry["methods"], error)) is not None
            )
            if not wins:
                lines.append(f"No method of {what} is within {error:.1%} anywhere.")
                continue
            none = len(group) - sum(wins.values())
            words = ", ".join(f"{family} ({n})" for family, n in wins.most_common(4))
            rest = f"; none in {none}" if none else ""
            lines.append(
                f"**{what}, error at most {error:.1%}**: the fastest evaluation is that "
                f"of {words} of {len(group)} cases{rest}."
            )
    lines += [_losses(result), *_choices(result), _predictions(result)]
    return [line for line in lines if line]


def _losses(result: dict) -> str:
    """Where another method is faster than ours at an error."""
    worst: list[tuple[float, str]] = []
    for panorama, material, entry in entries(result):
        ours = {k: v for k, v in entry["methods"].items() if v["ours"]}
        for error in ERRORS:
            best, own = cheapest(entry["methods"], error), cheapest(ours, error)
            if best is None or entry["methods"][best]["ours"]:
                continue
            rival = entry["methods"][best]["seconds"]
            if own is None:
                words = f"{material} under {panorama} at {error:.1%}: only {best}"
                worst.append((np.inf, words))
                continue
            ratio = entry["methods"][own]["seconds"] / rival
            words = (
                f"{material} under {panorama} at {error:.1%}: {best} takes 1/{ratio:.1f} "
                f"of the time of {own}"
            )
            worst.append((ratio, words))
    if not worst:
        return "No other method is faster than shjax's at any of these errors."
    worst.sort(key=lambda pair: -pair[0])
    shown = "; ".join(words for _, words in worst[:6])
    return f"**Where ours lose** ({len(worst)} cases), the largest first: {shown}."


def _choices(result: dict) -> Iterator[str]:
    """What choose_model picked, and whether something cheaper was as good."""
    for error in (0.3, 0.1, 0.03):
        name = f"choose_model {error:g}"
        measured, beaten, off, count = [], Counter(), 0, 0
        for _, material, entry in entries(result):
            row = entry["methods"].get(name)
            if material == "irradiance" or row is None:
                continue
            count += 1
            measured.append(row["rms"])
            off += row["rms"] > max(error, 1.15 * row["predicted"])
            best = cheapest(entry["methods"], row["rms"] * (1 + 1e-9))
            if best not in (None, name):
                beaten[entry["methods"][best]["family"]] += 1
        if not count:
            continue
        words = ", ".join(f"{family} in {n}" for family, n in beaten.most_common(3))
        faster = f"faster at no more error: {words}" if words else "nothing was faster"
        yield (
            f"**choose_model** asked for {error:g}: measured {np.median(measured):.3f} in "
            f"the median, {max(measured):.3f} at most; {off} of {count} above what was "
            f"asked and predicted; {faster}."
        )


def _predictions(result: dict) -> str:
    ratios = [
        row["rms"] / row["predicted"]
        for _, material, entry in entries(result)
        for row in entry["methods"].values()
        if row.get("predicted", 0) > 3 * entry["reference's own error"]
        and row["family"] in ("SHRM", "radial maps")
    ]
    if not ratios:
        return ""
    low, mid, high = np.quantile(ratios, [0.05, 0.5, 0.95])
    return (
        "**Predicted and measured**: over all maps whose predicted error is above three "
        f"times the reference's own, measured over predicted is {mid:.2f} in the median, "
        f"{low:.2f} to {high:.2f} for nine in ten ({len(ratios)} maps)."
    )


def _full_size(result: dict) -> str:
    found = result.get("full size")
    if not found:
        return "Not measured in this run."
    rows = ", ".join(
        f"{name} {row['small']:.3f} and {row['full']:.3f}"
        for name, row in found["methods"].items()
    )
    return (
        f"{found['panorama']} at {found['columns']} x {found['rows']}, "
        f"{found['material']}, {found['pairs']} orientations: errors with the averaged "
        f"and with the whole panorama: {rows}."
    )


def _milliseconds(seconds: float) -> str:
    return f"{1e3 * seconds:.3g}"


def _of_material(result: dict, material: str) -> list[tuple[str, dict]]:
    return [(p, e) for p, m, e in entries(result) if m == material]


def _cheapest_table(result: dict, material: str) -> list[list[str]]:
    table = [["panorama", "own error of the reference", *(f"{e:.1%}" for e in ERRORS)]]
    for panorama, entry in _of_material(result, material):
        row = [panorama, _own(entry)]
        for error in ERRORS:
            name = cheapest(entry["methods"], error)
            if name is None:
                row.append("none")
                continue
            whole = cheapest(entry["methods"], error, whole=True) or name
            found = entry["methods"]
            words = f"{name}, {_milliseconds(found[name]['seconds'])} ms"
            if whole != name:
                both = found[whole]["seconds"] + found[whole]["build seconds"]
                words += f" (with building: {whole}, {_milliseconds(both)} ms)"
            row.append(words)
        table.append(row)
    return table


def _own(entry: dict) -> str:
    error = entry["reference's own error"]
    return f"{error:.2g}"


def _method_table(result: dict, material: str) -> list[list[str]]:
    group = _of_material(result, material)
    table = [
        ["method", "build, ms", "evaluate, ms", "compile, s", "stored, kB",
         *(f"rms, {p}" for p, _ in group), "max", "most negative", "predicted"]
    ]  # fmt: skip
    first = group[0][1]["methods"]
    for name, row in first.items():
        errors = [e["methods"].get(name, {}).get("rms") for _, e in group]
        predicted = row.get("predicted")
        table.append(
            [name, _milliseconds(row["build seconds"]), _milliseconds(row["seconds"]),
             f"{row.get('compile seconds', 0):.2f}", f"{row['stored bytes'] / 1e3:.3g}",
             *("" if e is None else f"{e:.4f}" for e in errors), f"{row['max']:.3g}",
             f"{row['most negative']:.2g}", "" if predicted is None else f"{predicted:.4f}"]
        )  # fmt: skip
    return table


def _memory_table(result: dict) -> list[list[str]]:
    compiled = {
        name: row.get("compiled bytes", 0)
        for _, _, entry in entries(result)
        for name, row in entry["methods"].items()
    }
    table = [["method", "process, MB", "compiled evaluation, MB"]]
    for name, size in sorted(result["memory"].items(), key=lambda item: item[1] or 0):
        known = "failed" if size is None else f"{size / 1e6:.0f}"
        table.append([name, known, f"{compiled.get(name, 0) / 1e6:.2f}"])
    return table


def _plots(out: Path, result: dict) -> dict[str, list[str]]:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    found: dict[str, list[str]] = {}
    for material in dict.fromkeys(m for _, m, _ in entries(result)):
        group = _of_material(result, material)
        figure, axes = plt.subplots(
            1, len(group), figsize=(4.6 * len(group) + 2.2, 4.2), sharey=True,
            squeeze=False, layout="constrained",
        )  # fmt: skip
        for axis, (panorama, entry) in zip(axes[0], group, strict=True):
            draw(axis, entry)
            axis.set_title(f"{material}, {panorama}", fontsize=10)
        axes[0, 0].set_ylabel("relative rms error")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="outside right upper", fontsize=7, frameon=False
        )
        name = "".join(c if c.isalnum() else "_" for c in material) + ".png"
        figure.savefig(out / name, dpi=75, pil_kwargs={"optimize": True})
        plt.close(figure)
        found[material] = [name]
    return found


def draw(axis, entry: dict) -> None:
    """A Pareto plot of one panorama and material on a pair of log axes."""
    import matplotlib.pyplot as plt

    methods = {k: v for k, v in entry["methods"].items() if k != _NOT_A_METHOD}
    families = list(dict.fromkeys(row["family"] for row in methods.values()))
    colours = plt.get_cmap("tab20")
    floor = entry["reference's own error"]
    for number, family in enumerate(families):
        rows = [row for row in methods.values() if row["family"] == family]
        rows.sort(key=lambda row: row["seconds"])
        x = [1e3 * row["seconds"] for row in rows]
        y = [max(row["rms"], 1e-5) for row in rows]
        own = rows[0]["ours"]
        axis.plot(
            x, y, "o-" if own else "s--", color=colours(number % 20), linewidth=1,
            markersize=5, markerfacecolor=None if own else "white",
            label=family + (" (shjax)" if own else ""),
        )  # fmt: skip
    names = front(methods)
    x = [1e3 * methods[name]["seconds"] for name in names]
    y = [max(methods[name]["rms"], 1e-5) for name in names]
    axis.step(x, y, where="post", color="black", alpha=0.25, linewidth=5, zorder=0)
    axis.axhline(floor, color="grey", linestyle=":", linewidth=1)
    axis.set(xscale="log", yscale="log", xlabel="ms to evaluate all points")
    axis.grid(alpha=0.2)


def _markdown(blocks: list[Block]) -> str:
    lines: list[str] = []
    for kind, content in blocks:
        if kind == "table":
            head, *rest = content
            rows = [head, ["---"] * len(head), *rest]
            lines += ["| " + " | ".join(row) + " |" for row in rows]
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


def load(folder: Path) -> dict:
    """The numbers of a report."""
    return json.loads((folder / "results.json").read_text())
