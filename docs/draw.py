"""Draw the two figures of the mathematics: R's frame, and a reflection map's axes.

python docs/draw.py
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl

mpl.use("svg")
import matplotlib.pyplot as plt
import numpy as np

import shjax
from shjax import brdf, io

HERE = Path(__file__).resolve().parent
INK, RED, BLUE = "#333333", "#b2182b", "#2166ac"


def _arrow(axis, towards, text, colour, *, shift=(0.0, 0.0)) -> None:
    axis.annotate(
        "",
        xy=towards,
        xytext=(0, 0),
        arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.8},
    )
    place = np.array(towards) * 1.08 + np.array(shift)
    axis.text(*place, text, color=colour, ha="center", va="center", fontsize=12)


def frame() -> None:
    """The normal halfway between the view and R, and the angles about R."""
    figure, axis = plt.subplots(figsize=(5.2, 3.6))
    half = np.radians(34)
    at = lambda angle: (np.sin(angle), np.cos(angle))  # noqa: E731 - two letters
    axis.plot([-1.25, 1.25], [0, 0], color=INK, lw=2)
    axis.fill_between([-1.25, 1.25], [0, 0], [-0.09, -0.09], color="#dddddd")
    _arrow(axis, at(0), "n, normal", INK, shift=(0.0, 0.03))
    _arrow(axis, at(-half), "v, view", BLUE, shift=(-0.08, 0.02))
    _arrow(axis, at(half), "R = 2 (n.v) n - v", RED, shift=(0.22, 0.04))
    for start, end, radius, place, text, colour in (
        (-half, half, 0.5, (-0.62, 0.34), r"$\theta_o$ of the view", BLUE),
        (0, half, 0.26, (0.12, 0.32), r"$\theta_o / 2$", INK),
    ):
        angles = np.linspace(start, end, 40)
        axis.plot(radius * np.sin(angles), radius * np.cos(angles), color=colour, lw=1)
        axis.text(*place, text, color=colour, ha="center", fontsize=9)
    middle = np.array(at(half)) * 0.98
    for turn, text in ((half + np.pi / 2, r"$e_\theta$"), (None, r"$e_\phi$")):
        if turn is None:
            axis.plot(*middle, "o", color=RED, ms=9, mfc="none")
            axis.plot(*middle, ".", color=RED, ms=4)
            axis.text(middle[0] + 0.02, middle[1] - 0.12, text, color=RED, fontsize=10)
            continue
        tip = middle + 0.3 * np.array(at(turn))
        axis.annotate(
            "", xy=tip, xytext=middle, arrowprops={"arrowstyle": "->", "color": RED}
        )
        axis.text(tip[0] + 0.07, tip[1] - 0.02, text, color=RED, fontsize=10)
    axis.set_xlim(-1.3, 1.5)
    axis.set_ylim(-0.12, 1.22)
    axis.set_aspect("equal")
    axis.axis("off")
    figure.savefig(HERE / "frame.svg", bbox_inches="tight")


def reflection_map() -> None:
    """A map's rows and columns are R; its coefficients are functions of the view."""
    envmap = io.read_envmap(io.shipped_panorama())
    rho = shjax.brdf_coefs(brdf.ggx(0.3, 1.0), l_max=24, p_max=1)
    light = envmap.lighting(l_max=24)
    found = shjax.prefilter(light, rho, n_theta=64, n_phi=128)
    maps = np.asarray(found.coefs).mean(axis=-1)
    figure, axes = plt.subplots(1, 4, figsize=(11, 2.3), layout="constrained")
    names = ("p = 0, q = 0", "p = 1, q = -1", "p = 1, q = 0", "p = 1, q = 1")
    for k, axis in enumerate(axes):
        limit = float(np.quantile(np.abs(maps[..., k]), 0.99))
        axis.imshow(maps[..., k], cmap="RdBu_r", vmin=-limit, vmax=limit)
        axis.set_title(f"coefficient {k}: {names[k]}", fontsize=9)
        axis.set_xticks([0, 63.5, 127], [r"$\pi$", "0", r"$-\pi$"], fontsize=8)
        axis.set_yticks([0, 31.5, 63], ["0", r"$\pi/2$", r"$\pi$"], fontsize=8)
        axis.set_xlabel(r"azimuth of R, axis -3", fontsize=8)
    axes[0].set_ylabel("polar angle of R, axis -4", fontsize=8)
    figure.suptitle(
        "coefs (..., n_theta, n_phi, Q, C): rows and columns are the reflected direction "
        "R, Q functions of the view in R's frame",
        fontsize=9,
    )
    figure.savefig(HERE / "reflection_map.svg", dpi=80)


if __name__ == "__main__":
    mpl.rcParams["svg.hashsalt"] = "shjax"
    frame()
    reflection_map()
