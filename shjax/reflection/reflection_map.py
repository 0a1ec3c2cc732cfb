"""Reflection maps and diffuse reflection: reflected light as coefficients, ready to read.

References:
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
"""

from __future__ import annotations

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import (
    STATIC,
    Array,
    as_float,
    check_channels,
    check_vectors,
)
from shjax.brdf.core import Brdf
from shjax.envmap import EnvironmentMap, make_envmap
from shjax.harmonics.degrees import degree_of_coefs
from shjax.light import Light
from shjax.reference.random_orientations import (
    MeasuredError,
    draw_orientations,
    measured_error,
)
from shjax.reflection.convolution import reflect_kernels
from shjax.reflection.reading import check_frame, read_latlong
from shjax.reflection.reflector import check_against_integral
from shjax.reflection.view_basis import HarmonicViews, ViewBasis
from shjax.reflection.view_sum import sum_over_view
from shjax.vectors import mirror


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True, repr=False)
class ReflectionMap:
    """Reflection map: prefiltered radiance for every reflected direction and view.

    A reflector and a pytree, made by :func:`shjax.prefilter`. It knows how to read itself.

    Attributes:
        coefs: Coefficients over the view, ``(..., n_theta, n_phi, Q, C)`` on a lat-long
            grid of reflected directions R, ``(..., 6, size, size, Q, C)`` on a cube map.
        view_basis: The Q functions of the view that they belong to.
        kernels: Of the BRDF over the light's degree, ``(..., L, Q, C)``; None: unknown.
        lighting: Radiance coefficients that it was made from, ``(..., K, C)``, or None.
        truncation_error: Predicted, ``(...)``; None: unknown.
        brdf: What it was made for, or None.
        frame: Of the view: ``"local"`` (e_theta, e_phi, R) or ``"global"``, the world
            [T5, section 5.4].
        centre: What it is indexed by: ``"reflection"``, the reflected direction, or
            ``"tangent"``, the tangent of a fibre.
        layout: ``"latlong"``, or ``"cube"`` for export to a renderer.
    """

    coefs: Float[Array, "*grid Q C"]
    view_basis: ViewBasis
    kernels: Float[Array, "*brdfs L Q D"] | None = None
    lighting: Float[Array, "*lights K E"] | None = None
    truncation_error: Float[Array, ...] | None = None
    brdf: Brdf | None = None
    frame: str = dataclasses.field(default="local", metadata=STATIC)
    centre: str = dataclasses.field(default="reflection", metadata=STATIC)
    layout: str = dataclasses.field(default="latlong", metadata=STATIC)

    @classmethod
    def from_coefs(
        cls,
        coefs: Float[Array, "*batch n_theta n_phi Q C"],
        *,
        frame: str,
        centre: str = "reflection",
    ) -> ReflectionMap:
        """Reflection map of spherical harmonic coefficients that are already known.

        Args:
            coefs: Over the view, Q = (p_max + 1)^2; an even number of columns.
            frame: ``"local"`` or ``"global"``.
            centre: ``"reflection"`` or ``"tangent"``.

        Raises:
            ValueError: If the shape is wrong or a choice unknown.
        """
        check_frame(frame, centre)
        check_channels("coefs", coefs, "n_theta, n_phi, Q, C", 4)
        views = HarmonicViews(degree_of_coefs(coefs, "coefs"))
        found = cls(as_float("coefs", coefs), views, frame=frame, centre=centre)
        found._check_readable()
        return found

    def __repr__(self) -> str:
        """Description in one line."""
        return f"ReflectionMap: {self.message}"

    @property
    def predicted_rms_error(self) -> Array | float:
        """Predicted truncation error over all orientations and views, relative rms.

        Uniform in the reflected direction: a normal counts by n.v, as in a sphere's
        picture. One view may show half of it, or twice.
        NaN where it is not known: a map of bare coefficients does not tell what they
        leave out of the BRDF; :func:`shjax.brdf.expand` and
        :func:`shjax.reflection.fit_low_rank` do.
        """
        return math.nan if self.truncation_error is None else self.truncation_error

    @property
    def bytes(self) -> int:
        """Memory of the map and its functions of the view."""
        return self.coefs.nbytes + self.view_basis.bytes

    @property
    def message(self) -> str:
        """Description in words: view basis, size, light's degree, frame, centre."""
        rows, columns = self.coefs.shape[-4:-2]
        size = f"{rows} rows by {columns} columns"
        if self.layout == "cube":
            size = f"6 faces of {rows} x {columns}"
        degree = "" if self.kernels is None else f", light to degree {self.l_max}"
        place = "tangent" if self.centre == "tangent" else "reflected direction"
        what = f"{self.view_basis.message}, {size}{degree}"
        return f"{what}, {self.frame} frame, by the {place}"

    @property
    def l_max(self) -> int | None:
        """Highest degree of the light in the map; None where that is not known."""
        if self.kernels is None or self.lighting is None:
            return None
        return min(self.kernels.shape[-3] - 1, degree_of_coefs(self.lighting))

    def radiance(
        self,
        normals: Float[Array, "*points 3"],
        views: Float[Array, "*points 3"],
        *,
        tangents: Float[Array, "*points 3"] | None = None,
    ) -> Float[jax.Array, "*points C"]:
        """Reflected radiance at normals and views, read between pixels.

        Differentiable; not smooth within a pixel of a pole for local maps, whose frame
        turns there: :func:`shjax.reflection.reflect` is.

        Args:
            normals: Unit normals.
            views: Unit vectors to the viewer, in the world.
            tangents: Unit tangents, for a map indexed by them.

        Returns:
            ``(*batch, *points, C)``: each map of a batch at every point.

        Raises:
            ValueError: If a shape is wrong or tangents are missing.
        """
        if self.centre == "tangent":
            if tangents is None:
                raise ValueError(
                    "tangents must be given: the BRDF is about the tangent."
                )
            return self.read(tangents, views)
        for name, vectors in (("normals", normals), ("views", views)):
            check_vectors(name, vectors)
        if views.shape != normals.shape:
            raise ValueError(
                f"views must have the shape of normals {normals.shape}; got "
                f"{views.shape}."
            )
        normals, views = (as_float("normals", normals), as_float("views", views))
        return self.read(mirror(normals, views), views)

    def read(
        self,
        reflected: Float[Array, "*points 3"],
        views: Float[Array, "*points 3"],
        *,
        interpolation: str = "cubic",
    ) -> Float[jax.Array, "*points C"]:
        """Reflected radiance at reflected directions and views [T5, Eqs. 5.10, 5.11].

        Args:
            reflected: Unit reflected directions ``R = 2 (n.v) n - v``; tangents for a map
                indexed by them.
            views: Unit vectors to the viewer, in the world.
            interpolation: ``"cubic"`` (Catmull-Rom, 16 pixels) or ``"linear"`` (4).

        Raises:
            ValueError: If a shape is wrong, the interpolation unknown, or the map a cube.
        """
        self._check_readable()

        def one(coefs: Array) -> jax.Array:
            return read_latlong(
                self.view_basis,
                coefs,
                reflected,
                views,
                frame=self.frame,
                interpolation=interpolation,
            )

        *batch, rows, columns, count, channels = self.coefs.shape
        if not batch:
            return one(self.coefs)
        maps = self.coefs.reshape(-1, rows, columns, count, channels)
        found = jax.lax.map(one, maps)
        return found.reshape(*batch, *found.shape[1:])

    def _check_readable(self) -> None:
        if self.layout != "latlong" or self.coefs.shape[-3] % 2:
            raise ValueError(
                "a map is read on a lat-long grid of an even number of columns; got "
                f"layout {self.layout!r}, coefs {self.coefs.shape}."
            )

    def for_view(self, view: Float[Array, " 3"]) -> ReflectionMap:
        """Sum a global map over one view: a dynamic map for a distant viewer [T5, 5.35].

        Args:
            view: Unit vector to the viewer, in the world.

        Raises:
            ValueError: If the map is not global or a shape is wrong.
        """
        if self.frame != "global":
            raise ValueError(
                f"only a global map is summed over one view; got a {self.frame} one."
            )
        # One coefficient, Y_00 = 1 / sqrt(4 pi): a reflection map of radiance.
        single = sum_over_view(self.view_basis, self.coefs, view)[..., None, :]
        return ReflectionMap(
            single * math.sqrt(4 * math.pi),
            HarmonicViews(0),
            frame="global",
            centre=self.centre,
            layout=self.layout,
        )

    def check(
        self,
        light: Light | Float[Array, "K C"] | None = None,
        *,
        n: int = 2048,
        seed: int = 0,
    ) -> MeasuredError:
        """Measure the rms error at random orientations and views.

        Against the integral where the BRDF is known. A map of bare coefficients is
        compared with the light's convolution with them at single points, which tells of
        its resolution and of the light's degree, not of what the coefficients leave out.

        Args:
            light: An environment map, a lat-long panorama, or radiance coefficients;
                default those that the map was made from.
            n: How many orientations and views.
            seed: Of their random numbers.

        Returns:
            The rms error, relative to the rms radiance, and its standard error.

        Raises:
            ValueError: If the map holds a batch, or knows neither light nor kernels.
        """
        coefs = self.lighting if light is None else light
        if self.coefs.ndim != 4 or self.kernels is None or coefs is None:
            raise ValueError(
                "check needs one map that prefilter made and its light; got coefs "
                f"{self.coefs.shape}."
            )
        given = not isinstance(coefs, EnvironmentMap) and np.ndim(coefs) == 2
        if self.brdf is not None and self.lighting is not None:
            known = jnp.asarray(coefs) if given else self.lighting
            field = None if given else light
            return check_against_integral(self, self.brdf, field, known, n=n, seed=seed)
        if not given:
            if not isinstance(coefs, EnvironmentMap):
                coefs = make_envmap(coefs, layout="latlong")
            coefs = coefs.lighting(l_max=self.kernels.shape[-3] - 1)
        drawn = draw_orientations(n, seed=seed)
        reflected, views = (
            jnp.asarray(a, self.coefs.dtype) for a in (drawn.reflected, drawn.views)
        )
        exact = reflect_kernels(
            jnp.asarray(coefs), self.kernels, self.view_basis, reflected, views
        )
        return measured_error(self.read(reflected, views), exact, drawn.weights)
