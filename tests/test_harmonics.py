"""Basis, transforms and rotation against scipy, exact quadrature and known functions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import sph_harm_y

import shjax
import shjax.harmonics
from shjax.harmonics import degrees as layout
from shjax.harmonics.grid import Grid, make_grid
from shjax.sphere import latlong_directions
from tests.helpers import check_gradients, relative_error, unit_vectors


def scipy_basis(directions, l_max):
    """The same basis from scipy's complex one, which has the Condon-Shortley phase."""
    x, y, z = np.moveaxis(directions, -1, 0)
    theta, phi = np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)
    columns = []
    for l in range(l_max + 1):
        for m in range(-l, l + 1):
            value = sph_harm_y(l, abs(m), theta, phi) * (-1) ** m
            if m < 0:
                columns.append(np.sqrt(2) * value.imag)
            elif m == 0:
                columns.append(value.real)
            else:
                columns.append(np.sqrt(2) * value.real)
    return np.stack(columns, axis=-1)


def test_first_nine_are_the_papers(rng, dtype):
    d = unit_vectors(rng, 20)
    x, y, z = d.T
    paper = np.stack(
        [
            np.full_like(x, 0.282095),
            0.488603 * y,
            0.488603 * z,
            0.488603 * x,
            1.092548 * x * y,
            1.092548 * y * z,
            0.315392 * (3 * z * z - 1),
            1.092548 * x * z,
            0.546274 * (x * x - y * y),
        ],
        axis=-1,
    )
    ours = shjax.basis(jnp.asarray(d, dtype), l_max=2)
    np.testing.assert_allclose(ours, paper, atol=1e-6)


@pytest.mark.parametrize("l_max", [0, 1, 2, 8, 9, 40])
def test_basis_equals_scipy(l_max, rng, dtype):
    poles = np.array([[0, 0, 1.0], [0, 0, -1.0]])
    d = np.concatenate([unit_vectors(rng, 300), poles])
    ours = np.asarray(shjax.basis(jnp.asarray(d, dtype), l_max=l_max))
    truth = scipy_basis(d, l_max)
    # The input's own rounding moves a function of degree l by l^2 / 2 times eps.
    atol = (100 + l_max**2) * np.finfo(dtype).eps
    np.testing.assert_allclose(ours, truth, atol=atol)


def test_basis_is_orthonormal(dtype):
    grid = Grid(17, 17)
    nodes = jnp.asarray(latlong_directions(17, 17).reshape(-1, 3), dtype)
    values = np.asarray(shjax.basis(nodes, l_max=8), float)
    gram = values.T @ (values * np.repeat(grid.weights, 17)[:, None])
    np.testing.assert_allclose(gram, np.eye(81), atol=100 * np.finfo(dtype).eps)


def test_addition_theorem(rng, dtype):
    values = np.asarray(shjax.basis(jnp.asarray(unit_vectors(rng, 40), dtype), l_max=6))
    for l in range(7):
        sums = np.sum(values[:, l * l : (l + 1) ** 2] ** 2, axis=-1)
        expected = (2 * l + 1) / (4 * np.pi)
        np.testing.assert_allclose(sums, expected, rtol=200 * np.finfo(dtype).eps)


@pytest.mark.parametrize("n", [1, 2, 3, 8, 17])
@pytest.mark.parametrize(
    ("quadrature", "exact_to"),
    [
        ("fejer", lambda n: n),
        ("clenshaw-curtis", lambda n: n),
        ("gauss-legendre", lambda n: 2 * n),
    ],
)
def test_quadratures_are_exact_below_their_degree(quadrature, exact_to, n):
    grid = make_grid(n, 1, quadrature)
    z, weights = np.cos(grid.theta), grid.weights / (2 * np.pi)
    assert np.all(np.diff(z) < 0)  # north first
    for power in range(exact_to(n)):
        exact = 0 if power % 2 else 2 / (power + 1)
        assert weights @ z**power == pytest.approx(exact, abs=5e-15)


def test_gauss_legendre_is_numpys():
    grid = make_grid(20, 1, "gauss-legendre")
    z, weights = np.polynomial.legendre.leggauss(20)
    np.testing.assert_allclose(np.cos(grid.theta)[::-1], z, atol=1e-15)
    np.testing.assert_allclose(grid.weights[::-1] / (2 * np.pi), weights, rtol=1e-12)


