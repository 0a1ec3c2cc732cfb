import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import eval_legendre

import shjax
from shjax.clamped_cosine import clamped_cosine_coefs, cosine_kernel_table
from shjax.colour import luminance
from shjax.reference.irradiance_integral import irradiance_error
from shjax.sphere import fibonacci_directions, latlong_directions
from tests.helpers import check_gradients, relative_error, unit_vectors


def test_kernel_is_the_integral_of_the_clamped_cosine():
    kernel = cosine_kernel_table(14)
    for l in range(15):
        integral = quad(lambda z, l=l: z * eval_legendre(l, z), 0, 1, epsabs=1e-14)[0]
        assert kernel[l] == pytest.approx(2 * math.pi * integral, abs=1e-13)


def test_kernel_is_the_papers_to_degree_1000():
    kernel = cosine_kernel_table(1000)
    assert np.all(np.isfinite(kernel))
    assert np.all(kernel[3::2] == 0)
    for l in (2, 10, 500, 1000):  # [RH01, Eq. 8] in logarithms
        log = math.lgamma(l + 1) - l * math.log(2) - 2 * math.lgamma(l / 2 + 1)
        paper = (-1) ** (l // 2 - 1) * 2 * math.pi * math.exp(log) / ((l + 2) * (l - 1))
        assert kernel[l] == pytest.approx(paper, rel=1e-10)


def test_kernel_in_the_default_type(dtype):
    kernel = shjax.cosine_kernel(3)
    assert kernel.dtype == dtype
    np.testing.assert_allclose(kernel, [np.pi, 2 * np.pi / 3, np.pi / 4, 0], rtol=1e-6)
    assert shjax.cosine_kernel(0).shape == (1,)


def test_order_two_holds_992_thousandths_of_the_energy():
    # The energy of max(cos t, 0) over the sphere is 2 pi / 3.
    coefs = np.asarray(clamped_cosine_coefs(2), float)
    assert np.sum(coefs**2) / (2 * np.pi / 3) == pytest.approx(0.9922, abs=5e-5)


def test_order_two_is_off_by_at_most_nine_percent():
    coefs = np.asarray(clamped_cosine_coefs(2), float)
    z = np.linspace(-1, 1, 20001)
    norms = np.sqrt((2 * np.arange(3) + 1) / (4 * np.pi))
    values = sum(
        c * n * eval_legendre(l, z) for l, (c, n) in enumerate(zip(coefs, norms))
    )
    assert np.abs(values - np.maximum(z, 0)).max() == pytest.approx(0.09375, abs=1e-6)


def test_constant_light_gives_pi(dtype):
    radiance = jnp.ones((16, 32, 3), dtype)
    normals = jnp.asarray(fibonacci_directions(50), dtype)
    for value in (
        shjax.irradiance(shjax.analyze(radiance, l_max=2), normals),
        shjax.reference_irradiance(jnp.ones((128, 256, 3), dtype), normals),
    ):
        np.testing.assert_allclose(value, np.pi, rtol=3e-4)


def test_matrix_constants_are_the_papers():
    unit = np.asarray(shjax.irradiance_matrix(jnp.eye(9)))  # a channel a coefficient
    assert unit[0, 0, 8] == pytest.approx(0.429043, abs=1e-6)  # c1 of L22
    assert unit[0, 3, 3] == pytest.approx(0.511664, abs=1e-6)  # c2 of L11
    assert unit[2, 2, 6] == pytest.approx(0.743125, abs=2e-6)  # c3 of L20
    assert unit[3, 3, 0] == pytest.approx(0.886227, abs=1e-6)  # c4 of L00
    assert unit[3, 3, 6] == pytest.approx(-0.247708, abs=1e-6)  # c5 of L20


def test_the_three_forms_are_equal(rng, dtype):
    lighting = jnp.asarray(rng.normal(size=(2, 9, 3)), dtype)
    normals = jnp.asarray(unit_vectors(rng, 24).reshape(4, 6, 3), dtype)
    convolved = shjax.irradiance(lighting, normals)
    polynomial = shjax.irradiance_polynomial(lighting, normals)
    matrix = shjax.irradiance_from_matrix(shjax.irradiance_matrix(lighting), normals)
    assert convolved.shape == (2, 4, 6, 3)
    assert relative_error(polynomial, convolved) < 10 * np.finfo(dtype).eps
    assert relative_error(matrix, convolved) < 10 * np.finfo(dtype).eps


def test_reference_is_the_plain_sum(monkeypatch, rng, dtype):
    radiance = rng.uniform(size=(5, 7, 2))
    directions = latlong_directions(5, 7).reshape(-1, 3)
    weights = rng.uniform(size=35)
    normals = unit_vectors(rng, 9).reshape(3, 3, 3)
    plain = np.zeros((3, 3, 2))
    for value, towards, weight in zip(radiance.reshape(-1, 2), directions, weights):
        plain += np.maximum(normals @ towards, 0)[..., None] * value * weight
    arrays = (radiance.reshape(-1, 2), directions, weights, normals)
    arrays = [jnp.asarray(a, dtype) for a in arrays]
    for tile, block in ((512, 1024), (4, 6)):
        monkeypatch.setattr("shjax.reference.irradiance_integral._TILE", tile)
        monkeypatch.setattr("shjax.reference.irradiance_integral._BLOCK", block)
        jax.clear_caches()
        light = shjax.EnvironmentMap.from_samples(*arrays[:3])
        ours = shjax.reference_irradiance(light, arrays[3])
        assert relative_error(ours, plain) < 20 * np.finfo(dtype).eps


def test_band_limited_light_equals_its_integral(rng, dtype):
    lighting = rng.normal(size=(16, 3))
    radiance = shjax.synthesize(jnp.asarray(lighting, dtype), n_theta=256, n_phi=512)
    normals = jnp.asarray(unit_vectors(rng, 40), dtype)
    expansion = shjax.irradiance(jnp.asarray(lighting, dtype), normals)
    assert (
        relative_error(shjax.reference_irradiance(radiance, normals), expansion) < 2e-5
    )


def test_worst_light_stays_within_the_bounds(dtype):
    # One bright pixel. The mean over the sphere of |order-2 cosine - cosine| is 3.067 %
    # by quadrature: the papers' "under 3 %" is a rounded bound.
    radiance = jnp.zeros((64, 128, 3), dtype).at[20, 30].set(1e5)
    error = irradiance_error(shjax.analyze(radiance, l_max=2), radiance)
    assert 0.09 < float(error["max"]) < 0.094
    assert float(error["mean"]) == pytest.approx(0.030674, rel=1e-3)


def test_black_light_has_no_error(dtype):
    dark = jnp.zeros((2, 4, 3), dtype)
    error = irradiance_error(jnp.zeros((9, 3), dtype), dark)
    assert float(error["max"]) == 0
    assert float(error["ringing"]) == 0


def test_luminance_of_white_is_one(dtype):
    assert float(luminance(jnp.ones(3, dtype))) == pytest.approx(1)
    assert float(luminance(jnp.ones(1, dtype))) == pytest.approx(1)
    assert float(luminance(jnp.array([0, 1, 0], dtype))) == pytest.approx(0.7152)


@pytest.mark.x64
def test_gradients(rng):
    lighting = jnp.asarray(rng.normal(size=(9, 2)))
    # A pole, the other one, the zero normal of an empty pixel, and some others.
    special = np.array([[0, 0, 1.0], [0, 0, -1.0], [0, 0, 0]])
    normals = jnp.asarray(np.concatenate([special, unit_vectors(rng, 4)]))
    check_gradients(shjax.irradiance, lighting, normals)
    check_gradients(shjax.irradiance_polynomial, lighting, normals)
    check_gradients(
        lambda light, n: shjax.irradiance_from_matrix(
            shjax.irradiance_matrix(light), n
        ),
        lighting,
        normals,
    )


@pytest.mark.x64
def test_gradients_of_the_reference(rng):
    radiance = jnp.asarray(rng.uniform(size=(6, 9, 2)))
    # Differences across the clamp's kink are second order: a wide enough margin.
    normals = jnp.asarray(unit_vectors(rng, 5))
    check_gradients(shjax.reference_irradiance, radiance, normals, tolerance=1e-6)
    zero = jnp.zeros((1, 3))
    gradient = np.asarray(shjax.reference_irradiance(radiance, zero))
    assert np.all(gradient == 0)


@pytest.mark.usefixtures("as_a_user")
@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: shjax.irradiance(np.ones((8, 3)), np.ones(3)),
            r"lighting must .*\(8, 3\)",
        ),
        (lambda: shjax.irradiance(np.ones((9, 3)), np.ones(2)), r"normals must"),
        (lambda: shjax.irradiance_matrix(np.ones((4, 3))), r"\(..., 9, C\)"),
        (lambda: shjax.irradiance_from_matrix(np.ones((4, 3)), np.ones(3)), "4, 4, C"),
        (lambda: shjax.irradiance_polynomial(np.ones((9, 3)), np.ones(4)), "normals"),
        (
            lambda: shjax.reference_irradiance(np.ones((9, 3)), np.ones(3)),
            "n_theta, n_phi",
        ),
        (lambda: shjax.cosine_kernel(-1), "l_max"),
    ],
)
def test_wrong_shapes_are_refused_by_name(call, message):
    with pytest.raises(ValueError, match=message):
        call()
