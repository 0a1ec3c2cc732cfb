"""Transforms at any degree, size, quadrature and batch, by both algorithms."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shjax
import shjax.sphere
from shjax.harmonics import (
    legendre,
    phi_first,
    tables,
    theta_first,
    transforms,
)
from shjax.harmonics.grid import QUADRATURES, make_grid
from shjax.sphere import latlong_directions
from tests.helpers import check_gradients, relative_error, unit_vectors

# Degree, rows, columns: odd and even, square and wide, folded and not.
SIZES = [(0, 1, 1), (1, 3, 4), (5, 11, 13), (13, 27, 40), (14, 30, 29), (30, 64, 100)]


@pytest.mark.parametrize(("l_max", "n_theta", "n_phi"), SIZES)
@pytest.mark.parametrize("quadrature", QUADRATURES)
def test_round_trip_of_band_limited_light(
    l_max, n_theta, n_phi, quadrature, rng, dtype
):
    coefs = jnp.asarray(rng.normal(size=((l_max + 1) ** 2, 2)), dtype)
    rings = {"n_theta": n_theta, "n_phi": n_phi, "quadrature": quadrature}
    image = shjax.synthesize(coefs, **rings)
    grid = make_grid(n_theta, n_phi, quadrature)
    theta = np.broadcast_to(grid.theta[:, None], (n_theta, n_phi))
    nodes = shjax.sphere.spherical_directions(theta, shjax.sphere.latlong_phi(n_phi))
    truth = shjax.evaluate(coefs, jnp.asarray(nodes, dtype))
    limit = 50 * (1 + l_max) * np.finfo(dtype).eps
    assert relative_error(image, truth) < limit
    if quadrature != "pixel":  # whose radiance is constant in a pixel, not band-limited
        back = shjax.analyze(image, l_max=l_max, quadrature=quadrature)
        assert relative_error(back, coefs) < limit


def by(algorithm, array, grid, l_max, *, back=False):
    """One algorithm's analysis, or its synthesis, with its own tables."""
    of = (
        (algorithm.synthesis_tables, algorithm.synthesize)
        if back
        else (algorithm.analysis_tables, algorithm.analyze)
    )
    return of[1](array, of[0](grid, l_max, array.dtype), grid=grid, l_max=l_max)


@pytest.mark.parametrize(("l_max", "n_theta", "n_phi"), SIZES)
@pytest.mark.parametrize("quadrature", QUADRATURES)
def test_the_two_algorithms_agree(l_max, n_theta, n_phi, quadrature, rng, dtype):
    grid = make_grid(n_theta, n_phi, quadrature)
    image = jnp.asarray(rng.normal(size=(n_theta, n_phi, 2)), dtype)
    coefs = jnp.asarray(rng.normal(size=((l_max + 1) ** 2, 2)), dtype)
    limit = 100 * (1 + l_max) * np.finfo(dtype).eps
    for array, back in ((image, False), (coefs, True)):
        products = by(theta_first, array, grid, l_max, back=back)
        scanned = by(phi_first, array, grid, l_max, back=back)
        assert relative_error(scanned, products) < limit


def test_orders_above_the_columns_alias_alike(rng, dtype):
    grid, coefs = make_grid(4, 5), jnp.asarray(rng.normal(size=(64, 2)), dtype)
    products, scanned = (
        by(a, coefs, grid, 7, back=True) for a in (theta_first, phi_first)
    )
    assert relative_error(scanned, products) < 500 * np.finfo(dtype).eps


def test_pixel_quadrature_integrates_constant_pixels(rng, dtype):
    """One pixel's coefficients are the integral of the harmonics over it."""
    n_theta, n_phi, l_max, fine = 4, 6, 5, 64
    image = np.zeros((n_theta, n_phi, 1))
    image[1, 2] = 3
    ours = shjax.analyze(jnp.asarray(image, dtype), l_max=l_max, quadrature="pixel")
    nodes = latlong_directions(n_theta * fine, n_phi * fine)
    nodes = nodes[fine : 2 * fine, 2 * fine : 3 * fine].reshape(-1, 3)
    sine = np.hypot(nodes[:, 0], nodes[:, 1])
    weights = sine * (np.pi / (n_theta * fine)) * (2 * np.pi / (n_phi * fine))
    values = np.asarray(shjax.basis(jnp.asarray(nodes, dtype), l_max=l_max), float)
    assert (
        relative_error(ours[:, 0], 3 * values.T @ weights) < 2e-4
    )  # midpoints: 1/64^2


