"""Parametric reflectances in parameters that a solver can walk in without walls.

A family is a lobe with one or two shape parameters, shared by all channels, times ``ks``,
and a matte part ``kd``. Shapes are logarithms or logits; so are ``kd + ks``, which stays
below 1 in every channel, and the lobe's part of it. A weak Gaussian prior on these
parameters keeps what a picture does not determine finite, and its share in the answer
says so.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from shjax.brdf import Brdf
from shjax.brdf.core import Local, Model, Parameters, make_brdf
from shjax.brdf.ggx import ggx
from shjax.brdf.models import (
    gaussian_microfacet,
    lafortune,
    lambertian,
    phong,
    phong_cosine,
)

_AMPLITUDE_SPREAD = 3.0  # of the logits: from 0.002 to 0.998 within two of them
AMPLITUDE_VARIANCE = 1 / 12  # of an albedo of which nothing is known


class Shape(NamedTuple):
    """One shape parameter ``s`` and its unconstrained form ``u``.

    Attributes:
        name: The parameter's.
        natural: From u to s.
        free: From s to u.
        centre: Mean of the prior, in s.
        spread: Standard deviation of the prior, in u.
        starts: Where the search begins, in s.
    """

    name: str
    natural: Callable[[jax.Array], jax.Array]
    free: Callable[[np.ndarray], np.ndarray]
    centre: float
    spread: float
    starts: tuple[float, ...]


def _logit(s):
    return np.log(s) - np.log1p(-s)


_EXPONENT = Shape("exponent", jnp.exp, np.log, 30.0, 2.0, (2, 8, 40, 200, 1000))
_ALPHA = Shape("alpha", jax.nn.sigmoid, _logit, 0.2, 1.5, (0.05, 0.12, 0.3, 0.6))
_SIGMA = Shape("sigma", jnp.exp, np.log, 0.2, 1.0, (0.05, 0.12, 0.3, 0.6))
_TILT = Shape("tilt", jnp.exp, np.log, 1.0, 0.5, (1.0,))


def _tilted_lobe(exponent: jax.Array, tilt: jax.Array) -> Brdf:
    """A Lafortune lobe with ``cz / -cxy = tilt`` and the scale of a Phong lobe."""
    scale = jnp.sqrt((1 + tilt * tilt) / 2)
    lobe = lafortune((-1 / scale)[None], (tilt / scale)[None], exponent[None])
    return lobe * ((exponent + 2) / (2 * math.pi))


class Family(NamedTuple):
    """A parametric reflectance.

    Attributes:
        shapes: Its shape parameters.
        lobe: From them, each ``(C,)``, to the lobe of ``ks = 1``.
        diffuse: Whether there is a matte part too.
    """

    shapes: tuple[Shape, ...]
    lobe: Callable[..., Brdf]
    diffuse: bool = False

    @property
    def amplitudes(self) -> int:
        """How many a channel: kd and ks, or ks."""
        return 2 if self.diffuse else 1

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters, as they are reported."""
        return (*(s.name for s in self.shapes), *("kd", "ks")[-self.amplitudes :])

    def shares(self, logits: jax.Array) -> jax.Array:
        """Amplitudes ``(A, C)`` of their logits: of the total, and of the lobe's part."""
        total = jax.nn.sigmoid(logits[:1])
        if not self.diffuse:
            return total
        part = jax.nn.sigmoid(logits[1:])
        return jnp.concatenate([total * (1 - part), total * part])

    def natural(self, free: jax.Array) -> jax.Array:
        """Unconstrained parameters ``(P, C)`` as they are reported, ``(P, C)``."""
        shapes = [s.natural(u) for s, u in zip(self.shapes, free, strict=False)]
        return jnp.concatenate([jnp.stack(shapes), self.shares(free[len(shapes) :])])

    def brdf(self, free: jax.Array) -> Brdf:
        """The reflectance of unconstrained parameters ``(P, C)``."""
        values = self.natural(free)
        count = len(self.shapes)
        lobe = self.lobe(*values[:count]) * values[-1]
        return lobe + lambertian(values[count]) if self.diffuse else lobe

    def split(self, vector: jax.Array, channels: int) -> tuple[list[Brdf], jax.Array]:
        """Of the solver's vector: the parts, of one channel, and their amplitudes."""
        count = len(self.shapes)
        values = [s.natural(u)[None] for s, u in zip(self.shapes, vector, strict=False)]
        parts = [lambertian(jnp.ones(1, vector.dtype))] if self.diffuse else []
        shares = self.shares(vector[count:].reshape(-1, channels))
        return [*parts, self.lobe(*values)], shares

    def places(self, channels: int) -> np.ndarray:
        """Where each channel's parameters lie in the solver's vector, ``(C, P)``."""
        count = len(self.shapes)
        amplitudes = count + np.arange(self.amplitudes * channels).reshape(-1, channels)
        shapes = np.broadcast_to(np.arange(count)[:, None], (count, channels))
        return np.concatenate([shapes, amplitudes]).T

    def prior(self, channels: int) -> tuple[np.ndarray, np.ndarray]:
        """Means and standard deviations of the solver's vector."""
        shapes = np.array([float(s.free(np.array(s.centre))) for s in self.shapes])
        size = self.amplitudes * channels
        centre = np.concatenate([shapes, np.zeros(size)])
        spreads = np.array([s.spread for s in self.shapes])
        return centre, np.concatenate([spreads, np.full(size, _AMPLITUDE_SPREAD)])

    def place_of(self, name: str, value: float, channels: int):
        """Where a parameter of this name lies in the solver's vector, and its free form.

        Raises:
            ValueError: If there is none, or the value is outside its range.
        """
        names = [s.name for s in self.shapes]
        count = len(names)
        if name in names:
            places = np.array([names.index(name)])
            free = self.shapes[names.index(name)].free
        elif name == "total":
            places, free = count + np.arange(channels), _logit
        else:
            raise ValueError(
                f"known must name {', '.join(names)} or total; got {name!r}."
            )
        with np.errstate(all="ignore"):
            at = free(np.asarray(value, float))
        if not np.all(np.isfinite(at)):
            raise ValueError(f"known {name} must lie inside its range; got {value}.")
        return places, at

    def starts(self, channels: int, own=None) -> np.ndarray:
        """Where the search begins, ``(n, size of the vector)``.

        Args:
            channels: C.
            own: Natural values of the shapes, ``(n, shapes)``, in place of the usual.

        Raises:
            ValueError: If one's own do not fit or lie outside the parameters' range.
        """
        if own is None:
            grid = np.meshgrid(*(s.starts for s in self.shapes), indexing="ij")
            own = np.stack([g.ravel() for g in grid], axis=-1)
        own = np.asarray(own, float)
        own = own[:, None] if own.ndim == 1 else own
        if own.ndim != 2 or own.shape[1] != len(self.shapes) or not len(own):
            raise ValueError(
                f"starts must have shape (n, {len(self.shapes)}): "
                f"{', '.join(s.name for s in self.shapes)}; got {own.shape}."
            )
        with np.errstate(all="ignore"):
            columns = [s.free(c) for s, c in zip(self.shapes, own.T, strict=True)]
        free = np.stack(columns, axis=-1)
        if not np.all(np.isfinite(free)):
            raise ValueError(
                f"starts must lie inside the parameters' range; got {own}."
            )
        amplitudes = np.zeros((len(free), self.amplitudes * channels))
        return np.concatenate([free, amplitudes], axis=1)


