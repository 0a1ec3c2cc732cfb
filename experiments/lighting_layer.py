"""The lighting layer beside split-sum and the thesis's SHRM: errors and pictures.

    python experiments/lighting_layer.py --out experiments/results

Errors are exact for a light's power spectrum, over all orientations and views, of the
specular part alone with single scattering, by the tables that the package ships, in
float32. Three tables: a light of spectrum 1/l^2 over all roughnesses; the eight CC0
panoramas with their suns left in; lights split off, relative to the whole. And
pictures: spheres and a mesh beside the exact integral, with differences.
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
from experiments.alternatives import split_sum
from experiments.data import PANORAMAS, data_folder
from experiments.versions import versions
from experiments.writing import markdown_table, write_result
from shjax import brdf, ibl, io, render
from shjax.brdf.quadrature import view_nodes
from shjax.display import show_difference, tone_map
from shjax.ibl.ggx_tables import ggx_tables, locate, view_functions
from shjax.reflection.low_rank import view_kernels
from shjax.reflection.ranks import RANKS, orders_of, prior

L_MAX, VIEWS, ORDERS = 128, 96, 32
THESIS = (2, 4, 8)
# rms %, mean over alpha and worst, f0 0.04 and 1: LIGHTING_LAYER of the design papers.
PRINTED = {
    "split-sum": (30.5, 24.6, 45, 56),
    "thesis 9": (28.5, 10.8, 37, 18.5),
    "thesis 25": (17.5, 6.9, None, None),
    "thesis 81": (11.2, 4.0, None, None),
    "low-rank 4": (11.7, 8.7, 13.6, 16.6),
    "low-rank 9": (5.4, 3.3, 7.1, 5.2),
    "low-rank 16": (3.5, 1.9, 5.4, 2.5),
    "low-rank 21": (2.5, 1.4, 3.7, 2.0),
}
THETA, WEIGHTS = view_nodes(VIEWS)
TIMES = np.where(np.arange(ORDERS + 1) == 0, 1, 2)


def kernels_of(alpha: float, f0: float) -> np.ndarray:
    """``G_lq(theta_o)``, ``(O, L, Q)``."""
    surface = brdf.ggx(np.float32(alpha), np.float32(f0))
    return view_kernels(surface, tuple(THETA.tolist()), L_MAX, ORDERS)[..., 0]


def low_rank(alpha: float, f0: float, maps: int) -> np.ndarray:
    """The same as the shipped tables hold it, read in float32."""
    fit = ggx_tables(maps)
    rough = locate(jnp.full(VIEWS, alpha, jnp.float32))
    cosine = jnp.asarray(np.cos(THETA / 2), jnp.float32)
    base, slope = (np.asarray(a, float) for a in view_functions(fit, rough, cosine))
    orders = np.array(orders_of(fit.ranks))
    views = (base + f0 * slope) * np.sin(THETA / 2) ** orders[:, None]
    held = np.zeros((VIEWS, L_MAX + 1, ORDERS + 1))
    for step, share in ((0, 1 - float(rough.share[0])), (1, float(rough.share[0]))):
        profile = fit.profiles[int(rough.level[0]) + step].astype(np.float32)
        for j, q in enumerate(orders):
            held[:, : len(profile), q] += share * np.outer(views[j], profile[:, j])
    return held


def thesis(kernel: np.ndarray, p_max: int) -> np.ndarray:
    """The same in the harmonics of the view to degree P."""
    held = np.zeros_like(kernel)
    for q in range(p_max + 1):
        functions = np.sqrt(2 * np.pi) * _theta_parts(p_max, q)  # [p, o]
        onto = np.einsum("po,olq->plq", functions * WEIGHTS, kernel[:, :, q : q + 1])
        held[:, :, q] = np.einsum("po,pl->ol", functions, onto[..., 0])
    return held


def _theta_parts(p_max: int, q: int) -> np.ndarray:
    from shjax.harmonics.legendre import legendre

    return legendre(p_max, q, np.cos(THETA), np.sin(THETA))[q:]


def split(kernel: np.ndarray, alpha: float) -> np.ndarray:
    """The same by split-sum: the lobe along the normal, times the view's albedo."""
    held = np.zeros_like(kernel)
    l = np.arange(L_MAX + 1)
    lobe = split_sum.lobe(float(alpha), L_MAX) * np.sqrt(2 * l + 1)
    held[:, :, 0] = np.outer(kernel[:, 0, 0], lobe)
    return held


