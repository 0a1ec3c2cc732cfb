"""The Pareto plots, time against error."""

from __future__ import annotations

import io
from pathlib import Path

from experiments.speed.results import NOT_A_METHOD, entries, front, of_material


def save_plots(out: Path, result: dict) -> dict[str, list[str]]:
    """Write a picture for each material; their names by material."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from PIL import Image

    found: dict[str, list[str]] = {}
    for material in dict.fromkeys(m for _, m, _ in entries(result)):
        group = of_material(result, material)
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
        drawn = io.BytesIO()
        figure.savefig(drawn, dpi=75)
        plt.close(figure)
        # A palette is enough for lines, and takes a third.
        Image.open(drawn).convert("RGB").quantize(128).save(out / name, optimize=True)
        found[material] = [name]
    return found


def draw(axis, entry: dict) -> None:
    """A Pareto plot of one panorama and material on a pair of log axes."""
    import matplotlib.pyplot as plt

    methods = {k: v for k, v in entry["methods"].items() if k != NOT_A_METHOD}
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
