"""Windows: gains that fall with the degree, against ringing.

A truncated expansion of a small bright light rings: its irradiance falls below zero on
the other side. A window damps the high degrees.

References:
    [Sloan17] P.-P. Sloan, Deringing Spherical Harmonics, SIGGRAPH Asia Technical Briefs,
    2017.
    [Duchon79] C. Duchon, Lanczos Filtering in One and Two Dimensions, J. Applied
    Meteorology, 1979.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array, as_float, check_count, known_values, matmul
from shjax.clamped_cosine import irradiance, irradiance_coefs
from shjax.harmonics.degrees import check_l_max, degree_of_coefs, scale_degrees
from shjax.harmonics.evaluation import basis
from shjax.harmonics.spectrum import laplacian
from shjax.sphere import fibonacci_directions
from shjax.vectors import normalize

_WINDOWS = {
    "none": lambda x: np.ones_like(x),
    "hann": lambda x: (1 + np.cos(np.pi * x)) / 2,
    "lanczos": np.sinc,
    "sinc^4": lambda x: np.sinc(x) ** 4,
}
NAMES = (*_WINDOWS, "automatic")
_DIM = 1e-3  # of the brightest channel's mean: below, a channel is smoothed by itself


def window(
    name: str, l_max: int, *, width: float | None = None
) -> Float[jax.Array, " L"]:
    """Window gains that damp ringing, at the degrees 0 to ``l_max``, by name.

    With x = l / width: ``"none"`` 1; ``"hann"`` (1 + cos pi x) / 2; ``"lanczos"``
    sin(pi x) / (pi x); ``"sinc^4"`` its fourth power (cmgen's); zero for x > 1.

    Args:
        name: The window.
        l_max: Highest degree, inclusive.
        width: The degree where it reaches zero; default ``l_max + 1``.

    Returns:
        ``(l_max + 1,)``, in JAX's default floating-point type.

    Raises:
        ValueError: If the name is unknown or the width not positive.

    >>> [f"{gain:.3f}" for gain in window("hann", 2)]
    ['1.000', '0.750', '0.250']
    """
    if not isinstance(name, str) or name.lower() not in _WINDOWS:
        given = repr(name) if isinstance(name, str) else type(name).__name__
        raise ValueError(f"name must be one of {', '.join(_WINDOWS)}; got {given}.")
    name = name.lower()
    width = check_l_max(l_max) + 1 if width is None else width
    if not width > 0:
        raise ValueError(f"width must be positive; got {width}.")
    x = np.arange(l_max + 1) / width
    gains = np.where((x <= 1) | (name == "none"), _WINDOWS[name](x), 0)
    return jnp.asarray(gains, jnp.result_type(float))


class Deringed(NamedTuple):
    """Deringed lighting, whose irradiance is nowhere negative.

    Attributes:
        lighting: Coefficients, ``(K, C)``.
        gains: What each degree was multiplied by, ``(l_max + 1,)``, in all channels
            that are not nearly black.
        strength: The smoothing, the most of any channel; 0 where nothing rang.
        smallest: Smallest irradiance of ``lighting`` over its mean, the worst channel.
    """

    lighting: jax.Array
    gains: jax.Array
    strength: float
    smallest: float


def dering(lighting: Float[Array, "K C"], *, steps: int = 40) -> Deringed:
    """Dering lighting: the least smoothing that leaves irradiance non-negative [Sloan17].

    Gains ``1 / (1 + s l^2 (l + 1)^2)``, the minimisers of error plus s times the squared
    Laplacian, with the smallest s >= 0 for which no normal of any channel receives
    negative irradiance; found by bisection. Light that does not ring is left alone.
    Channels whose mean is below a thousandth of the brightest one's have an s of their
    own: noise in a black channel does not smooth the others. Runs eagerly: how much
    smoothing is needed is data.

    Args:
        lighting: Radiance coefficients.
        steps: Of the bisection.

    Returns:
        A :class:`Deringed`.

    Raises:
        ValueError: If the shape is wrong, a value is not finite, or a channel's mean is
            negative, or zero while its other coefficients are not: no light has that,
            and no window can mend it.
    """
    l_max = degree_of_coefs(lighting, "lighting")
    lighting = as_float("lighting", lighting)
    if lighting.ndim != 2:
        raise ValueError(f"lighting must have shape (K, C); got {lighting.shape}.")
    check_count("steps", steps)
    concrete = known_values("lighting", lighting)
    if not np.all(np.isfinite(concrete)):
        raise ValueError("lighting must be finite.")
    mean, lit = concrete[0], np.any(concrete != 0, axis=0)
    if np.any(mean < 0) or np.any(lit & (mean == 0)):
        bad = int(np.flatnonzero((mean < 0) | (lit & (mean == 0)))[0])
        raise ValueError(
            "lighting must have a mean > 0 in every channel that is not black; channel "
            f"{bad} has L_00 = {mean[bad]:.3g}."
        )
    dim = lit & (mean < _DIM * mean.max())
    groups = [np.flatnonzero(lit & ~dim), *np.flatnonzero(dim)[:, None]]
    result, strongest, worst = lighting, 0.0, np.inf
    gains = np.ones(l_max + 1)
    for channels in groups:
        if not channels.size:
            continue
        found, strength, smallest = _least_smoothing(
            jnp.take(lighting, channels, axis=1), l_max, steps
        )
        result = result.at[:, channels].set(found)
        if channels is groups[0]:
            gains = _gains(strength, l_max)
        strongest, worst = max(strongest, strength), min(worst, smallest)
    return Deringed(
        result,
        jnp.asarray(gains, lighting.dtype),
        strongest,
        worst if np.isfinite(worst) else 0.0,
    )


def _least_smoothing(
    lighting: jax.Array, l_max: int, steps: int
) -> tuple[jax.Array, float, float]:
    """The smoothed light of some channels, the strength, and what it leaves."""
    # In units of each channel's mean: a dim channel keeps its digits.
    unit = lighting / jnp.broadcast_to(lighting[:1], lighting.shape)

    def smallest(strength: float) -> float:
        return float(smallest_irradiance(_smoothed(unit, strength, l_max)))

    low, high = 0.0, 0.0
    if smallest(0.0) < 0:
        high = 1e-4
        while smallest(high) < 0 and high < 1e30:
            low, high = high, high * 4
        for _ in range(steps):
            middle = (low + high) / 2
            low, high = (low, middle) if smallest(middle) >= 0 else (middle, high)
    return _smoothed(lighting, high, l_max), high, smallest(high)


def _gains(strength: float, l_max: int) -> np.ndarray:
    return 1 / (1 + strength * laplacian(l_max) ** 2)


def _smoothed(lighting: jax.Array, strength: float, l_max: int) -> jax.Array:
    return scale_degrees(lighting, jnp.asarray(_gains(strength, l_max), lighting.dtype))


@jax.jit
def smallest_irradiance(lighting: Float[Array, "K C"]) -> Float[jax.Array, ""]:
    """Minimum irradiance over all normals and channels, over the channel's mean.

    The best of 2000 normals is improved by Newton steps on the sphere.

    Args:
        lighting: Radiance coefficients.

    Returns:
        The ratio; negative where the expansion rings. 0 for black light.

    Raises:
        ValueError: If the shape is wrong.
    """
    l_max = degree_of_coefs(lighting, "lighting")
    lighting = as_float("lighting", lighting)
    normals, functions = _scan_table(l_max)
    reflected = irradiance_coefs(lighting)
    values = matmul(
        jnp.asarray(functions, lighting.dtype),
        reflected,
    )
    starts = jnp.asarray(normals, lighting.dtype)[jnp.argmin(values, axis=0)]

    def refine(column, normal):
        def value(n):
            return irradiance(column[:, None], normalize(n))[0]

        def step(_, n):
            gradient, hessian = jax.grad(value)(n), jax.hessian(value)(n)
            # Damped along n, where the normalised function is flat.
            damping = jnp.eye(3, dtype=n.dtype) * 1e-6 * jnp.abs(column[0])
            system = hessian + jnp.outer(n, n) * (1 + jnp.abs(column[0])) + damping
            moved = normalize(n - jnp.linalg.solve(system, gradient))
            return jnp.where(value(moved) < value(n), moved, n)

        return value(jax.lax.fori_loop(0, 4, step, normal))

    refined = jax.vmap(refine, in_axes=(1, 0))(lighting, starts)
    mean = lighting[0] * float(np.sqrt(np.pi / 4))
    return jnp.min(refined / jnp.where(mean > 0, mean, 1))


@functools.lru_cache(maxsize=8)
def _scan_table(l_max: int) -> tuple[np.ndarray, np.ndarray]:
    normals = fibonacci_directions(2000)
    with jax.ensure_compile_time_eval():
        functions = basis(normals, l_max=l_max)
    return normals, np.asarray(functions)


def apply_window(lighting: Float[Array, "K C"], name: str) -> Float[jax.Array, "K C"]:
    """Apply a named window to lighting, ``"automatic"`` among them (:func:`dering`).

    Args:
        lighting: Radiance coefficients.
        name: One of :data:`NAMES`.

    Returns:
        Coefficients of the same shape.

    Raises:
        ValueError: If the name is unknown.
    """
    if name.lower() == "automatic":
        return dering(lighting).lighting
    lighting = as_float("lighting", lighting)
    gains = window(name, degree_of_coefs(lighting, "lighting"))
    return scale_degrees(lighting, gains.astype(lighting.dtype))
