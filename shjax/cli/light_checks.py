"""Checks of ``shjax light``: coefficients against the integral, and back from a picture.

The integral is over the map averaged to 128 rows, whose irradiance differs from that of the
whole map by far less than nine numbers do; by how much is measured, and said.
"""

from __future__ import annotations

import contextlib
import dataclasses
import threading
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import shjax
from shjax import render
from shjax.cli import AHEAD_THREAD
from shjax.cli.light import Settings
from shjax.cli.light_report import Light
from shjax.colour import luminance
from shjax.envmap import EnvironmentMap
from shjax.reference.irradiance_integral import compare_irradiance
from shjax.sphere import fibonacci_directions

ROWS = 128
RELATIVE_TO = "total radiance over the sphere, int L dw (Rec. 709 luminance)"
PROBES = 4000  # normals over the whole sphere
_COMPARED = 24  # normals at which the averaged map is compared with the whole one


@dataclasses.dataclass(frozen=True)
class Checks:
    """What was measured: for the JSON file, and white spheres, approximate and exact."""

    summary: dict[str, Any]
    spheres: tuple[np.ndarray, np.ndarray]


class Ahead:
    """Programs of the checks, compiled in a thread of its own while a map is read."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._integrals: jax.stages.Compiled | None = None
        self._first = threading.Event()
        # A daemon: what ends the command early does not wait for a compiler.
        self._thread = threading.Thread(
            target=self._compile, name=AHEAD_THREAD, daemon=True
        )

    def start(self) -> None:
        """Start, once."""
        if self._thread.ident is None:
            self._thread.start()

    def join(self) -> None:
        """Wait until everything is compiled."""
        self.start()
        self._thread.join()

    def integrals(self, *arguments) -> Any:
        """Run :func:`_integrals` as soon as it is compiled; the thread goes on."""
        self.start()
        self._first.wait()
        given = tuple(jax.ShapeDtypeStruct(a.shape, a.dtype) for a in arguments)
        run = self._integrals
        if run is None or given != jax.tree.map(_as_shape, run.args_info[0]):
            run = _integrals
        return jax.tree.map(np.asarray, run(*arguments))

    def _compile(self) -> None:
        """Compile for a colour map; what is quick is run, which compiles it too."""
        # What fails here fails again in the check, which says it.
        with contextlib.suppress(Exception):
            try:
                ball, drawn = self._compile_integrals()
            finally:
                self._first.set()
            _recover(ball, drawn, drawn)

    def _compile_integrals(self) -> tuple[_Ball, np.ndarray]:
        grey = np.ones((ROWS, 2 * ROWS, 3), np.float32)
        light = _rotated_samples(shjax.make_envmap(grey), None, grey.dtype)
        nine = np.zeros((9, 3), np.float32)
        nine[0] = 1
        ball = _Ball(self._size)
        arguments = (nine, *light.samples(), ball.normals)
        self._integrals = _integrals.lower(*map(_as_shape, arguments)).compile()
        return ball, np.ones((len(ball.normals), 3), np.float32)


def _as_shape(argument) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(argument.shape, argument.dtype)


@jax.jit
def _integrals(lighting, radiance, directions, weights, normals):
    """Irradiance by the integral and from coefficients at all normals, and its errors."""
    light = EnvironmentMap.from_samples(radiance, directions, weights)
    exact = shjax.reference_irradiance(light, normals)
    drawn = shjax.irradiance(lighting, normals)
    total = jnp.sum(luminance(radiance) * weights)
    first, second = (luminance(values[:PROBES]) for values in (drawn, exact))
    return exact, drawn, compare_irradiance(first, second, total)


def check(
    envmap: EnvironmentMap, found: Light, settings: Settings, ahead: Ahead
) -> Checks:
    """Measure coefficients against the integral, and recover nine from a sphere.

    Args:
        envmap: The light.
        found: Its coefficients, rotated.
        settings: The side of the sphere, the rotation.
        ahead: What was compiled before.
    """
    small = envmap
    if envmap.layout != "latlong" or len(envmap.image) > ROWS:
        small = envmap.to_latlong(ROWS)
    light = _rotated_samples(small, settings.rotate, found.lighting.dtype)
    ball = _Ball(settings.size)
    exact, drawn, error = ahead.integrals(
        found.lighting, *light.samples(), ball.normals
    )
    nine = drawn
    if len(found.lighting) != 9 or settings.window != "none":
        nine = np.asarray(shjax.irradiance(found.nine, ball.normals))
    difference = _difference(envmap, small)
    ahead.join()
    default, recovered = _recover(ball, nine, exact)
    summary = {
        "irradiance_error": {
            "mean": float(error["mean"]),
            "max": float(error["max"]),
            "relative_to": RELATIVE_TO,
            "smallest_over_mean": float(error["ringing"]),
        },
        "recovered_error": {
            name: _relative_error(value, found.nine)
            for name, value in recovered.items()
        },
        "recovered": {
            "coefficients": recovered["default"].astype(float).tolist(),
            "standard_deviation": np.sqrt(
                np.diagonal(np.asarray(default.covariance, float), axis1=1, axis2=2).T
            ).tolist(),
            "condition_number": default.condition_number,
            "message": default.message,
        },
        "integral": {
            "rows": len(small.image),
            "difference": difference,
        },
    }
    spheres = ball.picture(drawn / np.pi), ball.picture(exact / np.pi)
    return Checks(summary, spheres)


class _Ball:
    """Normals of all checks: many over the sphere, then those of a white ball's pixels.

    Attributes:
        normals: ``(N, 3)``: of :data:`PROBES` points, of the ball's pixels in rows, those
            inside its outline first.
    """

    def __init__(self, size: int) -> None:
        gbuffer = render.sphere(size)
        self._mask = np.asarray(gbuffer.mask)
        order = np.lexsort((np.arange(self._mask.size), -self._mask.ravel()))
        self._seen = order[: np.count_nonzero(self._mask)]
        end = PROBES + int(np.count_nonzero(self._mask == 1))
        self._inside = slice(PROBES, end)
        pixels = np.asarray(gbuffer.normals).reshape(-1, 3)[self._seen]
        normals = np.concatenate([fibonacci_directions(PROBES), pixels])
        self.normals = normals.astype(np.float32)

    def inside(self, values: np.ndarray) -> np.ndarray:
        """Those of the pixels inside the outline."""
        return values[self._inside]

    def picture(self, values: np.ndarray) -> np.ndarray:
        """Picture of the pixels' radiance, over black, times the coverage."""
        flat = np.zeros((self._mask.size, values.shape[-1]), values.dtype)
        flat[self._seen] = values[PROBES:] * self._mask.ravel()[self._seen, None]
        return flat.reshape(*self._mask.shape, -1)


