"""What the pixels show, in whichever way a call describes it, and the design of it."""

from __future__ import annotations

import dataclasses
import functools
import math

import jax
import jax.numpy as jnp
import numpy as np

from shjax.arrays import as_float, check_vectors, in_blocks, shape_of
from shjax.brdf import Brdf
from shjax.inverse.compression import Compressed
from shjax.inverse.glossy import glossy_rows, table_to
from shjax.inverse.pictures import Pixels, check_unit, flatten
from shjax.inverse.rows import cosine_rows, footprint_rows, seen_by_cosine

_PIXELS_AT_ONCE = 16384


@functools.partial(
    jax.tree_util.register_dataclass,
    data_fields=("pixels", "normals", "views", "brdf", "rows"),
    meta_fields=(),
)
@dataclasses.dataclass(frozen=True)
class Surface:
    """What the pixels show; one of normals, normals with views and brdf, rows."""

    pixels: Pixels
    normals: jax.Array | None = None
    views: jax.Array | None = None
    brdf: Brdf | None = None
    rows: jax.Array | None = None


def make_surface(image, normals, mask, albedo, brdf, views, least_cosine, rows):
    """Check what a call describes, and flatten it to a :class:`Surface`.

    Raises:
        ValueError: If it describes nothing, two things, or shapes do not fit.
    """
    points = shape_of("image", image)[:-1]
    if rows is not None:
        if normals is not None or brdf is not None:
            raise ValueError("rows stand in place of normals and brdf; give only them.")
        pixels = flatten(image, _any_nonzero(rows, points), mask, albedo)
        flat = as_float("rows", rows).astype(pixels.image.dtype)
        return Surface(pixels, rows=flat.reshape(-1, *rows.shape[len(points) :]))
    if normals is None:
        raise ValueError("normals must be given, or rows.")
    check_vectors("normals", normals)
    if views is not None:
        check_vectors("views", views)
    parts = normals.ndim == len(points) + 2
    shapes = [(*points, 3), (*points, normals.shape[-2], 3) if parts else None]
    if normals.shape not in shapes:
        raise ValueError(
            f"normals must have shape {(*points, 3)} to fit image, or that of its pixels' "
            f"parts (..., S, 3); got {normals.shape}."
        )
    pixels = flatten(image, _any_nonzero(normals, points), mask, albedo)
    used = (pixels.weights > 0).reshape(points)
    if parts:
        used = used[..., None] & jnp.any(jnp.asarray(normals) != 0, axis=-1)
    check_unit("normals", normals, used)
    flat = as_float("normals", normals).astype(pixels.image.dtype)
    flat = jnp.where(used[..., None], flat, 0)  # what has no weight may be anything
    flat = flat.reshape(-1, *normals.shape[len(points) :])
    if brdf is None:
        return Surface(pixels, normals=flat)
    _check_glossy(image, brdf, views, parts)
    check_unit("views", views, used)
    views = as_float("views", views).astype(pixels.image.dtype)
    views = jnp.where(used[..., None], views, 0).reshape(-1, 3)
    facing = jnp.sum(flat * views, axis=-1) >= least_cosine
    pixels = pixels._replace(weights=pixels.weights * facing.astype(flat.dtype))
    return Surface(pixels, normals=flat, views=views, brdf=brdf)


def _any_nonzero(array, points: tuple[int, ...]) -> jax.Array:
    """Where a pixel's entries are not all 0, of the shape of the pixels."""
    return jnp.any(jnp.asarray(array) != 0, axis=tuple(range(len(points), array.ndim)))


def _check_glossy(image, brdf: Brdf, views, parts: bool) -> None:
    if parts:
        raise ValueError("normals of parts serve matte surfaces only; got a brdf too.")
    expected = (*image.shape[:-1], 3)
    if views is None or shape_of("views", views) != expected:
        raise ValueError(
            f"views must have shape {expected} with brdf; got "
            f"{None if views is None else views.shape}."
        )
    if any(part.model.centre == "tangent" for part in brdf.parts):
        raise ValueError("brdf must be about the normal or R; it has fibres.")
    if brdf.channels not in (1, image.shape[-1]):
        raise ValueError(
            f"brdf must have one channel or image's {image.shape[-1]}; got "
            f"{brdf.channels}."
        )


