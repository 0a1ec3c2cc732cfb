"""A BRDF as a convolution kernel: rho_lpq by quadrature, closed forms where they exist.

About its centre (the reflected direction R; the tangent for fibres) the transfer function
is ``rho = sum rho_lp|q| Y_lq(light) Y_pq(view)`` [T5, Eq. 5.7 and section 5.6.2]: real, for
an isotropic BRDF equal for q and -q, zero for q > min(l, p).

References:
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
"""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import STATIC, Array, einsum, shape_of
from shjax.brdf.core import Brdf, Part
from shjax.brdf.projection import settled
from shjax.brdf.quadrature import (
    Resolution,
    kind_of,
    view_nodes,
)
from shjax.harmonics.degrees import check_l_max
from shjax.harmonics.legendre import legendre
from shjax.harmonics.tables import cached


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class BrdfExpansion:
    """Spherical harmonic expansion of a BRDF: coefficients, energies and their error.

    Attributes:
        rho: ``(l_max + 1, p_max + 1, p_max + 1, C)``, indexed ``[l, p, q]``.
        degree_energy: Energy of each degree l over all p and q, ``(l_max + 1, C)``.
        total_energy: Energy over all l, p and q, ``(C,)``: the right side of [T5, 5.18].
        error: Change of ``rho`` in the last doubling of the resolution, relative.
        centre: ``"reflection"`` or ``"tangent"``. Static.
        resolution: What the quadrature ended with. Static.
        brdf: What was expanded; None where a file was read.
    """

    rho: Float[Array, "L P P C"]
    degree_energy: Float[Array, "L C"]
    total_energy: Float[Array, " C"]
    error: Float[Array, ""]
    centre: str = dataclasses.field(metadata=STATIC)
    resolution: Resolution = dataclasses.field(metadata=STATIC)
    brdf: Brdf | None = None

    @property
    def l_max(self) -> int:
        """Highest degree of the light."""
        return self.rho.shape[0] - 1

    @property
    def p_max(self) -> int:
        """Highest degree of the view."""
        return self.rho.shape[1] - 1


def degrees_of_rho(rho: Array, name: str = "rho") -> tuple[int, int]:
    """Degrees ``(l_max, p_max)`` of BRDF coefficients, from their shape.

    Raises:
        ValueError: If they are no array or do not have that shape.
    """
    shape = shape_of(name, rho)
    if len(shape) < 4 or shape[-3] != shape[-2] or 0 in shape[-4:]:
        raise ValueError(
            f"{name} must have shape (..., l_max + 1, p_max + 1, p_max + 1, C); got "
            f"{shape}."
        )
    return shape[-4] - 1, shape[-3] - 1


def brdf_coefs(
    brdf: Brdf,
    *,
    l_max: int,
    p_max: int,
    accuracy: float = 1e-5,
    resolution: Resolution | None = None,
) -> Float[jax.Array, "L P P C"]:
    """Spherical harmonic coefficients rho_lpq of a BRDF [T5, Eq. 5.22].

    Closed forms serve radial models (Phong about R; a Lambertian part by a sum over one
    angle); all else is integrated, with nodes doubled until the coefficients change by
    less than ``accuracy``. Inside ``jit`` or a derivative, where that cannot be decided,
    the resolution is ``resolution``, or twice the first one tried.

    Args:
        brdf: The reflectance.
        l_max: Highest degree of the light, inclusive. Static.
        p_max: Highest degree of the view, inclusive. Static.
        accuracy: Relative change at which doubling stops. Static.
        resolution: Nodes to use instead. Static.

    Returns:
        ``(l_max + 1, p_max + 1, p_max + 1, C)``, sr^-1, indexed ``[l, p, q]``, q >= 0.

    Raises:
        ValueError: If a degree is out of range, ``accuracy`` not positive, or parts about
            the tangent are mixed with others.
    """
    l_max, p_max = check_l_max(l_max), check_l_max(p_max, "p_max")
    kind_of(brdf)
    shape = (l_max + 1, p_max + 1, p_max + 1, brdf.channels)
    rest = tuple(part for part in brdf.parts if part.model.radial is None)
    total = jnp.zeros(shape, brdf.parts[0].weight.dtype)
    for part in brdf.parts:
        if part.model.radial is not None:
            closed = _closed_form(part, l_max=l_max, p_max=p_max)
            total = total + jnp.broadcast_to(closed, shape)
    if rest:
        measured, _, _ = settled(Brdf(rest), l_max, p_max, p_max, accuracy, resolution)
        total = total + jnp.broadcast_to(measured.rho, shape)
    return total


