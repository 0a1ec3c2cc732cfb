"""Free gains about the reflected direction, as a lobe for the joint estimate."""

from __future__ import annotations

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from shjax.brdf import Brdf
from shjax.brdf.core import Local, Parameters, ReflectanceModel, make_brdf


class FreeGains(NamedTuple):
    """Free gains ``a_l > 0`` about R as a lobe: the logarithm of each.

    Attributes:
        l_max: Highest degree.
    """

    l_max: int

    @property
    def names(self) -> tuple[str, ...]:
        """Names ``a_0``, ``a_1``, ..."""
        return tuple(f"a_{l}" for l in range(self.l_max + 1))

    def natural(self, free: jax.Array) -> jax.Array:
        """Gains ``(L, C)`` from their logarithms."""
        return jnp.exp(free)

    def brdf(self, free: jax.Array) -> Brdf:
        """BRDF of these gains, ``(L, C)``."""
        return make_brdf(_GAINS, gains=jnp.exp(free))

    def places(self, channels: int) -> np.ndarray:
        """Positions of each channel's gains in the solver's vector, ``(C, P)``."""
        return np.arange((self.l_max + 1) * channels).reshape(-1, channels).T

    def prior(self, channels: int) -> tuple[np.ndarray, np.ndarray]:
        """Prior means and standard deviations, around gains of 1."""
        size = (self.l_max + 1) * channels
        return np.zeros(size), np.ones(size)

    def place_of(self, name: str, value: float, channels: int):
        """Position of a named gain in the solver's vector, and its logarithm."""
        if name not in self.names:
            raise ValueError(
                f"known must name one of {', '.join(self.names)}; got {name!r}."
            )
        if not np.all(np.asarray(value) > 0):
            raise ValueError(f"known {name} must be positive; got {value}.")
        start = self.names.index(name) * channels
        return start + np.arange(channels), np.log(value)

    def starts(self, channels: int, own=None) -> np.ndarray:
        """Starting point of the search; there is one."""
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


_GAINS = ReflectanceModel("free gains", _lobe_of_gains, horizon=False, radial=_gains_to)
