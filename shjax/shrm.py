"""The spherical harmonic reflection map: reflected light of every direction and view.

A map holds coefficients over the view for each reflected direction R (the tangent, for
fibres): ``(..., n_theta, n_phi, Q, C)`` on a lat-long grid, ``(..., 6, size, size, Q, C)``
on a cube. *Local* coefficients are over the view in R's own frame (e_theta, e_phi, R),
*global* ones over the view in the world [T5, section 5.4].

References:
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array, as_float, check_vectors, in_blocks
from shjax.convolution import common_channels
from shjax.harmonics.degrees import degree_of_coefs
from shjax.harmonics.orientations import HIGHEST, einsum, maps_at, maps_on_grid
from shjax.kernels import orders_of_rho
from shjax.sphere import (
    cube_directions,
    icosahedron,
    latlong_phi,
    latlong_theta,
    spherical_directions,
)
from shjax.view_basis import HarmonicViews, ViewBasis, views_of_maps

FRAMES = ("local", "global")
_POINTS_AT_ONCE = 2048


def default_size(l_max: int) -> tuple[int, int]:
    """Rows and columns of a map of this degree: eight samples to the shortest wave.

    Read by cubic interpolation a map of a flat spectrum is off by 0.2 % rms then.

    >>> default_size(24)
    (100, 200)
    """
    return 4 * (l_max + 1), 8 * (l_max + 1)


def prefilter(
    lighting: Float[Array, "*batch K C"],
    rho: Float[Array, "*brdfs L P P D"],
    *,
    n_theta: int | None = None,
    n_phi: int | None = None,
    frame: str = "local",
) -> Float[jax.Array, "*all n_theta n_phi Q E"]:
    """The SHRM on the pixels of a lat-long grid [T5, Eqs. 5.9, 5.14].

    Theta first, then phi: ``O(F^2 P^2 S + F P^2 S^2)`` [T5, Eq. 5.24].

    Args:
        lighting: Radiance coefficients; of degrees beyond ``rho``'s nothing is used.
        rho: BRDF coefficients (:func:`shjax.brdf_coefs`). Its batch axes broadcast
            against those of ``lighting``; one channel, of either, serves all.
        n_theta: Rows; default :func:`default_size` of the map's degree: the lower one of
            the two, plus ``p_max`` for a global map. Static.
        n_phi: Columns; default twice the rows. Static.
        frame: ``"local"`` or ``"global"``. Static.

    Returns:
        ``(..., n_theta, n_phi, (p_max + 1)^2, C)``, in the lighting's type.

    Raises:
        ValueError: If a shape is wrong, the degree exceeds 128, a size is not positive,
            or ``frame`` is unknown.
    """
    lighting, rho = _checked(lighting, rho, frame)
    degree = _degree(lighting, rho)
    if frame == "global":
        degree += orders_of_rho(rho.shape)[1]
    rows, columns = default_size(degree)
    n_theta = rows if n_theta is None else n_theta
    n_phi = (columns if n_theta == rows else 2 * n_theta) if n_phi is None else n_phi
    if n_theta < 1 or n_phi < 1:
        raise ValueError(f"n_theta, n_phi must be positive; got {n_theta}, {n_phi}.")
    views = HarmonicViews(orders_of_rho(rho.shape)[1])
    return prefilter_in(views, lighting, rho, n_theta=n_theta, n_phi=n_phi, frame=frame)


def prefilter_cube(
    lighting: Float[Array, "*batch K C"],
    rho: Float[Array, "*brdfs L P P D"],
    *,
    size: int | None = None,
    frame: str = "local",
) -> Float[jax.Array, "*all 6 size size Q E"]:
    """The SHRM on the pixels of a cube map (:func:`shjax.sphere.cube_directions`).

    Args:
        lighting: As in :func:`prefilter`.
        rho: As in :func:`prefilter`.
        size: Side of a face; default two pixels a degree. Static.
        frame: ``"local"`` or ``"global"``. Static.

    Returns:
        ``(..., 6, size, size, (p_max + 1)^2, C)``, in the lighting's type.

    Raises:
        ValueError: As :func:`prefilter`.
    """
    lighting, rho = _checked(lighting, rho, frame)
    size = 2 * (_degree(lighting, rho) + 1) if size is None else size
    if size < 1:
        raise ValueError(f"size must be positive; got {size}.")
    return _prefilter_cube(lighting, rho, size=size, frame=frame)


def _degree(lighting: jax.Array, rho: jax.Array) -> int:
    return min(degree_of_coefs(lighting.shape), orders_of_rho(rho.shape)[0])


def _checked(lighting, rho, frame: str) -> tuple[jax.Array, jax.Array]:
    _check_frame(frame)
    orders_of_rho(rho.shape)
    degree_of_coefs(lighting.shape, "lighting")
    common_channels(lighting.shape[-1], rho.shape[-1], "rho")
    lighting = as_float("lighting", lighting)
    rho = as_float("rho", rho).astype(lighting.dtype)
    if _degree(lighting, rho) > HIGHEST:
        raise ValueError(
            f"lighting or rho must end at degree {HIGHEST}; got "
            f"{_degree(lighting, rho)}. Cut one of them."
        )
    return lighting, rho


def _check_frame(frame: str) -> None:
    if frame not in FRAMES:
        raise ValueError(f"frame must be one of {', '.join(FRAMES)}; got {frame!r}.")


@functools.partial(jax.jit, static_argnames=("views", "n_theta", "n_phi", "frame"))
def prefilter_in(
    views: ViewBasis, lighting, rho, *, n_theta: int, n_phi: int, frame: str = "local"
) -> jax.Array:
    """:func:`prefilter` in a view basis of one's own; arguments are not checked."""
    theta, phi = latlong_theta(n_theta), latlong_phi(n_phi)

    def one(light, kernels):
        maps = maps_on_grid(light, kernels, views.orders, theta, phi)
        if frame == "local":
            return maps
        assert isinstance(views, HarmonicViews)  # only they turn
        azimuth = jnp.asarray(np.broadcast_to(phi, (n_theta, n_phi)), maps.dtype)
        return views.to_world(maps, jnp.asarray(theta, maps.dtype), azimuth)

    return _over_batch(one, views, lighting, rho)


