"""BRDFs in words, for command lines: ``"lambertian albedo=0.5 + 0.3 * ggx alpha=0.2"``."""

from __future__ import annotations

import inspect
from collections.abc import Callable

import numpy as np

from shjax.brdf.core import Brdf
from shjax.brdf.files import read_cornell, read_curet, read_merl
from shjax.brdf.ggx import ggx, metallic_roughness
from shjax.brdf.models import (
    gaussian_microfacet,
    kajiya_kay,
    lafortune,
    lambertian,
    phong,
    phong_cosine,
)


def _cornell(path: str) -> Brdf:
    return read_cornell(path)[0]


MODELS: dict[str, Callable[..., Brdf]] = {
    "lambertian": lambertian,
    "phong": phong,
    "phong_cosine": phong_cosine,
    "gaussian_microfacet": gaussian_microfacet,
    "ggx": ggx,
    "metallic_roughness": metallic_roughness,
    "lafortune": lafortune,
    "kajiya_kay": kajiya_kay,
    "merl": read_merl,
    "cornell": _cornell,
    "curet": read_curet,
}


def parse(text: str) -> Brdf:
    """Make a BRDF from a description.

    Terms are joined by ``+``; each is an optional factor and ``*``, a model's name, and
    its parameters as ``name=value``. A value is a number, numbers joined by commas (one a
    channel, or one a lobe for lafortune), ``true``, ``false``, or a path.

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
    if name not in MODELS:
        raise ValueError(f"brdf must be one of {', '.join(MODELS)}; got {term!r}.")
    make = MODELS[name]
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
