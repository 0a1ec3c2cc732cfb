"""The chosen model: kinds, errors met, splits, refusals; small lights."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shjax
import shjax.vectors
from experiments.data import PANORAMAS
from shjax import brdf, io
from shjax.envmap import make_envmap
from shjax.lights import CapLights, cap_coefs, cap_reflection, split_lights
from shjax.reflection.choice import choose_model
from shjax.reflection.cost import map_bytes, map_time
from shjax.reflection.energies import brdf_energies, light_coefs, prepare_light
from shjax.reflection.view_basis import HarmonicViews
from shjax.sphere import latlong_directions, latlong_solid_angles, spherical_directions
from tests.helpers import check_gradients, relative_error, unit_vectors

STRICT = {
    "lambertian": brdf.lambertian(0.8),
    "phong 8": brdf.phong(8.0),
    "phong 32": brdf.phong(32.0),
    "phong 128": brdf.phong(128.0),
    "microfacet 0.2": brdf.gaussian_microfacet(0.2),
    "microfacet 0.3": brdf.gaussian_microfacet(0.3),
    "microfacet 0.4": brdf.gaussian_microfacet(0.4),
    "microfacet 0.5": brdf.gaussian_microfacet(0.5),
    "kajiya-kay 32": brdf.kajiya_kay(32.0),
    "diffuse and specular": brdf.lambertian(0.6) + 0.3 * brdf.phong_cosine(30.0),
}
LOOSE = {
    "ggx 0.4, f0 0.04": brdf.ggx(0.4, 0.04),
    "ggx 0.4, f0 1": brdf.ggx(0.4, 1.0),
    "ggx 0.1, f0 1": brdf.ggx(0.1, 1.0),
}


@pytest.fixture(scope="module")
def panoramas(data):
    """The eight CC0 panoramas at 256 x 128, and what is known of their light."""
    found = {}
    for name in PANORAMAS[:8]:
        envmap = io.read_envmap(data / "hdri" / name).to_latlong(128)
        found[name] = (envmap, prepare_light(envmap))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", [*STRICT, *LOOSE][::2])
def test_what_is_asked_is_met_and_measured(name, panoramas):
    """On all of them: within 2 % plus three standard errors.

    Every other panorama, the others for the next material; one error on each, another on
    the next.
    """
    model = {**STRICT, **LOOSE}[name]
    known, wrong = brdf_energies(model), []
    first = [*STRICT, *LOOSE].index(name)
    for number, (panorama, (envmap, light)) in enumerate(panoramas.items()):
        if (first + number) % 2:
            continue
        errors = (0.32, 0.17, 0.10) if name in STRICT else (0.32,)
        asked = errors[(first + number) // 2 % len(errors)]
        chosen = choose_model(light, model, rms_error=asked, energies=known)
        found = chosen.check(envmap, n=2048, seed=3)
        fine = found.rms <= 1.02 * asked + 3 * found.standard_error
        if not (chosen.met and fine and chosen.predicted_rms_error <= asked):
            wrong.append((panorama, asked, chosen.message, found))
    assert not wrong


def smooth_light(rng, dtype, l_max=12, channels=3):
    l = np.repeat(np.arange(l_max + 1), 2 * np.arange(l_max + 1) + 1)
    light = rng.normal(size=((l_max + 1) ** 2, channels)) / (1 + l[:, None]) ** 1.5
    light[0] = 6.0
    return jnp.asarray(light, dtype)


@pytest.mark.slow
def test_kinds_are_what_the_material_needs(rng, dtype):
    light = smooth_light(rng, dtype)
    kinds = {
        "irradiance": (brdf.lambertian(0.5), 0.1),
        "radial": (brdf.phong(20.0), 0.01),
        "zonal": (brdf.kajiya_kay(12.0), 0.05),
        "harmonic": (brdf.lafortune([0.6], [1.0], [3.0]), 0.001),
        "low-rank": (brdf.ggx(0.4, 0.04), 0.03),
    }
    for kind, (model, asked) in kinds.items():
        chosen = choose_model(light, model, rms_error=asked)
        assert chosen.label == kind
        assert chosen.met
        found = chosen.check(n=1024)
        assert (
            abs(found.rms - chosen.predicted_rms_error)
            < 0.1 * asked + 4 * found.standard_error
        )
        assert f"{asked:.2%} rms ({asked**2:.2%} energy)" in chosen.message


def test_no_faster_model_would_have_done(rng, dtype):
    """Every pair of orders that is read faster, all q and q = 0, misses the error."""
    light = smooth_light(rng, dtype)
    model = brdf.gaussian_microfacet(0.3)
    asked, item = 0.06, 3 * light.dtype.itemsize
    chosen = choose_model(light, model, rms_error=asked)
    specular = chosen.specular
    basis = specular.view_basis
    tables = jax.tree.leaves(basis)
    assert chosen.bytes == sum(a.nbytes for a in (specular.coefs, *tables))
    own = map_time([basis], np.full((1, 1), specular.bytes))[0, 0]
    spectrum = shjax.power_spectrum(light)
    expansion = shjax.brdf.expand(model, l_max=12, p_max=8)
    bases = [HarmonicViews(p) for p in range(9)]
    faster = map_time(bases, map_bytes(bases, 13, item)) < own
    assert np.any(faster)
    for f, p in np.argwhere(faster):
        error = float(
            shjax.brdf.predicted_rms_error(
                spectrum, expansion, l_max=int(f), p_max=int(p)
            )
        )
        assert error > asked


@pytest.mark.slow
def test_prediction_with_a_diffuse_part(rng, dtype):
    """Its cross terms with the specular part count: against sampling."""
    light = smooth_light(rng, dtype, 20)
    model = brdf.lambertian(0.7) + 0.4 * brdf.phong_cosine(8.0)
    for asked in (0.2, 0.08, 0.03):
        chosen = choose_model(light, model, rms_error=asked)
        found = chosen.check(n=4096)
        assert chosen.diffuse_l_max is not None
        assert (
            abs(found.rms - chosen.predicted_rms_error)
            < 0.05 * asked + 4 * found.standard_error
        )


def test_not_met_is_said_and_the_best_is_given(rng, dtype):
    light = smooth_light(rng, dtype)
    model = brdf.gaussian_microfacet(0.3)
    max_bytes = 6_250 * light.dtype.itemsize
    tight = choose_model(light, model, rms_error=0.01, max_bytes=max_bytes)
    assert not tight.met
    assert tight.bytes <= max_bytes
    assert tight.predicted_rms_error > 0.01
    assert "NOT MET" in tight.message
    loose = choose_model(
        light, model, rms_error=tight.predicted_rms_error * 1.0001, max_bytes=max_bytes
    )
    assert loose.met
    with pytest.raises(ValueError, match="max_bytes must be enough"):
        choose_model(light, model, rms_error=0.1, max_bytes=10)
    with pytest.raises(ValueError, match="rms_error must be positive"):
        choose_model(light, model, rms_error=0.0)
    short = brdf_energies(brdf.phong(9.0), l_max=4, p_max=1)
    with pytest.raises(ValueError, match="energies must reach the light's degree 12"):
        choose_model(light, brdf.phong(9.0), rms_error=0.1, energies=short)
    with pytest.raises(ValueError, match="number of channels"):
        choose_model(light, brdf.phong(np.ones(2)), rms_error=0.1)


@pytest.mark.usefixtures("as_a_user")
def test_what_is_no_light_is_refused(dtype):
    for wrong in (np.ones((2, 9, 3), dtype), np.full((9, 3), np.nan, dtype)):
        with pytest.raises(ValueError, match="environment map or finite coefficients"):
            choose_model(wrong, brdf.phong(9.0), rms_error=0.1)


def test_hard_lights(dtype):
    black = choose_model(jnp.zeros((9, 3), dtype), brdf.phong(9.0), rms_error=0.1)
    assert black.met
    assert black.check(n=64).rms == 0
    single = choose_model(jnp.ones((1, 1), dtype), brdf.ggx(0.5, 0.5), rms_error=0.1)
    assert single.met
    assert single.l_max == 0


def sun_panorama(rows=64, radius=2.5, strength=5000.0):
    """A grey sky, brighter above, and a round sun."""
    directions = latlong_directions(rows, 2 * rows)
    axis = spherical_directions(np.array(0.9), np.array(2.0))
    sky = np.broadcast_to((1 + 0.3 * directions[..., 2:]), (*directions.shape[:2], 3))
    inside = directions @ axis > np.cos(np.radians(radius))
    colour = strength * np.array([1.0, 0.8, 0.5])
    return make_envmap((sky + inside[..., None] * colour).astype(np.float32)), axis


def test_a_sun_is_split_off_and_nothing_else(rng):
    envmap, axis = sun_panorama(128)
    lights, rest = split_lights(envmap)
    assert len(lights.heights) == 1
    assert (
        np.degrees(np.arccos(np.clip(np.asarray(lights.directions)[0] @ axis, -1, 1)))
        < 0.3
    )
    assert np.degrees(lights.angles[0]) == pytest.approx(2.5, abs=0.6)
    np.testing.assert_allclose(
        lights.radiance[0] / lights.radiance[0, 0], [1, 0.8, 0.5], rtol=0.01
    )
    areas = latlong_solid_angles(128, 256)[:, None, None]
    before, after = (
        np.sum(np.asarray(e.radiance, float) * areas, axis=(0, 1))
        for e in (envmap, rest)
    )
    np.testing.assert_allclose(
        after + np.asarray(lights.flux).sum(axis=0), before, rtol=1e-5
    )
    assert np.max(np.asarray(rest.radiance)) < 3
    again, _ = split_lights(envmap)
    np.testing.assert_array_equal(again.directions, lights.directions)
    for plain in (
        np.ones((32, 64, 3)),
        rng.uniform(0.5, 1.5, (32, 64, 3)),
        np.zeros((8, 16, 1)),
    ):
        lights, rest = split_lights(make_envmap(plain.astype(np.float32)))
        assert len(lights.heights) == 0
        np.testing.assert_array_equal(rest.radiance, plain.astype(np.float32))
    wide, _ = split_lights(sun_panorama(128, radius=8.0)[0])
    assert len(wide.heights) == 0


def test_flux_is_conserved_on_panoramas(data):
    for name in PANORAMAS[:8]:
        envmap = io.read_envmap(data / "hdri" / name).to_latlong(128)
        lights, rest = split_lights(envmap)
        areas = latlong_solid_angles(128, 256)[:, None, None]
        before, after = (
            np.sum(np.asarray(e.radiance, float) * areas, axis=(0, 1))
            for e in (envmap, rest)
        )
        np.testing.assert_allclose(
            after + np.asarray(lights.flux).sum(axis=0), before, rtol=1e-5
        )


@pytest.mark.x64
def test_cap_coefficients_and_shading_are_the_integral(rng):
    gamma = np.radians(20.0)
    axis = unit_vectors(rng, 1)
    height = 1 - np.cos(gamma)
    flux = 2 * np.pi * height * np.array([[2.0, 3.0]])
    lights = CapLights(jnp.asarray(axis), jnp.asarray([height]), jnp.asarray(flux))
    coefs = cap_coefs(lights, l_max=6)
    x, w = np.polynomial.legendre.leggauss(40)
    height = 1 - (1 - np.cos(gamma)) * (1 + x) / 2
    phi = 2 * np.pi * (np.arange(80) + 0.5) / 80
    local = spherical_directions(np.arccos(height)[:, None], phi).reshape(-1, 3)
    frame = np.asarray(shjax.vectors.frames(jnp.asarray(axis)))[0]
    weights = np.repeat(w * (1 - np.cos(gamma)) / 2, 80) * 2 * np.pi / 80
    towards = jnp.asarray(local @ frame)
    exact = shjax.project_samples(
        jnp.asarray(np.tile([2.0, 3.0], (3200, 1))),
        towards,
        jnp.asarray(weights),
        l_max=6,
    )
    assert relative_error(coefs, exact) < 1e-12
    np.testing.assert_allclose(np.sum(weights) * np.array([2.0, 3.0]), lights.flux[0])
    normals = jnp.asarray(unit_vectors(rng, 30))
    views = shjax.vectors.normalize(normals + 0.4 * jnp.asarray(unit_vectors(rng, 30)))
    model = brdf.lambertian(0.3) + brdf.ggx(0.5, 0.2)
    samples = (np.tile([2.0, 3.0], (3200, 1)), towards, weights)
    samples = [jnp.asarray(a) for a in samples]
    exact = shjax.reference_reflection(
        shjax.EnvironmentMap.from_samples(*samples),
        model,
        normals,
        views,
    )
    lit = np.asarray(normals) @ axis[0] > np.sin(gamma) + 0.05
    found = cap_reflection(lights, model, normals, views)
    assert np.sum(lit) > 5
    assert relative_error(found[lit], exact[lit]) < 2e-3
    check_gradients(
        lambda d, r, a: cap_reflection(
            CapLights(shjax.vectors.normalize(d), lights.heights, r),
            brdf.ggx(a, 0.2),
            normals[lit],
            views[lit],
            rings=10,  # else one program for each rule, chosen by the traced alpha
        ),
        lights.directions,
        lights.flux,
        jnp.asarray(0.5),
        tolerance=1e-6,
    )


@pytest.mark.slow
def test_the_split_helps_where_there_is_a_sun():
    envmap, _ = sun_panorama(128)
    model = brdf.gaussian_microfacet(0.2)
    # A radial map is read sooner than a light is shaded.
    assert choose_model(envmap, brdf.phong(8.0), rms_error=0.1).lights is None
    chosen = choose_model(envmap, model, rms_error=0.03)
    assert chosen.lights is not None
    assert "shaded exactly" in chosen.message
    whole = choose_model(light_coefs(envmap), model, rms_error=0.03)
    assert whole.lights is None
    assert chosen.bytes < whole.bytes / 10
    found = chosen.check(envmap)
    assert found.rms < 0.032 + 3 * found.standard_error


@pytest.mark.slow
def test_only_lights_that_count_are_split_off():
    strong, _ = sun_panorama()
    rows = strong.radiance.shape[0]
    axis = spherical_directions(np.array(1.2), np.array(-1.0))
    inside = latlong_directions(rows, 2 * rows) @ axis > np.cos(np.radians(2.5))
    # A twentieth of the other's radiance: found, though it hardly matters.
    both = make_envmap(
        np.asarray(strong.radiance) + 250 * inside[..., None].astype(np.float32)
    )
    light = prepare_light(both)
    assert light.rest.shape[0] == len(light.lights.heights) == 2
    assert light.lights.flux[0, 0] > 10 * light.lights.flux[1, 0]
    later = cap_coefs(jax.tree.map(lambda a: a[1:], light.lights), l_max=100)
    assert relative_error(light.rest[0] - light.rest[1], later) < 1e-4
    model = brdf.ggx(0.2, 1.0)
    known = brdf_energies(model)
    counts = []
    for asked in (0.3, 0.01):
        chosen = choose_model(light, model, rms_error=asked, energies=known)
        counts.append(len(chosen.lights.heights))
        found = chosen.check(both)
        assert found.rms < 1.02 * asked + 3 * found.standard_error + 0.02
    assert counts == [1, 2]


@pytest.mark.slow
def test_a_sun_stays_where_its_map_is_read_faster():
    """With the sun apart the map would be smaller, and the model slower."""
    envmap, _ = sun_panorama()
    chosen = choose_model(envmap, brdf.phong(8.0), rms_error=0.05)
    assert chosen.met
    assert (chosen.label, chosen.lights) == ("radial", None)


def test_a_model_is_a_pytree_and_differentiable(rng, dtype):
    light = smooth_light(rng, dtype, 4)
    chosen = choose_model(light, brdf.lambertian(0.5) + brdf.phong(6.0), rms_error=0.05)
    normals = jnp.asarray(unit_vectors(rng, 6), dtype)
    read = jax.jit(lambda m, n: m.radiance(n, n))
    assert (
        relative_error(read(chosen, normals), chosen.radiance(normals, normals)) < 1e-5
    )
    gradient = jax.grad(lambda n: jnp.sum(read(chosen, n)))(normals)
    assert np.all(np.isfinite(np.asarray(gradient)))
    fibres = choose_model(light, brdf.kajiya_kay(8.0), rms_error=0.1)
    with pytest.raises(ValueError, match="tangents must be given"):
        fibres.radiance(normals, normals)
