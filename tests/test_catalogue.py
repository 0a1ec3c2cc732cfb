"""The table of BRDFs: what the parser, the lobes and the library make of each row."""

import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shjax
from shjax import brdf
from shjax.brdf.catalogue import BRDFS
from shjax.inverse.reflectance.lobes import FAMILIES
from tests.helpers import check_gradients, unit_vectors

ANALYTIC = [name for name, row in BRDFS.items() if row.example]


def pairs(rng, n):
    """Normals, lights and views above the surface, tangents across it."""
    normals = unit_vectors(rng, n)
    lights, views = (
        v * np.sign(np.sum(v * normals, axis=1, keepdims=True))
        for v in (unit_vectors(rng, n), unit_vectors(rng, n))
    )
    tangents = np.cross(normals, unit_vectors(rng, n))
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    return [jnp.asarray(a) for a in (normals, lights, views, tangents)]


@pytest.mark.parametrize("name", ANALYTIC)
def test_a_row_is_what_its_words_make(name, rng):
    """By the parser as by the function; non-negative, of at most unit albedo, radial if told."""
    row = BRDFS[name]
    words = row.example.split()
    assert words[0] == name
    assert getattr(brdf, name) is row.make
    parsed = brdf.parse(row.example)
    values = dict(word.split("=") for word in words[1:])
    direct = row.make(**{key: float(value) for key, value in values.items()})
    same = [
        np.array_equal(a, b)
        for a, b in zip(jax.tree.leaves(parsed), jax.tree.leaves(direct))
    ]
    assert all(same)
    normals, lights, views, tangents = pairs(rng, 200)
    found = np.asarray(brdf.transfer(parsed, normals, lights, views, tangents))
    assert np.all(np.isfinite(found))
    assert np.all(found >= 0)
    assert np.any(found > 0)
    assert row.radial == all(part.model.radial is not None for part in parsed.parts)
    if name != "kajiya_kay":  # a transfer function of fibres is not normalised
        assert brdf.check(parsed).albedo.max() < 1.01
    rho = shjax.brdf_coefs(parsed, l_max=3, p_max=1)
    assert np.all(np.isfinite(np.asarray(rho)))


def test_parser_lobes_and_library_know_the_same():
    made = {n for n in dir(brdf) if n in BRDFS and callable(getattr(brdf, n))}
    assert made == set(ANALYTIC)
    lobes = [lobe for row in BRDFS.values() for lobe in row.lobes]
    assert len(lobes) == len(set(lobes))
    assert set(lobes) - {"diffuse"} == set(FAMILIES)
    for family in FAMILIES.values():
        assert len(inspect.signature(family.lobe).parameters) >= len(family.shapes)


def test_sheen_by_its_formula(dtype):
    """[EK17]: D of inverted Gaussians, and Lambda as tabulated, at one pair of directions."""
    alpha = 0.36
    light, view = np.array([0.6, 0, 0.8]), np.array([0, -0.28, 0.96])
    half = (light + view) / np.linalg.norm(light + view)
    sine = np.sqrt(1 - half[2] ** 2)
    density = (2 + 1 / alpha) * sine ** (1 / alpha) / (2 * np.pi)
    share = (1 - alpha) ** 2
    rough, smooth = (
        (21.5473, 3.82987, 0.19823, -1.97760, -4.32054),
        (25.3245, 3.32435, 0.16801, -1.27393, -4.85967),
    )
    a, b, c, d, e = ((1 - share) * r + share * s for r, s in zip(rough, smooth))

    def curve(x):
        return a / (1 + b * x**c) + d * x + e

    hidden = [np.exp(2 * curve(0.5) - curve(1 - v[2])) for v in (light, view)]
    expected = density / (4 * view[2] * (1 + sum(hidden)))
    up = jnp.asarray([[0.0, 0, 1]], dtype)
    vectors = (jnp.asarray(v[None], dtype) for v in (light, view))
    found = brdf.transfer(brdf.charlie(np.asarray(alpha, dtype)), up, *vectors)
    assert float(found[0, 0]) == pytest.approx(
        expected, rel=1e-5 if dtype == np.float32 else 1e-12
    )


@pytest.mark.x64
def test_gradients_of_the_sheen(rng):
    normals, lights, views, _ = pairs(rng, 20)
    check_gradients(
        lambda a: brdf.transfer(brdf.charlie(a), normals, lights, views),
        jnp.asarray([0.3, 0.7]),
        tolerance=1e-6,
    )


@pytest.mark.slow
@pytest.mark.x64
def test_sheen_from_a_picture(rng):
    """Made by the integral, recovered by the lobe of the same row."""
    light = np.zeros((81, 1))
    light[:25] = 0.3 * rng.normal(size=(25, 1))
    light[0] += 4
    panorama = shjax.synthesize(jnp.asarray(light), n_theta=48, n_phi=96)
    normals, _, views, _ = pairs(rng, 600)
    kept = np.sum(np.asarray(normals * views), axis=1) > 0.35
    normals, views = normals[kept], views[kept]
    surface = 0.8 * brdf.charlie(0.5)
    image = shjax.reference_reflection(panorama, surface, normals, views)
    found = shjax.estimate_brdf(
        image, normals, views, jnp.asarray(light), lobe="charlie"
    )
    np.testing.assert_allclose(np.asarray(found.value)[:, 0], [0.5, 0.8], rtol=0.03)
