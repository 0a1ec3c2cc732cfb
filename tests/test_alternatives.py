"""The alternatives: each at a value that is known."""

import jax.numpy as jnp
import numpy as np
import pytest

import shjax
import shjax.harmonics
from experiments.alternatives import importance, irradiance, split_sum, view_textures
from experiments.speed.methods import Draw
from shjax import brdf
from shjax.sphere import icosahedron
from tests.helpers import relative_error, unit_vectors

CONSTANT = jnp.full((32, 64, 3), 2.0, jnp.float32)


@pytest.fixture
def normals(rng):
    return jnp.asarray(unit_vectors(rng, 200), jnp.float32)


def fits(light):
    """Each representation of a light, as a function of normals."""
    coefs = shjax.analyze(light, l_max=8)
    axes = jnp.asarray(irradiance.AXES, jnp.float32)
    return {
        "cube": lambda n: irradiance.cube_irradiance(irradiance.cube_light(light), n),
        "ambient cube": lambda n: irradiance.ambient_cube(
            shjax.irradiance(coefs, axes), n
        ),
        "ambient dice": lambda n: irradiance.ambient_dice(
            irradiance.ambient_dice_fit(coefs), n
        ),
        "geomerics": lambda n: irradiance.geomerics(coefs[:4], n),
        "zh3": lambda n: irradiance.zh3(coefs[:9], n),
        "h-basis": lambda n: irradiance.h_basis_irradiance(
            irradiance.h_basis_fit(coefs), n
        ),
    }


@pytest.mark.parametrize("name", list(fits(CONSTANT)))
def test_constant_light_is_pi_times_it(name, normals):
    up = normals.at[:, 2].set(jnp.abs(normals[:, 2]))
    found = fits(CONSTANT)[name](up)
    np.testing.assert_allclose(found, 2 * np.pi, rtol=3e-3)


def test_ambient_cube_is_exact_on_its_axes(rng):
    colours = jnp.asarray(rng.uniform(1, 2, (6, 3)), jnp.float32)
    axes = jnp.asarray(irradiance.AXES, jnp.float32)
    np.testing.assert_allclose(
        irradiance.ambient_cube(colours, axes), colours, rtol=1e-6
    )


def test_ambient_dice_reproduces_its_lobes(rng, normals):
    colours = rng.uniform(1, 2, (12, 3))
    cosine = np.maximum(np.asarray(normals, float) @ icosahedron().T, 0)
    expected = (0.35 * cosine**2 + 0.25 * cosine**4) @ colours
    found = irradiance.ambient_dice(jnp.asarray(colours, jnp.float32), normals)
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_geomerics_of_a_directional_light():
    # A light at +z: four times the mean at +z, nothing behind.
    direction = jnp.array([[0, 0, 1.0]], jnp.float32)
    coefs = shjax.basis(direction, l_max=1)[0][:, None]
    found = irradiance.geomerics(
        coefs, jnp.array([[0, 0, 1.0], [0, 0, -1]], jnp.float32)
    )
    np.testing.assert_allclose(found[:, 0], [1, 0], atol=1e-5)


def test_zh3_is_exact_for_zonal_light(rng, normals):
    axis = jnp.asarray(unit_vectors(rng, 1), jnp.float32)
    gains = jnp.asarray([1.0, 0.8, 0.5], jnp.float32)
    coefs = shjax.harmonics.spread(gains) * shjax.basis(axis, l_max=2)[0]
    coefs = jnp.broadcast_to(coefs[:, None], (9, 3))
    np.testing.assert_allclose(
        irradiance.zh3(coefs, normals), shjax.irradiance(coefs, normals), atol=1e-5
    )


def test_gaussians_reproduce_a_gaussian(normals):
    from shjax.sphere import fibonacci_directions

    axes, _, _ = irradiance._gaussians()
    towards = irradiance.gaussian_directions()
    light = np.exp(irradiance._SHARPNESS * (towards @ axes[3] - 1))[:, None]
    amplitudes = irradiance.gaussian_fit(jnp.asarray(light, jnp.float32))
    np.testing.assert_allclose(amplitudes[:, 0], np.eye(12)[3], atol=1e-3)
    many = fibonacci_directions(20_000)
    lobe = np.exp(irradiance._SHARPNESS * (many @ axes[3] - 1))
    exact = (
        np.maximum(np.asarray(normals, float) @ many.T, 0)
        @ lobe
        * 4
        * np.pi
        / len(many)
    )
    found = irradiance.gaussian_irradiance(amplitudes, normals)[:, 0]
    np.testing.assert_allclose(found, exact, atol=2e-3 * exact.max())


def test_h_basis_is_orthonormal_on_the_hemisphere():
    from shjax.sphere import fibonacci_directions

    towards = fibonacci_directions(40_000)
    values = irradiance.h_basis(towards[towards[:, 2] > 0])
    gram = values.T @ values * 2 * np.pi / len(values)
    np.testing.assert_allclose(gram, np.eye(6), atol=2e-3)


