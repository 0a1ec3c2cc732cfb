"""BRDFs in words, for command lines: ``"lambertian albedo=0.5 + 0.3 * ggx alpha=0.2"``."""

from __future__ import annotations

import inspect

import numpy as np

from shjax.brdf.catalogue import BRDFS
from shjax.brdf.core import Brdf


def parse(text: str) -> Brdf:
    """Parse a BRDF from a description in words.

    Terms are joined by ``+``; each is an optional factor and ``*``, a model's name, and
    its parameters as ``name=value``. A value is a number, numbers joined by commas (one a
    channel, or one per lobe for lafortune), ``true``, ``false``, or a path.

    Args:
        text: Like ``"ggx alpha=0.2 f0=0.04"`` or
            ``"lambertian albedo=0.6,0.3,0.1 + 0.3 * phong_cosine exponent=30"``.

    Raises:
        OSError: If a measured file cannot be opened.
        ValueError: If a model or a parameter is unknown, missing or of the wrong form.

    >>> parse("lambertian albedo=0.5 + 0.3 * phong exponent=20").channels
    1
    """
    total = None
    for term in text.split(" + "):
        one = _term(term.strip())
        total = one if total is None else total + one
    assert total is not None  # split gives at least one term
    return total


def _term(term: str) -> Brdf:
    factor, star, rest = term.partition("*")
    words = (rest if star else term).split()
    name = words[0].lower() if words else ""
    if name not in BRDFS:
        raise ValueError(f"brdf must be one of {', '.join(BRDFS)}; got {term!r}.")
    make = BRDFS[name].make
    known = inspect.signature(make).parameters
    given = {}
    for word in words[1:]:
        key, equals, value = word.partition("=")
        key = key.lower()
        if not equals or key not in known:
            raise ValueError(
                f"{name} takes {', '.join(f'{k}=...' for k in known)}; got {word!r}."
            )
        given[key] = _value(value)
    missing = [
        k
        for k, p in known.items()
        if p.default is inspect.Parameter.empty and k not in given
    ]
    if missing:
        raise ValueError(f"{name} needs {', '.join(f'{k}=...' for k in missing)}.")
    brdf = make(**given)
    return brdf * _number(factor) if star else brdf


def _value(text: str):
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        return text
    if len(numbers) > 1:
        return np.array(numbers, np.float32)
    return numbers[0]


def _number(text: str):
    value = _value(text.strip())
    if isinstance(value, (str, bool)):
        raise ValueError(f"a factor must be a number or numbers; got {text.strip()!r}.")
    return value
