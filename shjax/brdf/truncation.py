"""Truncation: how many degrees a light and a BRDF need, and the error of keeping fewer.

Two ways lead to the degrees (F, P): the thesis's, from the BRDF's energy alone [T5, 5.15 to
5.18], and the exact one, which also knows the light's power spectrum: integrated over
all orientations and views the squared reflected radiance is
``sum_lpq 4 pi / (2 l + 1) S_l rho_lpq^2``, by orthogonality of the rotation matrices.

Errors are asked for in rms; an error in *energy*, as the thesis's tables have it, is the
square.

References:
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
"""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array, as_float, check_channels, known_values, safe_sqrt
from shjax.brdf.core import Brdf
from shjax.brdf.expansion import BrdfExpansion, coefs_and_energy
from shjax.brdf.quadrature import order_counts

_L_LIMIT, _P_LIMIT = 256, 32


def lighting_degree(spectrum: Float[Array, "L C"], *, rms_error: float) -> int:
    """Smallest degree that holds a light within an rms error [T5, Eqs. 5.15, 5.16].

    Args:
        spectrum: Power of each degree (:func:`shjax.power_spectrum`); what lies beyond it
            is taken as zero.
        rms_error: Relative; its square is the share of the energy, summed over channels,
            that may be lost.

    Raises:
        ValueError: If the error is not between 0 and 1.
    """
    energy_error = _energy(rms_error)
    check_channels("spectrum", spectrum, "L, C", 2, batch=False)
    held = np.cumsum(known_values("spectrum", spectrum).astype(np.float64).sum(axis=-1))
    return int(np.argmax(held >= (1 - energy_error) * held[-1]))


def energy_held(expansion: BrdfExpansion) -> Float[np.ndarray, "L P"]:
    """Energy of a BRDF that the degrees ``(F, P)`` hold, as a share [T5, 5.18].

    Args:
        expansion: Of the BRDF (:func:`shjax.brdf.expand`).
    """
    return _held(expansion.rho, expansion.total_energy)


def _held(rho: Array, total_energy: Array) -> np.ndarray:
    squares = np.sum(np.asarray(rho, np.float64) ** 2, axis=-1)
    squares = squares @ order_counts(rho.shape[1] - 1)
    held = np.cumsum(np.cumsum(squares, axis=0), axis=1)
    return held / np.sum(np.asarray(total_energy, np.float64))