def _recover(ball: _Ball, from_nine: np.ndarray, exact: np.ndarray):
    """Estimate the light from pictures of the sphere, by default and by nine numbers."""
    normals = ball.inside(ball.normals)
    pictures = [ball.inside(values) / np.pi for values in (from_nine, exact)]
    default = shjax.estimate_lighting(pictures[1].astype(np.float32), normals)
    # The picture that each of the nine numbers draws, a column.
    columns = np.asarray(shjax.irradiance(np.eye(9, dtype=np.float32), normals)) / np.pi
    own, plain = (
        np.linalg.lstsq(columns.astype(float), picture, rcond=None)[0]
        for picture in pictures
    )
    values = {"self": own, "plain": plain, "default": np.asarray(default.value)}
    return default, values


def _relative_error(value, truth: np.ndarray) -> float:
    difference = float(np.linalg.norm(np.asarray(value) - truth))
    norm = float(np.linalg.norm(truth))
    return difference / norm if norm else difference


def _rotated_samples(
    envmap: EnvironmentMap, rotation: np.ndarray | None, dtype
) -> EnvironmentMap:
    radiance, directions, weights = envmap.samples()
    if rotation is not None:
        directions = directions @ rotation.T
    return EnvironmentMap.from_samples(
        *(np.asarray(part, dtype) for part in (radiance, directions, weights))
    )


def _difference(whole: EnvironmentMap, small: EnvironmentMap) -> float:
    """Largest difference of two maps' irradiance at some normals, over its mean."""
    if whole is small:
        return 0.0
    if whole.layout == "latlong" and len(whole.image) > 1024:
        whole = whole.to_latlong(1024)
    normals = fibonacci_directions(_COMPARED).astype(np.float32)
    one, other = (
        np.asarray(shjax.reference_irradiance(envmap, normals))
        for envmap in (whole, small)
    )
    mean = float(np.mean(np.abs(one)))
    return float(np.max(np.abs(one - other))) / (mean or 1.0)
