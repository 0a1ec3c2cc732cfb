"""The solver of compressed linear problems, and what such a problem determines."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx

from shjax.arrays import matmul


def least_squares(r: jax.Array, target: jax.Array, *, tolerance: float):
    """Least-norm solution of ``min |r x - target|``: value, steps, and how it ended."""
    # In units in which both are of order one, so that the solver's tolerances mean
    # the same for a picture of any brightness.
    unit_r, unit_target = (scale_of(a) for a in (r, target))
    tight = float(jnp.finfo(r.dtype).eps) ** 0.75
    solver = optx.GaussNewton(tight, tight, linear_solver=lx.SVD(rcond=tolerance))
    solution = optx.least_squares(
        lambda x, args: matmul(args[0], x) - args[1],
        solver,
        jnp.zeros(r.shape[1], r.dtype),
        args=(r / unit_r, target / unit_target),
        max_steps=16,
        throw=False,
    )
    ended = solution.result == optx.RESULTS.successful
    value = solution.value * (unit_target / unit_r)
    return value, solution.stats["num_steps"], ended


def tolerance_of(r: jax.Array) -> float:
    """Share of the largest singular value below which one is rounding."""
    return float(128 * r.shape[-1] ** 0.5 * jnp.finfo(r.dtype).eps)


def scale_of(values: jax.Array) -> jax.Array:
    """Largest magnitude, 1 for zeros; a constant wherever it is differentiated."""
    largest = jnp.max(jnp.abs(jax.lax.stop_gradient(values)))
    return jnp.where(largest > 0, largest, 1)


def diagnose(r: jax.Array, *, tolerance: float):
    """Pseudo-inverse of ``r^T r``, the rank, and each unknown's undetermined share."""
    _, values, vectors = jnp.linalg.svd(r, full_matrices=False)
    known = values > tolerance * values[0]
    inverse = jnp.where(known, 1 / jnp.where(known, values, 1), 0)
    half = vectors * inverse[:, None]
    share = 1 - jnp.sum(jnp.where(known[:, None], vectors**2, 0), axis=0)
    return matmul(half.T, half), jnp.sum(known), jnp.clip(share, 0, 1)


def embed(matrix: jax.Array, rows: np.ndarray, size: int) -> jax.Array:
    """Embed a matrix of some unknowns among all of them; zeros elsewhere."""
    return jnp.zeros((size, size), matrix.dtype).at[rows[:, None], rows].set(matrix)


@jax.custom_jvp
def inverse_and_log_det(matrix: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Inverse and log determinant of a positive definite matrix of diagonal about 1.

    Under ``vmap`` still one at a time, and with derivatives that factorise nothing: on a
    CPU, jaxlib's batched factorisations wait for the threads they themselves run on, and
    two at once may wait for ever (seen with jaxlib 0.10.2, 480 matrices, two cores).
    """
    return _by_cholesky(matrix)


@inverse_and_log_det.defjvp
def _inverse_and_log_det_jvp(primals, tangents):
    (matrix,), (moved,) = primals, tangents
    inverse, log_det = inverse_and_log_det(matrix)
    tangent = -matmul(matmul(inverse, moved), inverse)
    return (inverse, log_det), (tangent, jnp.sum(inverse * moved))


@jax.custom_batching.sequential_vmap
def _by_cholesky(matrix: jax.Array) -> tuple[jax.Array, jax.Array]:
    size, dtype = matrix.shape[0], matrix.dtype
    identity = jnp.eye(size, dtype=dtype)
    lifted = 2 * size * jnp.finfo(dtype).eps  # what rounding takes from an eigenvalue
    factor = jnp.linalg.cholesky(matrix + lifted * identity)
    root = jax.scipy.linalg.solve_triangular(factor, identity, lower=True)
    return matmul(root.T, root), 2 * jnp.sum(jnp.log(jnp.diagonal(factor)))


@jax.custom_jvp
def inverse_of_triangle(r: jax.Array) -> jax.Array:
    """Inverse of an upper triangle; one at a time, as :func:`inverse_and_log_det`."""
    return _by_substitution(r)


@inverse_of_triangle.defjvp
def _inverse_of_triangle_jvp(primals, tangents):
    (r,), (moved,) = primals, tangents
    inverse = inverse_of_triangle(r)
    return inverse, -matmul(matmul(inverse, jnp.triu(moved)), inverse)


@jax.custom_batching.sequential_vmap
def _by_substitution(r: jax.Array) -> jax.Array:
    return jax.scipy.linalg.solve_triangular(r, jnp.eye(len(r), dtype=r.dtype))


@jax.custom_jvp
def regularised(a: jax.Array, y: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Minimiser of ``|a x - y|``, inverse and log determinant of ``a^T a``.

    By QR of ``a``, whose condition is not squared: float32 suffices. For one problem at a
    time as :func:`inverse_and_log_det`, and for its reason.
    """
    return _by_qr(a, y)


@regularised.defjvp
def _regularised_jvp(primals, tangents):
    (a, y), (moved_a, moved_y) = primals, tangents
    x, inverse, log_det = regularised(a, y)
    left = y - matmul(a, x)
    slope = matmul(moved_a.T, left) + matmul(a.T, moved_y - matmul(moved_a, x))
    cross = matmul(a.T, moved_a)
    gram = cross + cross.T
    return (x, inverse, log_det), (
        matmul(inverse, slope),
        -matmul(matmul(inverse, gram), inverse),
        jnp.sum(inverse * gram),
    )


@jax.custom_batching.sequential_vmap
def _by_qr(a: jax.Array, y: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
    q, r = jnp.linalg.qr(a)
    identity = jnp.eye(a.shape[1], dtype=a.dtype)
    root = jax.scipy.linalg.solve_triangular(r, identity)
    log_det = 2 * jnp.sum(jnp.log(jnp.abs(jnp.diagonal(r))))
    return matmul(root, matmul(q.T, y)), matmul(root, root.T), log_det
