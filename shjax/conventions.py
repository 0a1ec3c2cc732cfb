"""Other tools' coefficients: axes, sign and scale, as one table of data.

What a tool stores is ``scale_lm * sign_m * (lighting in the tool's axes)_lm``. The axes
are a 3 x 3 matrix whose rows are the tool's x, y and z in the library's frame; the sign is
``(-1)^m`` where the tool's basis has the Condon-Shortley phase; the scale is that of the
radiance coefficients or of something made from them.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import Array, as_float
from shjax.clamped_cosine import cosine_kernel_table
from shjax.harmonics import rotate
from shjax.harmonics.degrees import degree_of_coefs, degrees, orders


def _radiance(l_max: int) -> np.ndarray:
    return np.ones((l_max + 1) ** 2)


def _irradiance(l_max: int) -> np.ndarray:
    return cosine_kernel_table(l_max)[degrees(l_max)]


def _reflected(l_max: int) -> np.ndarray:
    """Irradiance over pi: what a white Lambertian surface sends back."""
    return _irradiance(l_max) / math.pi


def _shader(l_max: int) -> np.ndarray:
    """The same with the constants of the polynomials 1; y, z, x; xy, yz, 3z^2 - 1, ..."""
    if l_max > 2:
        raise ValueError(
            "coefs must end at l_max=2: this tool's polynomials are known to degree 2; "
            f"got l_max={l_max}."
        )
    first, second = math.sqrt(3 / (4 * math.pi)), math.sqrt(15 / (4 * math.pi))
    constants = [math.sqrt(1 / (4 * math.pi)), first, first, first, second, second]
    constants += [math.sqrt(5 / (16 * math.pi)), second, second / 2]
    return _reflected(l_max) * np.array(constants)[: (l_max + 1) ** 2]


@dataclasses.dataclass(frozen=True)
class Convention:
    """Convention by which a tool stores lighting coefficients: axes, signs, scale.

    Attributes:
        axes: Rows: the tool's x, y, z in the library's frame; None where no frame was
            measured.
        phase: Whether its basis has the Condon-Shortley phase.
        scale: ``l_max`` to the factor on each radiance coefficient.
    """

    axes: tuple[tuple[float | int, ...], ...] | None
    phase: bool = False
    scale: Callable[[int], np.ndarray] = _radiance


_X, _Y, _Z = (1, 0, 0), (0, 1, 0), (0, 0, 1)


def _minus(axis: tuple[int, int, int]) -> tuple[int, int, int]:
    x, y, z = axis
    return (-x, -y, -z)


_THREE = (_X, _Z, _minus(_Y))
_MIRRORED = (_Y, _Z, _X)  # cmgen's default, Mitsuba, OpenEXR
_LEFT_HANDED = (_minus(_Y), _Z, _X)
_GOOGLE = (_minus(_X), _Y, _Z)
_DEBEVEC = (_minus(_Y), _Z, _minus(_X))

# Stored numbers were measured for three.js, cmgen, Babylon.js and Mitsuba (tests/clients).
# OpenEXR, USD, Debevec, skylibs, nvdiffrec and Blender are frames: they store pictures,
# and their rows give plain radiance coefficients in their axes.
CONVENTIONS: dict[str, Convention] = {
    "shjax": Convention((_X, _Y, _Z)),
    "blender": Convention((_X, _Y, _Z)),
    "three.js": Convention(_THREE),
    "cmgen": Convention(_MIRRORED, True),
    "cmgen irradiance": Convention(_MIRRORED, True, _irradiance),
    "cmgen shader": Convention(_MIRRORED, False, _shader),
    "cmgen no-mirror": Convention(_LEFT_HANDED, True),
    "cmgen no-mirror irradiance": Convention(_LEFT_HANDED, True, _irradiance),
    "cmgen no-mirror shader": Convention(_LEFT_HANDED, False, _shader),
    "mitsuba": Convention(_MIRRORED, True),
    "openexr": Convention(_MIRRORED),
    "usd": Convention(_MIRRORED),
    "babylon.js": Convention(_LEFT_HANDED, True, _reflected),
    "babylon.js shader": Convention(_LEFT_HANDED, False, _shader),
    "cmft": Convention(_LEFT_HANDED, True),
    "rh01": Convention(_LEFT_HANDED),
    "google spherical-harmonics": Convention(_GOOGLE, True),  # its source has the phase
    "materialx": Convention(_GOOGLE),
    "materialx irradiance": Convention(_GOOGLE, False, _reflected),
    "debevec": Convention(_DEBEVEC),
    "skylibs": Convention(_DEBEVEC),
    "nvdiffrec": Convention(_DEBEVEC),
    # Axes depend on the scene or were not measured; scale and sign from documentation.
    "gltf": Convention(None, True, _irradiance),
    # Left-handed, y up; the axes reproduced its ShadeSH9 to 2e-7.
    "unity": Convention(_LEFT_HANDED, False, _shader),
    "unreal": Convention(None, True),
    "arkit": Convention(None),
    "arcore": Convention(None, True),
    "directxmath": Convention(None, True),
}


def convert(
    coefs: Float[Array, "*batch K C"],
    to: str = "shjax",
    *,
    from_: str = "shjax",
    axes: Float[Array, "3 3"] | None = None,
) -> Float[jax.Array, "*batch K C"]:
    """Convert lighting coefficients to another tool's convention, or from it.

    Args:
        coefs: What ``from_`` stores, ``(..., K, C)``, index ``l (l + 1) + m``.
        to: A name in :data:`CONVENTIONS`, in any case; ``"three"`` and ``"threejs"`` are
            ``"three.js"``. three.js and the other tools of nine coefficients read the
            first nine.
        from_: A name, as ``to``.
        axes: Rows: the tool's x, y, z in the library's frame, for a tool without a
            measured frame (which must have it) or instead of a measured one. It belongs
            to the one of ``to`` and ``from_`` that is not ``"shjax"``.

    Returns:
        What ``to`` stores, the same shape.

    Raises:
        ValueError: If a name is unknown, a needed ``axes`` is missing, it is ambiguous
            whose axes they are, or ``from_`` stores nothing of some degree (irradiance
            of odd degrees above 1).

    >>> nine = jnp.arange(9.0)[:, None]
    >>> [round(float(c), 3) for c in convert(nine, to="three.js")[:4, 0]]
    [0.0, 2.0, -1.0, 3.0]
    """
    l_max = degree_of_coefs(coefs)
    source, target = _named("from_", from_), _named("to", to)
    if axes is not None:
        if (from_.lower() == "shjax") == (to.lower() == "shjax"):
            raise ValueError(
                "axes must belong to one tool: give one of to and from_, not "
                f"{from_!r} and {to!r}."
            )
        given = tuple(tuple(row) for row in np.asarray(axes).tolist())
        source, target = (
            tool if name.lower() == "shjax" else dataclasses.replace(tool, axes=given)
            for tool, name in ((source, from_), (target, to))
        )
    frames = [_frame(tool, name) for tool, name in ((source, from_), (target, to))]
    factors = [_factors(tool, l_max) for tool in (source, target)]
    if np.any(factors[0] == 0):
        lost = sorted({int(l) for l in degrees(l_max)[factors[0] == 0]})
        raise ValueError(
            f"coefs from {from_!r} hold nothing of the degrees {lost}; "
            "shorten them first."
        )
    coefs = as_float("coefs", coefs)

    def scaled(values, factor):
        column = jnp.asarray(factor, values.dtype)[:, None]
        return values * jnp.broadcast_to(column, values.shape)

    turned = rotate(scaled(coefs, 1 / factors[0]), frames[1] @ frames[0].T)
    return scaled(turned, factors[1])


def _named(argument: str, name: str) -> Convention:
    if isinstance(name, str):
        name = _OTHER_NAMES.get(name.lower(), name.lower())
    if name not in CONVENTIONS:
        known = ", ".join(CONVENTIONS)
        raise ValueError(f"{argument} must be one of {known}; got {name!r}.")
    return CONVENTIONS[name]


_OTHER_NAMES = {"three": "three.js", "threejs": "three.js"}


def _frame(tool: Convention, name: str) -> np.ndarray:
    if tool.axes is None:
        raise ValueError(
            f"axes must be given for {name!r} (--axes), whose frame was not measured: rows "
            "are its x, y, z in the library's frame (z up, x the panorama's centre)."
        )
    return np.asarray(tool.axes, np.float64)


def _factors(tool: Convention, l_max: int) -> np.ndarray:
    sign = (-1.0) ** np.abs(orders(l_max)) if tool.phase else 1.0
    return tool.scale(l_max) * sign
