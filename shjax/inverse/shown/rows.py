"""Rows of the design: what each pixel receives of each lighting coefficient.

``image = albedo * rows @ lighting``; of a Lambertian one ``rows = Ahat_l Y_lm(n) / pi``.
Whatever else a pixel is (a footprint of several normals, a place that sees part of the
sky; a glossy surface, in :mod:`.glossy`) is other rows in the same problem.

References:
    [RH01] R. Ramamoorthi and P. Hanrahan, On the relationship between radiance and
    irradiance, JOSA A, 2001.
    [S02] P.-P. Sloan, J. Kautz, J. Snyder, Precomputed Radiance Transfer, SIGGRAPH 2002.
"""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import map_blocks
from shjax.clamped_cosine import cosine_kernel_table
from shjax.harmonics import basis
from shjax.harmonics.degrees import degrees
from shjax.harmonics.evaluation import some_harmonics
from shjax.render import Trace, visibility
from shjax.sphere import fibonacci_directions

_POINTS_AT_ONCE = 256


def seen_by_cosine(l_max: int) -> np.ndarray:
    """Positions of the coefficients that a Lambertian surface reflects."""
    return np.flatnonzero(cosine_kernel_table(l_max)[degrees(l_max)])


def cosine_rows(normals: jax.Array, l_max: int) -> jax.Array:
    """Design rows of a white Lambertian surface, ``(..., J)``.

    Args:
        normals: ``(..., 3)``; zero rows for zero vectors.
        l_max: Highest degree.
    """
    gains = cosine_kernel_table(l_max)[degrees(l_max)] / math.pi
    seen = np.flatnonzero(gains)
    # Only the columns that are used are kept: odd degrees above 1 are half of all.
    columns = some_harmonics(normals.reshape(-1, 3), l_max, seen)
    columns = columns.reshape(*normals.shape[:-1], len(seen))
    nonzero = jnp.any(normals != 0, axis=-1, keepdims=True)
    scaled = columns * jnp.broadcast_to(
        jnp.asarray(gains[seen], normals.dtype), columns.shape
    )
    return jnp.where(jnp.broadcast_to(nonzero, scaled.shape), scaled, 0)


def footprint_rows(normals: jax.Array, l_max: int) -> jax.Array:
    """Design rows of pixels averaged over their parts, ``(N, S, 3)`` to ``(N, J)``.

    A part that shows nothing has a zero normal, and counts: a pixel on the outline holds
    the black background too.
    """

    def block(some):
        return jnp.mean(cosine_rows(some, l_max), axis=1)

    return map_blocks(block, normals, _POINTS_AT_ONCE)


def visible_cosine(
    trace: Trace, *, l_max: int, directions: int = 4096
) -> Float[np.ndarray, "H W K"]:
    """Transfer of a white Lambertian mesh that shadows itself [S02, section 4.1].

    The clamped cosine times the visibility of each direction, projected for each pixel:
    odd degrees are no longer invisible.

    Args:
        trace: From :func:`shjax.render.trace_mesh`.
        l_max: Highest degree, inclusive.
        directions: How many are traced from each pixel, equally spread.

    Returns:
        ``(H, W, (l_max + 1)^2)``, to be given as ``rows`` to
        :func:`shjax.estimate_lighting`.

    Raises:
        ImportError: If trimesh is not installed.
        ValueError: If ``l_max`` is out of range.
    """
    towards = fibonacci_directions(directions)
    functions = np.asarray(basis(jnp.asarray(towards), l_max=l_max))
    # The whole cosine is known exactly; only what is hidden of it is summed.
    gains = cosine_kernel_table(l_max)[degrees(l_max)] / math.pi
    normals = np.asarray(trace.gbuffer.normals, float)
    rows = np.zeros((*normals.shape[:2], functions.shape[1]))
    weight = 4 * math.pi / directions / math.pi
    for i in range(normals.shape[0]):
        if not np.any(np.asarray(trace.gbuffer.mask[i]) > 0):
            continue
        cosine = np.maximum(normals[i] @ towards.T, 0)
        hidden = cosine * ~_visibility_of_row(trace, i, towards)
        exact = np.asarray(basis(jnp.asarray(normals[i]), l_max=l_max)) * gains
        rows[i] = exact - (hidden @ functions) * weight
    return np.where(np.any(normals != 0, axis=-1)[..., None], rows, 0)


def _visibility_of_row(trace: Trace, row: int, directions: np.ndarray) -> np.ndarray:
    """:func:`shjax.render.visibility` of one row of pixels, ``(W, N)``."""
    gbuffer = jax.tree.map(lambda a: a[row : row + 1], trace.gbuffer)
    one = Trace(gbuffer, trace.positions[row : row + 1], trace.geometry)
    return visibility(one, directions)[0]
