"""Objects in words, for command lines: ``"ggx alpha=0.2 f0=0.04"``."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np


def called(text: str, makers: Mapping[str, Callable[..., Any]], kind: str) -> Any:
    """Call the function that a text names, with the parameters that it gives.

    Args:
        text: A name, and parameters as ``name=value``. A value is a number, numbers joined
            by commas, rows of them joined by semicolons, ``true``, ``false``, or a text.
        makers: The functions by name.
        kind: What they make, for messages.

    Raises:
        ValueError: If the name or a parameter is unknown or missing.
    """
    words = text.split()
    name = words[0].lower() if words else ""
    if name not in makers:
        raise ValueError(f"{kind} must be one of {', '.join(makers)}; got {text!r}.")
    known = inspect.signature(makers[name]).parameters
    given = {}
    for word in words[1:]:
        key, equals, value = word.partition("=")
        key = key.lower()
        if not equals or key not in known:
            raise ValueError(
                f"{name} takes {', '.join(f'{k}=...' for k in known)}; got {word!r}."
            )
        given[key] = value_of(value)
    missing = [
        k
        for k, p in known.items()
        if p.default is inspect.Parameter.empty and k not in given
    ]
    if missing:
        raise ValueError(f"{name} needs {', '.join(f'{k}=...' for k in missing)}.")
    return makers[name](**given)


def value_of(text: str) -> Any:
    """Parse a value: a number, numbers, rows of numbers, a truth value, or the text."""
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    try:
        rows = [[float(part) for part in row.split(",")] for row in text.split(";")]
    except ValueError:
        return text
    if len(rows) > 1 and len({len(row) for row in rows}) == 1:
        return np.array(rows, np.float32)
    if len(rows) > 1:
        return text
    return np.array(rows[0], np.float32) if len(rows[0]) > 1 else rows[0][0]