@pytest.mark.parametrize("size", [(1, 1), (2, 3), (4, 8), (8, 4)])
def test_pixel_quadrature_works_at_any_size(size, dtype):
    ours = np.asarray(
        shjax.analyze(jnp.ones((*size, 1), dtype), l_max=6, quadrature="pixel")
    )
    assert ours[0, 0] == pytest.approx(np.sqrt(4 * np.pi), rel=1e-5)
    # A constant map has nothing else; the pixels cover the sphere exactly.
    np.testing.assert_allclose(ours[1:], 0, atol=1e-5)


@pytest.mark.parametrize(
    ("quadrature", "size", "words"),
    [
        ("fejer", (20, 64), "2 l_max + 1 = 21 rows and columns"),
        ("fejer", (64, 20), "got 64 x 20"),
        ("gauss-legendre", (10, 64), "11 rows and 21 columns"),
        ("clenshaw-curtis", (20, 64), "21 rows"),
        ("simpson", (64, 64), "quadrature must be one of fejer"),
    ],
)
def test_too_few_rows_are_refused_with_the_number_needed(quadrature, size, words):
    with pytest.raises(ValueError, match=re.escape(words)):
        shjax.analyze(np.ones((*size, 1), np.float32), l_max=10, quadrature=quadrature)


@pytest.mark.parametrize(("l_max", "n_theta", "n_phi"), [(44, 90, 92), (44, 91, 90)])
def test_folded_and_whole_maps_are_the_sum_of_their_harmonics(
    l_max, n_theta, n_phi, rng, dtype
):
    """Both parities of the rows; a map of an odd number of rows is not folded."""
    coefs = jnp.asarray(rng.normal(size=((l_max + 1) ** 2, 2)), dtype)
    image = shjax.synthesize(coefs, n_theta=n_theta, n_phi=n_phi)
    rows, columns = np.array([0, 20, 44, 45, 89]), np.array([0, 17, 45, 46, 89])
    towards = latlong_directions(n_theta, n_phi)[rows[:, None], columns]
    exact = shjax.evaluate(coefs, jnp.asarray(towards, dtype))
    found = np.asarray(image)[rows[:, None], columns]
    close = 1e-12 if dtype == np.float64 else 1e-5
    assert relative_error(found, exact) < close
    assert relative_error(shjax.analyze(image, l_max=l_max), coefs) < close


def test_tables_hold_what_they_say():
    grid = make_grid(12, 9)
    even, odd = tables.degree_tables(5)
    for parity, table in enumerate((even, odd)):
        ring = np.split(tables.ring_values(grid, 5), [6])[parity]
        for m, matrix in zip(tables.orders_of_parity(5, parity), table, strict=True):
            direct = legendre.legendre(
                5, int(m), np.cos(grid.theta), np.sin(grid.theta)
            )
            np.testing.assert_allclose(matrix @ ring, direct, atol=1e-14)
            np.testing.assert_allclose(
                matrix[m:] @ matrix[m:].T, np.eye(6 - m), atol=1e-14
            )
    with pytest.raises(ValueError, match="read-only"):
        even[0, 0, 0] = 1


def test_a_large_batch_on_the_host_goes_in_parts(rng, monkeypatch, dtype):
    batch = rng.normal(size=(3, 2, 9, 10, 2)).astype(dtype)
    whole = shjax.analyze(jnp.asarray(batch), l_max=3)
    monkeypatch.setattr(transforms, "_CHUNK_BYTES", 2 * batch[0, 0].nbytes)
    calls = []
    inner = transforms._analyze
    monkeypatch.setattr(
        transforms, "_analyze", lambda a, **k: calls.append(a.shape) or inner(a, **k)
    )
    parts = shjax.analyze(batch, l_max=3)
    assert calls == [(2, 9, 10, 2)] * 3
    assert relative_error(parts, whole) < 10 * np.finfo(dtype).eps


