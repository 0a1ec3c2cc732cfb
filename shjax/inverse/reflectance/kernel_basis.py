"""A basis for the kernels of a family of lobes: pictures become linear in a few numbers.

The kernels of one lobe, from the broadest to the sharpest that its prior allows, lie within
a millionth of a space of 24 dimensions. A picture is then a product of two dozen columns,
known once the light is, with coefficients that depend on the shape alone: polynomials in
the solver's parameter, off by 3e-6 of the kernel at most, by 3e-5 for the Gaussian
microfacet lobe at its sharpest. So QR compresses the picture once, and the solver works on
as many rows as there are columns.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from shjax.arrays import as_type, einsum, matmul
from shjax.brdf.transfer_rows import ViewTable
from shjax.inverse.reflectance.families import LobeFamily, ShapeParameter
from shjax.inverse.shown.glossy import Lit

_NODES, _RANK = 64, 24
_SPREADS = 3.5  # of the prior, to either side of its centre


class KernelBasis(NamedTuple):
    """Basis of the kernels of a lobe with one shape parameter.

    Attributes:
        kernels: ``(R, nodes, L, Q)`` as :meth:`ViewTable.kernels` has them.
        series: Chebyshev coefficients of each one's share over the parameter, ``(T, R)``.
        low: Smallest value of the free parameter; below, the lobe stays as it is there.
        high: Largest value.
    """

    kernels: jax.Array
    series: jax.Array
    low: jax.Array
    high: jax.Array

    def shares(self, free: jax.Array) -> jax.Array:
        """Share of each kernel in the lobe of a free parameter, ``(R,)``."""
        middle, half = (self.high + self.low) / 2, (self.high - self.low) / 2
        # Just inside: at the ends the angle has no derivative.
        inside = 1 - 8 * float(jnp.finfo(self.series.dtype).eps)
        angle = jnp.arccos(jnp.clip((free - middle) / half, -inside, inside))
        order = jnp.asarray(np.arange(len(self.series)), self.series.dtype)
        return matmul(jnp.cos(order * angle), self.series)

    def columns(self, lit: Lit) -> jax.Array:
        """Reflected radiance of lit pixels in each kernel, ``(N, R, C)``."""
        assert lit.turned is not None
        at_nodes = einsum("nlqc,rolq->nroc", lit.turned, self.kernels)
        return einsum("no,nroc->nrc", lit.nodes, at_nodes)


def has_basis(kind: LobeFamily) -> bool:
    """Whether a family has one shape parameter, over which its kernels are tabulated."""
    return len(kind.shapes) == 1


@functools.lru_cache(maxsize=16)
def kernel_basis(
    kind: LobeFamily, table: ViewTable, l_max: int, dtype: np.dtype
) -> KernelBasis | None:
    """Make the basis of a family's kernels; the first call takes about a second.

    None where some kernel of the range is not finite (a lobe of one's own).

    Args:
        kind: The lobe; of one shape parameter.
        table: Over the views.
        l_max: Highest degree of the light.
        dtype: Of the arrays.
    """
    (shape,) = kind.shapes
    centre = float(shape.free(np.array(shape.centre)))
    low, high = (centre + sign * _SPREADS * shape.spread for sign in (-1, 1))
    x = np.cos((np.arange(_NODES) + 0.5) * np.pi / _NODES)
    with jax.ensure_compile_time_eval():
        free = as_type((high + low) / 2 + x * (high - low) / 2, dtype)
        every = _kernels(free, kind.lobe, shape, table, l_max)
        rows = np.asarray(every, np.float64).reshape(_NODES, -1)
        if not np.all(np.isfinite(rows)):
            return None
        lengths = np.linalg.norm(rows, axis=1, keepdims=True)
        _, _, vectors = np.linalg.svd(rows / (lengths + (lengths == 0)), False)
        vectors = vectors[:_RANK]
        waves = np.cos(np.arange(_NODES) * np.arccos(x)[:, None])
        series = np.linalg.solve(waves, rows @ vectors.T)
        kernels = vectors.reshape(-1, *every.shape[1:])
        return KernelBasis(*(as_type(a, dtype) for a in (kernels, series, low, high)))


@functools.partial(jax.jit, static_argnames=("lobe", "shape", "table", "l_max"))
def _kernels(free, lobe, shape: ShapeParameter, table: ViewTable, l_max: int):
    def one(parameter: jax.Array) -> jax.Array:
        brdf = lobe(shape.natural(parameter)[None])
        return table.kernels(brdf, l_max)[..., 0]

    return jax.lax.map(one, free)