@functools.partial(jax.jit, static_argnames=("size", "frame"))
def _prefilter_cube(lighting, rho, *, size: int, frame: str) -> jax.Array:
    directions = cube_directions(size).reshape(-1, 3)
    views = HarmonicViews(orders_of_rho(rho.shape)[1])
    theta, phi = (jnp.asarray(a, lighting.dtype) for a in _angles(directions))

    def one(light, kernels):
        maps = maps_at(light, kernels, views.orders, theta, phi)
        if frame == "global":
            maps = _turn_points(views.to_world, maps, theta, phi)
        return maps.reshape(6, size, size, *maps.shape[1:])

    return _over_batch(one, views, lighting, rho)


def _angles(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x, y, z = np.moveaxis(directions, -1, 0)
    return np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)


def _over_batch(one: Callable, views: ViewBasis, lighting, rho) -> jax.Array:
    """Each light and BRDF in turn; a loop holds one map's temporaries at a time."""
    l_max = _degree(lighting, rho)
    channels = common_channels(lighting.shape[-1], rho.shape[-1], "rho")
    lighting = lighting[..., : (l_max + 1) ** 2, :]
    lighting = jnp.broadcast_to(lighting, (*lighting.shape[:-1], channels))
    rho = rho[..., : l_max + 1, :, :, :]

    def single(light, coefs):
        kernels = views.kernels(coefs)
        return one(light, jnp.broadcast_to(kernels, (*kernels.shape[:-1], channels)))

    batch = jnp.broadcast_shapes(lighting.shape[:-2], rho.shape[:-4])
    if not batch:
        return single(lighting, rho)
    lights = jnp.broadcast_to(lighting, (*batch, *lighting.shape[-2:]))
    coefs = jnp.broadcast_to(rho, (*batch, *rho.shape[-4:]))
    pairs = (
        lights.reshape(-1, *lighting.shape[-2:]),
        coefs.reshape(-1, *rho.shape[-4:]),
    )
    many = jax.vmap(single) if pairs[0].shape[0] <= 1 else None
    maps = many(*pairs) if many else jax.lax.map(lambda pair: single(*pair), pairs)
    return maps.reshape(*batch, *maps.shape[1:])


