"""Reflection models: diffuse reflection, a reflection map and lights apart, as a sum."""

from __future__ import annotations

import dataclasses

import jax
from jaxtyping import Float

from shjax.arrays import STATIC, Array
from shjax.brdf.core import Brdf
from shjax.light import Light
from shjax.lights import CapLights, cap_reflection
from shjax.reference.random_orientations import MeasuredError
from shjax.reflection.diffuse import DiffuseReflection
from shjax.reflection.reflection_map import ReflectionMap
from shjax.reflection.reflector import check_against_integral


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True, repr=False)
class ReflectionModel:
    """Reflection model that :func:`shjax.choose_model` chose: a sum of up to three parts.

    A reflector and a pytree.

    Attributes:
        brdf: The reflectance it was made for.
        lighting: The light's coefficients ``(K, C)``, all that are known.
        diffuse: Reflection of the BRDF's diffuse part; None without one.
        specular: Reflection map of the rest; None without one.
        lights: Suns and lamps split off the light, shaded exactly and in neither part;
            or None.
        asked_rms_error: What was asked for.
        predicted_rms_error: Over all orientations and views, relative.
        met: Whether the predicted error is within what was asked.
    """

    brdf: Brdf
    lighting: Float[Array, "K C"]
    diffuse: DiffuseReflection | None
    specular: ReflectionMap | None
    lights: CapLights | None
    asked_rms_error: float = dataclasses.field(metadata=STATIC)
    predicted_rms_error: float = dataclasses.field(metadata=STATIC)
    met: bool = dataclasses.field(metadata=STATIC)

    def __repr__(self) -> str:
        """Description in one line."""
        return f"ReflectionModel: {self.message}"

    @property
    def label(self) -> str:
        """Short name of what was chosen: ``"irradiance"``, or the view basis's."""
        return "irradiance" if self.specular is None else self.specular.view_basis.label

    @property
    def l_max(self) -> int:
        """Degree of the light in the map, or over the normal without one."""
        degree = self.diffuse_l_max if self.specular is None else self.specular.l_max
        assert degree is not None  # a model has one of the two
        return degree

    @property
    def p_max(self) -> int:
        """Degree of the view in the map; a low-rank one's highest azimuthal order."""
        return 0 if self.specular is None else self.specular.view_basis.p_max

    @property
    def diffuse_l_max(self) -> int | None:
        """Degree of the diffuse part; None without one."""
        if self.diffuse is None:
            return None
        return round(self.diffuse.coefs.shape[-2] ** 0.5) - 1

    @property
    def resolution(self) -> tuple[int, int] | None:
        """Rows and columns of the map; None without one."""
        if self.specular is None:
            return None
        return self.specular.coefs.shape[0], self.specular.coefs.shape[1]

    @property
    def bytes(self) -> int:
        """Memory of all parts."""
        parts = [part for part in (self.diffuse, self.specular) if part is not None]
        lights = sum(a.nbytes for a in jax.tree.leaves(self.lights))
        return sum(part.bytes for part in parts) + lights

    @property
    def about_tangent(self) -> bool:
        """True if it is read at tangents in place of reflected directions."""
        return self.specular is not None and self.specular.centre == "tangent"

    @property
    def message(self) -> str:
        """Description of what was chosen and why; errors in rms and in energy."""
        if self.specular is None:
            what = f"{(self.l_max + 1) ** 2} coefficients over the normal"
        else:
            rows, columns = self.resolution or (0, 0)
            basis = self.specular.view_basis
            what = f"{basis.message}, {rows} rows by {columns} columns"
            what += f", light to degree {self.l_max}"
            if basis.label in ("zonal", "harmonic"):
                what += f", view to degree {self.p_max}"
            if self.diffuse_l_max is not None:
                what += f", and {(self.diffuse_l_max + 1) ** 2} for the diffuse part"
        if self.lights is not None:
            count = len(self.lights.heights)
            what += (
                f", and {count} light source{'s' if count > 1 else ''} shaded exactly"
            )
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
        parts = [part for part in (self.diffuse, self.specular) if part is not None]
        found = [part.radiance(normals, views, tangents=tangents) for part in parts]
        total = sum(found[1:], start=found[0])
        if self.lights is not None:
            shine = cap_reflection(self.lights, self.brdf, normals, views, tangents)
            total = total + shine.astype(total.dtype)
        return total

    def check(
        self, light: Light | None = None, *, n: int = 2048, seed: int = 0
    ) -> MeasuredError:
        """Measure the rms error against the integral at random orientations and views.

        Args:
            light: The light as an environment map (one of more than 128 rows is averaged
                to 128) or a lat-long panorama. Default: the coefficients that the model
                was made from.
            n: How many orientations and views.
            seed: Of their random numbers.

        Returns:
            The rms error and its standard error.
        """
        return check_against_integral(
            self, self.brdf, light, self.lighting, n=n, seed=seed
        )


def _size(count: int) -> str:
    for unit, step in (("MB", 1e6), ("kB", 1e3)):
        if count >= step:
            return f"{count / step:.3g} {unit}"
    return f"{count} bytes"