def rms(kernel: np.ndarray, held: np.ndarray, lost: np.ndarray, whole=None) -> float:
    """Relative error for mean squares ``C_l`` of the rest and of the whole light."""
    whole = lost if whole is None else whole

    def energy(values, spectrum):
        return np.einsum("olq,o,l,q->", values**2, WEIGHTS, spectrum, TIMES)

    return float(np.sqrt(energy(kernel - held, lost) / energy(kernel, whole)))


def methods(alpha: float, f0: float, kernel: np.ndarray) -> dict[str, np.ndarray]:
    """Every method's kernel."""
    found = {"split-sum": split(kernel, alpha)}
    found |= {f"thesis {(p + 1) ** 2}": thesis(kernel, p) for p in THESIS}
    return found | {f"low-rank {n}": low_rank(alpha, f0, n) for n in RANKS}


def all_roughnesses(count: int = 17) -> dict:
    """Mean and worst rms over alpha = 1 ... 1/16, under 1/l^2."""
    found: dict = {}
    for f0 in (0.04, 1.0):
        rows: dict[str, list[float]] = {}
        for alpha in 2.0 ** -np.linspace(0, 4, count):
            kernel = kernels_of(alpha, f0)
            for name, held in methods(alpha, f0, kernel).items():
                rows.setdefault(name, []).append(rms(kernel, held, prior(L_MAX)))
        for name, values in rows.items():
            entry = found.setdefault(name, {})
            entry[f"mean {f0:g}"] = 100 * float(np.mean(values))
            entry[f"worst {f0:g}"] = 100 * float(np.max(values))
    return found


def spectrum(coefs) -> np.ndarray:
    """Mean square of the coefficients of each degree, all channels: ``(L,)``."""
    power = np.asarray(shjax.power_spectrum(coefs), float).sum(axis=1)
    return power / (2 * np.arange(len(power)) + 1)


def on_panoramas(folder: Path, alpha: float = 0.2) -> dict:
    """Mean rms over the eight CC0 panoramas, suns left in."""
    found: dict = {}
    for f0 in (0.04, 1.0):
        kernel = kernels_of(alpha, f0)
        held = methods(alpha, f0, kernel)
        for name in PANORAMAS[:8]:
            coefs = io.read_envmap(folder / name).lighting(l_max=L_MAX)
            for method, values in held.items():
                row = found.setdefault(method, {}).setdefault(f"{f0:g}", [])
                row.append(100 * rms(kernel, values, spectrum(coefs)))
    return {
        m: {k: float(np.mean(v)) for k, v in row.items()} for m, row in found.items()
    }


def lights_split(folder: Path, alpha: float = 0.2, f0: float = 0.04) -> dict:
    """Rms with 0, 1 and 4 lights taken out, relative to the rest of all four."""
    kernel, found = kernels_of(alpha, f0), {}
    held = methods(alpha, f0, kernel)
    for name in ("sunrise.exr", "night.exr"):
        envmap = io.read_envmap(folder / name)
        rests = {n: shjax.split_lights(envmap, max_lights=n) for n in (0, 1, 4)}
        spectra = {n: spectrum(r.lighting(l_max=L_MAX)) for n, (_, r) in rests.items()}
        for method in ("split-sum", "thesis 9", "low-rank 9"):
            found.setdefault(name, {})[method] = {
                n: 100 * rms(kernel, held[method], lost, spectra[0])
                for n, lost in spectra.items()
            }
        found[name]["lights found"] = len(rests[4][0].heights)
    return found


