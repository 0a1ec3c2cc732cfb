"""Parametric reflectances in parameters that a solver can walk in without walls.

A family is a lobe with one or two shape parameters, shared by all channels, times ``ks``,
and a diffuse part ``kd``. Shapes are logarithms or logits; so are ``kd + ks``, which stays
below 1 in every channel, and the lobe's part of it. A weak Gaussian prior on these
parameters keeps what a picture does not determine finite, and its share in the answer
says so.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from shjax.brdf import Brdf
from shjax.brdf.fibres import charlie
from shjax.brdf.ggx import ggx
from shjax.brdf.models import (
    gaussian_microfacet,
    lafortune,
    phong,
    phong_cosine,
)
from shjax.inverse.reflectance.families import LobeFamily, ShapeParameter, _logit

_EXPONENT = ShapeParameter(
    "exponent", jnp.exp, np.log, 30.0, 2.0, (2, 8, 40, 200, 1000)
)
_ALPHA = ShapeParameter(
    "alpha", jax.nn.sigmoid, _logit, 0.2, 1.5, (0.05, 0.12, 0.3, 0.6)
)
_SIGMA = ShapeParameter("sigma", jnp.exp, np.log, 0.2, 1.0, (0.05, 0.12, 0.3, 0.6))
_TILT = ShapeParameter("tilt", jnp.exp, np.log, 1.0, 0.5, (1.0,))


def _tilted_lobe(exponent: jax.Array, tilt: jax.Array) -> Brdf:
    """A Lafortune lobe with ``cz / -cxy = tilt`` and the scale of a Phong lobe."""
    scale = jnp.sqrt((1 + tilt * tilt) / 2)
    lobe = lafortune((-1 / scale)[None], (tilt / scale)[None], exponent[None])
    return lobe * ((exponent + 2) / (2 * math.pi))


FAMILIES = {
    "phong": LobeFamily((_EXPONENT,), phong),
    "phong_horizon": LobeFamily((_EXPONENT,), lambda s: phong(s, horizon=True)),
    "phong_cosine": LobeFamily((_EXPONENT,), phong_cosine),
    "gaussian_microfacet": LobeFamily((_SIGMA,), gaussian_microfacet),
    "ggx": LobeFamily((_ALPHA,), lambda a: ggx(a, jnp.ones_like(a))),
    "ggx_dielectric": LobeFamily((_ALPHA,), lambda a: ggx(a, jnp.full_like(a, 0.04))),
    "lafortune": LobeFamily((_EXPONENT, _TILT), _tilted_lobe),
    "charlie": LobeFamily((_ALPHA,), charlie),
}


class Radial(NamedTuple):
    """Free gains ``a_l`` about the reflected direction, for :func:`shjax.estimate_brdf`.

    Attributes:
        l_max: Highest degree returned (of :func:`shjax.estimate_joint` the light's own).
        fit_l_max: Highest degree fitted; default 8 beyond, as far as the lighting goes.
    """

    l_max: int = 8
    fit_l_max: int | None = None


class General(NamedTuple):
    """Free coefficients ``rho_lpq`` of any isotropic BRDF, for :func:`estimate_brdf`.

    Attributes:
        l_max: Highest degree over the light that is returned.
        p_max: Highest degree over the view.
        fit_l_max: Highest degree fitted; default 8 beyond, as far as the lighting goes.
    """

    l_max: int = 8
    p_max: int = 2
    fit_l_max: int | None = None


class LobeSearch(NamedTuple):
    """Lobe to be searched, with what is known of it; made by :func:`lobe`.

    Attributes:
        kind: The lobe.
        starts: Natural values of its shape parameters at which the search begins.
        known: Parameters that are not to be estimated, by name.
    """

    kind: LobeFamily | Radial | General
    starts: Any = None
    known: dict[str, float] = {}  # noqa: RUF012 - never written to


def lobe(name: str, *, starts: Any = None, known: dict | None = None) -> LobeSearch:
    """Lobe by name, for :func:`shjax.estimate_brdf` and :func:`shjax.estimate_joint`.

    Args:
        name: ``"radial"`` (:class:`Radial`), ``"general"`` (:class:`General`), or a
            parametric lobe, with ``"diffuse + "`` in front if a diffuse part lies under
            it: ``"phong"``, ``"phong_horizon"``, ``"phong_cosine"``,
            ``"gaussian_microfacet"``, ``"ggx"`` (f0 = 1), ``"ggx_dielectric"``
            (f0 = 0.04), ``"lafortune"`` (exponent, and ``tilt = cz / -cxy``),
            ``"charlie"`` (sheen).
        starts: Of the shape parameters, ``(n,)`` or ``(n, shapes)``, in place of the
            usual ones.
        known: Of :func:`shjax.estimate_joint`, parameters that are not to be estimated:
            a shape by its name, ``"total"`` for ``kd + ks``, or ``"a_0"``, ``"a_1"``, ...

    Raises:
        ValueError: If there is none of that name.
    """
    return LobeSearch(_named(name), starts, dict(known or {}))


def _named(name: str) -> LobeFamily | Radial | General:
    if name == "radial":
        return Radial()
    if name == "general":
        return General()
    bare = str(name).removeprefix("diffuse + ")
    if bare not in FAMILIES:
        raise ValueError(
            f"lobe must be radial, general, or one of {', '.join(FAMILIES)} (with "
            f"'diffuse + ' in front for a diffuse part); got {name!r}."
        )
    return FAMILIES[bare]._replace(diffuse=bare != name)


AnyLobe = str | LobeFamily | Radial | General | LobeSearch


def as_search(given: AnyLobe) -> LobeSearch:
    """A lobe given by name or as an object, with what is known of it."""
    if isinstance(given, LobeSearch):
        return given
    kind = _named(given) if isinstance(given, str) else given
    if not isinstance(kind, LobeFamily | Radial | General):
        raise ValueError(
            f"lobe must be a name or what lobe() gives; got {type(given).__name__}."
        )
    return LobeSearch(kind)