def _turn_points(turn: Callable, maps: jax.Array, theta, phi) -> jax.Array:
    """Turn coefficients ``(n, Q, C)`` at single directions, some at a time."""
    n = maps.shape[0]
    blocks = tuple(in_blocks(a, min(_POINTS_AT_ONCE, n)) for a in (maps, theta, phi))

    def block(some):
        values, a, b = some
        return turn(values[:, None], a, b[:, None])[:, 0]

    turned = jax.lax.map(block, blocks)
    return turned.reshape(-1, *maps.shape[1:])[:n]


@functools.partial(jax.jit, static_argnames=("frame", "interpolation"))
def radiance(
    maps: Float[Array, "n_theta n_phi Q C"],
    directions: Float[Array, "*points 3"],
    views: Float[Array, "*points 3"],
    *,
    frame: str = "local",
    interpolation: str = "cubic",
) -> Float[jax.Array, "*points C"]:
    """Read a lat-long SHRM at reflected directions and views [T5, Eqs. 5.10, 5.11].

    Differentiable in the map, the views and, piecewise, the directions. Not smooth within
    a pixel of a pole for local maps, whose frame turns there; :func:`shjax.reflect` is.

    Args:
        maps: From :func:`prefilter`; an even number of columns.
        directions: Unit reflected directions ``R = 2 (n.v) n - v``; tangents for fibres.
        views: Unit vectors to the viewer, in the world.
        frame: That of the map, ``"local"`` or ``"global"``. Static.
        interpolation: ``"cubic"`` (Catmull-Rom, 16 pixels) or ``"linear"`` (4). Static.

    Returns:
        ``(*points, C)``.

    Raises:
        ValueError: If a shape is wrong, or a choice unknown.
    """
    _check_frame(frame)
    if interpolation not in _WEIGHTS:
        raise ValueError(
            f"interpolation must be one of {', '.join(_WEIGHTS)}; got {interpolation!r}."
        )
    if maps.ndim != 4 or 0 in maps.shape or maps.shape[1] % 2:
        raise ValueError(
            "maps must have shape (n_theta, n_phi, Q, C) with n_phi even; got "
            f"{maps.shape}."
        )
    basis = views_of_maps(maps.shape)
    for name, vectors in (("directions", directions), ("views", views)):
        check_vectors(name, vectors.shape)
        if vectors.shape != directions.shape:
            raise ValueError(
                f"views must have the shape of directions; got {views.shape} and "
                f"{directions.shape}."
            )
    return read_in(
        basis, maps, directions, views, frame=frame, interpolation=interpolation
    )


@functools.partial(jax.jit, static_argnames=("basis", "frame", "interpolation"))
def read_in(
    basis: ViewBasis,
    maps,
    directions,
    views,
    *,
    frame: str = "local",
    interpolation: str = "cubic",
) -> jax.Array:
    """:func:`radiance` of maps in a view basis of one's own; arguments are not checked."""
    maps = as_float("maps", maps)
    points = as_float("directions", directions).astype(maps.dtype).reshape(-1, 3)
    towards = as_float("views", views).astype(maps.dtype).reshape(-1, 3)
    local = frame == "local"
    seen = in_spherical_frame(points, towards) if local else towards
    values = basis.values(seen)
    orders = np.array(basis.orders) if local else np.zeros(len(basis.orders), int)
    total = _read(maps, points, values, orders, _WEIGHTS[interpolation])
    return total.reshape(*directions.shape[:-1], maps.shape[-1])


def in_spherical_frame(directions: jax.Array, vectors: jax.Array) -> jax.Array:
    """Components of vectors along e_theta, e_phi and the directions, ``(..., 3)``.

    At the poles the frame is that of phi = 0.
    """
    x, y, z = directions[..., 0], directions[..., 1], directions[..., 2]
    squared = x * x + y * y
    off = squared > 0
    across = jnp.where(off, jnp.sqrt(jnp.where(off, squared, 1)), 0)
    cosine = jnp.where(off, x / jnp.where(off, across, 1), 1)
    sine = jnp.where(off, y / jnp.where(off, across, 1), 0)
    a, b, c = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    along = cosine * a + sine * b
    return jnp.stack(
        [z * along - across * c, cosine * b - sine * a, x * a + y * b + z * c], axis=-1
    )


def _linear(t: jax.Array) -> list[tuple[int, jax.Array]]:
    return [(0, 1 - t), (1, t)]


