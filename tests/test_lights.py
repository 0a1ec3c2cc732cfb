"""Analytic lights as coefficients and as shading: against the integral."""

import jax.numpy as jnp
import numpy as np
import pytest

import shjax
from shjax import brdf, lights
from shjax.sphere import latlong_directions, latlong_solid_angles
from shjax.vectors import normalize
from tests.helpers import check_gradients, relative_error, unit_vectors


def test_a_hemisphere_is_its_pixels(rng, dtype):
    """Sky and ground about z: coefficients and shading of every kind of BRDF."""
    sky = np.zeros((256, 512, 2))
    sky[:128], sky[128:] = [2.0, 1.0], [0.5, 0.25]
    both = lights.hemisphere_light(
        jnp.asarray([0.0, 0, 2.0], dtype),
        *(jnp.asarray(a, dtype) for a in ([2.0, 1.0], [0.5, 0.25])),
    )
    coefs = lights.cap_coefs(both, l_max=9)
    exact = shjax.analyze(jnp.asarray(sky, dtype), l_max=9, quadrature="pixel")
    assert relative_error(coefs, exact) < 1e-5
    normals = jnp.asarray(unit_vectors(rng, 8), dtype)
    views = normalize(normals + 0.5 * jnp.asarray(unit_vectors(rng, 8), dtype))
    for model in (brdf.lambertian(0.5), brdf.ggx(0.3, 0.04), brdf.phong_cosine(20.0)):
        found = lights.cap_reflection(both, model, normals, views)
        truth = shjax.reference_reflection(
            jnp.asarray(sky, dtype), model, normals, views
        )
        assert relative_error(found, truth) < 3e-3


def test_a_direction_is_the_brdf_itself(rng, dtype):
    toward = jnp.asarray(unit_vectors(rng, 1)[0], dtype)
    light = lights.directional_light(3 * toward, jnp.asarray([2.0, 1.0, 0.5], dtype))
    assert (
        relative_error(
            lights.cap_coefs(light, l_max=30),
            shjax.basis(toward, l_max=30)[:, None]
            * jnp.asarray([[2.0, 1.0, 0.5]], dtype),
        )
        < 1e-5
    )
    normals = normalize(toward[None] + 0.5 * jnp.asarray(unit_vectors(rng, 5), dtype))
    views = normalize(normals + 0.5 * jnp.asarray(unit_vectors(rng, 5), dtype))
    model = brdf.ggx(0.2, 0.5)
    each = brdf.transfer(model, normals, jnp.broadcast_to(toward, normals.shape), views)
    found = lights.cap_reflection(light, model, normals, views)
    assert relative_error(found, each * jnp.asarray([[2.0, 1.0, 0.5]], dtype)) < 1e-4


def test_small_caps_keep_their_digits(dtype):
    """A cap of 1e-4 radians: P_l falls by l (l + 1) h / 4."""
    height = 2 * np.sin(5e-5) ** 2
    gains = lights.cap_gains(jnp.asarray([height], dtype), l_max=200)[0]
    l = np.arange(201)
    np.testing.assert_allclose(gains, 1 - l * (l + 1) * height / 4, atol=2e-6)
    whole = lights.cap_gains(jnp.asarray([2.0], dtype), l_max=4)[0]
    np.testing.assert_allclose(whole, [1, 0, 0, 0, 0], atol=1e-6)


@pytest.mark.x64
def test_gradients_of_coefficients(rng):
    direction = jnp.asarray(unit_vectors(rng, 2))
    check_gradients(
        lambda d, h, f: lights.cap_coefs(lights.CapLights(normalize(d), h, f), l_max=8),
        direction,
        jnp.asarray([0.3, 0.05]),
        jnp.asarray([[1.0, 2.0], [0.5, 3.0]]),
    )


def test_splitting_many_and_at_the_pole(dtype):
    """Two suns, one at the zenith over all columns: both found, flux kept."""
    directions = latlong_directions(128, 256)
    solid = latlong_solid_angles(128, 256)[:, None]
    image = np.ones((128, 256, 3))
    axis = np.array([0.6, 0.0, 0.8])
    image[0] = 5000.0
    image[directions @ axis > np.cos(np.radians(1.5))] = 3000.0
    found, rest = lights.split_lights(shjax.make_envmap(image.astype(np.float32)))
    assert found.flux.shape == (2, 3)
    for toward in (axis, [0, 0, 1.0]):
        assert np.max(np.asarray(found.directions) @ np.asarray(toward)) > np.cos(0.01)
    kept = np.asarray(found.flux, float).sum(0) + np.sum(
        np.asarray(rest.radiance, float) * solid[..., None], (0, 1)
    )
    np.testing.assert_allclose(
        kept, np.sum(image * solid[..., None], (0, 1)), rtol=1e-5
    )


def test_what_is_refused(dtype):
    up = jnp.asarray([0.0, 0, 1], dtype)
    with pytest.raises(ValueError, match=r"angle must lie in \(0, pi\]; got 0"):
        lights.cap_light(up, 0.0, jnp.ones(3, dtype))
    light = lights.cap_light(up, 0.1, jnp.ones(3, dtype))
    with pytest.raises(ValueError, match="rings must be an integer, positive; got 0"):
        lights.cap_reflection(light, brdf.phong(3.0), up[None], up[None], rings=0)
