import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shjax
from shjax.sphere import latlong_directions, yaw_pitch_roll
from tests.helpers import check_gradients, relative_error, rotation_matrix, unit_vectors


def about_y(angle):
    return np.array(
        [
            [np.cos(angle), 0, np.sin(angle)],
            [0, 1, 0],
            [-np.sin(angle), 0, np.cos(angle)],
        ]
    )


SPECIAL = {
    "identity": np.eye(3),
    "half turn about x": np.diag([1.0, -1, -1]),
    "half turn about y": np.diag([-1.0, 1, -1]),
    "half turn about z": np.diag([-1.0, -1, 1]),
    "nearly nothing": about_y(1e-6),
    "nearly half": about_y(np.pi - 1e-6),
    "inversion": -np.eye(3),
    "mirror": np.diag([1.0, 1, -1]),
    "axes": np.array([[0.0, -1, 0], [0, 0, 1], [1, 0, 0]]),
}


@pytest.mark.parametrize("matrix", SPECIAL.values(), ids=SPECIAL.keys())
@pytest.mark.parametrize("l_max", [0, 2, 12])
def test_the_function_turns_with_its_coefficients(matrix, l_max, rng, dtype):
    coefs = jnp.asarray(rng.normal(size=((l_max + 1) ** 2, 3)), dtype)
    points = unit_vectors(rng, 30)
    turned = shjax.rotate(coefs, matrix)
    assert turned.dtype == dtype
    there = shjax.evaluate(turned, jnp.asarray(points @ matrix.T, dtype))
    here = shjax.evaluate(coefs, jnp.asarray(points, dtype))
    assert relative_error(there, here) < (100 + l_max**2) * np.finfo(dtype).eps


def test_random_rotations_and_mirrors(rng, dtype):
    coefs = jnp.asarray(rng.normal(size=(49, 2)), dtype)
    points = unit_vectors(rng, 30)
    here = shjax.evaluate(coefs, jnp.asarray(points, dtype))
    for sign in (1, -1, 1, -1, 1):
        matrix = sign * rotation_matrix(rng)
        there = shjax.evaluate(
            shjax.rotate(coefs, matrix), jnp.asarray(points @ matrix.T, dtype)
        )
        assert relative_error(there, here) < 200 * np.finfo(dtype).eps


def test_composition(rng, dtype):
    coefs = jnp.asarray(rng.normal(size=(81, 1)), dtype)
    a, b = rotation_matrix(rng), -rotation_matrix(rng)
    twice = shjax.rotate(shjax.rotate(coefs, a), b)
    assert relative_error(twice, shjax.rotate(coefs, b @ a)) < 100 * np.finfo(dtype).eps


def test_the_first_degree_is_a_vector(rng, dtype):
    matrix = rotation_matrix(rng)
    vector = rng.normal(size=3)  # x, y, z stand at 3, 1, 2
    coefs = jnp.asarray(np.array([0, vector[1], vector[2], vector[0]])[:, None], dtype)
    x, y, z = matrix @ vector
    turned = np.asarray(shjax.rotate(coefs, matrix))[:, 0]
    np.testing.assert_allclose(turned, [0, y, z, x], atol=20 * np.finfo(dtype).eps)


@pytest.mark.parametrize(
    "angle", [0.0, 1e-6, 0.7, np.pi / 2, np.pi - 1e-6, np.pi, -2.5]
)
@pytest.mark.parametrize("l", [0, 1, 2, 11])
def test_wigner_d_is_its_definition(l, angle, rng, dtype):
    matrix = np.asarray(shjax.wigner_d(l, np.asarray(angle, dtype)))
    points = unit_vectors(rng, 60)
    rows = slice(l * l, (l + 1) ** 2)
    turned = shjax.basis(jnp.asarray(points @ about_y(angle).T, dtype), l_max=l)[
        :, rows
    ]
    plain = shjax.basis(jnp.asarray(points, dtype), l_max=l)[:, rows]
    expected = np.asarray(plain) @ matrix.T
    np.testing.assert_allclose(
        turned, expected, atol=(20 + l**2) * 4 * np.finfo(dtype).eps
    )


@pytest.mark.x64
@pytest.mark.parametrize("l", [64, 300])
def test_wigner_d_in_float32_keeps_its_digits(l):
    for angle in np.float32([0, 1e-6, 1.0, np.pi / 2, np.pi - 1e-6, np.pi, 100.0]):
        exact = np.asarray(shjax.wigner_d(l, np.float64(angle)))
        single = np.asarray(shjax.wigner_d(l, angle))
        assert single.dtype == np.float32
        np.testing.assert_allclose(single, exact, atol=5e-7)
        np.testing.assert_allclose(exact @ exact.T, np.eye(2 * l + 1), atol=2e-13)


def test_batches_of_lights_and_of_rotations(rng, dtype):
    coefs = jnp.asarray(rng.normal(size=(2, 9, 3)), dtype)
    turns = np.stack([rotation_matrix(rng) for _ in range(2)])
    aligned = shjax.rotate(coefs, turns)
    assert aligned.shape == (2, 9, 3)
    one = shjax.rotate(coefs[1], turns[1])
    assert relative_error(aligned[1], one) < 20 * np.finfo(dtype).eps
    many = shjax.rotate(coefs[0], np.stack([*turns, np.eye(3)]))
    assert many.shape == (3, 9, 3)
    assert relative_error(many[2], coefs[0]) < 20 * np.finfo(dtype).eps


