"""Surfaces whose pictures are inverted: what a pixel receives of the light, as rows."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from shjax.arrays import (
    STATIC,
    Array,
    as_float,
    check_vectors,
    einsum,
    numpy_or_jax,
    shape_of,
)
from shjax.brdf import Brdf
from shjax.brdf.transfer_rows import glossy_rows, table_to
from shjax.inverse.linear.compression import Compressed
from shjax.inverse.shown.pixels import Pixels, check_unit, flatten
from shjax.inverse.shown.rows import cosine_rows, footprint_rows, seen_by_cosine

_PIXELS_ABOVE = 2048  # that tell what light above the fit does


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Surface:
    """Surface of a known shape that pictures show, from which the light is estimated.

    A pytree. Made by :meth:`matte`, :meth:`glossy` or :meth:`rows`; where an estimator
    takes one, an array of normals serves as a matte one.

    Attributes:
        normals: Unit normals ``(*points, 3)``, or those of each pixel's parts
            ``(*points, S, 3)``; zero for what shows nothing.
        views: Unit vectors to the viewer ``(*points, 3)``, of a glossy surface.
        brdf: The reflectance of a glossy surface.
        design: What each pixel receives of each lighting coefficient, ``(*points, K)`` or
            ``(*points, K, C)``, in place of all that.
        min_cosine: Pixels with ``n.v`` below are left out of a glossy surface.
    """

    normals: Float[Array, ...] | None = None
    views: Float[Array, ...] | None = None
    brdf: Brdf | None = None
    design: Float[Array, ...] | None = None
    min_cosine: float = dataclasses.field(default=0.2, metadata=STATIC)

    @classmethod
    def matte(cls, normals: Float[Array, ...]) -> Surface:
        """Lambertian surface without shadows of its own.

        Args:
            normals: Unit normals ``(*points, 3)``, zero for pixels that show nothing; or
                those of each pixel's parts, ``(*points, S, 3)``, zero for parts that show
                nothing (:func:`shjax.render.footprints`): then pixels on an outline serve
                too.
        """
        return cls(normals=normals)

    @classmethod
    def glossy(
        cls,
        normals: Float[Array, ...],
        views: Float[Array, ...],
        brdf: Brdf,
        *,
        min_cosine: float = 0.2,
    ) -> Surface:
        """Surface of any BRDF about the normal or the reflected direction.

        Args:
            normals: Unit normals ``(*points, 3)``, zero for pixels that show nothing.
            views: Unit vectors to the viewer, of the same shape.
            brdf: The reflectance.
            min_cosine: Pixels with ``n.v`` below are left out. Static.
        """
        return cls(normals=normals, views=views, brdf=brdf, min_cosine=min_cosine)

    @classmethod
    def rows(cls, design: Float[Array, ...]) -> Surface:
        """Surface of any kind by its linear transfer, as in precomputed radiance transfer.

        Args:
            design: What each pixel receives of each lighting coefficient at albedo 1,
                ``(*points, K)`` or ``(*points, K, C)``: of a shadowed mesh
                (:func:`shjax.inverse.visible_cosine`), or by a renderer of one's own.
        """
        return cls(design=design)

    def highest_degree(self, highest: int, l_max: int) -> int:
        """Degree of the fit: that of given rows, if they end below ``highest``.

        Raises:
            ValueError: If rows do not reach ``l_max``.
        """
        if self.design is None:
            return highest
        size = self.design.shape[1]
        own = math.isqrt(size) - 1
        if (own + 1) ** 2 != size or own < l_max:
            raise ValueError(
                "a surface's rows must have shape (..., K) or (..., K, C), "
                f"K = (l + 1)^2, l >= l_max = {l_max}; got K = {size}."
            )
        return min(own, highest)

    def unknowns(self, highest: int) -> np.ndarray:
        """Positions in K of the coefficients that the surface shows, ``(J,)``, rising."""
        if self.design is None and self.brdf is None:
            return seen_by_cosine(highest)
        return np.arange((highest + 1) ** 2)

    def rows_to(self, highest: int) -> jax.Array:
        """Design of flat pixels in the :meth:`unknowns` to a degree, ``(D, N, J)``."""
        if self.design is not None:
            rows = jnp.asarray(self.design)[:, : (highest + 1) ** 2]
        elif self.brdf is not None:
            table = table_to(self.min_cosine)
            assert self.normals is not None
            assert self.views is not None
            normals, views = (jnp.asarray(a) for a in (self.normals, self.views))
            rows = glossy_rows(self.brdf, normals, views, highest, table)
        else:
            assert self.normals is not None
            make = footprint_rows if self.normals.ndim == 3 else cosine_rows
            rows = make(jnp.asarray(self.normals), highest)
        return jnp.moveaxis(rows, -1, 0) if rows.ndim == 3 else rows[None]


class Picture(NamedTuple):
    """Flat pixels and the surface that they show, each ``(N, ...)``."""

    pixels: Pixels
    surface: Surface

    def design(self, highest: int) -> jax.Array:
        """Design with the albedo, ``(D, N, J)``, in the surface's unknowns."""
        rows = self.surface.rows_to(highest)
        albedo = self.pixels.albedo.T[..., None]  # [d, n, 1]
        shape = np.broadcast_shapes(rows.shape, albedo.shape)
        return jnp.broadcast_to(rows, shape) * jnp.broadcast_to(albedo, shape)