def single_materials(folder: Path) -> dict:
    """Rms of low-rank fits of one BRDF each, under 1/l^2."""
    curet = folder / "curet"
    skin = json.loads((folder / "cornell_lafortune.json").read_text())["materials"][
        "skin"
    ]
    cxy, cz, exponent = (
        np.array([lobe[k] for lobe in skin["lobes"]]) for k in ("cxy", "cz", "n")
    )
    models = {
        "gaussian microfacet 0.2": brdf.gaussian_microfacet(0.2),
        "Lafortune, skin": brdf.lafortune(cxy, cz, exponent, np.array(skin["diffuse"])),
        "CUReT 15, foil": brdf.read_curet(curet / "abrdf.dat", curet / "table.txt", 15),
    }
    found, weight = {}, prior(L_MAX)
    for name, model in models.items():
        row: dict[str, float] = {}
        for maps in RANKS:
            fit = shjax.reflection.fit_low_rank(model, maps=maps, l_max=L_MAX)
            lost, whole = (
                float(np.sum(weight[:, None] * np.asarray(a, float)))
                for a in (fit.lost, fit.energy)
            )
            row[f"low-rank {maps}"] = 100 * float(np.sqrt(lost / whole))
        kernel = view_kernels(model, tuple(THETA.tolist()), L_MAX, ORDERS)
        for p in THESIS:
            parts = [kernel[..., c] for c in range(kernel.shape[-1])]
            errors = [rms(part, thesis(part, p), weight) for part in parts]
            sizes = [
                np.einsum("olq,o,l,q->", part**2, WEIGHTS, weight, TIMES)
                for part in parts
            ]
            mean = np.average(np.square(errors), weights=sizes)
            row[f"thesis {(p + 1) ** 2}"] = 100 * float(np.sqrt(mean))
        found[name] = row
    return found


def pictures(folder: Path, out: Path, size: int = 160) -> dict:
    """Spheres under city and interior, GGX 0.2, f0 0.04: rms of each method, and PNGs."""
    found, rows = {}, []
    surface = brdf.ggx(0.2, 0.04, multiscatter=True)
    roughness = np.float32(np.sqrt(0.2))
    ball = render.sphere(size)
    for name in ("city.exr", "interior.exr"):
        envmap = io.read_envmap(folder / "hdri" / name)
        panorama = jnp.asarray(envmap.to_latlong(256).radiance)
        exact = np.asarray(render.reference(ball, panorama, surface))
        drawn = _draw(ball, envmap, surface, roughness)
        found[name] = {k: _difference(v, exact) for k, v in drawn.items()}
        rows.append(_shown(exact, drawn))
    io.write_image(out / "lighting_layer_spheres.png", np.concatenate(rows))
    camera = render.Camera(origin=(2.6, 1.4, 0.8), fov=0.6)
    trace = render.trace_mesh(_bunny(folder), camera, 2 * size)
    envmap = io.read_envmap(folder / "hdri" / "city.exr")
    panorama = jnp.asarray(envmap.to_latlong(128).radiance)
    exact = np.asarray(render.reference(trace.gbuffer, panorama, surface))
    drawn = _draw(trace.gbuffer, envmap, surface, roughness)
    found["bunny, city"] = {k: _difference(v, exact) for k, v in drawn.items()}
    io.write_image(out / "lighting_layer_mesh.png", _shown(exact, drawn))
    return found


