"""Methods of glossy reflection: how each prepares a light, and how it answers at points."""

from __future__ import annotations

import dataclasses
import functools
import pickle
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import shjax
from experiments.alternatives import importance, split_sum, view_textures
from experiments.speed.scenes import Material, Scene
from shjax import ibl
from shjax.io.writing import replacing
from shjax.reflection import ReflectionMap, default_size
from shjax.reflection.prefiltering import map_of_kernels
from shjax.reflection.view_basis import HarmonicViews, ViewBasis, ZonalViews
from shjax.vectors import mirror


@dataclasses.dataclass(frozen=True)
class Steps:
    """How many steps of each family of methods are measured.

    Attributes:
        radial: Degrees of radial maps.
        views: Degrees P of the SHRM.
        errors: What ``choose_model`` is asked for.
        maps: Of the lighting layer and of low-rank maps.
        lights: Split by the lighting layer.
        samples: Of Monte Carlo.
        l_max: To which a BRDF is expanded.
    """

    radial: tuple[int, ...] = (4, 8, 16, 32, 64, 128)
    views: tuple[int, ...] = (1, 2, 3, 4, 6, 8)
    errors: tuple[float, ...] = (0.3, 0.1, 0.03)
    maps: tuple[int, ...] = (4, 9, 16, 21)
    lights: tuple[int, ...] = (0, 1, 4)
    samples: tuple[int, ...] = (16, 64, 256, 1024, 4096)
    l_max: int = 128


ALL = Steps()
FEW = Steps(
    radial=(8, 16, 32),
    views=(2, 4),
    errors=(0.1,),
    maps=(9,),
    lights=(0, 4),
    samples=(16, 256),
    l_max=64,
)


@dataclasses.dataclass(frozen=True)
class Method:
    """One point of the plots.

    Attributes:
        name: In words.
        family: Methods of a line in the plots.
        build: What is done once for a light.
        evaluate: ``(built, normals, views)`` to values ``(n, C)``.
        ours: Whether it is shjax's.
        upper: Whether it knows upward normals only.
        predicted: Of what was built, the relative rms error that was predicted.
        own: Whether its evaluation, once compiled, is good for its material alone.
    """

    name: str
    family: str
    build: Callable[[], Any]
    evaluate: Callable[..., jax.Array]
    ours: bool = False
    upper: bool = False
    predicted: Callable[[Any], float] | None = None
    own: bool = False


class Prepared:
    """What a material needs once, whatever the light: none of it is timed.

    It takes half a minute, and is kept in a folder.
    """

    def __init__(self, material: Material, cache: Path, steps: Steps = ALL) -> None:
        self.material, self.steps = material, steps
        words = f"{material.name} {steps.l_max} {steps.maps}"
        name = "".join(c if c.isalnum() else "_" for c in words)
        path = cache / f"material_{shjax.__version__}_{name}.pickle"
        if not path.exists():
            made = self._make()
            cache.mkdir(parents=True, exist_ok=True)
            with replacing(path) as temporary:
                temporary.write_bytes(pickle.dumps(made))
        held = pickle.loads(path.read_bytes())
        self.expansion, self.energies, self.low_rank = held
        self.rho = np.asarray(self.expansion.rho, np.float32)
        energy = np.einsum("lpqc,q->l", self.rho**2, np.where(np.arange(9) == 0, 1, 2))
        held = np.cumsum(energy) / energy.sum()
        enough = int(np.argmax(held >= 0.9995))
        self.degree = next((f for f in (4, 8, 16, 32) if f >= enough), 64)

    def _make(self):
        surface, l_max = self.material.brdf, self.steps.l_max
        expansion = shjax.brdf.expand(surface, l_max=l_max, p_max=8, accuracy=1e-4)
        energies = shjax.reflection.brdf_energies(surface, p_max=16)
        counts = self.steps.maps if self.material.kind != "ggx" else ()
        low_rank = {
            n: shjax.reflection.fit_low_rank(surface, maps=n, l_max=63) for n in counts
        }
        return expansion, energies, low_rank


def glossy_methods(where: Scene, prepared: Prepared) -> Iterator[Method]:
    """Every way to the radiance of a material."""
    yield from _maps(where, prepared)
    yield from _models(where, prepared)
    yield from _fitted(where, prepared)
    yield from _others(where, prepared)
    yield from _monte_carlo(where, prepared)


def _map_method(
    where: Scene, prepared: Prepared, basis, f: int, name: str, family: str
):
    p = basis.p_max
    rho = jnp.asarray(prepared.rho[: f + 1, : p + 1, : p + 1])

    def build():
        return _map(_coefs(where, f), basis.kernels(rho), basis)

    def predicted(_) -> float:
        degree = min(127, prepared.expansion.l_max)
        light = shjax.analyze(where.radiance, l_max=degree, quadrature="pixel")
        error = shjax.brdf.predicted_rms_error(
            shjax.power_spectrum(light), prepared.expansion, l_max=f, p_max=p
        )
        return float(error)

    return Method(name, family, build, _read, ours=True, predicted=predicted)


def _map(coefs: jax.Array, kernels: jax.Array, basis: ViewBasis) -> ReflectionMap:
    size = default_size(kernels.shape[0] - 1)
    return map_of_kernels(coefs, kernels, basis, None, size=size, centre="reflection")


@jax.jit
def _read(held: ReflectionMap, normals: jax.Array, views: jax.Array) -> jax.Array:
    return held.radiance(normals, views)


def _coefs(where: Scene, f: int) -> jax.Array:
    """Coefficients to a degree, by the quadrature that the rows allow."""
    exact = 2 * f + 1 <= where.radiance.shape[0]
    quadrature = "fejer" if exact else "pixel"
    return shjax.analyze(where.radiance, l_max=f, quadrature=quadrature)