class Gains(NamedTuple):
    """Free gains ``a_l > 0`` about R in place of a family: logarithms of each.

    Attributes:
        l_max: Highest degree.
    """

    l_max: int

    @property
    def names(self) -> tuple[str, ...]:
        """``a_0``, ``a_1``, ..."""
        return tuple(f"a_{l}" for l in range(self.l_max + 1))

    def natural(self, free: jax.Array) -> jax.Array:
        """Gains ``(L, C)``."""
        return jnp.exp(free)

    def brdf(self, free: jax.Array) -> Brdf:
        """A BRDF of these gains, ``(L, C)``."""
        return make_brdf(_GAINS, gains=jnp.exp(free))

    def places(self, channels: int) -> np.ndarray:
        """As in :class:`Family`."""
        return np.arange((self.l_max + 1) * channels).reshape(-1, channels).T

    def prior(self, channels: int) -> tuple[np.ndarray, np.ndarray]:
        """As in :class:`Family`: around 1."""
        size = (self.l_max + 1) * channels
        return np.zeros(size), np.ones(size)

    def place_of(self, name: str, value: float, channels: int):
        """As in :class:`Family`."""
        if name not in self.names:
            raise ValueError(
                f"known must name one of {', '.join(self.names)}; got {name!r}."
            )
        if not np.all(np.asarray(value) > 0):
            raise ValueError(f"known {name} must be positive; got {value}.")
        start = self.names.index(name) * channels
        return start + np.arange(channels), np.log(value)

    def starts(self, channels: int, own=None) -> np.ndarray:
        """As in :class:`Family`; there is one."""
        if own is not None:
            raise ValueError("starts are of shape parameters; free gains have none.")
        return np.zeros((1, (self.l_max + 1) * channels))


def _lobe_of_gains(parameters: Parameters, light: Local, view: Local) -> jax.Array:
    """``sum_l a_l (2 l + 1) / 4 pi P_l(R.l)``."""
    cosine = light.z * view.z - light.x * view.x - light.y * view.y
    gains = parameters["gains"]
    before, last, total = jnp.zeros_like(cosine), jnp.ones_like(cosine), 0.0
    for l in range(gains.shape[0]):
        total = total + gains[l] * (2 * l + 1) / (4 * math.pi) * last
        before, last = last, ((2 * l + 1) * cosine * last - l * before) / (l + 1)
    return jnp.asarray(total)


def _gains_to(parameters: Parameters, l_max: int) -> jax.Array:
    gains = parameters["gains"][: l_max + 1]
    return jnp.pad(gains, (0, l_max + 1 - gains.shape[0]))


_GAINS = Model("free gains", _lobe_of_gains, horizon=False, radial=_gains_to)

_FAMILIES = {
    "phong": Family((_EXPONENT,), phong),
    "phong_horizon": Family((_EXPONENT,), lambda s: phong(s, horizon=True)),
    "phong_cosine": Family((_EXPONENT,), phong_cosine),
    "gaussian_microfacet": Family((_SIGMA,), gaussian_microfacet),
    "ggx": Family((_ALPHA,), lambda a: ggx(a, jnp.ones_like(a))),
    "ggx_dielectric": Family((_ALPHA,), lambda a: ggx(a, jnp.full_like(a, 0.04))),
    "lafortune": Family((_EXPONENT, _TILT), _tilted_lobe),
}
NAMES = tuple(_FAMILIES)


def family(name: str) -> Family:
    """The family of a name, ``"diffuse + "`` in front for a matte part.

    Raises:
        ValueError: If there is none.
    """
    bare = name.removeprefix("diffuse + ")
    if bare not in _FAMILIES:
        raise ValueError(
            f"model must be radial, general, or one of {', '.join(NAMES)} (with "
            f"'diffuse + ' in front for a matte part); got {name!r}."
        )
    return _FAMILIES[bare]._replace(diffuse=bare != name)
