"""Figures 5.5 to 5.9 of the thesis, redrawn from the data at hand: PNG and JSON each.

    python experiments/figures_5.py --out out/figures

5.5 accuracy of a reflected light field over F, its estimates and the exact prediction;
5.6 the microfacet model for P = 0, 1, 2; 5.7 the 61 CUReT samples for P = 0 .. 5; 5.8 SHRM
beside Kautz and McCool's map without azimuth (CUReT velvet); 5.9 SHRM beside Cabral's
twelve maps (GGX, Kajiya-Kay). The light is the shipped city; velvet and 5.7 need the
measured data.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click
import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import shjax
from experiments.data import data_folder
from experiments.prefiltering import rms
from shjax import brdf, io, plot, render
from shjax.brdf import Brdf, Resolution
from shjax.reflection import ReflectionMap, icosahedral_maps
from shjax.sphere import icosahedron

EXACT_ROWS = 64
VELVET = 7


def city(rows: int = EXACT_ROWS) -> jnp.ndarray:
    """The shipped panorama averaged to ``rows`` rows."""
    return jnp.asarray(io.read_envmap(io.shipped_panorama()).to_latlong(rows).radiance)


def figure_5_5(orders: int = 20, exponent: float = 32.0):
    """Accuracy over F: the truth (to F = 30), the two estimates, the exact prediction."""
    lighting = shjax.analyze(city(), l_max=30)
    spectrum = shjax.power_spectrum(lighting)
    gains = shjax.brdf.radial_coefs(brdf.phong(exponent), l_max=30)
    reflected = np.asarray(
        shjax.power_spectrum(shjax.reflection.convolve(lighting, gains))
    )
    light = np.asarray(spectrum).sum(axis=1)
    rho = np.asarray(gains)[:, 0] ** 2 * (2 * np.arange(31) + 1) / (4 * np.pi)
    expansion = shjax.brdf.expand(brdf.phong(exponent), l_max=30, p_max=0)

    def held(energy: np.ndarray) -> np.ndarray:
        return np.cumsum(energy)[:orders] / energy.sum()

    data = {
        "F": list(range(orders)),
        "exact": held(reflected.sum(axis=1)).tolist(),
        "minimum of errors": np.maximum(held(light), held(rho)).tolist(),
        "residual heuristic (5.19)": [
            1 - shjax.brdf.residual_heuristic(spectrum, gains, l_max=f)
            for f in range(orders)
        ],
        "predicted from the spectrum": [
            1
            - float(
                shjax.brdf.predicted_energy_error(spectrum, expansion, l_max=f, p_max=0)
            )
            for f in range(orders)
        ],
    }
    figure, axes = plot.new_figure(1, 1, 4.2, 3.0)
    styles = ("k-", "C0--", "C1-.", "C3:")
    for (name, values), style in zip(list(data.items())[1:], styles, strict=True):
        axes[0, 0].plot(data["F"], values, style, label=name)
    axes[0, 0].set_xlabel("F")
    axes[0, 0].set_ylabel("energy held")
    axes[0, 0].legend(fontsize=7, frameon=False)
    return figure, data


def _picture(ball, model: Brdf, f: int, p: int, *, zonal: bool = False):
    lighting = shjax.analyze(city(), l_max=f)
    rho = shjax.brdf_coefs(model, l_max=f, p_max=p)
    if zonal:
        rho = rho.at[:, :, 1:].set(0)
    return render.image(ball, shjax.prefilter(lighting, rho))


def figure_5_6(size: int = 128, sigma: float = 0.2, f: int = 30):
    """The microfacet model for P = 0, 1, 2, with the energy each holds."""
    ball, model = render.sphere(size), brdf.gaussian_microfacet(sigma)
    held = shjax.brdf.energy_held(shjax.brdf.expand(model, l_max=f, p_max=2))[f]
    exact = render.reference(ball, city(), model)
    pictures = {
        f"P = {p}, {held[p]:.0%} of the energy": _picture(ball, model, f, p)
        for p in range(3)
    }
    errors = {name: rms(picture, exact) for name, picture in pictures.items()}
    return plot.errors(pictures, exact), {"held": held.tolist(), "rms": errors}


def figure_5_7(folder: Path, f: int = 30, samples: int = 61):
    """Accuracy of all CUReT samples for P = 0 .. 5."""
    nodes, held = Resolution(48, 32, 40), []
    for sample in range(1, samples + 1):
        model = brdf.read_curet(folder / "abrdf.dat", folder / "table.txt", sample)
        expansion = shjax.brdf.expand(model, l_max=f, p_max=5, resolution=nodes)
        held.append(shjax.brdf.energy_held(expansion)[f].tolist())
    values = np.array(held)
    figure, axes = plot.new_figure(1, 1, 7.0, 2.6)
    axis, where = axes[0, 0], np.arange(1, samples + 1)
    for p in range(6):
        last = p == 5
        axis.plot(
            where,
            values[:, p],
            "o" if last else "d",
            ms=4 if last else 3,
            color="k" if last else str(0.8 - 0.12 * p),
            label=f"P = {p}",
        )
    axis.axhline(0.9, color="C3", lw=0.8)
    axis.set_xlabel("CUReT sample")
    axis.set_ylabel(f"energy held, F = {f}")
    axis.legend(fontsize=6, ncols=6, frameon=False, loc="lower center")
    above = {f"P = {p}": int(np.sum(values[:, p] > 0.9)) for p in range(6)}
    return figure, {"held": held, "above 90 %": above}


def figure_5_8(folder: Path, size: int = 128, f: int = 30, p: int = 5):
    """SHRM beside the map without azimuth, on CUReT's velvet."""
    ball = render.sphere(size)
    model = brdf.read_curet(folder / "abrdf.dat", folder / "table.txt", VELVET)
    exact = render.reference(ball, city(), model)
    pictures = {
        f"SHRM, P = {p}": _picture(ball, model, f, p),
        "q = 0 (Kautz and McCool)": _picture(ball, model, f, p, zonal=True),
    }
    errors = {name: rms(picture, exact) for name, picture in pictures.items()}
    return plot.errors(pictures, exact), {"rms": errors}