def flat_picture(
    image: Float[Array, "*points C"],
    normals_or_surface: Surface | Float[Array, ...],
    mask: Float[Array, ...] | Bool[Array, ...] | None,
    albedo: Float[Array, ...] | float,
) -> Picture:
    """Check a picture and its surface against each other, and flatten them.

    Raises:
        ValueError: If there is no surface, or shapes do not fit.
    """
    given = normals_or_surface
    if given is None:
        raise ValueError("normals_or_surface must be given: normals, or a Surface.")
    surface = given if isinstance(given, Surface) else Surface.matte(given)
    points = shape_of("image", image)[:-1]
    if surface.design is not None:
        design = surface.design
        pixels = flatten(image, _any_nonzero(design, points), mask, albedo)
        flat = as_float("rows", design).astype(pixels.image.dtype)
        flat = flat.reshape(-1, *design.shape[len(points) :])
        return Picture(pixels, Surface(design=flat))
    normals, brdf, views = surface.normals, surface.brdf, surface.views
    check_vectors("normals", normals)
    assert normals is not None
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
    numpy = numpy_or_jax(pixels.weights, normals, views)
    used = numpy.asarray(pixels.weights).reshape(points) > 0
    if parts:
        used = used[..., None] & numpy.any(numpy.asarray(normals) != 0, axis=-1)
    check_unit("normals", normals, used)
    flat = numpy.asarray(as_float("normals", normals), pixels.image.dtype)
    flat = numpy.where(used[..., None], flat, 0)  # what has no weight may be anything
    flat = flat.reshape(-1, *normals.shape[len(points) :])
    if brdf is None:
        return Picture(pixels, Surface.matte(jnp.asarray(flat)))
    _check_glossy(image, brdf, views, parts)
    check_unit("views", views, used)
    views = numpy.asarray(as_float("views", views), pixels.image.dtype)
    views = numpy.where(used[..., None], views, 0).reshape(-1, 3)
    facing = numpy.sum(flat * views, axis=-1) >= surface.min_cosine
    weights = jnp.asarray(numpy.asarray(pixels.weights) * facing.astype(flat.dtype))
    pixels = pixels._replace(weights=weights)
    own = Surface.glossy(
        jnp.asarray(flat), jnp.asarray(views), brdf, min_cosine=surface.min_cosine
    )
    return Picture(pixels, own)


def _any_nonzero(array, points: tuple[int, ...]) -> Array:
    """Where a pixel's entries are not all 0, of the shape of the pixels."""
    numpy = numpy_or_jax(array)
    axes = tuple(range(len(points), array.ndim))
    return numpy.any(numpy.asarray(array) != 0, axis=axes)


def _check_glossy(image, brdf: Brdf, views, parts: bool) -> None:
    if parts:
        raise ValueError(
            "normals of parts serve Lambertian surfaces only; got a brdf too."
        )
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


def beyond_seen_by(problem: Compressed, picture: Picture, above: int) -> jax.Array:
    """Overlap of a fit's unknowns A with what it leaves out: ``A^T W B``, ``(C, T, J)``.

    Of many pixels two thousand, equally spaced among those of weight, tell it to 2 % of
    the columns' lengths, and it serves error bars alone.

    Args:
        problem: Of the fitted unknowns, the first that the surface shows.
        picture: What is fitted.
        above: Highest degree of the T columns B.
    """
    fitted = problem.q.shape[2]
    chosen = _some_pixels(picture.pixels.weights)
    surface = picture.surface
    by_pixel = (picture.pixels, surface.normals, surface.views, surface.design)
    some, normals, views, design = jax.tree.map(lambda a: a[chosen], by_pixel)
    own = dataclasses.replace(surface, normals=normals, views=views, design=design)
    left_out = Picture(some, own).design(above)[..., fitted:]  # [d, n, t]
    columns = problem.q[:, chosen] * problem.root[:, chosen, None]
    # The share of the weight that these pixels have.
    squares = problem.root**2
    whole, held = (jnp.sum(a, axis=1) for a in (squares, squares[:, chosen]))
    times = jnp.where(held > 0, whole / jnp.where(held > 0, held, 1), 0)
    shape = (len(columns), *left_out.shape[1:])
    seen = einsum("dnj,dnt->dtj", columns, jnp.broadcast_to(left_out, shape))
    seen = seen * times[:, None, None]  # Q^T W^(1/2) B
    return einsum(
        "ctk,ckj->ctj",
        jnp.broadcast_to(seen, (len(problem.r), *seen.shape[1:])),
        problem.r,
    )


def _some_pixels(weights: jax.Array) -> jax.Array:
    """Positions of two thousand pixels of weight, or of all of fewer pixels."""
    if len(weights) <= _PIXELS_ABOVE:
        return jnp.arange(len(weights))
    rank = jnp.cumsum(weights > 0)
    places = (np.arange(_PIXELS_ABOVE) + 0.5) / _PIXELS_ABOVE
    wanted = jnp.asarray(places, weights.dtype) * rank[-1].astype(weights.dtype)
    return jnp.searchsorted(rank, jnp.floor(wanted).astype(rank.dtype) + 1)
