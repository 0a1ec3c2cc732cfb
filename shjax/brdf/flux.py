"""Outgoing flux of a BRDF and the angle that holds a share of it.

References:
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from shjax.brdf.core import Brdf
from shjax.brdf.quadrature import (
    azimuths_of,
    flux_by_angle,
    kind_of,
    light_nodes,
    nodes_for,
    transfer_at,
    view_nodes,
    weigh,
)


def lobe_angle(brdf: Brdf, share: float) -> float:
    """Angle about the centre that holds a share of the outgoing flux, radians.

    The transfer function itself is summed, not its square [T5, Eq. 5.30], over all views.
    """
    kind, dtype = kind_of(brdf), brdf.parts[0].weight.dtype
    theta_o, solid = view_nodes(24)
    theta, weight, end = light_nodes(tuple(theta_o.tolist()), kind, 64)
    arrays = (jnp.asarray(a, dtype) for a in (theta_o, theta, end))
    energy = np.asarray(flux_by_angle(brdf, kind, *arrays)) * weight * solid[:, None]
    rising = np.argsort(theta, axis=None)
    total = np.cumsum(energy.ravel()[rising])
    place = int(np.searchsorted(total, share * total[-1]))
    return float(theta.ravel()[rising][min(place, theta.size - 1)])


def outgoing_flux(
    brdf: Brdf, theta_o: jax.Array, n_light: int, n_phi: int
) -> jax.Array:
    """Outgoing flux ``int rho dw`` at views that are data, ``(O, C)``.

    Args:
        brdf: Prepared.
        theta_o: Polar angles of the views about the centre, ``(O,)``.
        n_light: Nodes in each piece of theta_i. Static.
        n_phi: Nodes in phi. Static.
    """
    kind = kind_of(brdf)
    theta, weight, end = nodes_for(theta_o, kind, n_light)

    def one_view(view):
        to, ti, w, last = view
        phi, share = azimuths_of(last, kind, n_phi)
        return jnp.sum(
            weigh(transfer_at(brdf, kind, to, ti, phi), w, share), axis=(1, 2)
        )

    return jax.vmap(one_view)((theta_o, theta, weight, end))