@pytest.mark.parametrize("size", [(7, 7), (8, 9), (31, 8), (16, 32)])
@pytest.mark.parametrize("l_max", [0, 1, 2, 3])
def test_analyze_equals_the_sum_over_pixels(size, l_max, rng, dtype):
    radiance = rng.normal(size=(*size, 2)) + 1
    nodes = latlong_directions(*size)
    values = scipy_basis(nodes, l_max)
    weights = Grid(*size).weights
    truth = np.einsum("hwk,h,hwc->kc", values, weights, radiance)
    ours = shjax.analyze(jnp.asarray(radiance, dtype), l_max=l_max)
    assert ours.dtype == dtype
    assert relative_error(ours, truth) < 20 * np.finfo(dtype).eps


def test_analyze_of_a_known_polynomial(dtype):
    # 1 + z + x y: coefficients from the norms of the basis, in closed form.
    x, y, z = np.moveaxis(latlong_directions(9, 11), -1, 0)
    radiance = jnp.asarray((1 + z + x * y)[..., None], dtype)
    expected = np.zeros((9, 1))
    expected[0] = np.sqrt(4 * np.pi)
    expected[2] = np.sqrt(4 * np.pi / 3)
    expected[4] = np.sqrt(4 * np.pi / 15)
    ours = np.asarray(shjax.analyze(radiance, l_max=2))
    np.testing.assert_allclose(ours, expected, atol=20 * np.finfo(dtype).eps)


@pytest.mark.parametrize("l_max", [0, 1, 2, 5, 6])
def test_synthesize_equals_evaluate(l_max, rng, dtype):
    coefs = jnp.asarray(rng.normal(size=((l_max + 1) ** 2, 3)), dtype)
    image = shjax.synthesize(coefs, n_theta=13, n_phi=14)
    points = shjax.evaluate(coefs, jnp.asarray(latlong_directions(13, 14), dtype))
    assert relative_error(image, points) < 50 * np.finfo(dtype).eps


def test_project_samples_equals_analyze(rng, dtype):
    radiance = jnp.asarray(rng.uniform(size=(8, 16, 3)), dtype)
    directions = jnp.asarray(latlong_directions(8, 16).reshape(-1, 3), dtype)
    weights = jnp.asarray(np.repeat(Grid(8, 16).weights, 16), dtype)
    one = shjax.project_samples(radiance.reshape(-1, 3), directions, weights, l_max=2)
    assert (
        relative_error(one, shjax.analyze(radiance, l_max=2)) < 20 * np.finfo(dtype).eps
    )


def test_parseval(rng, dtype):
    coefs = rng.normal(size=(9, 1))
    image = np.asarray(shjax.synthesize(jnp.asarray(coefs, dtype), n_theta=9, n_phi=9))
    energy = np.sum(image[..., 0] ** 2 * Grid(9, 9).weights[:, None])
    assert energy == pytest.approx(
        np.sum(coefs**2), rel=50 * float(np.finfo(dtype).eps)
    )


def test_a_batch_is_a_loop(rng, dtype):
    radiance = jnp.asarray(rng.normal(size=(2, 3, 7, 8, 2)), dtype)
    whole = shjax.analyze(radiance, l_max=2)
    assert whole.shape == (2, 3, 9, 2)
    one = shjax.analyze(radiance[1, 2], l_max=2)
    assert relative_error(whole[1, 2], one) < 10 * np.finfo(dtype).eps
    back = shjax.synthesize(whole, n_theta=4, n_phi=5)
    assert back.shape == (2, 3, 4, 5, 2)
    single = shjax.synthesize(one, n_theta=4, n_phi=5)
    assert relative_error(back[1, 2], single) < 10 * np.finfo(dtype).eps


