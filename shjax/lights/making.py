"""Making area lights from numbers, with checks of what is known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Float

from shjax.arrays import Array, as_number_or_float
from shjax.lights.flat_lights import DiskLight, PolygonLight
from shjax.lights.line_light import LineLight
from shjax.lights.round_lights import CapsuleLight, SphereLight
from shjax.vectors import frames, normalize

Number: TypeAlias = Float[Array, ""] | float
Colour: TypeAlias = Float[Array, " C"] | Sequence[float] | float
Vector: TypeAlias = Float[Array, " 3"] | Sequence[float]
Vectors: TypeAlias = Float[Array, "V 3"] | Sequence[Sequence[float]]

_FLAT = 1e-4  # how far a polygon's vertices may leave its plane, of its size


def polygon(
    vertices: Vectors,
    radiance: Colour,
    two_sided: bool = False,
) -> PolygonLight:
    """Make a polygonal area light: a triangle, a card, any simple polygon.

    Args:
        vertices: In order, in one plane, ``(V, 3)``; concave outlines are allowed. It
            emits to the side from which they run counter-clockwise.
        radiance: Of its surface, a number or ``(C,)``.
        two_sided: Whether it emits to both sides. Static.

    Raises:
        ValueError: If there are fewer than three vertices, they do not lie in a plane,
            enclose no area, or the outline crosses itself.
    """
    corners = _vectors("vertices", vertices, None)
    if corners.ndim != 2 or corners.shape[0] < 3:
        raise ValueError(
            f"vertices must have shape (V, 3) with V >= 3; got {corners.shape}."
        )
    if _known(corners):
        _check_polygon(np.asarray(corners, np.float64))
    return PolygonLight(corners, _radiance(radiance, corners.dtype), bool(two_sided))


def disk(
    centre: Vector,
    normal: Vector,
    radius: Number,
    radiance: Colour,
    two_sided: bool = False,
) -> DiskLight:
    """Make a disk as an area light.

    Args:
        centre: ``(3,)``.
        normal: Of its emitting side, of any length.
        radius: At least 0.
        radiance: Of its surface, a number or ``(C,)``.
        two_sided: Whether it emits to both sides. Static.

    Raises:
        ValueError: If the radius is negative or the normal zero.
    """
    place, axis = _vectors("centre", centre, (3,)), _vectors("normal", normal, (3,))
    dtype = np.result_type(place.dtype, axis.dtype)
    _check_length("normal", axis)
    size = _radius(radius, dtype)
    frame = frames(normalize(axis.astype(dtype)))
    return DiskLight(
        place.astype(dtype),
        size * frame[:2],
        _radiance(radiance, dtype),
        bool(two_sided),
        circular=True,
    )


def ellipse(
    centre: Vector,
    axes: Vectors,
    radiance: Colour,
    two_sided: bool = False,
) -> DiskLight:
    """Make an ellipse as an area light.

    Args:
        centre: ``(3,)``.
        axes: Half axes u and v, ``(2, 3)``, or any two conjugate half diameters; it emits
            towards ``u x v``.
        radiance: Of its surface, a number or ``(C,)``.
        two_sided: Whether it emits to both sides. Static.

    Raises:
        ValueError: If the axes are parallel, or a shape is wrong.
    """
    place, both = _vectors("centre", centre, (3,)), _vectors("axes", axes, (2, 3))
    dtype = np.result_type(place.dtype, both.dtype)
    if _known(both):
        u, v = np.asarray(both, np.float64)
        if np.linalg.norm(np.cross(u, v)) <= 1e-12 * (u @ u + v @ v):
            raise ValueError(f"axes must not be parallel; got {both.tolist()}.")
    return DiskLight(
        place.astype(dtype),
        both.astype(dtype),
        _radiance(radiance, dtype),
        bool(two_sided),
    )


def sphere(
    centre: Vector,
    radius: Number,
    radiance: Colour,
) -> SphereLight:
    """Make a sphere as an area light; inside it there is none.

    Args:
        centre: ``(3,)``.
        radius: At least 0.
        radiance: Of its surface, a number or ``(C,)``.

    Raises:
        ValueError: If the radius is negative or a shape is wrong.
    """
    place = _vectors("centre", centre, (3,))
    return SphereLight(
        place, _radius(radius, place.dtype), _radiance(radiance, place.dtype)
    )


def capsule(
    start: Vector,
    end: Vector,
    radius: Number,
    radiance: Colour,
) -> CapsuleLight:
    """Make a capsule, a tube with round ends, as an area light.

    Args:
        start: Of its axis, ``(3,)``.
        end: Of its axis, ``(3,)``; where it is the start, the light is a sphere.
        radius: At least 0.
        radiance: Of its surface, a number or ``(C,)``.

    Raises:
        ValueError: If the radius is negative or a shape is wrong.
    """
    ends = _ends(start, end)
    return CapsuleLight(
        ends, _radius(radius, ends.dtype), _radiance(radiance, ends.dtype)
    )


def line(
    start: Vector,
    end: Vector,
    radius: Number,
    radiance: Colour,
) -> LineLight:
    """Make a thin tube as an area light, by one-dimensional integrals.

    The limit of a capsule of small radius, without its ends: it differs from one by about
    six times the ratio of the radius to the distance.

    Args:
        start: ``(3,)``.
        end: ``(3,)``.
        radius: At least 0; what the light gives is proportional to it.
        radiance: Of its surface, a number or ``(C,)``.

    Raises:
        ValueError: If the radius is negative or a shape is wrong.
    """
    ends = _ends(start, end)
    return LineLight(ends, _radius(radius, ends.dtype), _radiance(radiance, ends.dtype))


def _ends(start, end) -> jax.Array:
    first, last = _vectors("start", start, (3,)), _vectors("end", end, (3,))
    dtype = np.result_type(first.dtype, last.dtype)
    return jnp.stack([first.astype(dtype), last.astype(dtype)])


def _known(*arrays) -> bool:
    return not any(isinstance(a, Tracer) for a in arrays)


def _vectors(name: str, value: Any, shape: tuple[int, ...] | None) -> jax.Array:
    """Vectors as given, lists too."""
    array = as_number_or_float(name, value, _type_of(value))
    if array.shape != shape if shape else array.shape[-1:] != (3,):
        rule = f"shape {shape}" if shape else "shape (V, 3) with V >= 3"
        raise ValueError(f"{name} must have {rule}; got {array.shape}.")
    _check_finite(name, array)
    return array


def _type_of(value: Any):
    """The value's own floating-point type, or JAX's default."""
    given = getattr(value, "dtype", None)
    if given is not None and jnp.issubdtype(given, jnp.floating):
        return jax.dtypes.canonicalize_dtype(
            jnp.float32 if jnp.finfo(given).bits < 32 else given
        )
    return jnp.result_type(float)


def _radiance(value: Any, dtype) -> jax.Array:
    array = as_number_or_float("radiance", value, dtype)
    if array.ndim > 1 or array.size == 0:
        raise ValueError(
            f"radiance must be a number or have shape (C,); got {array.shape}."
        )
    _check_finite("radiance", array)
    return jnp.atleast_1d(array)


def _radius(value: Any, dtype) -> jax.Array:
    array = as_number_or_float("radius", value, dtype)
    if array.ndim:
        raise ValueError(f"radius must be a number; got shape {array.shape}.")
    _check_finite("radius", array)
    if _known(array) and array < 0:
        raise ValueError(f"radius must not be negative; got {float(array)}.")
    return array


def _check_finite(name: str, array) -> None:
    if _known(array) and not np.all(np.isfinite(np.asarray(array))):
        raise ValueError(f"{name} must be finite; got {np.asarray(array).tolist()}.")


def _check_length(name: str, vector) -> None:
    if _known(vector) and not np.any(np.asarray(vector)):
        raise ValueError(f"{name} must not be zero.")


def _check_polygon(corners: np.ndarray) -> None:
    """Refuse bent polygons, those that cross themselves, and those without area."""
    about = corners - corners.mean(axis=0)
    _, (size, width, off), axes = np.linalg.svd(np.vstack([about, np.zeros((1, 3))]))
    if off > _FLAT * size:
        raise ValueError(
            f"vertices must lie in one plane; they leave it by {off / size:.2g} of the "
            "polygon's size."
        )
    flat = about @ axes[:2].T
    count = len(flat)
    for i in range(count):
        for j in range(i + 2, count if i else count - 1):
            if _cross(flat[i], flat[i + 1], flat[j], flat[(j + 1) % count]):
                raise ValueError(
                    f"vertices must give a simple outline; edges {i} and {j} cross."
                )
    following = np.roll(flat, -1, axis=0)
    area = np.sum(flat[:, 0] * following[:, 1] - flat[:, 1] * following[:, 0]) / 2
    if width <= 1e-7 * size or abs(area) <= 1e-7 * size**2:
        raise ValueError("vertices must enclose an area; the polygon is degenerate.")


def _cross(a, b, c, d) -> bool:
    """Whether two segments of a plane cross inside both."""

    def side(p, q, r):
        return np.sign((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    apart = side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0
    return bool(apart)
