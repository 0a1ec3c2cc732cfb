"""What a BRDF is here: a sum of parts, each a model with its parameters.

A model knows one thing, its *transfer function* [T5, Eq. 5.1]: the BRDF times the clamped
cosine (or what its paper defines in that place), for one channel, from the directions of
light and view in the frame whose z is the normal (the tangent, for fibres). Isotropic
models do not change when both directions are turned about z. Everything else (channels,
sums, which centre a part is expanded about) is here, and no model knows it.

References:
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from shjax.arrays import STATIC, Array, check_vectors
from shjax.vectors import frames

Parameters = Mapping[str, jax.Array]


class Local(NamedTuple):
    """Components of directions in a surface's local frame, arrays of one shape."""

    x: jax.Array
    y: jax.Array
    z: jax.Array


@dataclasses.dataclass(frozen=True)
class ReflectanceModel:
    """Reflectance model: a transfer function and how it is expanded.

    Attributes:
        name: For messages and files.
        transfer: ``(parameters, light, view)`` of one channel to values of their shape;
            every parameter lacks its last axis, the channel.
        centre: About what it is expanded: ``"reflection"``, ``"normal"``, ``"tangent"``.
        horizon: Whether it is zero where light or view is below the surface.
        radial: ``(parameters, l_max)`` to the gains ``a_l`` of a model that depends on
            the angle between light and centre only, ``(l_max + 1,)``; None for others.
        prepare: Parameters to parameters with tables made from them, for one channel;
            done once, before any loop over directions.
    """

    name: str
    transfer: Callable[[Parameters, Local, Local], jax.Array]
    centre: str = "reflection"
    horizon: bool = True
    radial: Callable[[Parameters, int], jax.Array] | None = None
    prepare: Callable[[Parameters], Parameters] | None = None


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Part:
    """Part of a BRDF: a model, its parameters ``(..., C)`` and a weight ``(C,)``."""

    model: ReflectanceModel = dataclasses.field(metadata=STATIC)
    parameters: dict[str, jax.Array]
    weight: jax.Array


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Brdf:
    """Bidirectional reflectance distribution function (BRDF), the sum of its parts.

    Add two with ``+``, scale one with ``*``. A pytree: parameters jit, batch (``jax.vmap``)
    and differentiate.
    """

    parts: tuple[Part, ...]
    in_place_of_array: ClassVar[str] = "pass shjax.brdf.expand(brdf, l_max=, p_max=)"

    def __repr__(self) -> str:
        """Its parts and channels, in one line."""
        names = " + ".join(part.model.name for part in self.parts)
        return f"Brdf: {names}, {self.channels} channel{'s' * (self.channels != 1)}"

    @property
    def channels(self) -> int:
        """Number of channels; one part's single channel serves all of another's."""
        return max(part.weight.shape[-1] for part in self.parts)

    def __add__(self, other: Brdf) -> Brdf:
        """Both together; a single channel of one serves all channels of the other."""
        if not isinstance(other, Brdf):
            return NotImplemented
        counts = {self.channels, other.channels} - {1}
        if len(counts) > 1:
            raise ValueError(
                "BRDFs to be added must have the same number of channels, or one; got "
                f"{self.channels} and {other.channels}."
            )
        return Brdf(self.parts + other.parts)

    def __mul__(self, factor) -> Brdf:
        """Scaled by a number, or by one for each channel ``(C,)``."""
        if isinstance(factor, Brdf):
            return NotImplemented
        scaled = []
        for part in self.parts:
            by = jnp.atleast_1d(jnp.asarray(factor, part.weight.dtype))
            if by.ndim != 1 or len({by.shape[0], part.weight.shape[0]} - {1}) > 1:
                raise ValueError(
                    "a BRDF is scaled by a number or by one for each channel; got shape "
                    f"{by.shape} for {part.weight.shape[0]} channels."
                )
            shape = np.broadcast_shapes(by.shape, part.weight.shape)
            weight = jnp.broadcast_to(by, shape) * jnp.broadcast_to(part.weight, shape)
            full = {
                name: jnp.broadcast_to(array, (*array.shape[:-1], *shape))
                for name, array in part.parameters.items()
            }
            scaled.append(Part(part.model, full, weight))
        return Brdf(tuple(scaled))

    def __truediv__(self, divisor) -> Brdf:
        """Divided by a number, or by one for each channel ``(C,)``."""
        return self * (1 / jnp.asarray(divisor))

    def __radd__(self, other) -> Brdf:
        """The BRDF itself after 0, so that ``sum`` adds a list of them."""
        return self if isinstance(other, int) and other == 0 else NotImplemented

    __rmul__ = __mul__
    __array_ufunc__ = None  # an array times a BRDF is a BRDF, not an array of them


def make_brdf(model: ReflectanceModel, **parameters) -> Brdf:
    """Make a BRDF of one part; parameters are arrays whose last axis is the channel.

    Raises:
        ValueError: If their numbers of channels do not fit each other, or a value is no
            floating-point number.
    """
    arrays = {}
    for name, value in parameters.items():
        array = jnp.asarray(value, _float_type(value))
        arrays[name] = array[None] if array.ndim == 0 else array
    dtype = jnp.result_type(*(array.dtype for array in arrays.values()))
    counts = {name: array.shape[-1] for name, array in arrays.items()}
    channels = max(counts.values())
    if set(counts.values()) - {1, channels} or 0 in counts.values():
        raise ValueError(
            f"the parameters of {model.name} must have the same number of channels, or "
            f"one; got {counts}."
        )
    # Every parameter carries all channels, so that one vmap serves them all.
    full = {
        name: jnp.broadcast_to(array.astype(dtype), (*array.shape[:-1], channels))
        for name, array in arrays.items()
    }
    return Brdf((Part(model, full, jnp.ones(channels, dtype)),))


