"""BRDFs in words, for command lines: ``"lambertian albedo=0.5 + 0.3 * ggx alpha=0.2"``."""

from __future__ import annotations

from shjax.brdf.catalogue import BRDFS
from shjax.brdf.core import Brdf
from shjax.texts import called, value_of


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
    makers = {name: entry.make for name, entry in BRDFS.items()}
    brdf = called(rest if star else term, makers, "brdf")
    return brdf * _number(factor) if star else brdf


def _number(text: str):
    value = value_of(text.strip())
    if isinstance(value, (str, bool)):
        raise ValueError(f"a factor must be a number or numbers; got {text.strip()!r}.")
    return value
