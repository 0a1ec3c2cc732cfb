"""Lighting and reflectance together, as far as pictures determine both.

Given the reflectance the picture is linear in the light, so the light is eliminated
(variable projection [GP73]) and the search walks in the reflectance's few parameters.
What remains open is read from the derivatives of the whole problem at its end: the
light's scale against the albedo always; from a lobe that is radial about R, every degree
of the light against the lobe's gain there, from however many views and lights, since
``B_lm = a_l L_lm`` [RH01, section 5.1].

References:
    [GP73] G. Golub, V. Pereyra, The differentiation of pseudo-inverses and nonlinear
    least squares problems whose variables separate, 1973.
    [RH01] R. Ramamoorthi and P. Hanrahan, A signal-processing framework for inverse
    rendering, SIGGRAPH 2001.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from shjax.arrays import Array, check_channels, matmul
from shjax.brdf.transfer_rows import glossy_rows, table_to
from shjax.harmonics import basis
from shjax.harmonics.degrees import check_l_max, degrees
from shjax.inverse.brdf import check_pictures
from shjax.inverse.estimate import Estimate
from shjax.inverse.linear.least_squares import inverse_and_log_det
from shjax.inverse.reflectance.ambiguity import HELD, joint_estimate
from shjax.inverse.reflectance.families import LobeFamily
from shjax.inverse.reflectance.free_gains import FreeGains
from shjax.inverse.reflectance.lobes import AnyLobe, Radial, as_search
from shjax.inverse.reflectance.nonlinear import approach, refine, search
from shjax.inverse.shown.pixels import Pixels, fit
from shjax.vectors import mirror

_SEARCHED = 500  # pixels of the search from many starts
_ROUGH = 0.01  # of the picture: the search's standard deviation of a pixel
_MIN_NOISE = 1e-4  # of the picture: no better is the forward model
_LIGHTLY = 1e-5  # of the design: what the surface does not show is held at 0 by this


def estimate_joint(
    images: Float[Array, "V *points C"],
    normals: Float[Array, "V *points 3"],
    views: Float[Array, "V *points 3"],
    *,
    lobe: AnyLobe,
    l_max: int = 4,
    lights: tuple[int, ...] | None = None,
    mask: Float[Array, "V *points"] | Bool[Array, "V *points"] | None = None,
    noise: Float[Array, ...] | float | None = None,
    min_cosine: float = 0.3,
) -> Estimate:
    """Estimate lighting and reflectance together from pictures of one material.

    Args:
        images: Linear radiance of V pictures.
        normals: Unit normals, zero where nothing is seen.
        views: Unit vectors to the viewer.
        lobe: ``"radial"`` (free gains ``a_l`` about R), a parametric lobe as in
            :func:`shjax.estimate_brdf`, or what :func:`shjax.inverse.lobe` makes of
            either and of parameters that are known.
        l_max: Highest degree of the light; there must be none above. Static.
        lights: Which light each picture is under, from 0; default one for all. Static.
        mask: Weights >= 0 of the squared residuals.
        noise: Standard deviation of a pixel of weight 1; None: from the residual.
        min_cosine: Pixels with ``n.v`` below are left out. Static.

    Returns:
        An :class:`Estimate`: the reflectance's rows, then ``L_00, L_1-1, ...`` of each
        light. ``null_space`` holds the directions (of the brightest channel, the
        reflectance in its free form, the light over its largest) that no picture changes
        along; then ``ok`` is false,
        ``message`` names them, what lies in them has infinite variance, and stands where
        the prior put it.

    Raises:
        ValueError: If shapes do not fit, or a name is unknown.
    """
    check_l_max(l_max)
    check_channels("images", images, "V, C", 2)
    count = images.shape[0]
    numbers = np.zeros(count, int) if lights is None else np.asarray(lights, int)
    kinds = np.unique(numbers)
    if numbers.shape != (count,) or not np.array_equal(kinds, np.arange(len(kinds))):
        raise ValueError(
            f"lights must number the light of each of {count} pictures from 0; got "
            f"{lights}."
        )
    pixels, normals, views = check_pictures(
        images, normals, views, mask, 1.0, min_cosine
    )
    channels, dtype = pixels.image.shape[-1], pixels.image.dtype
    sigma = None if noise is None else fit("noise", noise, (channels,), dtype)
    search_for = as_search(lobe)
    kind = search_for.kind
    if isinstance(kind, Radial):
        kind = FreeGains(l_max)
    if not isinstance(kind, LobeFamily | FreeGains):
        raise ValueError("lobe must be radial or a parametric lobe; got general.")
    centre, spread = _held(kind, channels, search_for.known)
    wide = jnp.result_type(float)
    begin = kind.starts(channels, search_for.starts)
    begin = np.where(spread == HELD, centre, begin)
    of_pixel = np.repeat(numbers, pixels.image.shape[0] // count)
    return _estimate(
        pixels,
        normals,
        views,
        sigma,
        jnp.asarray(begin, wide),
        (jnp.asarray(centre, wide), jnp.asarray(spread, wide)),
        jnp.asarray(of_pixel),
        kind=kind,
        l_max=l_max,
        lights=len(kinds),
        min_cosine=min_cosine,
    )


def _held(kind: LobeFamily | FreeGains, channels: int, known: dict[str, float]):
    """The prior, with known parameters held: means and standard deviations."""
    centre, spread = (np.array(a) for a in kind.prior(channels))
    for name, value in known.items():
        places, free = kind.place_of(name, value, channels)
        centre[places], spread[places] = free, HELD
    return centre, spread


class _Data(NamedTuple):
    """Pixels, and what the light is eliminated from."""

    normals: jax.Array
    views: jax.Array
    root: jax.Array
    image: jax.Array
    of_pixel: jax.Array


@functools.partial(jax.jit, static_argnames=("kind", "l_max", "lights", "min_cosine"))
def _estimate(
    pixels: Pixels,
    normals: jax.Array,
    views: jax.Array,
    sigma: jax.Array | None,
    starts: jax.Array,
    prior: tuple[jax.Array, jax.Array],
    of_pixel: jax.Array,
    *,
    kind: LobeFamily | FreeGains,
    l_max: int,
    lights: int,
    min_cosine: float,
) -> Estimate:
    channels, wide = pixels.image.shape[-1], starts.dtype
    root = jnp.sqrt(pixels.weights).astype(wide)
    image = jnp.where(root[:, None] > 0, pixels.image.astype(wide), 0) * root[:, None]
    used = jnp.maximum(jnp.sum(root > 0), 1).astype(wide)
    level = jnp.sqrt(jnp.sum(image * image, axis=0) / used)
    level = jnp.maximum(level, jnp.finfo(wide).tiny ** 0.5)
    data = _Data(normals.astype(wide), views.astype(wide), root, image, of_pixel)
    design = functools.partial(_design, kind, l_max, lights, min_cosine)

    def compare(vector, args):
        data, sigma = args
        _, left = _eliminate(design(vector, data), data.image)
        return (left / sigma[None]).ravel()

    step = -(-image.shape[0] // _SEARCHED)
    few = jax.tree.map(lambda a: a[::step], data)
    start = search(compare, (few, _ROUGH * level), starts, prior)
    if sigma is None:
        start = approach(compare, (data, _ROUGH * level), start, prior)
        _, left = _eliminate(design(start, data), image)
        unknowns = len(prior[0]) / channels + lights * (l_max + 1) ** 2
        freedom = jnp.maximum(used - unknowns, 1)
        sigma = jnp.sqrt(jnp.sum(left * left, axis=0) / freedom)
    sigma = jnp.maximum(sigma.astype(wide), _MIN_NOISE * level)
    found = refine(compare, (data, sigma), start, prior)
    light, left = _eliminate(design(found.value, data), image)
    squares = jnp.sum(left * left, axis=0)
    brightest = jnp.argmax(jnp.sum(image * image, axis=0))
    return joint_estimate(
        kind,
        found,
        light,
        lambda vector: design(vector, data),
        prior[1],
        sigma,
        squares,
        brightest,
        pixels.image.dtype,
        l_max=l_max,
        lights=lights,
    )


def _design(
    kind: LobeFamily | FreeGains,
    l_max: int,
    lights: int,
    min_cosine: float,
    vector: jax.Array,
    data: _Data,
) -> jax.Array:
    """The picture's derivatives in the light's coefficients, ``(C, N, lights K)``."""
    channels = data.image.shape[1]
    rows = 0.0
    if isinstance(kind, FreeGains):
        about = basis(mirror(data.normals, data.views), l_max=l_max)[None]
        gains = kind.natural(vector.reshape(-1, channels))[degrees(l_max)].T[:, None]
        shape = (channels, *about.shape[1:])
        rows = jnp.broadcast_to(about, shape) * jnp.broadcast_to(gains, shape)
    else:
        table = table_to(min_cosine)
        for brdf, share in zip(*kind.split(vector, channels), strict=True):
            part = glossy_rows(brdf, data.normals, data.views, l_max, table)[..., 0]
            rows = rows + part[None] * share[:, None, None]
    rows = rows * data.root[None, :, None]
    of_light = jnp.arange(lights)[None] == data.of_pixel[:, None]  # [n, light]
    wide = rows[:, :, None] * of_light.astype(rows.dtype)[None, :, :, None]
    return wide.reshape(*rows.shape[:2], -1)


def _eliminate(design: jax.Array, image: jax.Array):
    """The light that fits best ``(J, C)``, and what it leaves ``(N, C)``.

    What the surface does not show is held at 0, lightly.
    """
    light, left = [], []
    for rows, column in zip(design, image.T, strict=True):
        gram = matmul(rows.T, rows)
        held = _LIGHTLY**2 * jnp.trace(gram) / gram.shape[0]
        scale = jax.lax.rsqrt(jnp.diagonal(gram) + held)
        matrix = gram * scale[:, None] * scale[None] + jnp.diag(held * scale * scale)
        # By products alone, derivatives too: see there.
        inverse, _ = inverse_and_log_det(matrix)
        inverse = inverse * scale[:, None] * scale[None]
        one = jnp.zeros(gram.shape[0], rows.dtype)
        for _ in range(2):  # the second makes up for what squaring the rows has cost
            rest = column - matmul(rows, one)
            slope = matmul(rows.T, rest)
            one = one + matmul(inverse, slope - held * one)
        light.append(one)
        left.append(column - matmul(rows, one))
    return jnp.stack(light, axis=1), jnp.stack(left, axis=1)