def expand(
    brdf: Brdf,
    *,
    l_max: int,
    p_max: int,
    accuracy: float = 1e-5,
    resolution: Resolution | None = None,
    check: float = 2.0,
) -> BrdfExpansion:
    """Expand a BRDF in spherical harmonics, with its energies [T5, 5.15 to 5.18].

    Args:
        brdf: The reflectance.
        l_max: Highest degree of the light, inclusive; for :func:`predicted_error` that of
            the light's spectrum. Static.
        p_max: Highest degree of the view, inclusive. Static.
        accuracy: Relative change at which doubling stops. Static.
        resolution: Nodes to use instead; the error is then unknown (NaN). Static.
        check: So many times the first nodes the result is compared with. Static.

    Returns:
        The expansion.

    Raises:
        ValueError: As :func:`brdf_coefs`.
    """
    l_max, p_max = check_l_max(l_max), check_l_max(p_max, "p_max")
    q_max = max(l_max, p_max)
    found, error, used = settled(
        brdf, l_max, p_max, q_max, accuracy, resolution, check=check
    )
    centre = "tangent" if kind_of(brdf) == "tangent" else "reflection"
    return BrdfExpansion(
        found.rho,
        found.degree_energy,
        found.total_energy,
        error,
        centre,
        used,
        brdf,
    )


def coefs_and_energy(
    brdf: Brdf, *, l_max: int, p_max: int, accuracy: float = 1e-3
) -> tuple[Float[jax.Array, "L P P C"], Float[jax.Array, " C"], Float[jax.Array, ""]]:
    """Coefficients, total energy and quadrature error of a BRDF.

    Args:
        brdf: The reflectance.
        l_max: Highest degree of the light, inclusive. Static.
        p_max: Highest degree of the view, inclusive. Static.
        accuracy: Relative change at which doubling stops. Static.
    """
    found, error, _ = settled(brdf, l_max, p_max, p_max, accuracy, None)
    return found.rho, found.total_energy, error


def radial_coefs(brdf: Brdf, *, l_max: int) -> Float[jax.Array, "L C"]:
    """Convolution gains ``a_l`` of a radially symmetric BRDF: ``B_lm = a_l L_lm``.

    Args:
        brdf: Lambertian or horizon-free Phong parts, all about the same centre.
        l_max: Highest degree, inclusive. Static.

    Returns:
        ``(l_max + 1, C)``; albedo at l = 0.

    Raises:
        ValueError: If a part is not radial, or the centres differ.
    """
    centres = {part.model.centre for part in brdf.parts}
    names = [part.model.name for part in brdf.parts if part.model.radial is None]
    if names or len(centres) > 1:
        raise ValueError(
            "brdf must be radial about one centre; got "
            f"{', '.join(names) or 'parts about ' + ' and '.join(sorted(centres))}."
        )
    gains = [radial_gains(part, check_l_max(l_max)) for part in brdf.parts]
    shape = (l_max + 1, brdf.channels)
    return functools.reduce(jnp.add, [jnp.broadcast_to(g, shape) for g in gains])


def radial_gains(part: Part, l_max: int) -> jax.Array:
    """Convolution gains ``a_l`` of one radial part, ``(l_max + 1, C)``."""
    radial = part.model.radial
    assert radial is not None
    gains = jax.vmap(radial, in_axes=(-1, None), out_axes=-1)(part.parameters, l_max)
    return gains * jnp.broadcast_to(part.weight[None], gains.shape)


@functools.partial(jax.jit, static_argnames=("l_max", "p_max"))
def _closed_form(part: Part, *, l_max: int, p_max: int) -> jax.Array:
    gains = radial_gains(part, l_max)
    if part.model.centre == "normal":
        table = jnp.asarray(_normal_table(l_max, p_max), gains.dtype)
        return einsum("lc,lpq->lpqc", gains, table)
    # Radial about R: only p = q = 0, and B = sum_l a_l L_lm Y_lm(R).
    root = jnp.sqrt(jnp.asarray(2 * np.arange(l_max + 1) + 1, gains.dtype))[:, None]
    shape = (l_max + 1, p_max + 1, p_max + 1, gains.shape[-1])
    column = gains * jnp.broadcast_to(root, gains.shape)
    return jnp.zeros(shape, gains.dtype).at[:, 0, 0].set(column)


@cached
def _normal_table(l_max: int, p_max: int) -> np.ndarray:
    """``2 pi int f_lq(to / 2) f_pq(to) sin to d to``: ``(L, P, P)`` (math.md, section 4).

    The normal lies at to / 2, halfway between the view and R.
    """
    theta, weight = view_nodes(l_max + 2 * p_max + 16)
    table = np.zeros((l_max + 1, p_max + 1, p_max + 1))
    for q in range(min(l_max, p_max) + 1):
        here = legendre(l_max, q, np.cos(theta / 2), np.sin(theta / 2))
        there = legendre(p_max, q, np.cos(theta), np.sin(theta))
        table[:, :, q] = 2 * np.pi * (here * weight) @ there.T
    return table
