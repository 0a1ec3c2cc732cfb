"""Roughness, albedo and light from one picture, through the lighting layer and split-sum.

    python experiments/recovery.py --out experiments/results

A half-metallic sphere whose roughness and albedo vary over its surface is drawn by the
exact integral (never by what recovers it) under a light of degree 8; then all three are
learnt by Adam through :func:`shjax.shade`, and through split-sum, from the same start.
Roughness and albedo are smooth fields (harmonics of degree 3 over the normal); the views
are four, or one view would not tell light from albedo.
"""

from __future__ import annotations

import functools
import sys
from pathlib import Path

import click
import jax
import jax.numpy as jnp
import numpy as np
import optax

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import shjax
from experiments.alternatives import split_sum
from experiments.data import data_folder
from experiments.versions import versions
from experiments.writing import markdown_table, write_result
from shjax import ibl, io, render
from shjax.brdf import lambertian
from shjax.brdf.core import make_brdf
from shjax.brdf.ggx import GGX_MULTISCATTER

FIELD, LIGHT = 3, 8  # degrees of the fields and of the light
METALLIC = 0.5  # known; half of both tells light and albedo apart
CAMERAS = [(5.0, 0.0, 1.0), (-2.0, 4.5, 1.0), (-2.0, -4.5, -1.0), (1.0, 1.0, 5.0)]


class _Scene:
    """Points of all views, their true fields, and their exact radiance."""

    def __init__(self, size: int, seed: int) -> None:
        rng = np.random.default_rng(seed)
        envmap = io.read_envmap(data_folder() / "hdri" / "forest.exr").to_latlong(64)
        self.light = envmap.lighting(l_max=LIGHT).astype(jnp.float32)
        normals, views = [], []
        for origin in CAMERAS:
            ball = render.sphere(size, render.Camera(origin=origin, fov=0.5))
            facing = np.asarray(jnp.sum(ball.normals * ball.views, -1)) > 0.15
            normals.append(np.asarray(ball.normals)[facing])
            views.append(np.asarray(ball.views)[facing])
        self.normals, self.views = (
            jnp.asarray(np.concatenate(a), jnp.float32) for a in (normals, views)
        )
        self.basis = shjax.basis(self.normals, l_max=FIELD)
        shape = ((FIELD + 1) ** 2, 3)
        fall = 1 / (1 + np.repeat(np.arange(FIELD + 1), 2 * np.arange(FIELD + 1) + 1))
        self.truth = {
            "albedo": jnp.asarray(rng.normal(size=shape) * fall[:, None], jnp.float32),
            "roughness": jnp.asarray(rng.normal(size=shape[0]) * fall, jnp.float32),
        }
        self.albedo, self.roughness = fields(self.basis, self.truth)
        self.radiance = self._exact()

    def _exact(self) -> jax.Array:
        """By the integral, the material of each point its own."""
        grid = shjax.synthesize(self.light, n_theta=64, n_phi=128)
        shine = functools.partial(_one_point, grid)
        points = (self.normals, self.views, self.albedo, self.roughness)
        return jax.lax.map(lambda one: shine(*one), points, batch_size=64)


def _one_point(grid, normal, view, albedo, roughness):
    glossy = make_brdf(
        GGX_MULTISCATTER,
        alpha=roughness[None] ** 2,
        f0=0.04 * (1 - METALLIC) + albedo * METALLIC,
    )
    surface = lambertian(albedo * (1 - METALLIC)) + glossy
    return shjax.reference_reflection(grid, surface, normal[None], view[None])[0]


def fields(basis: jax.Array, coefs: dict) -> tuple[jax.Array, jax.Array]:
    """Albedo ``(n, 3)`` in [0.05, 0.95] and roughness ``(n,)`` in [0.3, 1]."""
    albedo = 0.05 + 0.9 * jax.nn.sigmoid(basis @ coefs["albedo"])
    return albedo, 0.3 + 0.7 * jax.nn.sigmoid(basis @ coefs["roughness"])