@pytest.mark.x64
@pytest.mark.parametrize("l_max", [14, 129])
def test_gradients_at_higher_degrees(l_max, rng):
    n = 2 * l_max + 2
    image = jnp.asarray(rng.normal(size=(n, n, 1)))
    check_gradients(lambda i: shjax.analyze(i, l_max=l_max), image, directions=1)
    coefs = jnp.asarray(rng.normal(size=((l_max + 1) ** 2, 1)))
    check_gradients(
        lambda c: shjax.synthesize(c, n_theta=9, n_phi=12), coefs, directions=1
    )


def test_evaluate_is_linear_and_batched_at_any_degree(rng, dtype):
    for l_max in (8, 9, 20):
        coefs = jnp.asarray(rng.normal(size=(2, (l_max + 1) ** 2, 3)), dtype)
        points = jnp.asarray(unit_vectors(rng, 2100), dtype)  # more than a block
        values = shjax.evaluate(coefs, points)
        basis = shjax.basis(points, l_max=l_max)
        truth = jnp.einsum("nk,bkc->bnc", basis, coefs, precision="highest")
        assert relative_error(values, truth) < 50 * l_max * np.finfo(dtype).eps


@pytest.mark.x64
@pytest.mark.parametrize("l_max", [6, 11])
def test_gradients_of_evaluation(l_max, rng):
    coefs = jnp.asarray(rng.normal(size=((l_max + 1) ** 2, 2)))
    poles = np.array([[0, 0, 1.0], [0, 0, -1.0]])
    points = jnp.asarray(np.concatenate([unit_vectors(rng, 5), poles]))
    check_gradients(shjax.evaluate, coefs, points, tolerance=1e-7)
    check_gradients(lambda p: shjax.evaluate(coefs, p), points, tolerance=1e-7)
    check_gradients(lambda c: shjax.evaluate(c, points), coefs)
    check_gradients(lambda p: shjax.basis(p, l_max=l_max), points, tolerance=1e-7)


@pytest.mark.x64
@pytest.mark.parametrize("l_max", [5, 10])
def test_second_derivatives_at_the_poles(l_max, rng):
    coefs = jnp.asarray(rng.normal(size=((l_max + 1) ** 2, 1)))

    def gradient(d):
        return jax.grad(lambda p: shjax.evaluate(coefs, p)[0])(d)

    for pole in (1.0, -1.0):
        check_gradients(gradient, jnp.array([0.0, 0.0, pole]), tolerance=1e-6)


@pytest.mark.x64
@pytest.mark.parametrize("sine", [0.0, 1e-6, 0.02, 0.1, 0.4, 1.0])
def test_float32_keeps_its_digits_above_128(sine):
    """Where the seeds leave float32, and where the functions then grow from them."""
    direction = np.array([0.6 * sine, 0.8 * sine, -np.sqrt(1 - sine**2)], np.float32)
    exact = np.asarray(shjax.basis(direction.astype(float), l_max=400))
    single = np.asarray(shjax.basis(direction, l_max=400))
    assert np.max(np.abs(single - exact)) / np.max(np.abs(exact)) < 5e-6


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "l_max"), [(np.float32, 1024), (np.float64, 512)])
def test_high_degrees(kind, l_max, rng, dtype):
    if kind == np.float64 and dtype != kind:
        return
    # A few coefficients, low and high in l and m, in closed form elsewhere by addition.
    coefs = np.zeros(((l_max + 1) ** 2, 1), kind)
    high, half = l_max - 24, l_max // 2
    chosen = [(0, 0), (half + 9, 3), (high, 1 - high), (l_max, 0), (l_max, half)]
    chosen.append((l_max, -l_max))
    for l, m in chosen:
        coefs[l * (l + 1) + m] = 1
    image = shjax.synthesize(coefs, n_theta=2 * l_max + 1, n_phi=2 * l_max + 2)
    back = np.asarray(shjax.analyze(image, l_max=l_max))
    limit = 1e-4 if kind == np.float32 else 1e-12
    assert relative_error(back, coefs) < limit
    # Parseval: orthonormal functions.
    weights = make_grid(2 * l_max + 1, 2 * l_max + 2).weights
    energy = np.sum(np.asarray(image, float)[..., 0] ** 2 * weights[:, None])
    assert energy == pytest.approx(len(chosen), rel=limit)
