"""Albedo that is not known, from pictures of one view under several lights.

``I_vn = a_n (A L_v)_n``: an unknown factor per pixel. Two pictures of a pixel together have
none, ``I_vn (A L_w)_n = I_wn (A L_v)_n``, which is linear in all lights: exact without
noise, it is one start of the search; equal albedos are the other. In the search the
albedos are eliminated (variable projection). Only their scale against the lights stays
open, and is set so that the mean albedo is 1.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
import optimistix as optx
from jaxtyping import Bool, Float

from shjax.arrays import Array, as_float, matmul, shape_of
from shjax.inverse.estimate import Estimate
from shjax.inverse.lighting import estimate_lighting
from shjax.inverse.linear.priors import PicturePrior
from shjax.inverse.shown.rows import cosine_rows
from shjax.inverse.shown.surface import flat_picture

_PIXELS = 1500
_STEPS = 64


class AlbedoEstimate(NamedTuple):
    """Lights and albedos from pictures, :func:`estimate_albedo`.

    Attributes:
        lighting: The lights given the albedos, a channel for each light and colour,
            ``(K, V C)``, up to one scale per colour. Its error bars are those of known
            albedos: what the albedos themselves are wrong by is not in them, and with
            noise and two pictures it is several times more.
        albedo: Of each pixel, of mean 1, ``(*points, C)``.
    """

    lighting: Estimate
    albedo: Float[jax.Array, "*points C"]


def estimate_albedo(
    images: Float[Array, "V *points C"],
    normals: Float[Array, "*points 3"],
    *,
    mask: Float[Array, ...] | Bool[Array, ...] | None = None,
    l_max: int = 2,
    noise: Float[Array, ...] | float | None = None,
    prior: str | PicturePrior | Float[Array, ...] | None = "picture",
    loss: str = "squares",
    clipped: Bool[Array, ...] | None = None,
) -> AlbedoEstimate:
    """Estimate the diffuse albedo of each pixel, and the lights of several pictures.

    The lights need not be known. The error bars of the lights take the albedos as known.

    Args:
        images: Linear radiance of one view of a Lambertian surface under V >= 2 lights.
        normals: Unit normals, zero for pixels that show nothing.
        mask: Weights >= 0 of the squared residuals ``(*points)``.
        l_max: Highest degree of the lights. Static.
        noise: As in :func:`shjax.estimate_lighting`.
        prior: As there.
        loss: As there. Static.
        clipped: As there, ``(V, *points, C)``.

    Raises:
        ValueError: If there are not several pictures of a surface, or as there.
    """
    points = shape_of("images", images)[1:-1]
    if images.ndim < 3 or images.shape[0] < 2:
        raise ValueError(
            f"images must be (V, *points, C) of V >= 2 lights; got {images.shape}."
        )
    if shape_of("normals", normals) != (*points, 3):
        raise ValueError(
            f"normals must have shape {(*points, 3)} to fit images; got {normals.shape}."
        )
    first = flat_picture(images[0], normals, mask, 1.0)
    assert first.surface.normals is not None
    pictures = as_float("images", images).reshape(images.shape[0], -1, images.shape[-1])
    flat_normals = jnp.asarray(first.surface.normals)
    found = _albedos(pictures, flat_normals, first.pixels.weights, l_max=l_max)
    albedo = found.astype(pictures.dtype).reshape(images.shape[1:])
    wide, repeated = _side_by_side(images, albedo)
    if clipped is not None:
        clipped = jnp.moveaxis(jnp.asarray(clipped), 0, -2).reshape(wide.shape)
    lighting = estimate_lighting(
        wide,
        normals,
        mask=mask,
        albedo=repeated,
        l_max=l_max,
        noise=noise,
        prior=prior,
        loss=loss,
        clipped=clipped,
    )
    return AlbedoEstimate(lighting, albedo)


def _side_by_side(image, albedo) -> tuple[jax.Array, jax.Array]:
    """Pictures and albedo with a channel for each light and colour."""
    count = image.shape[0]
    wide = jnp.moveaxis(jnp.asarray(image), 0, -2)  # [..., v, c]
    repeated = jnp.broadcast_to(albedo[..., None, :], wide.shape)
    flat = (*wide.shape[:-2], count * wide.shape[-1])
    return wide.reshape(flat), repeated.reshape(flat)


@functools.partial(jax.jit, static_argnames=("l_max",))
def _albedos(
    images: jax.Array, normals: jax.Array, weights: jax.Array, *, l_max: int
) -> jax.Array:
    """Albedos ``(N, C)`` of mean 1, of Lambertian pixels.

    Args:
        images: ``(V, N, C)``.
        normals: ``(N, 3)``.
        weights: ``(N,)``.
        l_max: Highest degree of the lights. Static.
    """
    wide = jnp.result_type(float)
    images, normals, weights = (a.astype(wide) for a in (images, normals, weights))
    used = weights > 0
    images = jnp.where(used[None, :, None], images, 0)
    step = -(-normals.shape[0] // _PIXELS)
    rows = cosine_rows(normals, l_max)

    def channel(pictures):
        unit = jnp.maximum(jnp.max(jnp.abs(pictures)), jnp.finfo(wide).tiny ** 0.5)
        pictures = pictures / unit
        root = jnp.sqrt(weights[::step])
        some = (pictures[:, ::step], rows[::step], root)
        ends = [_descend(start(*some), some) for start in (_crossed, _of_equal)]
        losses = jnp.stack([jnp.sum(_residual(end, some) ** 2) for end in ends])
        lights = jnp.stack(ends)[jnp.argmin(losses)]
        albedo = _albedo(pictures, lights, rows)
        mean = jnp.sum(albedo * weights) / jnp.maximum(jnp.sum(weights), 1e-30)
        return albedo / jnp.where(jnp.abs(mean) > 0, mean, 1)

    found = jax.lax.map(channel, jnp.moveaxis(images, -1, 0)).T
    return jnp.where(used[:, None], found, 0)


def _crossed(pictures, rows, root) -> jax.Array:
    """Lights ``(V, J)``, of norm 1, that cross-multiplied pictures agree on best."""
    count, size = pictures.shape[0], rows.shape[1]
    blocks = []
    for v in range(count):
        w = (v + 1) % count
        block = jnp.zeros((rows.shape[0], count, size), rows.dtype)
        block = block.at[:, w].set(rows * (pictures[v] * root)[:, None])
        blocks.append(block.at[:, v].add(-rows * (pictures[w] * root)[:, None]))
    stacked = jnp.concatenate(blocks).reshape(-1, count * size)
    _, vectors = jnp.linalg.eigh(matmul(stacked.T, stacked))
    lights = vectors[:, 0].reshape(count, size)
    return lights * jnp.where(jnp.sum(lights[:, 0]) < 0, -1, 1)


def _of_equal(pictures, rows, root) -> jax.Array:
    """Lights of norm 1 under which equal albedos come nearest."""
    weighted = rows * root[:, None]
    size = rows.shape[1]
    held = 1e-6 * jnp.sqrt(jnp.sum(weighted**2) / size) * jnp.eye(size)
    tall = jnp.concatenate([weighted, held.astype(rows.dtype)])
    right = jnp.pad((pictures * root[None]).T, ((0, size), (0, 0)))
    q, r = jnp.linalg.qr(tall)
    lights = jax.scipy.linalg.solve_triangular(r, matmul(q.T, right)).T
    return lights / jnp.maximum(jnp.linalg.norm(lights), 1e-30)


def _residual(lights, args) -> jax.Array:
    pictures, rows, root = args
    made = matmul(lights, rows.T) * _albedo(pictures, lights, rows)[None]
    # The scale is open: it is held where it was.
    size = jnp.sum(lights**2)[None] - 1
    return jnp.concatenate([((made - pictures) * root[None]).ravel(), size])


def _descend(start, data) -> jax.Array:
    tight = float(jnp.finfo(start.dtype).eps) ** 0.6
    solution = optx.least_squares(
        _residual,
        optx.LevenbergMarquardt(tight, tight),
        start,
        args=data,
        max_steps=_STEPS,
        throw=False,
        options={"jac": "fwd"},
    )
    return solution.value


def _albedo(pictures, lights, rows) -> jax.Array:
    """Of each pixel, ``(N,)``, by least squares over the lights."""
    made = matmul(lights, rows.T)
    power = jnp.sum(made * made, axis=0)
    return jnp.sum(made * pictures, axis=0) / jnp.where(power > 0, power, 1)