def cabral(ball, maps) -> np.ndarray:
    """Cabral's interpolation: the three nearest of twelve maps, by spherical areas."""
    vertices = icosahedron()
    view = np.asarray(ball.views)[tuple(s // 2 for s in ball.mask.shape)]
    near = np.argsort(-(vertices @ view))[:3]
    corners = vertices[near]
    weights = np.linalg.solve(corners.T, view)
    weights = np.maximum(weights, 0) / np.maximum(weights, 0).sum()
    images = np.asarray(icosahedral_maps(maps))[near]
    mixed = np.einsum("v,vijc->ijc", weights, images)[:, :, None] * np.sqrt(4 * np.pi)
    centre = "reflection" if ball.tangents is None else "tangent"
    mixed = jnp.asarray(mixed, jnp.float32)
    one = ReflectionMap.from_coefs(mixed, frame="global", centre=centre)
    return np.asarray(render.image(ball, one))


def figure_5_9(size: int = 128, f: int = 30):
    """SHRM beside Cabral's twelve maps: near grazing, and fibres."""
    cases = {
        "GGX 0.3, f0 = 0.04": (brdf.ggx(0.3, 0.04), 12, False),
        "Kajiya-Kay 32": (brdf.kajiya_kay(32.0), 10, True),
    }
    figures, data = {}, {}
    for name, (model, p, fibres) in cases.items():
        ball = render.sphere(size, tangents=fibres)
        exact = render.reference(ball, city(), model)
        lighting = shjax.analyze(city(), l_max=f)
        expansion = shjax.brdf.expand(model, l_max=f, p_max=p)
        maps = shjax.prefilter(
            lighting, expansion, n_theta=96, n_phi=192, frame="global"
        )
        pictures = {
            f"SHRM, P = {p}": render.image(ball, maps),
            "twelve maps (Cabral)": cabral(ball, maps),
        }
        data[name] = {k: rms(picture, exact) for k, picture in pictures.items()}
        figures[name] = plot.errors(pictures, exact)
    return figures, data


def run(out: Path, *, size: int = 128, samples: int = 61) -> dict:
    """Draw what the data allow; returns the numbers, and writes PNG and JSON."""
    out.mkdir(parents=True, exist_ok=True)
    curet = data_folder() / "brdf" / "curet"
    made = {"5.5": figure_5_5(), "5.6": figure_5_6(size)}
    if curet.is_dir():
        made["5.7"] = figure_5_7(curet, samples=samples)
        made["5.8"] = figure_5_8(curet, size)
    else:
        print(
            f"no CUReT data at {curet}: figures 5.7 and 5.8 left out", file=sys.stderr
        )
    figures, data = figure_5_9(size)
    made |= {"5.9": (figures["GGX 0.3, f0 = 0.04"], data)}
    made |= {"5.9b": (figures["Kajiya-Kay 32"], data)}
    for name, (figure, numbers) in made.items():
        stem = f"figure_{name.replace('.', '_')}"
        figure.savefig(out / f"{stem}.png", dpi=150)
        (out / f"{stem}.json").write_text(json.dumps(numbers, indent=1) + "\n")
    return {name: numbers for name, (_, numbers) in made.items()}


@click.command()
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    required=True,
    help="Folder for the figures.",
)
def main(out: Path) -> None:
    """Write the figures."""
    for name, numbers in run(out).items():
        shown = {k: v for k, v in numbers.items() if k in ("rms", "above 90 %")} or ""
        print(f"figure {name}: {shown}")


if __name__ == "__main__":
    main()
