import jax
import jax.numpy as jnp
import numpy as np
import pytest

from shjax import sphere
from shjax.vectors import normalize
from tests.helpers import check_gradients, unit_vectors


def test_the_panorama_is_seen_from_inside():
    directions = sphere.latlong_directions(2, 4)
    assert directions.shape == (2, 4, 3)
    assert np.all(directions[0, :, 2] > 0)  # row 0 is up
    centre = directions[:, 1:3].mean(axis=(0, 1))
    np.testing.assert_allclose(centre / np.linalg.norm(centre), [1, 0, 0], atol=1e-15)
    quarter = sphere.latlong_directions(1, 4)[0, :2].mean(axis=0)  # u = 0.25
    np.testing.assert_allclose(quarter / np.linalg.norm(quarter), [0, 1, 0], atol=1e-15)


@pytest.mark.parametrize(("n_theta", "n_phi"), [(1, 1), (5, 8), (512, 1024)])
def test_solid_angles_cover_the_sphere(n_theta, n_phi):
    rows = sphere.latlong_solid_angles(n_theta, n_phi)
    edges = np.cos(np.linspace(0, np.pi, n_theta + 1))
    np.testing.assert_allclose(rows, -np.diff(edges) * 2 * np.pi / n_phi, rtol=1e-9)
    assert rows.sum() * n_phi == pytest.approx(4 * np.pi, rel=1e-14)


def test_pixels_undo_directions():
    row, column = sphere.latlong_pixels(sphere.latlong_directions(6, 11), 6, 11)
    np.testing.assert_allclose(
        row, np.repeat(np.arange(6.0)[:, None], 11, 1), atol=1e-12
    )
    np.testing.assert_allclose(column, np.tile(np.arange(11.0), (6, 1)), atol=1e-12)


def test_pixels_at_the_poles_are_finite():
    row, _ = sphere.latlong_pixels(np.array([[0, 0, 1.0], [0, 0, -1.0]]), 8, 16)
    np.testing.assert_allclose(row, [-0.5, 7.5])


def test_normalize_scales_to_one(rng, dtype):
    vectors = (unit_vectors(rng, 50) * rng.uniform(0.1, 9, (50, 1))).astype(dtype)
    lengths = np.linalg.norm(np.asarray(normalize(vectors)), axis=-1)
    np.testing.assert_allclose(lengths, 1, rtol=4 * np.finfo(dtype).eps)


def test_normalize_of_zero_is_zero_with_zero_derivative(dtype):
    zero = jnp.zeros(3, dtype)
    assert np.all(np.asarray(normalize(zero)) == 0)
    assert np.all(np.asarray(jax.jacfwd(normalize)(zero)) == 0)
    assert np.all(np.asarray(jax.jacrev(normalize)(zero)) == 0)


@pytest.mark.x64
def test_normalize_gradient(rng):
    check_gradients(normalize, jnp.asarray(rng.normal(size=(4, 3))))


def test_fibonacci_directions_average_well():
    directions = sphere.fibonacci_directions(4000)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1, rtol=1e-14)
    np.testing.assert_allclose(directions.mean(axis=0), 0, atol=1e-4)
    second = directions.T @ directions / 4000
    np.testing.assert_allclose(second, np.eye(3) / 3, atol=1e-4)
