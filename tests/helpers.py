"""Checkers that the tests share; test_helpers.py shows that each of them can fail."""

import jax
import jax.numpy as jnp
import numpy as np


def unit_vectors(rng, n, dtype=np.float64):
    """Random directions over the whole sphere."""
    vectors = rng.normal(size=(n, 3))
    return (vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)).astype(dtype)


def rotation_matrix(rng):
    """A random rotation."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def relative_error(value, truth):
    """Norm of the difference over the norm of the truth."""
    value, truth = np.asarray(value, float), np.asarray(truth, float)
    assert value.shape == truth.shape, (value.shape, truth.shape)
    return np.linalg.norm(value - truth) / np.linalg.norm(truth)


def check_gradients(
    function, *arguments, tolerance=1e-8, directions=3, seed=7, transpose=1e-11
):
    """Compare JVP with central differences, and VJP with JVP.

    Double precision only. The step is eps^(1/3) times the argument's size; the error is
    relative to the norm of the derivative, which must not vanish. ``transpose`` is the
    agreement of VJP and JVP: rounding, more where a linear system is solved.
    """
    assert all(a.dtype == np.float64 for a in jax.tree.leaves(arguments))
    rng = np.random.default_rng(seed)
    step = np.finfo(np.float64).eps ** (1 / 3)

    @jax.jit  # one program: compiling is what such a test takes
    def everything(arguments, tangents, cotangent):
        value, forward = jax.jvp(function, arguments, tangents)
        return value, forward, jax.vjp(function, *arguments)[1](cotangent)

    shape = jax.eval_shape(function, *arguments).shape
    for _ in range(directions):
        tangents = jax.tree.map(
            lambda a, r=rng: jnp.asarray(r.normal(size=a.shape)), arguments
        )
        cotangent = jnp.asarray(rng.normal(size=shape))
        _, forward, reverse = everything(arguments, tangents, cotangent)

        def moved(sign, tangents=tangents, cotangent=cotangent):
            there = jax.tree.map(lambda a, t: a + sign * step * t, arguments, tangents)
            return everything(there, tangents, cotangent)[0]

        central = (moved(1) - moved(-1)) / (2 * step)
        norm = float(jnp.linalg.norm(forward))
        assert norm > 1e-3, f"the derivative nearly vanishes: {norm}"
        error = float(jnp.linalg.norm(forward - central)) / norm
        assert error < tolerance, f"JVP differs from central differences by {error:.1e}"

        left = float(jnp.vdot(cotangent, forward))
        products = jax.tree.map(lambda g, t: float(jnp.vdot(g, t)), reverse, tangents)
        right = sum(jax.tree.leaves(products))
        scale = norm * float(jnp.linalg.norm(cotangent))
        assert abs(left - right) < transpose * scale, (
            f"VJP differs from JVP by {abs(left - right) / scale:.1e}"
        )