def _maps(where: Scene, prepared: Prepared) -> Iterator[Method]:
    for f in prepared.steps.radial:
        yield _map_method(
            where, prepared, ZonalViews(0), f, f"radial map F={f}", "radial maps"
        )
    for p in prepared.steps.views:
        name = f"SHRM F={prepared.degree} P={p}"
        yield _map_method(
            where, prepared, HarmonicViews(p), prepared.degree, name, "SHRM"
        )


def _models(where: Scene, prepared: Prepared) -> Iterator[Method]:
    for error in prepared.steps.errors:
        build = functools.partial(
            shjax.choose_model,
            where.envmap,
            prepared.material.brdf,
            rms_error=error,
            energies=prepared.energies,
        )
        yield Method(
            f"choose_model {error:g}",
            "choose_model",
            build,
            jax.jit(lambda model, n, v: model.radiance(n, v)),
            ours=True,
            predicted=lambda model: model.predicted_rms_error,
        )


def _fitted(where: Scene, prepared: Prepared) -> Iterator[Method]:
    material = prepared.material
    if material.kind == "ggx":
        values = _metallic_roughness(material, where.normals.shape[0])
        for maps in prepared.steps.maps:
            for lights in prepared.steps.lights:
                words = f"{lights} {'light' if lights == 1 else 'lights'}"
                yield Method(
                    f"layer {maps} maps, {words}",
                    f"lighting layer, {words}",
                    functools.partial(
                        ibl.prefilter_light, where.envmap, maps=maps, max_lights=lights
                    ),
                    functools.partial(_shade, values),
                    ours=True,
                    own=True,
                )
        return
    for maps in prepared.steps.maps:
        fit = prepared.low_rank[maps]
        kernels = jnp.asarray(fit.kernels, jnp.float32)
        kernels = jnp.broadcast_to(kernels, (*kernels.shape[:2], 3))

        def build(kernels=kernels[:64], basis=fit.views):
            return _map(_coefs(where, 63), kernels, basis)

        name = f"low-rank {maps} maps"
        yield Method(name, "low-rank maps", build, _read, ours=True, own=True)


def _metallic_roughness(material: Material, n: int) -> dict[str, jax.Array]:
    metal = float(material.f0 == 1)
    return {
        "albedo": jnp.full((n, 3), metal, jnp.float32),
        "roughness": jnp.full(n, np.sqrt(material.parameter), jnp.float32),
        "metallic": jnp.full(n, metal, jnp.float32),
    }


def _shade(values, light, normals, views):
    return ibl.shade(light, normals, views, **values)


def _others(where: Scene, prepared: Prepared) -> Iterator[Method]:
    material = prepared.material
    if material.kind == "ggx":
        values = _metallic_roughness(material, where.normals.shape[0])

        def build():
            light = where.radiance
            return split_sum.prefilter(
                shjax.analyze(light, l_max=128, quadrature="pixel")
            )

        for fit in ("table", "analytic"):
            for shift in (False, True):
                name = f"split-sum, {fit}{', shifted' if shift else ''}"

                def evaluate(light, n, v, fit=fit, shift=shift):
                    return split_sum.shade(light, n, v, **values, fit=fit, shift=shift)

                yield Method(name, "split-sum", build, evaluate, own=True)
    f, p = prepared.degree, 8
    rho = jnp.asarray(prepared.rho[: f + 1])

    def elevations():
        return view_textures.elevation_maps(
            shjax.prefilter(_coefs(where, f), rho[:, : p + 1, : p + 1])
        )

    def twelve():
        rows, columns = default_size(f)
        maps = shjax.prefilter(
            _coefs(where, f), rho, n_theta=rows, n_phi=columns, frame="global"
        )
        return view_textures.cabral_maps(maps)

    yield Method(
        "Kautz-McCool, 16 elevations",
        "Kautz-McCool",
        elevations,
        view_textures.kautz_mccool,
    )
    yield Method("Cabral's 12 maps", "Cabral", twelve, view_textures.cabral)


@dataclasses.dataclass(frozen=True)
class Draw:
    """A way to draw directions, static for jit."""

    how: str
    parameter: float
    samples: int

    def __call__(self, normals: jax.Array, views: jax.Array) -> importance.Drawn:
        """Directions and densities at points."""
        n = self.samples
        if self.how == "uniform":
            return importance.draw_uniform(n, normals)
        if self.how == "phong":
            return importance.draw_phong(self.parameter, n, mirror(normals, views))
        if self.how == "microfacet":
            return importance.draw_microfacet(self.parameter, n, normals, views)
        if self.how == "ggx":
            return importance.draw_ggx(self.parameter, n, normals, views)
        return importance.draw_both(self.parameter, n, normals, mirror(normals, views))


def _monte_carlo(where: Scene, prepared: Prepared) -> Iterator[Method]:
    material = prepared.material

    def pyramid():
        return importance.pyramid(where.radiance)

    for name, how, filtered in (
        ("uniform", "uniform", False),
        ("importance", material.kind, False),
        ("filtered importance", material.kind, True),
    ):
        for n in prepared.steps.samples:
            draw = Draw(how, float(material.parameter), n)

            def evaluate(levels, normals, views, draw=draw, filtered=filtered):
                return importance.reflect(
                    levels, material.brdf, normals, views, draw=draw, filtered=filtered
                )

            yield Method(
                f"{name} sampling, {n}",
                f"{name} sampling",
                pyramid,
                evaluate,
                own=True,
            )
