"""The Pareto plots, time against error."""

from __future__ import annotations

import io
from pathlib import Path

from experiments.speed.results import NOT_A_METHOD, entries, front, of_material

_MARKERS = "osD^vPX*<>"


def save_plots(out: Path, result: dict) -> dict[str, list[str]]:
    """Write a picture for each material; their names by material."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from PIL import Image

    found: dict[str, list[str]] = {}
    for material in dict.fromkeys(m for _, m, _ in entries(result)):
        group = of_material(result, material)
        with plt.rc_context({"font.size": 13, "axes.titlesize": 13}):
            figure, axes = plt.subplots(
                1,
                len(group),
                figsize=(5 * len(group) + 1, 5.8),
                sharey=True,
                squeeze=False,
                layout="constrained",
            )
            for axis, (panorama, entry) in zip(axes[0], group, strict=True):
                draw(axis, entry)
                axis.set_title(f"{material}, {panorama}")
            axes[0, 0].set_ylabel("relative rms error")
            handles, labels = axes[0, 0].get_legend_handles_labels()
            figure.legend(
                handles,
                labels,
                loc="outside lower center",
                fontsize=12,
                frameon=False,
                ncols=max(2, min(4, 1 + len(group))),
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
    colours = plt.get_cmap("tab10")
    count = {True: 0, False: 0}  # ours filled and solid, others open and dashed
    floor = entry["reference's own error"]
    for family in families:
        rows = [row for row in methods.values() if row["family"] == family]
        rows.sort(key=lambda row: row["seconds"])
        x = [1e3 * row["seconds"] for row in rows]
        y = [max(row["rms"], 1e-5) for row in rows]
        own = rows[0]["ours"]
        axis.plot(
            x,
            y,
            linestyle="-" if own else "--",
            linewidth=1.5 if own else 1,
            marker=_MARKERS[count[own] % len(_MARKERS)],
            color=colours(count[own] % 10),
            markersize=6,
            markerfacecolor=None if own else "white",
            label=family + (" (shjax)" if own else ""),
        )
        count[own] += 1
    names = front(methods)
    x = [1e3 * methods[name]["seconds"] for name in names]
    y = [max(methods[name]["rms"], 1e-5) for name in names]
    axis.step(
        x,
        y,
        where="post",
        color="black",
        alpha=0.25,
        linewidth=6,
        zorder=0,
        label="the fastest at each error",
    )
    axis.axhline(floor, color="grey", linestyle=":", label="the reference's own error")
    axis.set(xscale="log", yscale="log", xlabel="ms to evaluate all points")
    axis.grid(alpha=0.2)
