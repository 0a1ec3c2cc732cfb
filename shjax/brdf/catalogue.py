"""The table of BRDFs: every reflectance by name, against which all else is checked.

The parser of the command line reads it (:mod:`.parse`); the lobes of
:func:`shjax.estimate_brdf` and the tests are checked against it. A new analytic BRDF is
one function and one row.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from shjax.brdf.core import Brdf
from shjax.brdf.fibres import charlie, kajiya_kay
from shjax.brdf.files import read_cornell, read_curet, read_merl
from shjax.brdf.ggx import ggx, metallic_roughness
from shjax.brdf.models import (
    gaussian_microfacet,
    lafortune,
    lambertian,
    phong,
    phong_cosine,
)


class Row(NamedTuple):
    """Row of the table of BRDFs.

    Attributes:
        make: From its parameters to a BRDF.
        example: In words, as the command line takes it; empty for what is read from a
            file.
        lobes: The lobes of :func:`shjax.estimate_brdf` that fit it.
        radial: Whether it depends on the angle to its centre alone.
    """

    make: Callable[..., Brdf]
    example: str = ""
    lobes: tuple[str, ...] = ()
    radial: bool = False


def _cornell(path: str) -> Brdf:
    return read_cornell(path)[0]


BRDFS = {
    "lambertian": Row(lambertian, "lambertian albedo=0.5", ("diffuse",), True),
    "phong": Row(phong, "phong exponent=20", ("phong", "phong_horizon"), True),
    "phong_cosine": Row(phong_cosine, "phong_cosine exponent=20", ("phong_cosine",)),
    "gaussian_microfacet": Row(
        gaussian_microfacet, "gaussian_microfacet sigma=0.3", ("gaussian_microfacet",)
    ),
    "ggx": Row(ggx, "ggx alpha=0.3 f0=0.8", ("ggx", "ggx_dielectric")),
    "metallic_roughness": Row(
        metallic_roughness, "metallic_roughness albedo=0.8 roughness=0.5 metallic=0.4"
    ),
    "lafortune": Row(
        lafortune, "lafortune cxy=-0.6 cz=0.7 exponent=12", ("lafortune",)
    ),
    "kajiya_kay": Row(kajiya_kay, "kajiya_kay exponent=16"),
    "charlie": Row(charlie, "charlie alpha=0.4", ("charlie",)),
    "merl": Row(read_merl),
    "cornell": Row(_cornell),
    "curet": Row(read_curet),
}