def highest_degree(surface: Surface, highest: int, l_max: int) -> int:
    """The degree of given rows, which is that of the fit."""
    if surface.rows is None:
        return highest
    size = surface.rows.shape[1]
    own = math.isqrt(size) - 1
    if (own + 1) ** 2 != size or own < l_max:
        raise ValueError(
            f"rows must have shape (..., K) or (..., K, C), K = (l + 1)^2, l >= l_max = "
            f"{l_max}; got K = {size}."
        )
    return min(own, highest)


def unknowns_of(surface: Surface, highest: int) -> np.ndarray:
    """Positions in K of the coefficients that the surface shows, ``(J,)``, rising."""
    if surface.rows is None and surface.brdf is None:
        return seen_by_cosine(highest)
    return np.arange((highest + 1) ** 2)


def design_of(surface: Surface, highest: int, least_cosine: float) -> jax.Array:
    """The design with the albedo, ``(D, N, J)``, in :func:`unknowns_of`."""
    if surface.rows is not None:
        rows = surface.rows[:, : (highest + 1) ** 2]
    elif surface.brdf is not None:
        table = table_to(least_cosine)
        assert surface.normals is not None
        assert surface.views is not None
        rows = glossy_rows(surface.brdf, surface.normals, surface.views, highest, table)
    else:
        normals = surface.normals
        assert normals is not None
        make = footprint_rows if normals.ndim == 3 else cosine_rows
        rows = make(normals, highest)
    stacked = jnp.moveaxis(rows, -1, 0) if rows.ndim == 3 else rows[None]
    albedo = surface.pixels.albedo.T[..., None]  # [d, n, 1]
    shape = np.broadcast_shapes(stacked.shape, albedo.shape)
    return jnp.broadcast_to(stacked, shape) * jnp.broadcast_to(albedo, shape)


def beyond_seen_by(
    problem: Compressed, surface: Surface, above: int, least_cosine: float
) -> jax.Array:
    """What a fit's unknowns A see of what it leaves out: ``A^T W B``, ``(C, T, J)``.

    Args:
        problem: Of the fitted unknowns, the first of :func:`unknowns_of`.
        surface: What the pixels show.
        above: Highest degree of the T columns B; a block of pixels' are stored at a time.
        least_cosine: As of the design.
    """
    pixels, fitted = problem.q.shape[1:]
    size = min(_PIXELS_AT_ONCE, pixels)
    weighted = jnp.moveaxis(problem.q * problem.root[..., None], 1, 0)  # [n, d, j]
    shown = (surface.pixels, surface.normals, surface.views, surface.rows)
    blocks = jax.tree.map(lambda a: in_blocks(a, size), (shown, weighted))
    einsum = functools.partial(jnp.einsum, precision=jax.lax.Precision.HIGHEST)

    @jax.checkpoint
    def add(total, block):
        (some, normals, views, rows), columns = block
        part = Surface(some, normals, views, surface.brdf, rows)
        left_out = design_of(part, above, least_cosine)[..., fitted:]
        every = jnp.broadcast_to(left_out, (total.shape[0], *left_out.shape[1:]))
        return total + einsum("ndj,dnt->dtj", columns, every), None

    count = len(unknowns_of(surface, above)) - fitted
    start = jnp.zeros((len(problem.q), count, fitted), problem.r.dtype)
    seen = jax.lax.scan(add, start, blocks)[0]  # Q^T W^(1/2) B
    return einsum(
        "ctk,ckj->ctj",
        jnp.broadcast_to(seen, (len(problem.r), *seen.shape[1:])),
        problem.r,
    )