def by_layer(scene: _Scene, guess: dict) -> jax.Array:
    """Radiance of all points by the lighting layer."""
    albedo, roughness = fields(scene.basis, guess)
    light = ibl.prefilter_light(guess["light"], maps=9)
    return ibl.shade(
        light,
        scene.normals,
        scene.views,
        albedo=albedo,
        roughness=roughness,
        metallic=METALLIC,
    )


def by_split_sum(scene: _Scene, guess: dict) -> jax.Array:
    """The same by split-sum."""
    albedo, roughness = fields(scene.basis, guess)
    return split_sum.shade(
        split_sum.prefilter(guess["light"]),
        scene.normals,
        scene.views,
        albedo=albedo,
        roughness=roughness,
        metallic=jnp.full_like(roughness, METALLIC),
    )


def recover(scene: _Scene, forward, steps: int) -> dict:
    """Descend from a grey, half-rough ball under white light; errors at the end."""
    guess = _start(scene)
    rates = optax.cosine_decay_schedule(0.05, steps)
    optimiser = optax.adam(rates)

    @jax.jit
    def step(state, _):
        guess, memory = state
        value, gradient = jax.value_and_grad(
            lambda guess: _loss(scene, forward, guess)
        )(guess)
        change, memory = optimiser.update(gradient, memory)
        return (optax.apply_updates(guess, change), memory), value

    (found, _), losses = jax.lax.scan(
        step, (guess, optimiser.init(guess)), None, length=steps
    )
    return _errors(scene, found, losses[-1])


def _loss(scene: _Scene, forward, guess: dict) -> jax.Array:
    """Mean square of the difference over that of the picture."""
    norm = jnp.mean(scene.radiance**2)
    return jnp.mean((forward(scene, guess) - scene.radiance) ** 2) / norm


def _start(scene: _Scene) -> dict:
    """A grey, half-rough ball under white light."""
    return {
        "albedo": jnp.zeros_like(scene.truth["albedo"]),
        "roughness": jnp.zeros_like(scene.truth["roughness"]),
        "light": jnp.zeros_like(scene.light).at[0].set(scene.light[0]),
    }


def _errors(scene: _Scene, found: dict, loss: jax.Array) -> dict:
    """How far a guess is from the truth."""
    albedo, roughness = fields(scene.basis, found)
    # Light and albedo share a factor in each channel, which half a metal only nearly
    # tells: each error is after its own best one.
    light = _scaled(found["light"], scene.light)
    colour = _scaled(albedo, scene.albedo)
    return {
        "picture, relative": float(jnp.sqrt(loss)),
        "roughness rms": float(jnp.sqrt(jnp.mean((roughness - scene.roughness) ** 2))),
        "albedo rms": float(jnp.sqrt(jnp.mean((colour - scene.albedo) ** 2))),
        "light, relative": float(
            jnp.linalg.norm(light - scene.light) / jnp.linalg.norm(scene.light)
        ),
    }


def _scaled(found: jax.Array, truth: jax.Array) -> jax.Array:
    """Times the factor of each channel that fits best."""
    return found * (jnp.sum(found * truth, 0) / jnp.sum(found**2, 0))[None]


def run(size: int = 24, steps: int = 2000, seed: int = 4) -> dict:
    """Errors of both, and of the start."""
    scene = _Scene(size, seed)
    return {
        "lighting layer": recover(scene, by_layer, steps),
        "split-sum": recover(scene, by_split_sum, steps),
        "start": _errors(scene, _start(scene), _loss(scene, by_layer, _start(scene))),
        "points": scene.normals.shape[0],
        "steps": steps,
        "versions": versions(),
    }


def markdown(result: dict) -> str:
    """The table as text."""
    names = list(result["start"])
    rows = [
        [method, *(f"{result[method][name]:.4f}" for name in names)]
        for method in ("start", "split-sum", "lighting layer")
    ]
    return "\n\n".join(
        [
            f"# Recovery by gradient descent\n\n{__doc__ or ''}",
            f"{result['points']} points, {result['steps']} steps of Adam.",
            markdown_table(["", *names], rows),
        ]
    )


@click.command()
@click.option("--out", required=True, type=click.Path(path_type=Path))
def main(out: Path) -> None:
    """Write recovery.md and .json."""
    result = run()
    write_result(out, "recovery", markdown(result), result)


if __name__ == "__main__":
    main()