def test_an_empty_batch_is_empty(dtype):
    assert shjax.analyze(jnp.zeros((0, 5, 8, 3), dtype), l_max=2).shape == (0, 9, 3)
    coefs = jnp.zeros((0, 9, 3), dtype)
    assert shjax.synthesize(coefs, n_theta=2, n_phi=2).shape == (0, 2, 2, 3)
    assert shjax.evaluate(coefs, jnp.ones((4, 3), dtype)).shape == (0, 4, 3)
    many = jnp.zeros((0, 169, 3), dtype)
    assert shjax.evaluate(many, jnp.ones((4, 3), dtype)).shape == (0, 4, 3)


def test_evaluate_keeps_batch_then_points(rng, dtype):
    coefs = jnp.asarray(rng.normal(size=(2, 9, 3)), dtype)
    points = jnp.asarray(unit_vectors(rng, 20).reshape(4, 5, 3), dtype)
    values = shjax.evaluate(coefs, points)
    assert values.shape == (2, 4, 5, 3)
    one = shjax.evaluate(coefs[1], points[2, 3])
    assert relative_error(values[1, 2, 3], one) < 10 * np.finfo(dtype).eps


@pytest.mark.usefixtures("as_a_user")
def test_half_precision_is_widened_and_integers_refused():
    assert shjax.analyze(np.ones((5, 5, 1), np.float16), l_max=1).dtype == np.float32
    with pytest.raises(ValueError, match="floating-point numbers; got uint8"):
        shjax.analyze(np.ones((5, 5, 1), np.uint8), l_max=1)


@pytest.mark.usefixtures("as_a_user")
@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: shjax.analyze(np.ones((4, 8, 3)), l_max=2),
            "at least 2 l_max [+] 1 = 5",
        ),
        (lambda: shjax.analyze(np.ones((8, 4, 3)), l_max=2), "got 8 x 4"),
        (
            lambda: shjax.analyze(np.ones((8, 8)), l_max=2),
            r"\(..., n_theta, n_phi, C\)",
        ),
        (lambda: shjax.analyze(np.ones((8, 8, 1)), l_max=-1), "l_max must be"),
        (lambda: shjax.analyze(np.ones((8, 8, 1)), l_max=1.5), "l_max must be"),
        (lambda: shjax.analyze(np.ones((8, 8, 1)), l_max=1025), "at most 1024"),
        (lambda: shjax.wigner_d(2, np.ones(3)), "angle must be a number"),
        (lambda: shjax.synthesize(np.ones((8, 3)), n_theta=4, n_phi=4), r"\(8, 3\)"),
        (lambda: shjax.synthesize(np.ones((9, 3)), n_theta=0, n_phi=4), "positive"),
        (lambda: shjax.evaluate(np.ones((9, 3)), np.ones((4, 2))), r"\(..., 3\)"),
        (
            lambda: shjax.project_samples(
                np.ones((5, 1)), np.ones((4, 3)), np.ones(5), l_max=1
            ),
            r"directions must have shape \(5, 3\)",
        ),
    ],
)
def test_wrong_shapes_are_refused_by_name(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_spread_repeats_over_the_orders():
    gains = np.asarray(shjax.harmonics.spread(jnp.array([1.0, 2.0, 3.0])))
    assert gains.tolist() == [1, 2, 2, 2, 3, 3, 3, 3, 3]
    assert layout.degrees(3).shape == (16,)


@pytest.mark.x64
def test_gradients_of_the_transforms(rng):
    radiance = jnp.asarray(rng.normal(size=(7, 8, 2)))
    check_gradients(lambda r: shjax.analyze(r, l_max=2), radiance)
    coefs = jnp.asarray(rng.normal(size=(9, 2)))
    check_gradients(lambda c: shjax.synthesize(c, n_theta=6, n_phi=7), coefs)
    points = jnp.asarray(unit_vectors(rng, 6))
    check_gradients(shjax.evaluate, coefs, points)


@pytest.mark.x64
def test_gradients_at_the_poles_and_at_zero(rng):
    coefs = jnp.asarray(rng.normal(size=(9, 2)))
    points = jnp.asarray([[0, 0, 1.0], [0, 0, -1.0], [0, 0, 0.0]])
    check_gradients(shjax.evaluate, coefs, points)
    hessian = jax.jacfwd(jax.jacrev(lambda d: shjax.evaluate(coefs, d)))(points[0])
    assert np.all(np.isfinite(np.asarray(hessian)))
