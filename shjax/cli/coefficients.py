"""Coefficients of a map for a command, and what to say of how they came."""

from __future__ import annotations

import jax
import numpy as np

import shjax
from shjax.envmap import EnvironmentMap


def light_of(
    envmap: EnvironmentMap, l_max: int, rotation: np.ndarray | None
) -> tuple[jax.Array, str]:
    """Radiance coefficients of a map, rotated, and the quadrature they came by.

    Raises:
        ValueError: If they overflow.
    """
    rule = envmap.quadrature(l_max)
    lighting = envmap.lighting(l_max=l_max)
    if not np.all(np.isfinite(np.asarray(lighting))):
        brightest = np.max(np.abs(np.asarray(envmap.image)))
        raise ValueError(
            f"{envmap.report.source}: the light overflows float32; its largest value is "
            f"{brightest:.3g}."
        )
    if rotation is not None:
        lighting = shjax.rotate(lighting, rotation)
    return lighting, _QUADRATURES.get(rule, rule)


_QUADRATURES = {"samples": "pixel centres, exact solid angles"}


def quadrature_note(quadrature: str, l_max: int) -> str:
    """What to say of a map that is too small for its degree; empty otherwise."""
    if quadrature != "pixel":
        return ""
    return (
        f"fewer than {2 * l_max + 1} rows or columns: taken as constant over each pixel "
        "(quadrature 'pixel')"
    )
