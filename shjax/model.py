"""The least model that a scene needs: chosen by its predicted error, checked by measuring.

Four kinds, from few numbers to many: coefficients of the irradiance about the normal; a
radial map about R (P = 0); a map without azimuth (q = 0); the SHRM. A diffuse part stays
about the normal, where it needs a handful of numbers, and is no part of the map. Each
candidate's error is predicted from the light's spectrum [MATH, section 5], the cross terms
of diffuse and specular included, and the one that takes the fewest bytes is chosen.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.angular import reference_reflection
from shjax.arrays import Array, as_float
from shjax.brdf.core import Brdf, select
from shjax.convolution import common_channels, convolve
from shjax.envmap import EnvironmentMap
from shjax.harmonics import evaluate, power_spectrum, project_samples, synthesize
from shjax.harmonics.degrees import degree_of_coefs
from shjax.kernels import brdf_coefs, expand_brdf, order_counts, radial_coefs
from shjax.lights import CapLights, cap_reflection, split_lights
from shjax.sampling import MeasuredError, draw_orientations, measured_error
from shjax.shrm import default_size, prefilter_in, read_in
from shjax.sphere import mirror
from shjax.view_basis import HarmonicViews, ViewBasis, ZonalViews

KINDS = ("irradiance", "radial", "q=0", "shrm")
_DIFFUSE_DEGREES = (0, 2, 4, 6, 8, 12, 16, 24, 32)
_LIGHT_DEGREE = 100
_VIEW_DEGREES = (16, 32)
_CHECK_ROWS = 128


class Light(NamedTuple):
    """What :func:`choose_model` needs to know of a light, whatever the material.

    Attributes:
        coefs: All of it, ``(K, C)``.
        lights: Its small lights, or None.
        rest: Coefficients without them, or None.
    """

    coefs: jax.Array
    lights: CapLights | None
    rest: jax.Array | None


class Energies(NamedTuple):
    """What a BRDF holds of each degree, for the prediction of errors; float64 NumPy.

    Attributes:
        diffuse: Energy of the radial parts about the normal, ``(L, C)``.
        specular: Energy of the rest, ``(L, C)``.
        both: Energy of their sum, ``(L, C)``.
        rho: Coefficients of the rest, ``(L, P, P, C)``.
        cross: Their products with the diffuse part's, ``(L, P, P, C)``.
        error: Relative error of the quadrature.
    """

    diffuse: np.ndarray
    specular: np.ndarray
    both: np.ndarray
    rho: np.ndarray
    cross: np.ndarray
    error: float


@functools.partial(
    jax.tree_util.register_dataclass,
    data_fields=("brdf", "lighting", "diffuse", "maps", "lights"),
    meta_fields=(
        "kind",
        "l_max",
        "p_max",
        "diffuse_l_max",
        "asked_rms_error",
        "predicted_rms_error",
        "met",
    ),
)
@dataclasses.dataclass(frozen=True)
class Model:
    """A reflected light field, ready to be read.

    Attributes:
        brdf: The reflectance it was made for.
        lighting: The light's coefficients ``(K, C)``, all that are known.
        diffuse: Coefficients over the normal, ``(K, C)``; None without a diffuse part.
        maps: Map over R, ``(n_theta, n_phi, Q, C)``; None without a specular part.
        lights: Small lights that are shaded exactly, and are in neither; or None.
        kind: One of :data:`KINDS`.
        l_max: Degree of the light in the map, or over the normal for ``"irradiance"``.
        p_max: Degree of the view in the map.
        diffuse_l_max: Degree of the diffuse part; None without one.
        asked_rms_error: What was asked for.
        predicted_rms_error: Over all orientations and views.
        met: Whether the predicted error is within what was asked.
    """

    brdf: Brdf
    lighting: Float[Array, "K C"]
    diffuse: Float[Array, "J C"] | None
    maps: Float[Array, "n_theta n_phi Q C"] | None
    lights: CapLights | None
    kind: str
    l_max: int
    p_max: int
    diffuse_l_max: int | None
    asked_rms_error: float
    predicted_rms_error: float
    met: bool

    @property
    def bytes(self) -> int:
        """What it takes to store."""
        arrays = (self.diffuse, self.maps, *jax.tree.leaves(self.lights))
        return sum(a.nbytes for a in arrays if a is not None)

    @property
    def resolution(self) -> tuple[int, int] | None:
        """Rows and columns of the map; None without one."""
        return None if self.maps is None else (self.maps.shape[0], self.maps.shape[1])

    @property
    def about_tangent(self) -> bool:
        """Whether it is read at tangents in place of reflected directions."""
        return select(self.brdf, "tangent") is not None

    @property
    def view_basis(self) -> ViewBasis:
        """The functions of the view that its maps are coefficients of."""
        return _basis(self.kind, self.p_max)

    @property
    def message(self) -> str:
        """What was chosen and why, in words; errors in rms and in energy."""
        if self.kind == "irradiance":
            what = f"{(self.l_max + 1) ** 2} coefficients over the normal"
        else:
            rows, columns = self.resolution or (0, 0)
            count = len(self.view_basis.orders)
            names = {
                "radial": "a radial map",
                "q=0": f"a map without azimuth, {count} coefficients a pixel",
                "shrm": f"an SHRM, {count} coefficients a pixel",
            }
            what = f"{names[self.kind]}, {rows} x {columns}, F = {self.l_max}"
            what += f", P = {self.p_max}" if self.kind != "radial" else ""
            if self.diffuse_l_max is not None:
                what += f", and {(self.diffuse_l_max + 1) ** 2} for the diffuse part"
        if self.lights is not None:
            what += f", and {len(self.lights.cosines)} small light(s) shaded exactly"
        rms, asked = self.predicted_rms_error, self.asked_rms_error
        line = (
            f"{what}: {_size(self.bytes)}; predicted error {rms:.2%} rms "
            f"({rms**2:.2%} energy), asked {asked:.2%} rms ({asked**2:.2%} energy)"
        )
        return line if self.met else f"{line}: NOT MET, the smallest that is reachable"

    def radiance(
        self,
        normals: Float[Array, "*points 3"],
        views: Float[Array, "*points 3"],
        *,
        tangents: Float[Array, "*points 3"] | None = None,
    ) -> Float[jax.Array, "*points C"]:
        """Reflected radiance at normals and views.

        Args:
            normals: Unit normals.
            views: Unit vectors to the viewer.
            tangents: Unit tangents, for fibres.

        Raises:
            ValueError: If a shape is wrong or tangents are missing.
        """
        total = None
        if self.diffuse is not None:
            total = evaluate(self.diffuse, normals)
        if self.maps is not None:
            if self.about_tangent and tangents is None:
                raise ValueError(
                    "tangents must be given: the BRDF is about the tangent."
                )
            centre = tangents if self.about_tangent else mirror(normals, views)
            glossy = read_in(self.view_basis, self.maps, centre, views)
            total = glossy if total is None else total + glossy
        assert total is not None  # a BRDF has a diffuse part or another
        if self.lights is not None:
            shine = cap_reflection(self.lights, self.brdf, normals, views, tangents)
            total = total + shine.astype(total.dtype)
        return total

    def check(
        self,
        radiance: EnvironmentMap | Float[Array, "n_theta n_phi C"] | None = None,
        *,
        n: int = 2048,
        seed: int = 0,
    ) -> MeasuredError:
        """Measure the error by the integral at seeded orientations and views.

        Args:
            radiance: The light as a panorama; a map of more than 128 rows is averaged to
                128. Default: the coefficients that the model was made from.
            n: How many orientations and views.
            seed: Of their random numbers.

        Returns:
            The rms error and its standard error.
        """
        samples = draw_orientations(n, seed=seed)
        dtype = self.lighting.dtype
        normals, views, tangents = (
            jnp.asarray(a, dtype)
            for a in (samples.normals, samples.views, samples.directions)
        )
        found = self.radiance(normals, views, tangents=tangents)
        panorama = jnp.asarray(self._panorama(radiance), dtype)
        exact = reference_reflection(
            panorama, self.brdf, normals, views, tangents=tangents
        )
        return measured_error(found, exact, samples.weights)

    def _panorama(self, radiance) -> Array:
        if radiance is None:
            rows = max(2 * degree_of_coefs(self.lighting.shape) + 2, _CHECK_ROWS)
            return synthesize(self.lighting, n_theta=rows, n_phi=2 * rows)
        if isinstance(radiance, EnvironmentMap):
            small = radiance.layout == "latlong" and len(radiance.image) <= _CHECK_ROWS
            return (radiance if small else radiance.to_latlong(_CHECK_ROWS)).radiance
        return radiance


def _size(count: int) -> str:
    for unit, step in (("MB", 1e6), ("kB", 1e3)):
        if count >= step:
            return f"{count / step:.3g} {unit}"
    return f"{count} bytes"


def _basis(kind: str, p_max: int) -> ViewBasis:
    return HarmonicViews(p_max) if kind == "shrm" else ZonalViews(p_max)


def choose_model(
    lighting: EnvironmentMap | Light | Float[Array, "K C"],
    brdf: Brdf,
    *,
    rms_error: float,
    max_bytes: int = 2**28,
    energies: Energies | None = None,
) -> Model:
    """The smallest model whose predicted rms error is small enough.

    Args:
        lighting: An environment map; what :func:`prepare_light` made of one, where one
            light meets several BRDFs; or radiance coefficients (what lies beyond their
            degree is taken as zero).
        brdf: The reflectance; concrete (this runs eagerly).
        rms_error: Error over all orientations and views, relative to the rms radiance;
            its square is the error in energy.
        max_bytes: Larger models are not considered.
        energies: From :func:`brdf_energies`, where one BRDF meets several lights.

    Returns:
        The model; ``met`` is False where none is good enough, and it is then the one with
        the smallest predicted error.

    Raises:
        ValueError: If ``rms_error`` is not positive, ``max_bytes`` too small for any
            model, or the channels do not fit.
    """
    if not rms_error > 0:
        raise ValueError(f"rms_error must be positive; got {rms_error}.")
    light = lighting if isinstance(lighting, Light) else prepare_light(lighting)
    l_light = degree_of_coefs(light.coefs.shape, "lighting")
    channels = common_channels(light.coefs.shape[-1], brdf.channels, "brdf")
    coefs, rest = (
        None if a is None else jnp.broadcast_to(a, (a.shape[0], channels))
        for a in (light.coefs, light.rest)
    )
    assert coefs is not None
    degrees = _VIEW_DEGREES if energies is None else (energies.rho.shape[1] - 1,)
    best, kept, lights = None, coefs, None
    for p_max in degrees:
        known = energies or brdf_energies(brdf, l_max=l_light, p_max=p_max)
        pick = functools.partial(
            _cheapest, coefs, brdf, known, rms_error, max_bytes, channels
        )
        best, kept, lights = pick(coefs), coefs, None
        if rest is not None:
            split = pick(rest)
            if split is not None and (best is None or _helps(split, best, rms_error)):
                best, kept, lights = split, rest, light.lights
        if best is not None and best.error <= rms_error:
            break
    if best is None:
        raise ValueError(f"max_bytes={max_bytes} is too small for any model.")
    return _built(coefs, kept, lights, brdf, best, rms_error)


def prepare_light(lighting: EnvironmentMap | Float[Array, "K C"]) -> Light:
    """Coefficients of a light, and of what is left when its small lights are taken out.

    Args:
        lighting: An environment map, or radiance coefficients.
    """
    coefs = light_coefs(lighting)
    if not isinstance(lighting, EnvironmentMap) or lighting.layout != "latlong":
        return Light(coefs, None, None)
    lights, rest = split_lights(lighting)
    if not len(lights.cosines):
        return Light(coefs, None, None)
    cast = jax.tree.map(lambda a: jnp.asarray(a, jnp.float32), lights)
    return Light(coefs, cast, light_coefs(rest))


def _helps(split: _Candidate, plain: _Candidate, rms_error: float) -> bool:
    """Whether taking the lights out reaches the error at last, or by half the bytes."""
    if plain.error > rms_error:
        return split.error < plain.error
    return split.error <= rms_error and 2 * split.bytes < plain.bytes


def light_coefs(lighting: EnvironmentMap | Float[Array, "K C"]) -> jax.Array:
    """Coefficients of a light as far as they matter: to degree 100 for a panorama."""
    if not isinstance(lighting, EnvironmentMap):
        return as_float("lighting", lighting)
    if (
        lighting.layout == "latlong"
        and min(lighting.image.shape[:2]) > 2 * _LIGHT_DEGREE
    ):
        return jnp.asarray(lighting.lighting(l_max=_LIGHT_DEGREE))
    # The samples as they are: exact for their sum at any degree.
    samples = (jnp.asarray(a, jnp.float32) for a in lighting.samples())
    return project_samples(*samples, l_max=_LIGHT_DEGREE)


def brdf_energies(
    brdf: Brdf, *, l_max: int = _LIGHT_DEGREE, p_max: int = 16
) -> Energies:
    """What :func:`choose_model` needs to know of a BRDF, whatever the light.

    Args:
        brdf: The reflectance; concrete.
        l_max: Degree of the light's coefficients, 100 for a panorama.
        p_max: Highest degree of the view that is considered.
    """
    matte, rest = _split(brdf)
    shape = (l_max + 1, p_max + 1, p_max + 1, brdf.channels)
    zero, flat = np.zeros(shape), np.zeros((l_max + 1, brdf.channels))
    diffuse, about_r, error = flat, zero, 0.0
    if matte is not None:
        l = np.arange(l_max + 1)[:, None]
        gains = np.asarray(radial_coefs(matte, l_max=l_max), np.float64)
        diffuse = np.broadcast_to((2 * l + 1) * gains**2, flat.shape)
        about_r = np.asarray(brdf_coefs(matte, l_max=l_max, p_max=p_max), np.float64)
    if rest is None:
        return Energies(diffuse, flat, diffuse, zero, zero, error)
    sharp = expand_brdf(rest, l_max=l_max, p_max=p_max, accuracy=1e-4)
    rho = np.broadcast_to(np.asarray(sharp.rho, np.float64), shape)
    specular = np.broadcast_to(np.asarray(sharp.degree_energy, np.float64), flat.shape)
    both = specular
    if matte is not None:
        whole = expand_brdf(brdf, l_max=l_max, p_max=p_max, accuracy=1e-4)
        both = np.asarray(whole.degree_energy, np.float64)
    return Energies(diffuse, specular, both, rho, about_r * rho, float(sharp.error))


def _split(brdf: Brdf) -> tuple[Brdf | None, Brdf | None]:
    """The radial parts about the normal, and the rest."""
    matte = [p for p in brdf.parts if p.model.centre == "normal" and p.model.radial]
    rest = [p for p in brdf.parts if not any(p is one for one in matte)]
    return (Brdf(tuple(matte)) if matte else None), (
        Brdf(tuple(rest)) if rest else None
    )


class _Candidate(NamedTuple):
    bytes: int
    rank: int
    error: float
    kind: str
    l_max: int
    p_max: int
    diffuse_l_max: int | None


def _cheapest(
    whole_light: jax.Array,
    brdf: Brdf,
    known: Energies,
    rms_error: float,
    max_bytes: int,
    channels: int,
    coefs: jax.Array,
) -> _Candidate | None:
    """The smallest candidate that is good enough, else the best one that fits.

    Errors are those of the light in ``coefs``, relative to what the whole one gives.
    """
    l_light = degree_of_coefs(coefs.shape)

    def weights(light: jax.Array) -> np.ndarray:
        spectrum = np.asarray(power_spectrum(light), np.float64)
        return 4 * np.pi * spectrum / (2 * np.arange(l_light + 1)[:, None] + 1)

    weight = weights(coefs)
    whole = np.sum(weights(whole_light) * known.both[: l_light + 1])
    matte, rest = _split(brdf)
    item = coefs.dtype.itemsize * channels
    degrees = [d for d in _DIFFUSE_DEGREES if d < l_light] + [l_light]
    if matte is None:
        degrees = [-1]
    found: list[_Candidate] = []
    for d in degrees:
        own = (d + 1) ** 2 * item
        order = d if matte is not None else None
        if rest is None:
            lost = np.sum((weight * known.both[: l_light + 1])[d + 1 :])
            error = math.sqrt(lost / whole) if whole else 0.0
            found.append(_Candidate(own, 0, error, "irradiance", d, 0, order))
            continue
        for kind, lost in _lost(weight, known, d).items():
            error = np.sqrt(np.maximum(lost, 0) / (whole or 1.0))
            for f, p in np.ndindex(*error.shape):
                rows, columns = default_size(f)
                count = len(_basis(kind, p).orders)
                size = own + rows * columns * count * item
                name, rank = ("radial", 1) if p == 0 else (kind, KINDS.index(kind))
                found.append(
                    _Candidate(size, rank, float(error[f, p]), name, f, p, order)
                )
    found = [one for one in found if one.bytes <= max_bytes]
    if not found:
        return None
    enough = [one for one in found if one.error <= rms_error]
    return min(enough) if enough else min(found, key=lambda one: (one.error, one.bytes))


def _lost(weight: np.ndarray, known: Energies, d: int) -> dict[str, np.ndarray]:
    """Lost energy of each ``(F, P)`` for maps with all q and with q = 0 alone.

    Degrees to d of the diffuse part are kept about the normal; of the specular part those
    to F, and of them the coefficients to P. Where the diffuse part is lost too, so is
    twice its product with what the specular part loses.
    """
    count = weight.shape[0]
    diffuse, specular, both = (
        a[:count] for a in (known.diffuse, known.specular, known.both)
    )
    beyond = (np.arange(count) > d)[:, None]
    product = (both - diffuse - specular) / 2
    if d < 0:
        diffuse, product = np.zeros_like(diffuse), np.zeros_like(product)
    dropped = specular + np.where(beyond, diffuse + 2 * product, 0)
    times = order_counts(known.rho.shape[1] - 1)
    lost = {}
    for kind in ("shrm", "q=0"):
        chosen = times if kind == "shrm" else np.where(times == 1, 1, 0)
        squares, crossed = (
            np.cumsum(np.einsum("lpqc,q->lpc", a[:count], chosen), axis=1)
            for a in (known.rho**2, known.cross)
        )
        gain = squares + np.where(beyond[:, None], 2 * crossed, 0)
        kept = np.cumsum(np.einsum("lc,lpc->lp", weight, gain), axis=0)
        lost[kind] = np.sum(weight * dropped) - kept
    return lost


def _built(
    lighting: jax.Array,
    coefs: jax.Array,
    lights: CapLights | None,
    brdf: Brdf,
    chosen: _Candidate,
    rms_error: float,
) -> Model:
    """The model itself, of the light in ``coefs`` and of small ``lights``."""
    matte, rest = _split(brdf)
    diffuse = maps = None
    if matte is not None and chosen.diffuse_l_max is not None:
        d = chosen.diffuse_l_max
        gains = radial_coefs(matte, l_max=d).astype(coefs.dtype)
        diffuse = convolve(coefs[: (d + 1) ** 2], gains)
    if rest is not None:
        f, p = chosen.l_max, chosen.p_max
        rho = brdf_coefs(rest, l_max=f, p_max=p, accuracy=1e-4).astype(coefs.dtype)
        rows, columns = default_size(f)
        views = _basis(chosen.kind, p)
        light = coefs[: (f + 1) ** 2]
        maps = prefilter_in(views, light, rho, n_theta=rows, n_phi=columns)
    return Model(
        brdf, lighting, diffuse, maps, lights, chosen.kind, chosen.l_max, chosen.p_max,
        chosen.diffuse_l_max, rms_error, chosen.error, chosen.error <= rms_error,
    )  # fmt: skip
