"""Power of each degree, and the product of two expansions."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array, as_float
from shjax.harmonics.degrees import degree_of_coefs, degrees
from shjax.harmonics.transforms import analyze, synthesize


@jax.jit
def power_spectrum(
    coefs: Float[Array, "*batch K C"],
) -> Float[jax.Array, "*batch L C"]:
    """Power spectrum: sum of squares over the orders, ``S_l = sum_m c_lm^2``.

    It does not change under rotation; over all degrees it adds up to the integral of the
    squared function (Parseval).

    Args:
        coefs: Coefficients.

    Returns:
        ``(..., l_max + 1, C)``.

    Raises:
        ValueError: If the axis before the last is not a square number.

    >>> power_spectrum(jnp.ones((9, 1)))[:, 0].tolist()
    [1.0, 3.0, 5.0]
    """
    l_max = degree_of_coefs(coefs)
    squares = jnp.moveaxis(as_float("coefs", coefs) ** 2, -2, 0)
    sums = jnp.zeros((l_max + 1, *squares.shape[1:]), squares.dtype)
    return jnp.moveaxis(sums.at[degrees(l_max)].add(squares), 0, -2)


def multiply(
    first: Float[Array, "*batch K1 C"], second: Float[Array, "*batch K2 C"]
) -> Float[jax.Array, "*batch K C"]:
    """Multiply two functions on the sphere exactly, by their coefficients.

    The product of degrees l1 and l2 has degree l1 + l2: both are evaluated on the rings
    of a Gauss-Legendre grid that integrates it exactly.

    Args:
        first: Coefficients to degree l1.
        second: Coefficients to degree l2; the same batch and channels.

    Returns:
        Coefficients ``(..., (l1 + l2 + 1)^2, C)``.

    Raises:
        ValueError: If a shape is wrong or the two do not fit each other.
    """
    l_max = degree_of_coefs(first, "first") + degree_of_coefs(second, "second")
    if first.shape[:-2] != second.shape[:-2] or first.shape[-1] != second.shape[-1]:
        raise ValueError(
            "first and second must have the same batch and channels; got "
            f"{first.shape} and {second.shape}."
        )
    first, second = as_float("first", first), as_float("second", second)
    common = np.promote_types(first.dtype, second.dtype)
    first, second = first.astype(common), second.astype(common)
    rings = {"n_theta": l_max + 1, "n_phi": 2 * l_max + 1}
    values = [
        synthesize(coefs, **rings, quadrature="gauss-legendre")
        for coefs in (first, second)
    ]
    return analyze(values[0] * values[1], l_max=l_max, quadrature="gauss-legendre")


def laplacian(l_max: int) -> np.ndarray:
    """Eigenvalues of minus the Laplacian, ``l (l + 1)``, ``(l_max + 1,)``."""
    l = np.arange(l_max + 1)
    return l * (l + 1.0)