def _cubic(t: jax.Array) -> list[tuple[int, jax.Array]]:
    """Catmull and Rom's weights of the pixels -1, 0, 1, 2."""
    t2, t3 = t * t, t * t * t
    return [
        (-1, (-t3 + 2 * t2 - t) / 2),
        (0, (3 * t3 - 5 * t2 + 2) / 2),
        (1, (-3 * t3 + 4 * t2 + t) / 2),
        (2, (t3 - t2) / 2),
    ]


_WEIGHTS = {"linear": _linear, "cubic": _cubic}


def _read(maps, points, values, orders: np.ndarray, weights: Callable) -> jax.Array:
    """Sum of interpolated coefficients times the basis values, ``(n, C)``."""
    n_theta, n_phi, maps_count, channels = maps.shape
    x, y, z = points[:, 0], points[:, 1], points[:, 2]
    squared = x * x + y * y
    off = squared > 0
    across = jnp.where(off, jnp.sqrt(jnp.where(off, squared, 1)), 0)
    theta = jnp.arctan2(across, jnp.where(off, z, jnp.sign(z)))
    phi = jnp.where(off, jnp.arctan2(jnp.where(off, y, 0), jnp.where(off, x, 1)), 0)
    row = theta * (n_theta / np.pi) - 0.5
    column = (np.pi - phi) * (n_phi / (2 * np.pi)) - 0.5
    top, left = (jnp.floor(a).astype(jnp.int32) for a in (row, column))
    flat = maps.reshape(n_theta * n_phi, maps_count, channels)
    odd = jnp.asarray(orders % 2 == 1)[None]
    total = jnp.zeros((points.shape[0], channels), maps.dtype)
    for down, weight in weights(row - top.astype(row.dtype)):
        line = top + down
        # Across a pole the next row is the one on the other side, half a turn on,
        # in a frame that is turned by pi.
        north, south = line < 0, line >= n_theta
        line = jnp.where(
            north, -1 - line, jnp.where(south, 2 * n_theta - 1 - line, line)
        )
        line = jnp.clip(line, 0, n_theta - 1)
        over = north | south
        flipped = jnp.where(over[:, None] & odd, -values, values)
        for right, share in weights(column - left.astype(column.dtype)):
            place = left + right + jnp.where(over, n_phi // 2, 0)
            index = line * n_phi + jnp.mod(place, n_phi)
            texels = jnp.take(flat, index, axis=0)
            part = einsum("nqc,nq->nc", texels, flipped)
            total = total + part * jnp.broadcast_to(
                (weight * share)[:, None], part.shape
            )
    return total


@jax.jit
def dynamic_map(
    maps: Float[Array, "*grid Q C"], view: Float[Array, 3]
) -> Float[jax.Array, "*grid C"]:
    """One reflection map for a distant viewer, from a global SHRM [T5, Eq. 5.35].

    Args:
        maps: Global coefficients on any pixels, lat-long or cube.
        view: Unit vector to the viewer, in the world.

    Returns:
        Radiance ``(*grid, C)``.

    Raises:
        ValueError: If a shape is wrong.
    """
    basis = views_of_maps(maps.shape)
    if view.shape != (3,):
        raise ValueError(f"view must have shape (3,); got {view.shape}.")
    maps = as_float("maps", maps)
    values = basis.values(as_float("view", view).astype(maps.dtype))
    return _sum_over_views(maps, values)


def _sum_over_views(maps: jax.Array, values: jax.Array) -> jax.Array:
    """``(*grid, Q, C)`` times ``(Q,)``, as one product with a block of identities."""
    count, channels = maps.shape[-2:]
    blocks = values[:, None, None] * jnp.eye(channels, dtype=maps.dtype)[None]
    flat = maps.reshape(-1, count * channels)
    total = jnp.matmul(
        flat,
        blocks.reshape(count * channels, channels),
        precision=jax.lax.Precision.HIGHEST,
    )
    return total.reshape(*maps.shape[:-2], channels)


def view_maps(
    maps: Float[Array, "*grid Q C"], views: Float[Array, "*views 3"]
) -> Float[jax.Array, "*views_grid C"]:
    """Explicit reflection maps, one for each view, by the same sum [T5, section 5.6.2].

    Args:
        maps: Coefficients on any pixels; the views are in their frame: the world's for
            global ones, (e_theta, e_phi, R) for local ones.
        views: Unit vectors, ``(*views, 3)``.

    Returns:
        ``(*views, *grid, C)``.

    Raises:
        ValueError: If a shape is wrong.
    """
    check_vectors("views", views.shape)
    flat = as_float("views", views).reshape(-1, 3)
    if flat.shape[0] == 0:
        raise ValueError(f"views must hold at least one vector; got {views.shape}.")
    found = jax.lax.map(lambda view: dynamic_map(maps, view), flat)
    return found.reshape(*views.shape[:-1], *found.shape[1:])


def icosahedral_maps(maps: Float[Array, "*grid Q C"]) -> Float[jax.Array, "V *grid C"]:
    """Cabral's twelve reflection maps from a global SHRM [T5, section 5.6.2].

    Args:
        maps: Global coefficients on any pixels.

    Returns:
        ``(12, *grid, C)``, seen from :func:`shjax.sphere.icosahedron`.
    """
    return view_maps(maps, icosahedron())


@jax.jit
def azimuthal_texture(
    maps: Float[Array, "*grid Q C"], theta_o: Float[Array, " T"]
) -> Float[jax.Array, "*grid T C"]:
    """Kautz and McCool's 3D texture, without azimuth, from a local SHRM [T5, Eq. 5.25].

    Args:
        maps: Local coefficients on any pixels.
        theta_o: Angles of the view to R, in [0, pi].

    Returns:
        ``(*grid, T, C)``: the terms q = 0 only.

    Raises:
        ValueError: If ``theta_o`` is not a list of angles.
    """
    basis, maps = views_of_maps(maps.shape), as_float("maps", maps)
    if theta_o.ndim != 1:
        raise ValueError(f"theta_o must have shape (T,); got {theta_o.shape}.")
    theta = as_float("theta_o", theta_o).astype(maps.dtype)
    zero = jnp.zeros_like(theta)
    views = jnp.stack([jnp.sin(theta), zero, jnp.cos(theta)], axis=-1)
    values = basis.values(views)  # [t, q]
    symmetric = jnp.asarray(np.array(basis.orders) == 0)[None]
    values = jnp.where(jnp.broadcast_to(symmetric, values.shape), values, 0)
    return einsum("...qc,tq->...tc", maps, values)


def view_grid(n: int) -> np.ndarray:
    """``n x n`` views over the sphere, theta by phi: ``(n, n, 3)``, float64.

    At the nodes of the lat-long grid, as explicit T x T tables have them.
    """
    return spherical_directions(latlong_theta(n)[:, None], latlong_phi(n))


def fit_views(
    values: Float[Array, "V *grid C"], views: Float[Array, "V 3"], *, p_max: int
) -> Float[jax.Array, "*grid Q C"]:
    """Coefficients over the view from explicit maps, by least squares.

    Args:
        values: Radiance seen in each view, on any pixels.
        views: Unit vectors, in the frame that the result is to have.
        p_max: Highest degree of the fit. Static.

    Returns:
        ``(*grid, (p_max + 1)^2, C)``.

    Raises:
        ValueError: If the shapes do not fit, or the views do not determine so many
            functions (12 icosahedral ones determine p_max = 2).
    """
    basis = HarmonicViews(p_max)
    count = len(basis.orders)
    if views.ndim != 2 or views.shape[1] != 3 or values.shape[:1] != views.shape[:1]:
        raise ValueError(
            "values and views must have shapes (V, ..., C) and (V, 3); got "
            f"{values.shape} and {views.shape}."
        )
    exact = np.asarray(basis.values(jnp.asarray(views)), np.float64)
    rank = int(np.linalg.matrix_rank(exact, tol=1e-4))
    if rank < count:
        raise ValueError(
            f"views must determine {count} functions for p_max={p_max}; these "
            f"{views.shape[0]} determine {rank}."
        )
    values = as_float("values", values)
    inverse = jnp.asarray(np.linalg.pinv(exact), values.dtype)  # [q, v]
    flat = values.reshape(values.shape[0], -1, values.shape[-1])
    fitted = einsum("qv,vnc->nqc", inverse, flat)
    return fitted.reshape(*values.shape[1:-1], count, values.shape[-1])
