"""What every public numeric function keeps: jit, vmap, types, both modes, finiteness."""

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shjax
from shjax import brdf, render
from shjax.reflection import ReflectionMap, dynamic_map
from shjax.vectors import normalize
from tests.helpers import relative_error


@dataclasses.dataclass
class Case:
    """A function of the arrays drawn by ``shapes``; unit vectors where named so."""

    function: Callable
    shapes: tuple[tuple[int, ...], ...]
    units: tuple[int, ...] = ()
    batched: bool = True  # whether the first argument takes leading batch axes itself
    derivative: bool = True  # whether it is checked here, and not where it is cheaper


CASES = {
    "analyze": Case(lambda r: shjax.analyze(r, l_max=2), ((6, 7, 3),)),
    "synthesize": Case(lambda c: shjax.synthesize(c, n_theta=4, n_phi=5), ((9, 3),)),
    "evaluate": Case(shjax.evaluate, ((9, 3), (6, 3)), (1,)),
    "basis": Case(lambda d: shjax.basis(d, l_max=3), ((6, 3),), (0,)),
    "project_samples": Case(
        lambda r, d, w: shjax.project_samples(r, d, w, l_max=2),
        ((8, 3), (8, 3), (8,)),
        (1,),
    ),
    "analyze at 14": Case(lambda r: shjax.analyze(r, l_max=14), ((30, 31, 1),)),
    "analyze pixels": Case(
        lambda r: shjax.analyze(r, l_max=3, quadrature="pixel"), ((3, 4, 2),)
    ),
    "evaluate at 9": Case(shjax.evaluate, ((100, 2), (5, 3)), (1,)),
    "basis at 10": Case(lambda d: shjax.basis(d, l_max=10), ((5, 3),), (0,)),
    "wigner_d": Case(lambda a: shjax.wigner_d(4, a), ((),), batched=False),
    "power_spectrum": Case(shjax.power_spectrum, ((9, 2),)),
    "multiply": Case(
        lambda a: shjax.multiply(a, jnp.ones((*a.shape[:-2], 4, a.shape[-1]), a.dtype)),
        ((9, 2),),
    ),
    "convert": Case(lambda c: shjax.convert(c, to="cmgen shader"), ((9, 3),)),
    "rotate": Case(lambda c, v: shjax.rotate(c, jnp.linalg.qr(v)[0]), ((9, 3), (3, 3))),
    "scale_degrees": Case(shjax.harmonics.scale_degrees, ((9, 3), (3,))),
    "irradiance_coefs": Case(shjax.irradiance_coefs, ((9, 3),)),
    "irradiance": Case(shjax.irradiance, ((9, 3), (6, 3)), (1,)),
    "irradiance_matrix": Case(shjax.irradiance_matrix, ((9, 3),)),
    "irradiance_from_matrix": Case(
        shjax.irradiance_from_matrix, ((4, 4, 3), (6, 3)), (1,)
    ),
    "irradiance_polynomial": Case(shjax.irradiance_polynomial, ((9, 3), (6, 3)), (1,)),
    "reference_irradiance": Case(
        shjax.reference_irradiance, ((6, 8, 3), (5, 3)), (1,), batched=False
    ),
    "lambertian": Case(
        lambda light, n: render.image(render.make_gbuffer(n), light),
        ((9, 3), (4, 5, 3)),
        (1,),
        batched=False,
    ),
    "brdf.transfer": Case(
        lambda n, l, v: brdf.transfer(brdf.ggx(0.5, 0.3), n, l, v),
        ((400, 3), (400, 3), (400, 3)),
        (0, 1, 2),
        batched=False,
    ),
    "brdf_coefs": Case(
        lambda u: shjax.brdf_coefs(
            brdf.ggx(0.3 + 0.2 * jax.nn.sigmoid(u[0]), jax.nn.sigmoid(u[1])),
            l_max=3,
            p_max=1,
            resolution=brdf.Resolution(12, 10, 10),
        ),
        ((2,),),
        batched=False,
    ),
    "convolve": Case(shjax.reflection.convolve, ((9, 3), (3, 1))),
    "reflected_coefs": Case(shjax.reflection.reflected_coefs, ((9, 3), (3, 2, 2, 1))),
    "reflect": Case(
        shjax.reflection.reflect,
        ((9, 3), (3, 2, 2, 1), (5, 3), (5, 3)),
        (2, 3),
        batched=False,
    ),
    "prefilter": Case(
        lambda c, r: shjax.prefilter(c, r, n_theta=5, n_phi=6).coefs,
        ((9, 3), (3, 2, 2, 1)),
    ),
    "prefilter, global": Case(
        lambda c, r: shjax.prefilter(c, r, n_theta=5, n_phi=6, frame="global").coefs,
        ((9, 3), (3, 2, 2, 1)),
    ),
    "prefilter_cube": Case(
        lambda c, r: shjax.reflection.prefilter_cube(c, r, size=2).coefs,
        ((9, 3), (3, 2, 2, 1)),
    ),
    "ReflectionMap.radiance": Case(
        lambda c, n, v: ReflectionMap.from_coefs(c, frame="local").radiance(n, v),
        ((5, 6, 4, 3), (7, 3), (7, 3)),
        (1, 2),
        batched=False,
    ),
    "dynamic_map": Case(
        lambda c, v: dynamic_map(ReflectionMap.from_coefs(c, frame="global"), v),
        ((5, 6, 4, 3), (3,)),
        (1,),
    ),
    "reference_reflection": Case(
        lambda r, n, v: shjax.reference_reflection(r, brdf.phong(3.0), n, v),
        ((6, 8, 3), (5, 3), (5, 3)),
        (1, 2),
        batched=False,
    ),
    "prefilter_light": Case(
        lambda c: shjax.prefilter_light(c, maps=4).level(0), ((9, 3),)
    ),
    "shade": Case(
        lambda n, v: shjax.shade(
            shjax.prefilter_light(jnp.ones((9, 3), n.dtype), maps=4),
            n,
            v,
            albedo=jnp.full(3, 0.5, n.dtype),
            roughness=jnp.asarray(0.6, n.dtype),
            metallic=jnp.asarray(0.3, n.dtype),
        ),
        ((5, 3), (5, 3)),
        (0, 1),
        batched=False,
    ),
    "cap_coefs": Case(
        lambda d, f: shjax.lights.cap_coefs(
            shjax.lights.CapLights(d, jnp.full(2, 0.1, d.dtype), f), l_max=3
        ),
        ((2, 3), (2, 3)),
        (0,),
        batched=False,
    ),
    "cap_reflection": Case(
        lambda h, n, v: shjax.lights.cap_reflection(
            shjax.lights.CapLights(
                jnp.asarray([[0.0, 0.6, 0.8]], h.dtype),
                jnp.abs(jnp.tanh(h)),
                jnp.ones((1, 1), h.dtype),
            ),
            brdf.ggx(0.3),
            n,
            v,
        ),
        ((1,), (4, 3), (4, 3)),
        (1, 2),
        batched=False,
        derivative=False,  # five rules by width: tests/test_model.py has one's
    ),
    "estimate_lighting": Case(
        lambda i, n: shjax.estimate_lighting(i, normalize(n)).value,
        ((120, 3), (120, 3)),  # more than unknowns: QR has no derivative with fewer
        (1,),
        batched=False,
    ),
}

