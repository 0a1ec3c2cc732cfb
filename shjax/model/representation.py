"""A chosen model: what it holds, how it is read, how its error is measured."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
from jaxtyping import Float

from shjax.angular import reference_reflection
from shjax.arrays import Array
from shjax.brdf.core import Brdf, select
from shjax.envmap import EnvironmentMap
from shjax.harmonics import evaluate, synthesize
from shjax.harmonics.degrees import degree_of_coefs
from shjax.lights import CapLights, cap_reflection
from shjax.sampling import MeasuredError, draw_orientations, measured_error
from shjax.shrm import read_in
from shjax.sphere import mirror
from shjax.view_basis import (
    AdaptedViews,
    CoefficientViews,
    HarmonicViews,
    ViewBasis,
    ZonalViews,
)

KINDS = ("irradiance", "radial", "q=0", "shrm", "adapted")
_CHECK_ROWS = 128


@functools.partial(
    jax.tree_util.register_dataclass,
    data_fields=("brdf", "lighting", "diffuse", "maps", "views", "lights"),
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
        views: The functions of the view that read an adapted map; None for others.
        lights: Small lights that are shaded exactly, and are in neither; or None.
        kind: One of :data:`KINDS`.
        l_max: Degree of the light in the map, or over the normal for ``"irradiance"``.
        p_max: Degree of the view in the map; an adapted one's highest azimuthal order.
        diffuse_l_max: Degree of the diffuse part; None without one.
        asked_rms_error: What was asked for.
        predicted_rms_error: Over all orientations and views.
        met: Whether the predicted error is within what was asked.
    """

    brdf: Brdf
    lighting: Float[Array, "K C"]
    diffuse: Float[Array, "J C"] | None
    maps: Float[Array, "n_theta n_phi Q C"] | None
    views: AdaptedViews | None
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
        extra = jax.tree.leaves((self.views, self.lights))
        arrays = (self.diffuse, self.maps, *extra)
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
        return self.views or coefficient_views(self.kind, self.p_max)

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
                "adapted": f"an adapted map, {count} coefficients a pixel",
            }
            what = f"{names[self.kind]}, {rows} rows by {columns} columns"
            what += f", light to degree {self.l_max}"
            what += (
                f", view to degree {self.p_max}" if self.kind in ("q=0", "shrm") else ""
            )
            if self.diffuse_l_max is not None:
                what += f", and {(self.diffuse_l_max + 1) ** 2} for the diffuse part"
        if self.lights is not None:
            count = len(self.lights.heights)
            lights = "light" if count == 1 else "lights"
            what += f", and {count} small {lights} shaded exactly"
        rms, asked = self.predicted_rms_error, self.asked_rms_error
        line = (
            f"{what}: {_size(self.bytes)}; predicted error {rms:.2%} rms "
            f"({rms**2:.2%} energy), asked {asked:.2%} rms ({asked**2:.2%} energy), a mean "
            "over all orientations and views"
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
            rows = max(2 * degree_of_coefs(self.lighting) + 2, _CHECK_ROWS)
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


def coefficient_views(kind: str, p_max: int) -> CoefficientViews:
    """The view basis of a kind of map that holds BRDF coefficients."""
    return HarmonicViews(p_max) if kind == "shrm" else ZonalViews(p_max)
