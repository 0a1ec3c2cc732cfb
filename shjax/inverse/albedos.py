"""Albedo that is not known, from pictures of one view under several lights.

``I_vn = a_n (A L_v)_n``: an unknown factor a pixel. Two pictures of a pixel together have
none, ``I_vn (A L_w)_n = I_wn (A L_v)_n``, which is linear in all lights: exact without
noise, it is one start of the search; equal albedos are the other. In the search the
albedos are eliminated (variable projection). Only their scale against the lights stays
open, and is set so that the mean albedo is 1.
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import optimistix as optx

from shjax.arrays import as_float, shape_of
from shjax.inverse.rows import cosine_rows
from shjax.inverse.surfaces import make_surface

_PIXELS = 1500
_STEPS = 64
_matmul = functools.partial(jnp.matmul, precision=jax.lax.Precision.HIGHEST)


def unknown_albedo(image, normals, mask, brdf, rows, l_max: int) -> jax.Array:
    """Albedos ``(*points, C)`` from pictures ``(V, *points, C)``.

    Raises:
        ValueError: If the surface is not matte, or there are not several pictures of it.
    """
    points = shape_of("image", image)[1:-1]
    if brdf is not None or rows is not None or normals is None:
        raise ValueError("albedo None is for a matte surface with normals.")
    if image.ndim < 3 or image.shape[0] < 2 or normals.shape != (*points, 3):
        raise ValueError(
            "albedo None needs pictures (V, *points, C) of V >= 2 lights and normals "
            f"(*points, 3); got {image.shape} and {normals.shape}."
        )
    first = make_surface(image[0], normals, mask, 1.0, None, None, 0.0, None)
    assert first.normals is not None
    pictures = as_float("image", image).reshape(image.shape[0], -1, image.shape[-1])
    found = estimate_albedo(pictures, first.normals, first.pixels.weights, l_max=l_max)
    return found.astype(pictures.dtype).reshape(image.shape[1:])


def side_by_side(image, albedo) -> tuple[jax.Array, jax.Array]:
    """Pictures and albedo with a channel for each light and colour."""
    count = image.shape[0]
    wide = jnp.moveaxis(jnp.asarray(image), 0, -2)  # [..., v, c]
    repeated = jnp.broadcast_to(albedo[..., None, :], wide.shape)
    flat = (*wide.shape[:-2], count * wide.shape[-1])
    return wide.reshape(flat), repeated.reshape(flat)


@functools.partial(jax.jit, static_argnames=("l_max",))
def estimate_albedo(
    images: jax.Array, normals: jax.Array, weights: jax.Array, *, l_max: int
) -> jax.Array:
    """Albedos ``(N, C)`` of mean 1, of matte pixels.

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
    _, vectors = jnp.linalg.eigh(_matmul(stacked.T, stacked))
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
    lights = jax.scipy.linalg.solve_triangular(r, _matmul(q.T, right)).T
    return lights / jnp.maximum(jnp.linalg.norm(lights), 1e-30)


def _residual(lights, args) -> jax.Array:
    pictures, rows, root = args
    made = _matmul(lights, rows.T) * _albedo(pictures, lights, rows)[None]
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
    made = _matmul(lights, rows.T)
    power = jnp.sum(made * made, axis=0)
    return jnp.sum(made * pictures, axis=0) / jnp.where(power > 0, power, 1)