def test_split_sum_is_exact_to_its_table_under_constant_light(rng, normals):
    light = split_sum.prefilter(shjax.analyze(CONSTANT, l_max=15))
    views = normals + 0.5 * jnp.asarray(unit_vectors(rng, 200), jnp.float32)
    views = views / jnp.linalg.norm(views, axis=-1, keepdims=True)
    n = len(normals)
    values = {
        "albedo": jnp.zeros((n, 3)),
        "roughness": jnp.full(n, 0.5),
        "metallic": jnp.zeros(n),
    }
    values = {k: jnp.asarray(v, jnp.float32) for k, v in values.items()}
    cosine = jnp.sum(normals * views, axis=-1)
    rough = split_sum.locate(values["roughness"] ** 2)
    base, slope = split_sum._looked_up(rough.place * 4, cosine * 64 - 0.5)
    for shift in (False, True):
        found = split_sum.shade(light, normals, views, **values, shift=shift)
        np.testing.assert_allclose(
            found[:, 0],
            2 * (np.asarray(base) + 0.04 * np.asarray(slope)),
            rtol=2e-3,
            atol=1e-5,
        )


def test_the_analytic_fit():
    # By hand at roughness 0 and 1, n.v 1; elsewhere it is known to be rough.
    one = jnp.ones(1, jnp.float32)
    base, slope = split_sum._analytic(0 * one, one)
    a = 2**-9.28 + 0.0425
    np.testing.assert_allclose(
        [base[0], slope[0]], [1.04 * a - 0.04, 1.04 - 1.04 * a], rtol=1e-5
    )
    base, slope = split_sum._analytic(one, one)
    np.testing.assert_allclose([base[0], slope[0]], [-0.0024, 0.4524], atol=1e-4)
    cosine = jnp.linspace(0.2, 1, 20).astype(jnp.float32)
    for roughness in (0.3, 0.6, 0.9):
        rough = split_sum.locate(jnp.full(20, roughness**2, jnp.float32))
        table = split_sum._looked_up(rough.place * 4, cosine * 64 - 0.5)
        fit = split_sum._analytic(jnp.full(20, roughness, jnp.float32), cosine)
        for f0, limit in ((0.04, 0.04), (1.0, 0.2)):
            a, b = (np.asarray(x[0] + f0 * x[1]) for x in (table, fit))
            np.testing.assert_allclose(b, a, atol=limit)


@pytest.mark.parametrize("read", ["cabral", "kautz_mccool"])
def test_view_textures_under_a_radial_lobe(rng, normals, read):
    # A lobe about R does not depend on the view: both tables hold it.
    light = jnp.asarray(
        rng.uniform(0.5, 2, (25, 3)) / (1 + np.arange(25))[:, None], jnp.float32
    )
    rho = shjax.brdf_coefs(brdf.phong(8.0), l_max=4, p_max=2).astype(jnp.float32)
    frame = {"cabral": "global", "kautz_mccool": "local"}[read]
    maps = shjax.prefilter(light, rho, n_theta=64, n_phi=128, frame=frame)
    views = jnp.asarray(unit_vectors(rng, 200), jnp.float32)
    make = {
        "cabral": view_textures.cabral_maps,
        "kautz_mccool": view_textures.elevation_maps,
    }[read]
    found = getattr(view_textures, read)(make(maps), normals, views)
    local = (
        maps if frame == "local" else shjax.prefilter(light, rho, n_theta=64, n_phi=128)
    )
    expected = local.radiance(normals, views)
    assert relative_error(found, expected) < 5e-3


def test_uniform_sampling_falls_as_the_root(rng, normals):
    light = jnp.asarray(1 + rng.uniform(0, 1, (16, 32, 3)), jnp.float32)
    surface, levels = brdf.phong(4.0), importance.pyramid(light)
    views = normals
    exact = shjax.reference_reflection(light, surface, normals, views)
    counts = np.array([16, 64, 256, 1024])
    errors = []
    for n in counts:
        draw = Draw("uniform", 0.0, int(n))
        found = importance.reflect(
            levels, surface, normals, views, draw=draw, filtered=False
        )
        errors.append(relative_error(found, exact))
    slope = np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert slope == pytest.approx(-0.5, abs=0.1)


def test_drawing_by_both_integrates_the_density(normals):
    views = normals
    drawn = Draw("both", 20.0, 4096)(normals[:4], views[:4])
    # The mean of a density over the mixture is the integral of it: one for a lobe.
    cosine = jnp.maximum(jnp.einsum("pi,pki->pk", normals[:4], drawn.lights), 0)
    lobe = 5 / (2 * np.pi) * cosine**4
    np.testing.assert_allclose(jnp.mean(lobe / drawn.density, axis=1), 1, rtol=0.01)


@pytest.mark.parametrize("how", ["phong", "microfacet", "ggx"])
def test_samples_integrate_their_density(how, dtype):
    """Uniform light and one view: the directional albedo, by 4096 samples."""
    parameter = {"phong": 12.0, "microfacet": 0.3, "ggx": 0.3}[how]
    model = {
        "phong": lambda s: brdf.phong(s, horizon=True),
        "microfacet": brdf.gaussian_microfacet,
        "ggx": lambda alpha: brdf.ggx(alpha, 1.0),
    }[how](parameter)
    normals = jnp.asarray([[0.0, 0.0, 1.0]], dtype)
    views = jnp.asarray([[0.6, 0.0, 0.8]], dtype)
    seen = importance.reflect(
        (jnp.ones((4, 8, 1), dtype),),
        model,
        normals,
        views,
        draw=Draw(how, parameter, 4096),
        filtered=False,
    )
    angle = jnp.asarray([2 * np.arccos(0.8)], dtype)
    exact = brdf.flux.outgoing_flux(brdf.core.prepared(model), angle, 96, 64)
    np.testing.assert_allclose(seen, exact, rtol=5e-3)
