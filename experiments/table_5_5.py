"""Table 5.5 of the thesis: the microfacet model, angular over frequency.

    taskset -c 0 python experiments/table_5_5.py --out experiments/results

From a 128 x 128 map to 100 maps of 128 x 128 (T = 10), RGB float32, jitted, one run. The
angular side integrates over the lobe's cap of 95 % energy; one map is timed and a hundred
are a hundred times that. Frequency: the SHRM at the thesis's orders, and from it all
hundred maps. Filtered importance sampling (one map) with the fewest samples (up to 1024)
whose error is no larger than the SHRM's on that map.
"""

from __future__ import annotations

import functools
import sys
from pathlib import Path

import click
import jax
import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import shjax
import shjax.vectors
from experiments.alternatives import importance
from experiments.prefiltering import (
    SIZE,
    importance_at,
    light,
    rms,
    samples_of,
)
from experiments.timing import median_seconds
from experiments.versions import versions_line
from experiments.writing import markdown_table, write_result
from shjax import brdf, reflection
from shjax.sphere import latlong_directions

# sigma: F, P, angular time an image, frequency time, SHRM time [T5, Table 5.5]
PAPER = {
    0.1: (24, 3, 9.23, 2.70, 1.55),
    0.2: (12, 2, 27.44, 1.55, 0.72),
    0.3: (7, 2, 57.31, 1.49, 0.67),
    0.4: (5, 2, 90.34, 1.47, 0.65),
    0.5: (5, 2, 125.80, 1.45, 0.64),
}
VIEWS = 10


def run(size: int = SIZE, sigmas: tuple[float, ...] = tuple(PAPER)) -> dict:
    """One row a roughness."""
    panorama = light(size)
    towards = latlong_directions(size, size).reshape(-1, 3)
    directions = jnp.asarray(towards, jnp.float32)
    local = reflection.view_grid(VIEWS)
    chosen = local[1, 3]  # 27 degrees from R: 13 from the normal
    phi = np.arctan2(towards[:, 1], towards[:, 0])
    theta = np.arctan2(np.hypot(towards[:, 0], towards[:, 1]), towards[:, 2])
    frame = _spherical_frames(theta, phi)
    views = jnp.asarray(np.einsum("nij,i->nj", frame, chosen), jnp.float32)
    normals = shjax.vectors.normalize(directions + views)
    rows = []
    for sigma in sigmas:
        f, p, image, whole, own = PAPER[sigma]
        model = brdf.gaussian_microfacet(float(sigma))
        rho = shjax.brdf_coefs(model, l_max=f, p_max=p)

        @jax.jit
        def make(map_, f=f, rho=rho):
            lighting = shjax.analyze(map_, l_max=f)
            return shjax.prefilter(lighting, rho, n_theta=size, n_phi=size)

        @jax.jit
        def explicit(map_, make=make):
            return reflection.view_maps(make(map_), jnp.asarray(local, jnp.float32))

        exact = shjax.reference_reflection(panorama, model, normals, views)
        one = reflection.view_maps(make(panorama), jnp.asarray(chosen, jnp.float32))
        error = rms(one.reshape(-1, 3), exact)

        def angular(model=model):
            return shjax.reference_reflection(
                panorama, model, normals, views, lobe_energy=0.95
            )

        times = {
            "angular_image": median_seconds(angular, 3),
            "shrm": median_seconds(lambda m=make: m(panorama), 9),
            "frequency": median_seconds(lambda e=explicit: e(panorama), 3),
            "coefficients": median_seconds(
                lambda m=model, f=f, p=p: shjax.brdf_coefs(m, l_max=f, p_max=p), 3
            ),
        }
        sampled = importance_at(
            error,
            panorama,
            model,
            normals,
            views,
            lambda n, s=sigma: functools.partial(
                importance.draw_microfacet, float(s), n
            ),
            exact,
        )
        count = VIEWS**2
        rows.append(
            {
                "sigma": sigma,
                "F": f,
                "P": p,
                **times,
                "error": error,
                "angular_error": rms(angular(), exact),
                "ratio": count * times["angular_image"] / times["frequency"],
                "paper": count * image / whole,
                "image_over_shrm": times["angular_image"] / times["shrm"],
                "paper_image_over_shrm": image / own,
                "importance": sampled,
            }
        )
        print(f"sigma = {sigma}: {rows[-1]['ratio']:.0f}", file=sys.stderr)
    return {"size": size, "views": VIEWS**2, "rows": rows}


def _spherical_frames(theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
    c, s, cp, sp = np.cos(theta), np.sin(theta), np.cos(phi), np.sin(phi)
    zero = np.zeros_like(c)
    rows = [[c * cp, c * sp, -s], [-sp, cp, zero], [s * cp, s * sp, c]]
    return np.stack([np.stack(row, -1) for row in rows], axis=-2)


def table(result: dict) -> str:
    """The rows as markdown."""
    heading = [
        "sigma",
        "F, P",
        "angular map, ms",
        "SHRM, ms",
        "SHRM + 100 maps, ms",
        "rho, ms",
        "ratio",
        "paper",
        "angular map over SHRM",
        "paper",
        "angular error",
        "SHRM error",
        "FIS samples",
        "FIS map, ms",
        "FIS error",
    ]
    rows = []
    for row in result["rows"]:
        fis = row["importance"]
        rows.append(
            [
                str(row["sigma"]),
                f"{row['F']}, {row['P']}",
                f"{1e3 * row['angular_image']:.0f}",
                f"{1e3 * row['shrm']:.2f}",
                f"{1e3 * row['frequency']:.0f}",
                f"{1e3 * row['coefficients']:.0f}",
                f"**{row['ratio']:.0f}**",
                f"{row['paper']:.0f}",
                f"{row['image_over_shrm']:.0f}",
                f"{row['paper_image_over_shrm']:.0f}",
                f"{row['angular_error']:.1%}",
                f"{row['error']:.1%}",
                samples_of(fis),
                f"{1e3 * fis['seconds']:.0f}",
                f"{fis['error']:.1%}",
            ]
        )
    return "\n".join(
        [
            "# Table 5.5: microfacet model, angular over frequency",
            "",
            versions_line(),
            "",
            "Ratio: a hundred angular maps (one timed) over SHRM and 100 maps from it. "
            "Errors (rms, one view 13 degrees from the normal) against the whole integral.",
            "",
            markdown_table(heading, rows),
        ]
    )


@click.command()
@click.option("--out", type=click.Path(path_type=Path), help="Folder for the tables.")
def main(out: Path | None) -> None:
    """Print the table, and write it where asked."""
    result = run()
    write_result(out, "table_5_5", table(result), result)


if __name__ == "__main__":
    main()