def _float_type(value):
    """The type of a parameter: its own if a float, JAX's default for integers."""
    given = value.dtype if hasattr(value, "dtype") else np.asarray(value).dtype
    if jnp.issubdtype(given, jnp.floating) and hasattr(value, "dtype"):
        widened = jnp.float32 if jnp.finfo(given).bits < 32 else given
        return jax.dtypes.canonicalize_dtype(widened)
    whole = jnp.issubdtype(given, jnp.integer) and given != np.uint8
    if jnp.issubdtype(given, jnp.floating) or whole:
        return jnp.result_type(float)
    raise ValueError(f"a BRDF's parameters must be real numbers; got {given}.")


def prepared(brdf: Brdf) -> Brdf:
    """Tabulate what each model needs, before any loop over directions."""
    parts = []
    for part in brdf.parts:
        prepare = part.model.prepare
        if prepare is not None:
            tables = jax.vmap(prepare, in_axes=-1, out_axes=-1)(part.parameters)
            part = dataclasses.replace(part, parameters=dict(tables))
        parts.append(part)
    return Brdf(tuple(parts))


def select(brdf: Brdf, *centres: str) -> Brdf | None:
    """Select the parts of a BRDF that are expanded about some centres; None without any."""
    parts = tuple(part for part in brdf.parts if part.model.centre in centres)
    return Brdf(parts) if parts else None


def part_values(part: Part, light: Local, view: Local) -> jax.Array:
    """Transfer function of one prepared part, channels in front: ``(C, ...)``."""
    dtype = light.z.dtype
    cast = {name: array.astype(dtype) for name, array in part.parameters.items()}

    def one_channel(parameters, weight):
        value = part.model.transfer(parameters, light, view) * weight
        if part.model.horizon:
            value = jnp.where((light.z > 0) & (view.z > 0), value, 0)
        return value

    count = part.weight.shape[-1]
    names = list(cast)
    channels = []
    # Channels by a loop: XLA then fuses each into what reads it. Long spectra are mapped.
    if count <= 4:
        for c in range(count):
            one = {name: cast[name][..., c] for name in names}
            channels.append(one_channel(one, part.weight[c].astype(dtype)))
        return jnp.stack(channels)
    return jax.vmap(one_channel, in_axes=(-1, 0))(cast, part.weight.astype(dtype))


def transfer_local(brdf: Brdf, light: Local, view: Local) -> jax.Array:
    """Transfer function of a prepared BRDF in local frames, ``(C, ...)``.

    The frame's z is the normal, or the tangent where all parts are about it.
    """
    total = None
    for part in brdf.parts:
        values = part_values(part, light, view)
        shape = (brdf.channels, *values.shape[1:])
        values = jnp.broadcast_to(values, shape)
        total = values if total is None else total + values
    assert total is not None  # a BRDF has at least one part
    return total


def in_frame(frame: jax.Array, vectors: jax.Array) -> Local:
    """Components of vectors ``(..., 3)`` in frames ``(..., 3, 3)``."""
    parts = jnp.sum(frame * vectors[..., None, :], axis=-1)
    return Local(parts[..., 0], parts[..., 1], parts[..., 2])


@jax.jit
def transfer(
    brdf: Brdf,
    normals: Float[Array, "*batch 3"],
    lights: Float[Array, "*batch 3"],
    views: Float[Array, "*batch 3"],
    tangents: Float[Array, "*batch 3"] | None = None,
) -> Float[jax.Array, "*batch C"]:
    """Transfer function: BRDF times the clamped cosine, for given directions.

    Args:
        brdf: The reflectance.
        normals: Unit normals.
        lights: Unit vectors to the light.
        views: Unit vectors to the viewer.
        tangents: Unit tangents; needed by models about the tangent.

    Returns:
        The transfer function, sr^-1.

    Raises:
        ValueError: If a shape is wrong or tangents are missing.
    """
    given = {"normals": normals, "lights": lights, "views": views}
    if tangents is not None:
        given["tangents"] = tangents
    for name, vectors in given.items():
        check_vectors(name, vectors)
        if vectors.shape != normals.shape:
            raise ValueError(
                f"{name} must have the shape of normals {normals.shape}; got "
                f"{vectors.shape}."
            )
    ready, total = prepared(brdf), None
    for axes, part in by_frame(ready, normals, tangents):
        frame = frames(axes)
        light, view = (in_frame(frame, jnp.asarray(a)) for a in (lights, views))
        values = transfer_local(part, light, view)
        values = jnp.broadcast_to(values, (brdf.channels, *values.shape[1:]))
        total = values if total is None else total + values
    return jnp.moveaxis(jnp.asarray(total), 0, -1)


def by_frame(brdf: Brdf, normals, tangents):
    """Split a BRDF into its parts in the normals' frame and in the tangents' frame.

    Raises:
        ValueError: If there are parts about the tangent and no tangents.
    """
    found = []
    about_normal = select(brdf, "normal", "reflection")
    if about_normal is not None:
        found.append((normals, about_normal))
    about_tangent = select(brdf, "tangent")
    if about_tangent is not None:
        if tangents is None:
            raise ValueError("tangents must be given: a part is about the tangent.")
        found.append((tangents, about_tangent))
    return found
