"""Figures fit for a paper, each one call (extra ``plot``: matplotlib).

Every function returns a ``matplotlib.figure.Figure`` that belongs to no window: save it
with ``figure.savefig(path)``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax import render
from shjax.arrays import Array
from shjax.brdf import Brdf
from shjax.brdf.expansion import BrdfExpansion
from shjax.brdf.quadrature import order_counts
from shjax.display import show_difference, tone_map
from shjax.envmap import EnvironmentMap
from shjax.harmonics import evaluate, power_spectrum
from shjax.harmonics.degrees import degree_of_coefs, degrees, orders
from shjax.reflection import ReflectionMap, choose_model

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["coefficients", "errors", "reflection_maps", "spectra", "three_balls"]


def __dir__() -> list[str]:
    return __all__


_INCH = 2.0


def new_figure(
    rows: int, columns: int, width: float = _INCH, height: float = _INCH
) -> Any:
    """Make an empty figure and its axes, ``(rows, columns)``.

    Args:
        rows: Panels down.
        columns: Panels across.
        width: Of one panel, inches.
        height: Of one panel, inches.

    Raises:
        ImportError: If matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ImportError("plots need matplotlib: pip install 'shjax[plot]'") from error
    figure = Figure(figsize=(columns * width, rows * height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False)


def _grey(values: np.ndarray) -> np.ndarray:
    return np.asarray(values, float).mean(axis=-1)


def _show(axis: Any, image: np.ndarray, title: str = "", **options: Any) -> Any:
    axis.set_axis_off()
    axis.set_title(title, fontsize=8)
    return axis.imshow(image, **options)


def _encoded(image: np.ndarray, white: float | None = None) -> np.ndarray:
    shown = tone_map(np.asarray(image), white=white, encode=True)
    return np.broadcast_to(shown[..., :3], (*shown.shape[:2], 3))


def coefficients(coefs: Float[Array, "K C"], *, size: int = 128) -> Figure:
    """Figure of a spherical harmonic expansion and its degrees on a sphere.

    Above as the default camera sees it (from -x, where a panorama's centre is reflected),
    below from the other side.

    Args:
        coefs: Coefficients, ``(K, C)``.
        size: Side of each picture, pixels.
    """
    l_max = degree_of_coefs(coefs)
    figure, axes = new_figure(1, l_max + 2, 1.2 * _INCH, 2 * _INCH)
    sides = [
        render.sphere(size, render.Camera(origin=(x, 0.0, 0.0))) for x in (-4.0, 4.0)
    ]
    normals = jnp.concatenate([ball.normals for ball in sides])
    seen = np.concatenate([np.asarray(ball.mask) > 0.5 for ball in sides])
    towards = normals.astype(jnp.asarray(coefs).dtype)
    l = degrees(l_max)
    for axis, degree in zip(axes[0], [None, *range(l_max + 1)], strict=True):
        keep = np.ones_like(l, bool) if degree is None else l == degree
        part = jnp.where(jnp.asarray(keep)[:, None], jnp.asarray(coefs), 0)
        values = np.where(seen, _grey(np.asarray(evaluate(part, towards))), np.nan)
        limit = float(np.nanmax(np.abs(values))) or 1.0
        title = "sum" if degree is None else f"l = {degree}"
        shown = _show(axis, values, title, cmap="RdBu_r", vmin=-limit, vmax=limit)
        figure.colorbar(shown, ax=axis, shrink=0.7).ax.tick_params(labelsize=6)
    return figure


def spectra(
    lighting: Float[Array, "K C"],
    expansion: BrdfExpansion,
    *,
    chosen: tuple[int, int] | None = None,
) -> Figure:
    """Figure of the power spectra of a light and of a BRDF.

    Args:
        lighting: Radiance coefficients.
        expansion: Of the BRDF (:func:`shjax.brdf.expand`).
        chosen: ``(l_max, p_max)`` to mark.
    """
    figure, axes = new_figure(1, 2, 1.9 * _INCH, 1.5 * _INCH)
    light = _grey(np.asarray(power_spectrum(jnp.asarray(lighting))))
    l = np.arange(light.size)
    brdf = _grey(np.asarray(expansion.degree_energy))
    left, right = axes[0]
    left.semilogy(l[1:], (light / (2 * l + 1))[1:], "k-", label="light, S_l / (2l+1)")
    left.semilogy(
        np.arange(brdf.size), np.maximum(brdf, 1e-12), "C0-", label="BRDF, E_l"
    )
    left.set_xlabel("degree l")
    rho = np.asarray(expansion.rho, float)
    by_p = np.einsum("lpqc,q->p", rho**2, order_counts(expansion.p_max))
    right.semilogy(by_p / max(by_p.sum(), 1e-300), "C0o-", ms=3, label="BRDF")
    right.set_xlabel("degree p of the view")
    for axis, at in ((left, 0), (right, 1)):
        if chosen is not None:
            name = "F" if axis is left else "P"
            axis.axvline(chosen[at], color="C3", lw=1, label=f"{name} = {chosen[at]}")
        axis.tick_params(labelsize=7)
        axis.legend(fontsize=7, frameon=False)
    left.set_ylim(bottom=max(brdf.max(), light.max()) * 1e-9)
    return figure


def reflection_maps(reflection_map: ReflectionMap) -> Figure:
    """Figure of a reflection map's coefficients, one picture each, ordered by p and q.

    Args:
        reflection_map: From :func:`shjax.prefilter`, in spherical harmonics.
    """
    maps = reflection_map.coefs
    p_max = degree_of_coefs(maps, "reflection_map")
    figure, axes = new_figure(p_max + 1, 2 * p_max + 1, 1.2 * _INCH, 0.75 * _INCH)
    for axis in axes.ravel():
        axis.set_axis_off()
    for k, (p, q) in enumerate(zip(degrees(p_max), orders(p_max), strict=True)):
        values = _grey(np.asarray(maps)[:, :, k])
        limit = float(np.quantile(np.abs(values), 0.995)) or 1.0
        title = f"p = {p}, q = {q}"
        _show(axes[p, p_max + q], values, title, cmap="RdBu_r", vmin=-limit, vmax=limit)
    return figure


def errors(
    pictures: Mapping[str, Float[Array, "H W C"]], exact: Float[Array, "H W C"]
) -> Figure:
    """Figure of pictures beside the exact one, with differences and rms errors.

    Args:
        pictures: By name.
        exact: The truth.
    """
    truth = np.asarray(exact, float)
    figure, axes = new_figure(2, len(pictures) + 1)
    lit = truth.mean(axis=-1)
    white = float(np.quantile(lit[lit > 0], 0.99)) if np.any(lit > 0) else 1.0
    _show(axes[0, 0], _encoded(truth, white), "exact")
    axes[1, 0].set_axis_off()
    for k, (name, picture) in enumerate(pictures.items(), start=1):
        values = np.asarray(picture, float)
        off = values - truth
        rms = float(np.sqrt(np.sum(off**2) / max(np.sum(truth**2), 1e-300)))
        _show(axes[0, k], _encoded(values, white), name)
        shown = show_difference(off, white / 10)
        shown = np.where(lit[..., None] > 0, shown, 1)
        _show(axes[1, k], shown, f"{rms:.2%} rms")
    return figure


def three_balls(
    envmap: EnvironmentMap,
    *,
    glossy: Brdf,
    size: int = 160,
    rms_error: float = 0.05,
) -> Figure:
    """Figure of a mirror, a glossy and a diffuse ball under one light.

    Args:
        envmap: The light.
        glossy: The material of the second ball.
        size: Side of each picture, pixels.
        rms_error: Of the second and third.
    """
    from shjax.brdf import lambertian

    rows = min(len(envmap.image), 512)
    panorama = jnp.asarray(envmap.to_latlong(rows).radiance)
    ball = render.sphere(size)
    mask = np.asarray(ball.mask)[..., None]
    reflected = render.mirrored(ball, panorama)
    models = [
        choose_model(envmap, b, rms_error=rms_error) for b in (glossy, lambertian())
    ]
    pictures = [reflected, *(render.image(ball, model) for model in models)]
    figure, axes = new_figure(1, 3)
    names = ("mirror", "glossy", "diffuse")
    for axis, picture, name in zip(axes[0], pictures, names, strict=True):
        whole = np.asarray(picture) / np.where(mask == 0, 1, mask)
        _show(axis, mask * _encoded(whole) + 1 - mask, name)
    return figure
