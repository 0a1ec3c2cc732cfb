"""Project the panorama as Mitsuba 3's envmap emitter sees it.

python run_mitsuba.py panorama.raw rows output.json, in an environment with mitsuba.
"""

import json
import sys
from pathlib import Path

import numpy as np

N_THETA = 32


def project(path: Path, rows: int) -> dict:
    """Evaluate the emitter at quadrature nodes of its own frame and project."""
    import drjit as dr
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    image = np.fromfile(path, "<f4").reshape(rows, 2 * rows, 3)
    emitter = mi.load_dict({"type": "envmap", "bitmap": mi.Bitmap(image)})
    interaction = mi.SurfaceInteraction3f()

    cosines, weights = np.polynomial.legendre.leggauss(N_THETA)
    n_phi = 2 * N_THETA
    output = np.zeros((9, 3))
    for cosine, weight in zip(cosines, weights, strict=True):
        sine = np.sqrt(1 - cosine * cosine)
        for phi in 2 * np.pi * (np.arange(n_phi) + 0.5) / n_phi:
            direction = mi.ScalarVector3f(
                sine * np.cos(phi), sine * np.sin(phi), cosine
            )
            interaction.wi = -direction
            radiance = np.array(emitter.eval(interaction))
            harmonics = np.array(dr.sh_eval(direction, 2))
            output += weight * 2 * np.pi / n_phi * np.outer(harmonics, radiance)
    return {
        "mitsuba": {
            "tool": "Mitsuba 3",
            "version": mi.__version__,
            "command": (
                "emitter.eval of an envmap projected on drjit.sh_eval(d, 2), "
                f"scalar_rgb, {rows} rows of which the first and the last are the poles"
            ),
            "convention": "Mitsuba dr.sh_eval basis",
            "frame": "Mitsuba 3",
            "variant": "envmap",
            "order": "dr.sh_eval: 00, 1-1, 10, 11, 2-2, 2-1, 20, 21, 22; RGB each",
            "output": output.tolist(),
            "tolerance": {
                "value": 2e-5,
                "why": "single precision and the emitter's bilinear interpolation",
            },
        }
    }


if __name__ == "__main__":
    records = project(Path(sys.argv[1]), int(sys.argv[2]))
    Path(sys.argv[3]).write_text(json.dumps(records))