def choose_degrees(brdf: Brdf, *, rms_error: float) -> tuple[int, int]:
    """Choose degrees ``(l_max, p_max)`` that hold a BRDF within an rms error [T5, 5.18].

    By the BRDF's energy alone, whatever the light: for a given light
    :func:`shjax.choose_model` needs fewer. Energies are summed over channels. Of all
    pairs that suffice the one with the smallest cost ``F^2 P^2 + F P^2 S`` at S = 2 F,
    ties to the smaller P, then the smaller F: so a radial map (P = 0), which costs
    nothing by that count, is taken wherever it suffices.

    Args:
        brdf: The reflectance; concrete (this runs eagerly).
        rms_error: Relative, in (0, 1); its square is the share of the energy that may be
            lost, which the thesis's tables name.

    Raises:
        ValueError: If the error is not between 0 and 1, or no pair up to (256, 32) is
            enough; the message says what the largest holds.
    """
    energy_error = _energy(rms_error)
    l_max, p_max = 32, 8
    while True:
        rho, total, _ = coefs_and_energy(brdf, l_max=l_max, p_max=p_max)
        if not np.any(np.asarray(total)):
            return 0, 0
        held = _held(rho, total)
        # A longer table must not offer a cheaper pair: its last octave is negligible.
        octave = held[-1, -1] - held[l_max // 2, -1]
        if octave > energy_error / 10 and l_max < _L_LIMIT:
            l_max *= 2
        elif held[-1, -1] < 1 - energy_error and p_max < _P_LIMIT:
            p_max *= 2
        else:
            break
    enough = held >= 1 - energy_error
    if not np.any(enough):
        raise ValueError(
            f"rms_error={rms_error:g} is not reached: F={l_max}, P={p_max} hold "
            f"{held[-1, -1]:.4f} of the energy."
        )
    pairs = [(3 * f * f * p * p, p, f) for f, p in np.argwhere(enough).tolist()]
    _, best_p, best_f = min(pairs)
    return best_f, best_p


def _energy(rms_error: float) -> float:
    """Share of the energy that an rms error allows to lose."""
    if not 0 < rms_error < 1:
        raise ValueError(f"rms_error must lie in (0, 1); got {rms_error}.")
    return rms_error**2


def residual_heuristic(
    spectrum: Float[Array, "L C"], gains: Float[Array, "L D"], *, l_max: int
) -> float:
    """Residual heuristic: the thesis's estimate of the energy error [T5, Eq. 5.19].

    For a radial BRDF. A heuristic, no bound: it has Lambda where energy has its square.
    For the error itself see :func:`predicted_rms_error`.

    Args:
        spectrum: Power of the light, as far as it goes.
        gains: ``a_l`` of the BRDF (:func:`shjax.radial_coefs`), as far as the spectrum.
        l_max: Order F of the expansion.

    Returns:
        Energy error, in [0, 1].

    Raises:
        ValueError: If the two do not have the same length or end at or before ``l_max``.
    """
    for name, array in (("spectrum", spectrum), ("gains", gains)):
        check_channels(name, array, "L, C", 2, batch=False)
    power = known_values("spectrum", spectrum).astype(np.float64).sum(axis=-1)
    gain = known_values("gains", gains).astype(np.float64).sum(axis=-1)
    if power.shape != gain.shape or power.size <= l_max + 1:
        raise ValueError(
            f"spectrum and gains must have the same length > {l_max + 1}; got "
            f"{power.size} and {gain.size}."
        )
    lam = np.sqrt(4 * np.pi / (2 * np.arange(power.size) + 1))
    rho = (gain / lam) ** 2
    lost_light, lost_brdf = power[l_max + 1 :].sum(), rho[l_max + 1 :].sum()
    residual = lam[l_max + 1] * lost_light * lost_brdf
    kept = np.sum((gain**2 * power)[: l_max + 1])
    return float(residual / (kept + residual))


def predicted_energy_error(
    spectrum: Float[Array, "L C"], expansion: BrdfExpansion, *, l_max: int, p_max: int
) -> Float[jax.Array, ""]:
    """Predicted energy error of truncating a reflection map to degrees (F, P), relative.

    The squared error over all orientations and views, exact for a light of that spectrum
    (docs/math.md, section 5). Differentiable.

    Args:
        spectrum: Power of each degree of the light, ``(L, C)``; one channel serves all.
        expansion: Of the BRDF, at least as long as the spectrum.
        l_max: Degrees of the light that are kept, inclusive. Static.
        p_max: Degrees of the view that are kept, inclusive. Static.

    Returns:
        Lost energy over all energy, both summed over channels; 0 for a black picture.

    Raises:
        ValueError: If the expansion is too short or the channels do not fit.
    """
    check_channels("spectrum", spectrum, "L, C", 2, batch=False)
    spectrum = as_float("spectrum", spectrum)
    degrees = spectrum.shape[0]
    if degrees > expansion.l_max + 1:
        raise ValueError(
            f"expansion must reach the spectrum's degree {degrees - 1}; it ends at "
            f"l_max={expansion.l_max}."
        )
    if p_max > expansion.p_max or l_max > expansion.l_max:
        raise ValueError(
            f"l_max={l_max}, p_max={p_max} are beyond the expansion's "
            f"{expansion.l_max}, {expansion.p_max}."
        )
    counts = {spectrum.shape[-1], expansion.rho.shape[-1]} - {1}
    if len(counts) > 1:
        raise ValueError(
            "spectrum and expansion must have the same number of channels, or one; got "
            f"{spectrum.shape[-1]} and {expansion.rho.shape[-1]}."
        )
    dtype = spectrum.dtype
    l = np.arange(degrees)
    weight = jnp.asarray(4 * math.pi / (2 * l + 1), dtype)[:, None]
    shape = (degrees, max(counts, default=1))
    light = jnp.broadcast_to(spectrum * jnp.broadcast_to(weight, spectrum.shape), shape)
    energy = jnp.broadcast_to(expansion.degree_energy[:degrees].astype(dtype), shape)
    rho = expansion.rho[:degrees, : p_max + 1, : p_max + 1].astype(dtype)
    times = jnp.asarray(order_counts(p_max), dtype)
    kept = jnp.broadcast_to(jnp.einsum("lpqc,q->lc", rho**2, times), shape)
    within = jnp.broadcast_to(jnp.asarray(l <= l_max)[:, None], shape)
    lost = jnp.maximum(energy - jnp.where(within, kept, 0), 0)
    whole = jnp.sum(light * energy)
    return jnp.sum(light * lost) / jnp.where(whole == 0, 1, whole)


def predicted_rms_error(
    spectrum: Float[Array, "L C"], expansion: BrdfExpansion, *, l_max: int, p_max: int
) -> Float[jax.Array, ""]:
    """Predicted rms error of truncating a reflection map to degrees (F, P), relative.

    The root of :func:`predicted_energy_error`.

    Args:
        spectrum: Power of each degree of the light.
        expansion: Of the BRDF, at least as long as the spectrum.
        l_max: Degrees of the light that are kept, inclusive. Static.
        p_max: Degrees of the view that are kept, inclusive. Static.

    Returns:
        rms of the error over rms of the reflected radiance.

    Raises:
        ValueError: As :func:`predicted_energy_error`.
    """
    energy = predicted_energy_error(spectrum, expansion, l_max=l_max, p_max=p_max)
    return safe_sqrt(energy)
