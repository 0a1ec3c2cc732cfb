"""Power, products and windows."""

import jax.numpy as jnp
import numpy as np
import pytest

import shjax
import shjax.harmonics
from shjax import windows
from shjax.sphere import fibonacci_directions
from tests.helpers import check_gradients, relative_error, rotation_matrix, unit_vectors

# Which of the eleven panoramas ring at nine coefficients, in one channel at least.
PANORAMAS = {
    "city.exr": False,
    "courtyard.exr": False,
    "forest.exr": False,
    "interior.exr": False,
    "night.exr": False,
    "studio.exr": False,
    "sunrise.exr": True,
    "sunset.exr": False,
    "potsdamer_platz_1k.hdr": False,
    "rooitou_park_1k.hdr": True,  # in one channel; its luminance does not
    "studio_small_03_1k.hdr": True,
}


def test_power_is_the_sum_over_orders(rng, dtype):
    coefs = rng.normal(size=(2, 16, 3))
    power = np.asarray(shjax.power_spectrum(jnp.asarray(coefs, dtype)))
    assert power.shape == (2, 4, 3)
    for l in range(4):
        expected = np.sum(coefs[:, l * l : (l + 1) ** 2] ** 2, axis=1)
        np.testing.assert_allclose(power[:, l], expected, rtol=1e-5)


def test_power_does_not_change_under_rotation(rng, dtype):
    coefs = jnp.asarray(rng.normal(size=(25, 1)), dtype)
    turned = shjax.power_spectrum(shjax.rotate(coefs, rotation_matrix(rng)))
    assert (
        relative_error(turned, shjax.power_spectrum(coefs)) < 50 * np.finfo(dtype).eps
    )


@pytest.mark.parametrize("degrees", [(0, 0), (2, 3), (5, 1)])
def test_product_is_the_product_at_points(degrees, rng, dtype):
    first, second = (
        jnp.asarray(rng.normal(size=((l + 1) ** 2, 2)), dtype) for l in degrees
    )
    product = shjax.multiply(first, second)
    assert product.shape == ((sum(degrees) + 1) ** 2, 2)
    points = jnp.asarray(unit_vectors(rng, 40), dtype)
    truth = shjax.evaluate(first, points) * shjax.evaluate(second, points)
    assert (
        relative_error(shjax.evaluate(product, points), truth)
        < 100 * np.finfo(dtype).eps
    )


def test_product_of_two_known_functions(dtype):
    # z times z is (1 + (3 z^2 - 1)) / 3.
    z = jnp.zeros((4, 1), dtype).at[2].set(np.sqrt(4 * np.pi / 3))
    expected = np.zeros((9, 1))
    expected[0], expected[6] = np.sqrt(4 * np.pi) / 3, np.sqrt(16 * np.pi / 5) / 3
    product = np.asarray(shjax.multiply(z, z))
    np.testing.assert_allclose(product, expected, atol=10 * np.finfo(dtype).eps)


@pytest.mark.usefixtures("as_a_user")
def test_products_that_do_not_fit_are_refused():
    with pytest.raises(ValueError, match="same batch and channels"):
        shjax.multiply(np.ones((4, 3)), np.ones((4, 1)))


@pytest.mark.x64
def test_gradients(rng):
    first, second = (jnp.asarray(rng.normal(size=(k, 2))) for k in (9, 4))
    check_gradients(shjax.multiply, first, second)
    check_gradients(shjax.power_spectrum, first)


def test_windows_are_their_formulas():
    l = np.arange(5)
    np.testing.assert_allclose(shjax.window("none", 4), 1)
    np.testing.assert_allclose(
        shjax.window("hann", 4), (1 + np.cos(np.pi * l / 5)) / 2, atol=1e-6
    )
    np.testing.assert_allclose(shjax.window("lanczos", 4), np.sinc(l / 5), atol=1e-6)
    wide = np.asarray(shjax.window("sinc^4", 4, width=3.0))
    np.testing.assert_allclose(wide, np.where(l < 3, np.sinc(l / 3) ** 4, 0), atol=1e-6)


def test_cmgens_window_at_its_measured_width():
    # Measured on cmgen's default output: 0.96036 at l = 1 and 0.84978 at l = 2.
    gains = np.asarray(shjax.window("sinc^4", 2, width=12.77))
    np.testing.assert_allclose(gains, [1, 0.96036, 0.84978], atol=2e-4)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: shjax.window("box", 2), "name must be one of"),
        (lambda: shjax.window("hann", -1), "l_max"),
        (lambda: shjax.window("hann", 2, width=0.0), "width must be positive"),
        (lambda: shjax.dering(-np.ones((9, 1), np.float32)), "mean > 0"),
    ],
)
def test_wrong_windows_are_refused(call, words):
    with pytest.raises(ValueError, match=words):
        call()


def point_light(l_max, dtype=np.float32):
    """A light in one direction: rings as much as anything can."""
    direction = np.array([[0.36, -0.48, 0.8]], dtype)
    return jnp.asarray(np.asarray(shjax.basis(direction, l_max=l_max)).T)


@pytest.mark.parametrize("l_max", [2, 4])
def test_smallest_irradiance_is_found(l_max, rng, dtype):
    lighting = jnp.asarray(rng.normal(size=((l_max + 1) ** 2, 2)), dtype).at[0].set(4)
    dense = shjax.irradiance(
        lighting, jnp.asarray(fibonacci_directions(200_000), dtype)
    )
    mean = np.asarray(lighting[0]) * np.sqrt(np.pi / 4)
    expected = np.min(np.asarray(dense).min(axis=0) / mean)
    assert float(windows.smallest_irradiance(lighting)) == pytest.approx(
        expected, abs=2e-5
    )


@pytest.mark.parametrize("l_max", [2, 4])
def test_deringing_is_the_least_that_helps(l_max):
    light = point_light(l_max)
    assert float(windows.smallest_irradiance(light)) < -0.01
    result = shjax.dering(light)
    assert -1e-5 < result.smallest < 1e-3
    weaker = (
        light * shjax.harmonics.spread(1 / (1 + 0.95 * (1 / result.gains - 1)))[:, None]
    )
    assert float(windows.smallest_irradiance(weaker)) < 0
    assert result.gains[0] == 1


@pytest.mark.parametrize("name", PANORAMAS)
def test_the_panoramas_that_ring(data, name):
    lighting = shjax.io.read_envmap(data / "hdri" / name).lighting(l_max=2)
    result = shjax.dering(lighting)
    assert (result.strength > 0) == PANORAMAS[name]
    if not PANORAMAS[name]:
        np.testing.assert_array_equal(result.lighting, lighting)
    else:
        assert -1e-5 < result.smallest < 1e-3
        weaker = 1 / (1 + 0.95 * (1 / np.asarray(result.gains) - 1))
        weaker = (
            lighting
            * shjax.harmonics.spread(jnp.asarray(weaker, lighting.dtype))[:, None]
        )
        assert float(windows.smallest_irradiance(weaker)) < 0


def test_a_window_by_name(dtype):
    light = jnp.asarray(point_light(2), dtype)
    for name in windows.NAMES:
        windowed = windows.apply_window(light, name)
        assert windowed.shape == light.shape
        assert np.array_equal(windowed, light) == (name == "none")