def _bunny(folder: Path):
    from shjax.render.loading import load_mesh

    mesh = load_mesh(folder / "mesh" / "bunny_igl.off").copy()
    turn = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    vertices = np.asarray(mesh.vertices) @ turn.T
    vertices -= (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    mesh.vertices = vertices / np.linalg.norm(vertices, axis=1).max()
    return mesh


def _draw(gbuffer, envmap, surface, roughness) -> dict[str, np.ndarray]:
    """The picture by each method."""
    black = dict(albedo=0.0, roughness=roughness, metallic=0.0)
    found = {}
    coefs = envmap.lighting(l_max=L_MAX)
    shape, n = gbuffer.mask.shape, gbuffer.mask.size
    flat = [gbuffer.normals.reshape(n, 3), gbuffer.views.reshape(n, 3)]
    zero = jnp.zeros(n, jnp.float32)
    simple = split_sum.shade(
        split_sum.prefilter(coefs),
        *flat,
        albedo=jnp.zeros((n, 3), jnp.float32),
        roughness=zero + roughness,
        metallic=zero,
    )
    mask = np.asarray(gbuffer.mask)[..., None]
    found["split-sum"] = np.asarray(simple).reshape(*shape, 3) * mask
    rho = shjax.brdf_coefs(surface, l_max=64, p_max=2, accuracy=1e-4)
    maps = shjax.prefilter(coefs[: 65**2], rho.astype(coefs.dtype))
    found["thesis 9"] = np.asarray(render.image(gbuffer, maps))
    for lights in (0, 1):
        light = ibl.prefilter_light(envmap, maps=9, max_lights=lights)
        values = ibl.shade(light, gbuffer.normals, gbuffer.views, **black)
        found[f"low-rank 9, {lights} light"] = np.asarray(values) * mask
    return found


def _difference(picture: np.ndarray, exact: np.ndarray) -> float:
    return 100 * float(np.linalg.norm(picture - exact) / np.linalg.norm(exact))


def _shown(exact: np.ndarray, drawn: dict[str, np.ndarray]) -> np.ndarray:
    """Exact and every method above their differences."""
    lit = exact.mean(axis=-1)
    white = float(np.quantile(lit[lit > 0], 0.97))
    above = [tone_map(exact, white=white)]
    below = [np.ones_like(exact)]
    for picture in drawn.values():
        above.append(tone_map(picture, white=white))
        below.append(show_difference(picture - exact, white / 5))
    return np.concatenate([np.concatenate(above, 1), np.concatenate(below, 1)])


def run(out: Path | None = None, count: int = 17, size: int = 160) -> dict:
    """All tables, and the pictures where there is a folder for them."""
    folder = data_folder()
    result = {
        "one over l squared": all_roughnesses(count),
        "panoramas, GGX 0.2": on_panoramas(folder / "hdri"),
        "split, GGX 0.2, f0 0.04": lights_split(folder / "hdri"),
        "single materials": single_materials(folder / "brdf"),
    }
    if out is not None:
        result["pictures, GGX 0.2, f0 0.04"] = pictures(folder, out, size)
    return {**result, "versions": versions()}


def markdown(result: dict) -> str:
    """The tables as text."""
    parts = ["# The lighting layer beside split-sum and the SHRM", __doc__ or ""]
    rows = []
    for name, row in result["one over l squared"].items():
        a, b, c, d = PRINTED[name]
        means = f"{row['mean 0.04']:.1f} / {row['mean 1']:.1f}"
        worst = f"{row['worst 0.04']:.1f} / {row['worst 1']:.1f}"
        rows.append([name, means, worst, f"{a} / {b}", f"{c or '-'} / {d or '-'}"])
    head = ["", "mean, f0 .04 / 1", "worst", "printed mean", "printed worst"]
    parts += [
        "## rms %, 1/l^2 light, over alpha = 1 ... 1/16",
        markdown_table(head, rows),
    ]
    rows = [
        [name, f"{row['0.04']:.1f}", f"{row['1']:.1f}"]
        for name, row in result["panoramas, GGX 0.2"].items()
    ]
    parts += [
        "## rms %, mean over eight panoramas, suns left in, GGX 0.2",
        markdown_table(["", "f0 .04", "f0 1"], rows),
    ]
    methods = ("split-sum", "thesis 9", "low-rank 9")
    rows = [
        [
            f"{name} ({row['lights found']} found)",
            *(" / ".join(f"{x:.1f}" for x in row[m].values()) for m in methods),
        ]
        for name, row in result["split, GGX 0.2, f0 0.04"].items()
    ]
    parts += [
        "## rms %, 0 / 1 / 4 lights split off, GGX 0.2, f0 .04",
        markdown_table(["", *methods], rows),
    ]
    if "single materials" in result:
        names = list(next(iter(result["single materials"].values())))
        rows = [
            [name, *(f"{row[key]:.1f}" for key in names)]
            for name, row in result["single materials"].items()
        ]
        parts += [
            "## rms %, bases fitted to one BRDF, 1/l^2 light",
            markdown_table(["", *names], rows),
        ]
    if "pictures, GGX 0.2, f0 0.04" in result:
        rows = [
            [f"{name}: {method}", f"{value:.1f}"]
            for name, row in result["pictures, GGX 0.2, f0 0.04"].items()
            for method, value in row.items()
        ]
        parts += ["## rms % of pictures", markdown_table(["", "error"], rows)]
    return "\n\n".join(parts)


@click.command()
@click.option("--out", required=True, type=click.Path(path_type=Path))
def main(out: Path) -> None:
    """Write lighting_layer.md, .json and two PNGs."""
    out.mkdir(parents=True, exist_ok=True)
    result = run(out)
    write_result(out, "lighting_layer", markdown(result), result)


if __name__ == "__main__":
    main()
