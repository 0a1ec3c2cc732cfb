"""View bases: how a reflection map depends on the view, the one place that knows.

A map holds, for each direction R, coefficients of the outgoing radiance over the view in
R's frame (e_theta, e_phi, R). The functions of the view are the spherical harmonics
``Y_pq`` [T5, Eq. 5.10], the zonal ones of them, or a few that were fitted to the BRDF.
Whoever holds a basis asks it: for the signed order q of each of its functions, for their
values at a view, for its label, its size and the time that a look-up takes; nobody asks
which one it is.

References:
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
"""

from __future__ import annotations

import dataclasses
import functools
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from shjax.arrays import STATIC, Array, einsum
from shjax.harmonics import basis
from shjax.harmonics.degrees import degrees, orders
from shjax.harmonics.wigner import rotate_about_y, waves
from shjax.harmonics.wigner import tables as wigner_tables


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class HarmonicViews:
    """Spherical harmonics ``Y_pq`` of the view to degree ``p_max``, (p_max + 1)^2 of them.

    Attributes:
        p_max: Highest degree, inclusive.
        kind: Tells it from other bases of equal fields, which JAX's comparison of tree
            structures does not (0.10: a jitted function could run one for the other).
    """

    p_max: int = dataclasses.field(metadata=STATIC)
    kind: str = dataclasses.field(default="harmonic", metadata=STATIC)
    lookup_time: ClassVar[float] = 0.0
    bytes: ClassVar[int] = 0

    @property
    def label(self) -> str:
        """Short name: ``"harmonic"``, or ``"radial"`` where degree 0 is all."""
        return "harmonic" if self.p_max else "radial"

    @property
    def message(self) -> str:
        """Description in words."""
        if not self.p_max:
            return "a radial map"
        return f"a spherical harmonic reflection map, {_per_pixel(self)}"

    @property
    def orders(self) -> tuple[int, ...]:
        """Signed q of each function; negative for sines."""
        return tuple(int(q) for q in orders(self.p_max))

    def kernels(self, rho: Array) -> Array:
        """Kernel over the light's degree of each function, ``(L, Q, C)``, from rho_lpq."""
        p, q = degrees(self.p_max), np.abs(orders(self.p_max))
        size = self.p_max + 1
        flat = rho.reshape(*rho.shape[:-3], size * size, rho.shape[-1])
        return jnp.take(flat, p * size + q, axis=-2)

    def values(self, views: jax.Array) -> jax.Array:
        """Values of the functions at unit vectors ``(..., 3)``: ``(..., Q)``."""
        return basis(views, l_max=self.p_max)

    def to_world(self, maps: jax.Array, theta: jax.Array, phi: jax.Array) -> jax.Array:
        """Coefficients in R's frame to coefficients over the world's view [T5, Eq. 5.14].

        Args:
            maps: ``(n, m, Q, C)``.
            theta: Polar angle of R, the same along m: ``(n,)``.
            phi: Azimuth of R, ``(n, m)``.
        """
        dtype, q = maps.dtype, orders(self.p_max)
        about_y = _rotation_matrices(self.p_max, theta.astype(dtype))  # [n, Q, Q]
        if self.p_max:
            maps = einsum("nqs,nmsc->nmqc", about_y, maps)
        return _about_z(maps, phi, q)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class ZonalViews:
    """Zonal harmonics ``Y_p0`` of the view: no azimuth, P + 1 of them [T5, section 5.7.3].

    Attributes:
        p_max: Highest degree, inclusive; 0 makes a radial map.
        kind: As of :class:`HarmonicViews`.
    """

    p_max: int = dataclasses.field(metadata=STATIC)
    kind: str = dataclasses.field(default="zonal", metadata=STATIC)
    lookup_time: ClassVar[float] = 0.0
    bytes: ClassVar[int] = 0

    @property
    def label(self) -> str:
        """Short name: ``"zonal"``, or ``"radial"`` where degree 0 is all."""
        return "zonal" if self.p_max else "radial"

    @property
    def message(self) -> str:
        """Description in words."""
        if not self.p_max:
            return "a radial map"
        return f"a map without azimuth (zonal), {_per_pixel(self)}"

    @property
    def orders(self) -> tuple[int, ...]:
        """Signed q of each function: all zero."""
        return (0,) * (self.p_max + 1)

    def kernels(self, rho: Array) -> Array:
        """Kernel over the light's degree of each function, ``(L, P, C)``, from rho_lpq."""
        return rho[..., 0, :]

    def values(self, views: jax.Array) -> jax.Array:
        """Values of the functions at unit vectors ``(..., 3)``: ``(..., P)``."""
        zonal = np.arange(self.p_max + 1) * (np.arange(self.p_max + 1) + 1)
        return jnp.take(basis(views, l_max=self.p_max), zonal, axis=-1)


_LINES = 129