pytestmark = pytest.mark.parametrize("name", CASES)


def draw(case, rng, dtype):
    arrays = []
    for place, shape in enumerate(case.shapes):
        values = rng.normal(size=shape)
        if place in case.units:
            values /= np.linalg.norm(values, axis=-1, keepdims=True)
        arrays.append(jnp.asarray(values, dtype))
    return arrays


def corners(case, dtype):
    """Where code that knows its values may branch: zero, ones, vectors at both poles."""
    for number, z in ((0.0, 1.0), (1.0, -1.0)):
        yield [
            jnp.broadcast_to(jnp.asarray([0.0, 0.0, z], dtype), shape)
            if place in case.units
            else jnp.full(shape, number, dtype)
            for place, shape in enumerate(case.shapes)
        ]


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_type_in_is_type_out(name, kind, dtype):
    """By tracing alone; the values of each type are in the lane of that type."""
    if np.dtype(kind) == dtype or kind == np.float32:
        shapes = [jax.ShapeDtypeStruct(s, kind) for s in CASES[name].shapes]
        assert jax.eval_shape(CASES[name].function, *shapes).dtype == kind


def test_jit_and_vmap_change_nothing(name, rng, dtype):
    """Eager, compiled and mapped: at random values and at corners."""
    case, close = CASES[name], 1000 * np.finfo(dtype).eps
    jitted = jax.jit(case.function)
    arrays, first = draw(case, rng, dtype), []
    for values in (arrays, *corners(case, dtype)):
        try:
            plain = case.function(*values)
        except ValueError:
            assert values is not arrays  # a corner may be refused where it is seen
            plain = jitted(*values)
        np.testing.assert_allclose(
            jitted(*values), plain, rtol=close, atol=close * np.max(np.abs(plain))
        )
        first.append(values[0])
    axes = (0, *(None for _ in arrays[1:]))
    mapped = jax.jit(jax.vmap(case.function, in_axes=axes))(
        jnp.stack(first), *arrays[1:]
    )
    loop = jnp.stack([jitted(one, *arrays[1:]) for one in first])
    assert relative_error(mapped, loop) < close
    if case.batched:
        whole = jax.jit(case.function)(jnp.stack(first), *arrays[1:])
        assert relative_error(whole, loop) < close


def test_both_modes_agree_and_are_finite(name, rng, dtype):
    case = CASES[name]
    if not case.derivative:
        return
    arrays = draw(case, rng, dtype)
    tangents = draw(case, rng, dtype)
    shape = jax.eval_shape(case.function, *arrays).shape
    cotangent = jnp.asarray(rng.normal(size=shape), dtype)

    @jax.jit
    def both(arrays, tangents, cotangent):
        _, forward = jax.jvp(case.function, arrays, tangents)
        return forward, jax.vjp(case.function, *arrays)[1](cotangent)

    forward, gradients = both(arrays, tangents, cotangent)
    left = float(jnp.vdot(cotangent, forward))
    right = sum(float(jnp.vdot(g, t)) for g, t in zip(gradients, tangents, strict=True))
    scale = float(jnp.linalg.norm(cotangent) * jnp.linalg.norm(forward))
    assert np.isfinite(scale)
    assert scale > 1e-3
    assert abs(left - right) < 1e4 * np.finfo(dtype).eps * scale
