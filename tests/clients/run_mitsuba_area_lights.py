"""Radiance that Mitsuba 3 finds on a sphere under area emitters, at single rays.

python run_mitsuba_area_lights.py output.json, in an environment with mitsuba. Direct light
only; the sphere is convex and stands alone, so nothing is shadowed. A capsule is a cylinder
and two spheres.
"""

import json
import sys
from pathlib import Path

import numpy as np

SAMPLES, RUNS = 2**20, 32
RADIUS = 0.5
START, END, TUBE = [-0.9, 1.1, 0.7], [0.6, 1.3, 0.9], 0.15
THIN = 0.002
EMITTERS = {
    "rectangle": {"centre": [0.3, 1.2, 0.8], "normal": [-0.3, -1.0, -0.6], "half": 0.5},
    "disk": {"centre": [0.9, 0.4, 1.0], "normal": [-1.0, -0.3, -0.9], "radius": 0.6},
    "sphere": {"centre": [0.2, 1.0, 1.1], "radius": 0.4},
    "capsule": {"start": START, "end": END, "radius": TUBE},
    "line": {"start": START, "end": END, "radius": THIN},
}
ALPHA, ALBEDO = 0.3, 0.5


def shapes(mi, name: str) -> list[dict]:
    """Emitters of unit radiance."""
    about = EMITTERS[name]
    emitter = {"type": "area", "radiance": {"type": "rgb", "value": 1.0}}
    transform = mi.ScalarTransform4f
    if name in ("rectangle", "disk"):
        target = np.add(about["centre"], about["normal"]).tolist()
        place = transform().look_at(origin=about["centre"], target=target, up=[0, 0, 1])
        size = about.get("half", about.get("radius"))
        return [
            {"type": name, "to_world": place @ transform().scale(size), "e": emitter}
        ]
    if name == "sphere":
        return [
            {
                "type": "sphere",
                "center": about["centre"],
                "radius": about["radius"],
                "e": emitter,
            }
        ]
    tube = {
        "type": "cylinder",
        "p0": about["start"],
        "p1": about["end"],
        "radius": about["radius"],
        "e": emitter,
    }
    if name == "line":
        return [tube]
    ends = [
        {"type": "sphere", "center": about[k], "radius": about["radius"], "e": emitter}
        for k in ("start", "end")
    ]
    return [tube, *ends]


def rays() -> list[tuple[np.ndarray, np.ndarray]]:
    """Normals of the sphere and views, facing the lights."""
    rng = np.random.default_rng(7)
    found = []
    while len(found) < 8:
        normal, view = rng.normal(size=(2, 3))
        normal, view = normal / np.linalg.norm(normal), view / np.linalg.norm(view)
        if normal @ view > 0.3 and normal @ [0.3, 0.7, 0.6] > 0.3:
            found.append((normal, view))
    return found


def measure(output: Path) -> None:
    """Write the radiance of each ray and its standard error."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    materials = {
        "diffuse": {"type": "diffuse", "reflectance": {"type": "rgb", "value": ALBEDO}},
        "ggx": {
            "type": "roughconductor",
            "material": "none",
            "distribution": "ggx",
            "alpha": ALPHA,
        },
    }
    records = {}
    for name in EMITTERS:
        for material, bsdf in materials.items():
            rows, samples = [], SAMPLES
            integrator = {"type": "direct"}
            if name == "capsule":
                samples = 8 * SAMPLES
                integrator |= {"emitter_samples": 0, "bsdf_samples": 1}
            for normal, view in rays():
                origin = RADIUS * normal + 0.2 * view
                scene = {
                    "type": "scene",
                    "integrator": integrator,
                    "ball": {"type": "sphere", "radius": RADIUS, "bsdf": bsdf},
                    "sensor": {
                        "type": "radiancemeter",
                        "origin": origin.tolist(),
                        "direction": (-view).tolist(),
                        "film": {
                            "type": "hdrfilm",
                            "width": 1,
                            "height": 1,
                            "rfilter": {"type": "box"},
                        },
                        "sampler": {
                            "type": "independent",
                            "sample_count": samples // RUNS,
                        },
                    },
                }
                for k, shape in enumerate(shapes(mi, name)):
                    scene[f"light{k}"] = shape
                loaded = mi.load_dict(scene)
                found = [
                    float(np.array(mi.render(loaded, seed=s)).ravel()[0])
                    for s in range(RUNS)
                ]
                rows.append(
                    {
                        "normal": normal.tolist(),
                        "view": view.tolist(),
                        "radiance": float(np.mean(found)),
                        "standard_error": float(np.std(found, ddof=1) / np.sqrt(RUNS)),
                    }
                )
            records[f"{name}, {material}"] = rows
    about = {
        "tool": "Mitsuba 3",
        "version": mi.__version__,
        "emitters": EMITTERS,
        "sphere radius": RADIUS,
        "alpha": ALPHA,
        "albedo": ALBEDO,
        "masking": "separable Smith",
        "samples": SAMPLES,
        "radiance": records,
    }
    output.write_text(json.dumps(about, indent=1) + "\n")


if __name__ == "__main__":
    measure(Path(sys.argv[1]))