def view_lines() -> np.ndarray:
    """Angles about R of the table lines of :class:`LowRankViews`, ``(lines,)``, radians.

    Dense towards grazing views, where ``cos(theta_o / 2) = n.v`` vanishes.
    """
    return 2 * np.arccos(np.linspace(0, 1, _LINES) ** 2 * (1 - 1e-12))


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class LowRankViews:
    """Functions of the view of a low-rank approximation, tabulated (:func:`fit_low_rank`).

    Attributes:
        table: ``b_k(theta_o) / sin(theta_o / 2)^q`` at :func:`view_lines`, ``(J, lines)``.
        functions: The row of each map.
        orders: Signed q of each map; negative for sines.
    """

    table: jax.Array
    functions: tuple[int, ...] = dataclasses.field(metadata=STATIC)
    orders: tuple[int, ...] = dataclasses.field(metadata=STATIC)
    lookup_time: ClassVar[float] = 1.5  # to find the functions of a view in the table
    label: ClassVar[str] = "low-rank"

    @property
    def p_max(self) -> int:
        """Highest azimuthal order, which takes the place of the view's degree."""
        return max(self.orders)

    @property
    def bytes(self) -> int:
        """Size of the table."""
        return self.table.nbytes

    @property
    def message(self) -> str:
        """Description in words."""
        return f"a low-rank map, {_per_pixel(self)}"

    def values(self, views: jax.Array) -> jax.Array:
        """Values of the functions at unit vectors ``(..., 3)``: ``(..., Q)``."""
        x, y, z = views[..., 0], views[..., 1], views[..., 2]
        # n.v = cos(theta_o/2); towards grazing from sin(theta_o), since 1 + z cancels.
        across = jnp.sqrt(jnp.maximum(x * x + y * y, 1e-24))
        sine = jnp.sqrt(jnp.clip((1 - z) / 2, 0.25, 1))
        facing = jnp.sqrt(jnp.clip((1 + z) / 2, 0.25, 1))
        cosine = jnp.where(z < 0, across / (2 * sine), facing)
        place = jnp.sqrt(cosine) * (_LINES - 1)
        line = jnp.clip(jnp.floor(place), 0, _LINES - 2).astype(jnp.int32)
        share = place - line.astype(place.dtype)
        table = self.table.astype(views.dtype)
        low, high = (jnp.take(table, line + step, axis=1) for step in (0, 1))
        radial = low + jnp.broadcast_to(share, low.shape) * (high - low)  # [j, ...]
        rise = halfway(x / (2 * cosine), y / (2 * cosine), self.orders)
        return jnp.stack(
            [radial[j] * wave for j, wave in zip(self.functions, rise, strict=True)],
            axis=-1,
        )


def halfway(x: jax.Array, y: jax.Array, orders: tuple[int, ...]) -> list[jax.Array]:
    """Factors ``sin(theta_o/2)^q sqrt(2) (cos | sin) q phi_o``, without trigonometry.

    Args:
        x: The normal's component along e_theta of R, ``sin(theta_o/2) cos phi_o``.
        y: Along e_phi.
        orders: Signed q; 0 gives 1, negative ones sines. Static.
    """
    powers = [(jnp.ones_like(x), jnp.zeros_like(x))]
    for _ in range(max(abs(q) for q in orders)):
        a, b = powers[-1]
        powers.append((a * x - b * y, a * y + b * x))
    root = float(np.sqrt(2))
    return [powers[abs(q)][int(q < 0)] * (root if q else 1.0) for q in orders]


CoefficientViews = HarmonicViews | ZonalViews  # of BRDF coefficients
ViewBasis = CoefficientViews | LowRankViews


def _per_pixel(basis: ViewBasis) -> str:
    return f"{len(basis.orders)} coefficients per pixel"


def _about_z(maps: jax.Array, phi: jax.Array, q: np.ndarray) -> jax.Array:
    """Rotate pairs (q, -q) of maps ``(n, m, Q, C)`` by ``q phi``, phi ``(n, m)``."""
    angle = phi.astype(maps.dtype)
    table = jax.vmap(jax.vmap(functools.partial(waves, multiples=np.abs(q))))(angle)
    cosine, sine = (jnp.broadcast_to(w[..., None], maps.shape) for w in table)
    p = np.floor(np.sqrt(np.arange(q.size))).astype(int)
    mirrored = jnp.take(maps, p * (p + 1) - q, axis=2)
    signs = jnp.asarray(np.where(q > 0, -1, 1), maps.dtype)[None, None, :, None]
    return maps * cosine + mirrored * sine * jnp.broadcast_to(signs, maps.shape)


def _rotation_matrices(p_max: int, theta: jax.Array) -> jax.Array:
    """``d^p(theta)`` of all degrees as one block-diagonal matrix, ``(n, Q, Q)``."""
    size, q, p = p_max + 1, orders(p_max), degrees(p_max)
    vectors, frequencies = (np.asarray(t) for t in wigner_tables(p_max))
    vectors = jnp.asarray(vectors, theta.dtype)
    slots = (p * 2 + (q < 0)) * size + np.abs(q)  # in [p, block, q]
    unit = np.zeros((p.size, size * 2 * size))
    unit[np.arange(p.size), slots] = 1
    unit = unit.reshape(p.size, size, 2, size).transpose(1, 2, 3, 0)  # [p, block, q, s]
    unit = jnp.asarray(unit, theta.dtype)

    def one(angle):
        turned = rotate_about_y(unit, vectors, waves(angle, frequencies))
        return jnp.take(turned.reshape(-1, p.size), slots, axis=0)

    return jax.vmap(one)(theta)
