"""Families of parametric lobes, in parameters that a solver can search without walls.

A family is a lobe with one or two shape parameters, shared by all channels, times ``ks``,
and a diffuse part ``kd``. Shapes are logarithms or logits; so are ``kd + ks``, which stays
below 1 in every channel, and the lobe's part of it. A weak Gaussian prior on these
parameters keeps what a picture does not determine finite, and its share in the answer
says so.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import jax
import jax.numpy as jnp
import numpy as np

from shjax.brdf import Brdf
from shjax.brdf.models import (
    lambertian,
)

_AMPLITUDE_SPREAD = 3.0  # of the logits: from 0.002 to 0.998 within two of them


AMPLITUDE_VARIANCE = 1 / 12  # of an albedo of which nothing is known


class ShapeParameter(NamedTuple):
    """Shape parameter ``s`` of a lobe and its unconstrained form ``u``.

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


class Lobe(Protocol):
    """Reflectance with parameters that a solver searches, without walls.

    The solver's vector holds all channels' parameters in a form without bounds (*free*);
    what is reported is natural.
    """

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters of a channel, as they are reported."""
        ...

    def natural(self, free: jax.Array) -> jax.Array:
        """Parameters ``(P, C)`` as they are reported, from their free form."""
        ...

    def brdf(self, free: jax.Array) -> Brdf:
        """Reflectance of free parameters ``(P, C)``."""
        ...

    def places(self, channels: int) -> np.ndarray:
        """Positions of each channel's parameters in the solver's vector, ``(C, P)``."""
        ...

    def prior(self, channels: int) -> tuple[np.ndarray, np.ndarray]:
        """Means and standard deviations of the solver's vector."""
        ...

    def place_of(
        self, name: str, value: float, channels: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Positions of a named parameter in the solver's vector, and its free value."""
        ...

    def starts(self, channels: int, own: Any = None) -> np.ndarray:
        """Vectors at which the search begins, ``(n, size)``."""
        ...


class LobeFamily(NamedTuple):
    """Parametric lobe: shape parameters, an amplitude ``ks``, and perhaps ``kd`` below it.

    Implements :class:`Lobe`. Made by name with :func:`lobe`, or of one's own.

    Attributes:
        shapes: Its shape parameters.
        lobe: From them, each ``(C,)``, to the BRDF of ``ks = 1``.
        diffuse: Whether there is a diffuse part too.
    """

    shapes: tuple[ShapeParameter, ...]
    lobe: Callable[..., Brdf]
    diffuse: bool = False

    @property
    def amplitudes(self) -> int:
        """Number of amplitudes per channel: kd and ks, or ks."""
        return 2 if self.diffuse else 1

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, as they are reported."""
        return (*(s.name for s in self.shapes), *("kd", "ks")[-self.amplitudes :])

    def shares(self, logits: jax.Array) -> jax.Array:
        """Amplitudes ``(A, C)`` of their logits: of the total, and of the lobe's part."""
        total = jax.nn.sigmoid(logits[:1])
        if not self.diffuse:
            return total
        part = jax.nn.sigmoid(logits[1:])
        return jnp.concatenate([total * (1 - part), total * part])

    def natural(self, free: jax.Array) -> jax.Array:
        """Parameters as they are reported, ``(P, C)``, from unconstrained ones."""
        shapes = [s.natural(u) for s, u in zip(self.shapes, free, strict=False)]
        return jnp.concatenate([jnp.stack(shapes), self.shares(free[len(shapes) :])])

    def brdf(self, free: jax.Array) -> Brdf:
        """BRDF of unconstrained parameters ``(P, C)``."""
        values = self.natural(free)
        count = len(self.shapes)
        lobe = self.lobe(*values[:count]) * values[-1]
        return lobe + lambertian(values[count]) if self.diffuse else lobe

    def split(self, vector: jax.Array, channels: int) -> tuple[list[Brdf], jax.Array]:
        """Parts, of one channel, and their amplitudes, from the solver's vector."""
        count = len(self.shapes)
        values = [s.natural(u)[None] for s, u in zip(self.shapes, vector, strict=False)]
        parts = [lambertian(jnp.ones(1, vector.dtype))] if self.diffuse else []
        shares = self.shares(vector[count:].reshape(-1, channels))
        return [*parts, self.lobe(*values)], shares

    def places(self, channels: int) -> np.ndarray:
        """Positions of each channel's parameters in the solver's vector, ``(C, P)``."""
        count = len(self.shapes)
        amplitudes = count + np.arange(self.amplitudes * channels).reshape(-1, channels)
        shapes = np.broadcast_to(np.arange(count)[:, None], (count, channels))
        return np.concatenate([shapes, amplitudes]).T

    def prior(self, channels: int) -> tuple[np.ndarray, np.ndarray]:
        """Prior means and standard deviations of the solver's vector."""
        shapes = np.array([float(s.free(np.array(s.centre))) for s in self.shapes])
        size = self.amplitudes * channels
        centre = np.concatenate([shapes, np.zeros(size)])
        spreads = np.array([s.spread for s in self.shapes])
        return centre, np.concatenate([spreads, np.full(size, _AMPLITUDE_SPREAD)])

    def place_of(self, name: str, value: float, channels: int):
        """Position of a named parameter in the solver's vector, and its free form.

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
        """Starting points of the search, ``(n, size of the vector)``.

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
