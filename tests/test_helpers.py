"""The checkers see what is wrong."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.helpers import check_gradients, relative_error, rotation_matrix

pytestmark = pytest.mark.x64


def test_check_gradients_accepts_a_right_derivative():
    check_gradients(lambda x: jnp.sin(x) * x, jnp.linspace(0.3, 2.0, 5))


def test_check_gradients_sees_a_wrong_jvp():
    @jax.custom_jvp
    def wrong(x):
        return x**3

    wrong.defjvp(
        lambda primals, tangents: (primals[0] ** 3, 2.9 * primals[0] ** 2 * tangents[0])
    )
    with pytest.raises(AssertionError, match="central differences"):
        check_gradients(wrong, jnp.linspace(0.3, 2.0, 5))


def test_check_gradients_sees_a_wrong_transpose():
    def linear(x):
        return jax.custom_derivatives.linear_call(
            lambda _, v: 2 * v, lambda _, g: 2.001 * g, (), x
        )

    with pytest.raises(AssertionError, match="VJP differs"):
        check_gradients(linear, jnp.linspace(0.3, 2.0, 5))


def test_check_gradients_refuses_a_vanishing_derivative():
    with pytest.raises(AssertionError, match="vanishes"):
        check_gradients(lambda x: 0 * x, jnp.linspace(0.3, 2.0, 5))


def test_relative_error_sees_scale_and_shape():
    assert relative_error([1.1, 0.0], [1.0, 0.0]) == pytest.approx(0.1)
    with pytest.raises(AssertionError):
        relative_error([1.0], [[1.0]])


def test_rotation_matrix_is_a_rotation(rng):
    matrix = rotation_matrix(rng)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(matrix) == pytest.approx(1)
