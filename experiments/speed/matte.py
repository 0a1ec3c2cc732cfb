"""Methods of irradiance: how each prepares a light, and how it answers at normals."""

from __future__ import annotations

import functools
from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np

import shjax
from experiments.alternatives import irradiance
from experiments.speed.methods import Method
from experiments.speed.scenes import Scene
from shjax.sphere import latlong_pixels
from shjax.windows import NAMES, apply_window

DEGREES = (0, 1, 2, 4, 6, 8)


def _at(radiance: jax.Array, directions: np.ndarray) -> jax.Array:
    """The pixels that directions fall in."""
    rows, columns, channels = radiance.shape
    i, j = latlong_pixels(directions, rows, columns)
    place = np.clip(np.round(i), 0, rows - 1) * columns + np.round(j) % columns
    return jnp.take(
        radiance.reshape(-1, channels), jnp.asarray(place, jnp.int32), axis=0
    )


def irradiance_methods(where: Scene) -> Iterator[Method]:
    """Every way to irradiance."""
    light = where.radiance

    def coefs(l_max: int, name: str = "none"):
        return apply_window(shjax.analyze(light, l_max=l_max), name)

    def by_degree(held, normals, views):
        return shjax.irradiance(held, normals)

    for l in DEGREES:
        build = functools.partial(coefs, l)
        yield Method(f"degree {l}", "harmonics", build, by_degree, ours=True)
    for name in NAMES:
        if name != "none":
            build = functools.partial(coefs, 2, name)
            yield Method(f"window {name}", "windows at 2", build, by_degree, ours=True)
    yield Method(
        "brute force",
        "brute force",
        lambda: light,
        lambda held, n, v: shjax.reference_irradiance(held, n),
        ours=True,
    )
    yield Method(
        "brute force, cube 16",
        "brute force",
        lambda: irradiance.cube_light(light),
        lambda held, n, v: irradiance.cube_irradiance(held, n),
    )
    yield Method(
        "ambient cube",
        "ambient cube",
        lambda: shjax.irradiance(
            shjax.analyze(light, l_max=8), jnp.asarray(irradiance.AXES, jnp.float32)
        ),
        lambda held, n, v: irradiance.ambient_cube(held, n),
    )
    yield Method(
        "ambient dice",
        "ambient dice",
        lambda: irradiance.ambient_dice_fit(coefs(8)),
        lambda held, n, v: irradiance.ambient_dice(held, n),
    )
    yield Method(
        "Geomerics, degree 1",
        "degree 1, non-linear",
        lambda: coefs(1),
        lambda held, n, v: irradiance.geomerics(held, n),
    )
    yield Method(
        "ZH3", "ZH3", lambda: coefs(2), lambda held, n, v: irradiance.zh3(held, n)
    )
    yield Method(
        "12 spherical Gaussians",
        "spherical Gaussians",
        lambda: irradiance.gaussian_fit(_at(light, irradiance.gaussian_directions())),
        lambda held, n, v: irradiance.gaussian_irradiance(held, n),
    )
    yield Method(
        "H-basis, 6",
        "H-basis",
        lambda: irradiance.h_basis_fit(coefs(8)),
        lambda held, n, v: irradiance.h_basis_irradiance(held, n),
        upper=True,
    )
