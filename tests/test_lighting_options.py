"""Albedo, exposure and sign of the light, where they are not known."""

import jax.numpy as jnp
import numpy as np
import pytest

import shjax
import shjax.sphere
from shjax.harmonics.degrees import degrees
from shjax.inverse import estimate_albedo, estimate_exposure, nonnegative
from shjax.inverse.nonnegative import smooth_radiance
from tests.helpers import check_gradients, relative_error, unit_vectors


def pictures(rng, lights, normals):
    """Radiance of a white matte surface by the polynomial in the normal."""
    return (
        np.stack(
            [
                np.asarray(
                    shjax.irradiance_polynomial(jnp.asarray(l), jnp.asarray(normals))
                )
                for l in lights
            ]
        )
        / np.pi
    )


def lights_of(rng, count, channels=3):
    lights = 0.4 * rng.normal(size=(count, 9, channels))
    lights[:, 0] += 4
    return lights


def front(rng, count):
    normals = unit_vectors(rng, count)
    normals[:, 0] = np.abs(normals[:, 0])
    return normals


@pytest.mark.slow
@pytest.mark.x64
def test_unknown_albedo_from_several_lights(rng):
    normals, lights = front(rng, 800), lights_of(rng, 4)
    albedo = rng.uniform(0.2, 0.9, (800, 3))
    albedo /= albedo.mean(axis=0)
    image = pictures(rng, lights, normals) * albedo
    found = estimate_albedo(image, normals, prior=None)
    assert found.lighting.value.shape == (9, 12)
    assert found.albedo.shape == (800, 3)
    assert relative_error(found.albedo, albedo) < 1e-6
    assert (
        relative_error(found.lighting.value, np.moveaxis(lights, 0, 1).reshape(9, 12))
        < 1e-6
    )
    noisy = image + 0.01 * rng.normal(size=image.shape)
    found = estimate_albedo(noisy, normals, prior=None)
    assert relative_error(found.albedo, albedo) < 0.02


@pytest.mark.usefixtures("as_a_user")
def test_unknown_albedo_needs_several_lights(rng):
    normals = front(rng, 50)
    with pytest.raises(ValueError, match="of V >= 2 lights"):
        estimate_albedo(np.ones((1, 50, 3)), normals)
    with pytest.raises(ValueError, match="normals must have shape"):
        estimate_albedo(np.ones((2, 40, 3)), normals)


@pytest.mark.x64
@pytest.mark.parametrize("prior", [None, "picture"])
def test_exposure_and_white_balance_of_several_pictures(rng, prior):
    light = lights_of(rng, 1)[0]
    normals = np.stack(
        [front(rng, 300), unit_vectors(rng, 300), unit_vectors(rng, 300)]
    )
    gains = np.array([[1.0, 1, 1], [2.5, 2.0, 1.5], [0.4, 0.5, 0.7]])
    image = np.stack([pictures(rng, [light], n)[0] for n in normals])
    image = image * gains[:, None] + 0.003 * rng.normal(size=image.shape)
    found = estimate_exposure(image, normals, prior=prior)
    assert found.lighting.converged
    np.testing.assert_allclose(found.gains, gains, rtol=3e-3)
    assert relative_error(found.lighting.value, light) < 5e-3
    assert float(np.max(found.lighting.residual_norm)) < 0.004 * np.sqrt(900)
    with pytest.raises(ValueError, match="images must have shape"):
        estimate_exposure(image[0], normals[0])


@pytest.mark.slow
@pytest.mark.x64
def test_gradient_through_the_balance(rng):
    light = lights_of(rng, 1, 1)[0]
    normals = jnp.asarray(np.stack([unit_vectors(rng, 40), unit_vectors(rng, 40)]))
    image = np.stack([pictures(rng, [light], n)[0] for n in np.asarray(normals)])
    image = jnp.asarray(image * np.array([1, 2.0])[:, None, None])
    image = image + 0.05 * rng.normal(size=image.shape)
    check_gradients(
        lambda i: estimate_exposure(i, normals, prior=None).lighting.value,
        image,
        tolerance=1e-6,
        transpose=1e-8,
    )


@pytest.mark.x64
def test_light_that_is_nowhere_negative(rng):
    """One lamp behind the seen half: the free answer has dark light, this one has none."""
    normals = front(rng, 400)
    lamp = np.array([-0.5, 0.6, 0.62])
    lamp /= np.linalg.norm(lamp)
    light = np.asarray(shjax.basis(jnp.asarray(lamp), l_max=10))[:, None]
    image = np.asarray(
        shjax.irradiance(jnp.asarray(light), jnp.asarray(normals)) / np.pi
    )
    image = image + 0.02 * rng.normal(size=image.shape)
    free = shjax.estimate_lighting(image, normals)
    held = nonnegative(free)
    table = np.asarray(smooth_radiance(10))
    assert (table @ np.asarray(light)).min() > -1e-12  # a lamp satisfies it
    darkest = [float((table @ np.asarray(e.full_value)).min()) for e in (free, held)]
    level = float(held.value[0, 0])
    assert darkest[0] < -0.02 * level
    assert darkest[1] > -0.003 * level
    assert held.converged
    # Not nearer to the truth in every picture: the constraint adds no information here.
    assert relative_error(held.value, light[:9]) < 0.3


@pytest.mark.x64
def test_positive_light_is_left_as_it_is(rng):
    normals, light = unit_vectors(rng, 300), lights_of(rng, 1)[0] * 0.3
    light[0] = 4
    image = pictures(rng, [light], normals)[0]
    free = shjax.estimate_lighting(image, normals, prior=None)
    held = nonnegative(free)
    assert relative_error(held.value, free.value) < 1e-6


def test_the_kernel_is_not_negative():
    cosine = np.linspace(-1, 1, 101)
    table = np.asarray(smooth_radiance(6))
    assert table.shape == (196, 49)
    gains = [1.0]
    for l in range(1, 7):
        gains.append(gains[-1] * (6 - l + 1) / (6 + l + 1))
    legendre = np.polynomial.legendre.Legendre(
        (2 * np.arange(7) + 1) / (4 * np.pi) * np.array(gains)
    )
    exact = 7 / (4 * np.pi) * ((1 + cosine) / 2) ** 6
    np.testing.assert_allclose(legendre(cosine), exact, atol=1e-12)
    np.testing.assert_allclose(
        table[:, 1] / table[:, 0] / np.sqrt(3) / (6 / 8),
        shjax.sphere.fibonacci_directions(196)[:, 1],
        atol=1e-6,
    )
    assert degrees(6)[-1] == 6
