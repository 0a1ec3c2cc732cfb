"""Area lights in words: ``"disk centre=0,0,2 normal=0,0,-1 radius=0.5 radiance=8"``."""

from __future__ import annotations

from shjax.lights.area_light import AreaLight
from shjax.lights.making import capsule, disk, ellipse, line, polygon, sphere
from shjax.texts import called

MAKERS = {
    "polygon": polygon,
    "disk": disk,
    "ellipse": ellipse,
    "sphere": sphere,
    "capsule": capsule,
    "line": line,
}


def parse(text: str) -> AreaLight:
    """Parse an area light from a description in words.

    Args:
        text: A kind and its parameters as ``name=value``: numbers joined by commas, points
            of a polygon by semicolons.

    Raises:
        ValueError: If the kind or a parameter is unknown, missing or of the wrong form.

    >>> parse("sphere centre=0,0,2 radius=0.5 radiance=8,8,6").radiance.shape
    (3,)
    """
    return called(text, MAKERS, "light")