def test_power_of_each_degree_survives_many_rotations(rng):
    coefs = jnp.asarray(rng.normal(size=(64, 1)), jnp.float32)
    before = shjax.power_spectrum(coefs)
    turns = jnp.asarray(
        np.stack([rotation_matrix(rng) for _ in range(1000)]), jnp.float32
    )

    @jax.jit
    def all_of_them(start):
        return jax.lax.scan(lambda c, r: (shjax.rotate(c, r), None), start, turns)[0]

    after = shjax.power_spectrum(all_of_them(coefs))
    np.testing.assert_allclose(after, before, rtol=1e-4)


@pytest.mark.x64
def test_above_the_tables_one_degree_at_a_time(rng):
    l_max = 140
    coefs = np.zeros(((l_max + 1) ** 2, 1))
    some = rng.integers(0, coefs.size, 60)
    coefs[some] = rng.normal(size=(60, 1))
    matrix = -rotation_matrix(rng)
    points = unit_vectors(rng, 20)
    turned = shjax.rotate(jnp.asarray(coefs), matrix)
    there = shjax.evaluate(turned, points @ matrix.T)
    assert relative_error(there, shjax.evaluate(coefs, points)) < 1e-11


@pytest.mark.slow
@pytest.mark.x64
def test_memory_of_a_rotation_at_256():
    """Peak resident memory above what the process had before, in its own process."""
    import subprocess
    import sys

    script = """
import resource, numpy as np, shjax
rng = np.random.default_rng(0)
turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
small = rng.normal(size=(9, 1)).astype(np.float32)
np.asarray(shjax.rotate(small, turn))
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
coefs = rng.normal(size=(257**2, 1)).astype(np.float32)
after = np.asarray(shjax.rotate(coefs, turn))
power = shjax.power_spectrum(after) / shjax.power_spectrum(coefs)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before, float(abs(power - 1).max()))
"""
    run = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    kilobytes, error = run.stdout.split()
    assert float(kilobytes) < 200e3
    assert float(error) < 1e-5


@pytest.mark.x64
@pytest.mark.parametrize("matrix", SPECIAL.values(), ids=SPECIAL.keys())
def test_gradients_everywhere(matrix, rng):
    coefs = jnp.asarray(rng.normal(size=(16, 2)))
    check_gradients(shjax.rotate, coefs, jnp.asarray(matrix), tolerance=1e-7)


@pytest.mark.x64
def test_gradients_of_gradients_and_of_wigner_d(rng):
    coefs = jnp.asarray(rng.normal(size=(9, 1)))
    weights = jnp.asarray(rng.normal(size=(9, 1)))

    def gradient(matrix):
        return jax.grad(lambda r: jnp.sum(weights * shjax.rotate(coefs, r)))(matrix)

    # Along rotations; off them the derivative is that of the nearest one.
    def on_the_group(v):
        skew = jnp.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 0]]) * v[0]
        skew = skew + jnp.array([[0.0, 0, 1], [0, 0, 0], [-1, 0, 0]]) * v[1]
        return gradient(jax.scipy.linalg.expm(skew))

    check_gradients(on_the_group, jnp.array([0.3, 0.4]), tolerance=1e-6)
    check_gradients(lambda a: shjax.wigner_d(5, a[0]), jnp.array([0.0]), directions=1)


@pytest.mark.usefixtures("as_a_user")
@pytest.mark.parametrize(
    "matrix",
    [np.ones((3, 3)), np.eye(3) * 1.01, np.full((3, 3), np.nan), np.zeros((3, 3))],
)
def test_what_is_not_orthogonal_is_refused(matrix):
    with pytest.raises(ValueError, match="rotation must be orthogonal"):
        shjax.rotate(np.ones((9, 3)), matrix)
    with pytest.raises(ValueError, match=r"shape \(..., 3, 3\)"):
        shjax.rotate(np.ones((9, 3)), matrix[:2])


def test_yaw_turns_left_pitch_raises_roll_is_clockwise():
    centre, left = np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    np.testing.assert_allclose(
        yaw_pitch_roll(np.pi / 2, 0.0, 0.0) @ centre, left, atol=1e-15
    )
    assert (yaw_pitch_roll(0.0, 0.1, 0.0) @ centre)[2] > 0
    assert (yaw_pitch_roll(0.0, 0.0, 0.1) @ left)[2] > 0
    # A yawed panorama is the panorama with its columns moved.
    image = np.random.default_rng(0).random((16, 32, 1)).astype(np.float32)
    turned = shjax.rotate(
        shjax.analyze(image, l_max=3), yaw_pitch_roll(np.pi / 4, 0.0, 0.0)
    )
    moved = shjax.analyze(np.roll(image, -4, axis=1), l_max=3)
    assert relative_error(turned, moved) < 1e-5
    assert latlong_directions(2, 4).shape == (2, 4, 3)
