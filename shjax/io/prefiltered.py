"""A prefiltered light in files: one EXR and one JSON, enough to write a shader from.

The EXR holds the levels one below the other, alpha = 1, 1/2, 1/4, 1/8, 1/16, each a
lat-long map as described in ``rows`` and ``columns`` of the JSON, at the left edge; the
rest is 0. Its layers ``k0.R`` ... are the maps, in the order of the JSON's ``maps``.

The JSON holds all else: tables of the view, irradiance coefficients, and the small
lights, with the formula of shading (``how``).
"""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np

from shjax.ibl import PrefilteredLight
from shjax.ibl.ggx_tables import DEGREES, LEVELS, NODES, ggx_tables, node_alphas
from shjax.ibl.prefiltered_light import level_shape
from shjax.io.images import write_image
from shjax.io.writing import write_text
from shjax.lights import CapLights

FORMAT, VERSION = "shjax.prefiltered-light", 1
_FRAME = "right-handed, +z up; theta from +z, phi from +x towards +y"
_HOW = [
    "n, v: unit normal and view; R = 2 (n.v) n - v; alpha = max(roughness^2, 1/16)",
    "F0 = f0 (1 - metallic) + albedo metallic",
    "x = -log2 alpha; j = min(floor x, 3); t = x - j: levels j and j + 1 at (1 - t), t",
    "pixel of R: row = theta / pi * rows - 1/2, column = (pi - phi) / 2 pi * columns - 1/2,"
    " linear between; over a pole row -1 is row 0 half the columns on, and maps of odd q"
    " change their sign there",
    "z = n.e_theta + i n.e_phi, e_theta and e_phi the unit vectors of theta and phi at R",
    "b_k = tables[k][4 x][64 sqrt(n.v)], linear between: [base, slope]",
    "w_k = (base + slope F0) * (1 if q = 0, sqrt 2 Re z^q if q > 0, sqrt 2 Im z^|q| if"
    " q < 0)",
    "E = sum over q = 0 of (base + slope) uniform_k, uniform linear between levels as maps",
    "glossy = (1 + F0 (1 - E) / E) (sum_k w_k map_k(R) + GGX of each light source)",
    "matte = albedo (1 - metallic) / pi (sum_i irradiance_i Y_i(n) + sum flux max(n.l, 0))",
    "Y_i: real orthonormal harmonics without Condon-Shortley phase, i = l (l + 1) + m",
]


def lights_as_json(lights: CapLights) -> list[dict]:
    """Describe lights as JSON: centre, half angle in degrees, flux."""
    rows = zip(
        np.asarray(lights.directions, float).tolist(),
        np.degrees(np.asarray(lights.angles, float)).tolist(),
        np.asarray(lights.flux, float).tolist(),
        strict=True,
    )
    return [{"direction": d, "half_angle": a, "flux": f} for d, a, f in rows]


def write_prefiltered(path: str | os.PathLike, light: PrefilteredLight) -> None:
    """Write a prefiltered light for a renderer: an EXR of maps, a JSON of tables.

    Args:
        path: Of the EXR.
        light: One light.

    Raises:
        OSError: If a file cannot be written.
        ValueError: If the name does not end in ``.exr`` or there are several lights.
    """
    path = Path(path)
    if path.suffix != ".exr":
        raise ValueError(f"path must end in .exr; got {path}.")
    if light.texels.ndim != 3:
        raise ValueError(f"light must be one light; got shape {light.texels.shape}.")
    fit, channels = ggx_tables(light.maps), light.texels.shape[-1]
    shapes = [level_shape(level) for level in range(LEVELS)]
    tall, wide = sum(rows for rows, _ in shapes), max(columns for _, columns in shapes)
    image, top, levels = np.zeros((tall, wide, light.maps, channels), np.float32), 0, []
    for level, (rows, columns) in enumerate(shapes):
        image[top : top + rows, :columns] = np.asarray(light.level(level))
        levels.append(
            {
                "alpha": 2.0**-level,
                "first_row": top,
                "rows": rows,
                "columns": columns,
                "degree": DEGREES[level],
                "uniform": (
                    np.sqrt(4 * np.pi) * fit.profiles[level][0, : fit.ranks[0]]
                ).tolist(),
            }
        )
        top += rows
    tables = fit.tables.reshape(len(fit.tables), NODES, -1, 2)
    about = {
        "format": FORMAT,
        "version": VERSION,
        "frame": _FRAME,
        "how": _HOW,
        "levels": levels,
        "maps": [
            {"layer": f"k{k}", "q": q, "table": j}
            for k, (q, j) in enumerate(zip(fit.orders, fit.functions, strict=True))
        ],
        "tables": {
            "alpha": node_alphas().tolist(),
            "order": "[table][alpha][line of sqrt(n.v), 0 to 1][base, slope]",
            "values": np.round(tables, 7).tolist(),
        },
        "irradiance": np.asarray(light.irradiance, float).tolist(),
        "lights": lights_as_json(light.lights),
    }
    names = {1: ("Y",), 3: ("R", "G", "B")}.get(channels) or [
        f"c{c:03d}" for c in range(channels)
    ]
    write_image(
        path,
        image.reshape(tall, wide, -1),
        attributes={"format": f"{FORMAT} {VERSION}", "layout": "see the JSON beside"},
        channels=[f"k{k}.{name}" for k in range(light.maps) for name in names],
    )
    # Last, so that its presence says that the maps are there.
    write_text(path.with_suffix(".json"), json.dumps(about) + "\n")
