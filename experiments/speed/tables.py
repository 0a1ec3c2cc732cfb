"""The tables, as rows of words with the head first."""

from __future__ import annotations

from experiments.speed.results import ERRORS, cheapest, entries, of_material


def _milliseconds(seconds: float) -> str:
    return f"{1e3 * seconds:.3g}"


def cheapest_table(result: dict, material: str) -> list[list[str]]:
    """The cheapest method under each error, a row a panorama."""
    table = [["panorama", "own error of the reference", *(f"{e:.1%}" for e in ERRORS)]]
    for panorama, entry in of_material(result, material):
        own = entry["reference's own error"]
        row = [panorama, f"{own:.2g}"]
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


def method_table(result: dict, material: str) -> list[list[str]]:
    """All that was measured of a material, a row a method."""
    group = of_material(result, material)
    table = [
        [
            "method",
            "build, ms",
            "evaluate, ms",
            "compile, s",
            "stored, kB",
            *(f"rms, {p}" for p, _ in group),
            "max",
            "most negative",
            "predicted",
        ]
    ]
    first = group[0][1]["methods"]
    for name, row in first.items():
        errors = [e["methods"].get(name, {}).get("rms") for _, e in group]
        predicted = row.get("predicted")
        table.append(
            [
                name,
                _milliseconds(row["build seconds"]),
                _milliseconds(row["seconds"]),
                f"{row.get('compile seconds', 0):.2f}",
                f"{row['stored bytes'] / 1e3:.3g}",
                *("" if e is None else f"{e:.4f}" for e in errors),
                f"{row['max']:.3g}",
                f"{row['most negative']:.2g}",
                "" if predicted is None else f"{predicted:.4f}",
            ]
        )
    return table


def choice_table(result: dict, material: str) -> list[list[str]]:
    """What ``choose_model`` took, a row a panorama and error."""
    table = [["panorama", "choose_model took", "predicted", "measured", "ms"]]
    for panorama, entry in of_material(result, material):
        for row in entry["methods"].values():
            if "chosen" in row:
                what = row["chosen"].partition("; predicted error")[0]
                measured = f"{row['rms']:.4f} +- {row['standard error']:.4f}"
                predicted = f"{row['predicted']:.4f}"
                time = _milliseconds(row["seconds"])
                table.append([panorama, what, predicted, measured, time])
    return table


def memory_table(result: dict) -> list[list[str]]:
    """Memory of each method, the smallest process first."""
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
