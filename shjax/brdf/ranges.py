"""What BRDFs and their parameters must be."""

from __future__ import annotations

import jax
import numpy as np
from jax.core import Tracer

from shjax.brdf.core import Brdf


def check_range(
    name: str, value, low: float | int, high: float | int, *, open_low: bool = False
) -> None:
    """Refuse a concrete parameter outside its range.

    Raises:
        ValueError: Naming the parameter, the range and what came.
    """
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(value)):
        return
    try:
        values = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        raise ValueError(
            f"{name} must be a number or numbers; got {value!r}."
        ) from None
    fine = (values > low if open_low else values >= low) & (values <= high)
    if not np.all(fine):
        left = "(" if open_low else "["
        raise ValueError(
            f"{name} must lie in {left}{low:g}, {high:g}]; got {values[~fine].flat[0]:g}."
        )


def check_brdf(name: str, value) -> Brdf:
    """Check that an argument is a BRDF.

    Raises:
        ValueError: Naming it, and what to do with what came instead.
    """
    if isinstance(value, Brdf):
        return value
    kind = type(value).__name__
    hint = getattr(type(value), "in_place_of_brdf", "")
    if isinstance(value, tuple) and any(isinstance(one, Brdf) for one in value):
        hint = "read_cornell returns the BRDF and its wavelengths"
    raise ValueError(f"{name} must be a Brdf; got {kind}{hint and f': {hint}'}.")
