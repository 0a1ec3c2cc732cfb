"""Time, memory and error of one method."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import jax
import numpy as np

from experiments.speed.methods import Method
from experiments.speed.scenes import Scene
from experiments.timing import median_seconds
from shjax.reference.random_orientations import measured_error
from shjax.reflection.model import ReflectionModel

ROUNDS = 3
_LONG = 0.5  # seconds after which no further round is run


class Measure:
    """Measures methods, and keeps what it compiled for them."""

    def __init__(self, rounds: int = ROUNDS) -> None:
        self.rounds = rounds
        self._compiled: dict[tuple[str, str], tuple] = {}

    def __call__(
        self,
        method: Method,
        where: Scene,
        exact: np.ndarray,
        *,
        weights: np.ndarray,
        material: str = "",
    ) -> dict:
        """Seconds of building and of evaluating, warm; errors beside the reference.

        Args:
            method: What is measured.
            where: The light, the normals and the views.
            exact: The reference, ``(n, C)``.
            weights: Of the orientations, ``(n,)``.
            material: Its name.
        """
        keep = np.asarray(where.normals)[:, 2] > 0 if method.upper else slice(None)
        normals, views = where.normals[keep], where.views[keep]
        exact, weights = exact[keep], weights[keep]
        built = jax.block_until_ready(method.build())
        found = {"build seconds": median_seconds(method.build, self.rounds, long=_LONG)}
        evaluate = self._evaluation(method, material, built, normals, views, found)
        values = jax.block_until_ready(evaluate(built, normals, views))
        found["seconds"] = median_seconds(
            lambda: evaluate(built, normals, views), self.rounds, long=_LONG
        )
        found["points"] = int(normals.shape[0])
        found |= _errors(np.asarray(values, np.float64), exact, weights)
        held = sum(a.nbytes for a in jax.tree.leaves(built))
        found["stored bytes"] = getattr(built, "bytes", held)
        if method.predicted is not None:
            found["predicted"] = method.predicted(built)
        row = {
            k: v if isinstance(v, int) else float(f"{v:.5g}") for k, v in found.items()
        }
        return row | (
            {"chosen": built.message} if isinstance(built, ReflectionModel) else {}
        )

    def forget(self, material: str) -> None:
        """Drop what was compiled for a material: a process may map only so much code."""
        self._compiled = {k: v for k, v in self._compiled.items() if k[0] != material}
        jax.clear_caches()

    def _evaluation(self, method: Method, material: str, built, normals, views, found):
        """The compiled evaluation; its time and memory go into ``found``."""
        shapes = str([a.shape for a in jax.tree.leaves((built, normals, views))])
        key = (material if method.own else "", method.name + shapes)
        if method.family == "choose_model":  # another kind of model each time
            key = ("", "")
            self._compiled.pop(key, None)
        if key not in self._compiled:
            leaves, tree = jax.tree.flatten(built)

            def run(leaves, normals, views):
                return method.evaluate(tree.unflatten(leaves), normals, views)

            start = time.perf_counter()
            made = jax.jit(run).lower(leaves, normals, views).compile()
            seconds = time.perf_counter() - start
            memory = made.memory_analysis()
            parts = ("argument", "output", "temp")
            total = sum(
                int(getattr(memory, f"{part}_size_in_bytes", 0)) for part in parts
            )
            self._compiled[key] = made, seconds, total
        made, found["compile seconds"], found["compiled bytes"] = self._compiled[key]
        return lambda held, n, v: made(jax.tree.leaves(held), n, v)


def _errors(values: np.ndarray, exact: np.ndarray, weights: np.ndarray) -> dict:
    """Relative to the rms of the reference."""
    size = np.linalg.norm(values - exact, axis=1)
    scale = float(np.sqrt(np.average(np.sum(exact**2, axis=1), weights=weights)))
    rms, standard_error = measured_error(values, exact, weights)
    return {
        "rms": rms,
        "standard error": standard_error,
        "mean": float(np.average(size, weights=weights)) / scale,
        "max": float(np.max(size)) / scale,
        "most negative": min(float(values.min()) / scale, 0.0),
    }


def child_memory(panorama: str, material: str, method: str, cache: Path) -> int | None:
    """Largest resident size of a process that does nothing but one method, bytes."""
    script = (
        "import sys; from experiments.speed import measure; measure.only(*sys.argv[1:])"
    )
    run = subprocess.run(
        [sys.executable, "-c", script, panorama, material, method, str(cache)],
        capture_output=True,
        text=True,
        timeout=600,
    )
    return int(run.stdout.split()[-1]) if run.returncode == 0 else None


def only(panorama: str, material: str, name: str, cache: str) -> None:
    """Run one method and print the largest resident size of this process, in bytes.

    From the kernel's status: what ``getrusage`` tells a child starts at its parent's.
    """
    from experiments.speed import matte, methods, scenes

    where = scenes.scene(panorama)
    if material:
        chosen = next(m for m in scenes.materials() if m.name == material)
        known = methods.glossy_methods(where, methods.Prepared(chosen, Path(cache)))
    else:
        known = matte.irradiance_methods(where)
    method = next(m for m in known if m.name == name)
    built = method.build()
    jax.block_until_ready(method.evaluate(built, where.normals, where.views))
    status = Path("/proc/self/status").read_text()
    print(1024 * int(status.split("VmHWM:")[1].split()[0]))
