"""Linearly transformed cosines: exact for Lambertian, known errors for GGX."""

import jax.numpy as jnp
import numpy as np
import pytest

from shjax import brdf, lights, ltc
from tests.helpers import relative_error, unit_vectors
from tests.test_area_lights import FACE, ORIGIN, UP, some_lights


def test_a_lambertian_lobe_is_its_cosine(rng, dtype):
    """Then every transform is one of space: all lights at once, and the horizon."""
    table = ltc.fit(brdf.lambertian(np.asarray([0.5, 0.25], dtype)))
    assert float(jnp.max(table.error)) < 1e-2  # of the quadrature at the last view
    made = [light for k, light in enumerate(some_lights(dtype)) if k != 4]
    points = (0.2 * rng.normal(size=(20, 3))).astype(dtype)
    normals = unit_vectors(rng, 20).astype(dtype)
    views = normals + 0.5 * unit_vectors(rng, 20).astype(dtype)
    views = views / np.linalg.norm(views, axis=1, keepdims=True)
    found = table.radiance(made, points, normals, views)
    exact = lights.area_irradiance(made, points, normals) / np.pi
    exact = np.asarray(exact) * np.array([0.5, 0.25], dtype)
    assert relative_error(found, exact) < (2e-3 if dtype == np.float32 else 1e-4)
    with pytest.raises(ValueError, match="must not be a CapsuleLight"):
        table.radiance(some_lights(dtype)[4], points, normals, views)


@pytest.mark.x64
def test_errors_of_ggx_are_those_known():
    """L1 errors of the lobe at 0, 46 and 60 degrees, and the converged albedo."""
    table = ltc.fit(brdf.ggx(np.float64(0.2), 1.0))
    cosine = 1 - np.linspace(0, 1, 32) ** 2
    at = [int(np.argmin(np.abs(cosine - np.cos(np.radians(a))))) for a in (0, 46, 60)]
    np.testing.assert_allclose(
        np.asarray(table.error)[at], [0.03, 0.08, 0.18], atol=0.01
    )
    narrow = ltc.fit(brdf.ggx(np.float64(0.1008), 1.0), views=2)
    np.testing.assert_allclose(narrow.albedo[0, 0], 0.98811, atol=2e-5)
    assert "32 views" in repr(table)


@pytest.mark.x64
def test_a_glossy_reflection_is_as_good_as_the_fit(rng):
    """Within a few hundredths of the integral; harmonics of degree 16 are closer."""
    surface = brdf.ggx(np.float64(0.2), 1.0)
    table = ltc.fit(surface)
    light = lights.polygon(0.5 * FACE + np.array([0.2, 0, 0.5]), 1.0)
    angles = np.radians(np.linspace(-45, 45, 24))
    views = np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=-1)
    points, normals = (np.repeat(a, 24, axis=0) for a in (ORIGIN, UP))
    given = (points, normals, views)
    exact = lights.area_reflection(light, surface, *given)
    error = relative_error(table.radiance(light, *given), exact)
    assert 1e-3 < error < 0.04
    close = lights.area_shade(light, surface, *given, l_max=16)
    assert relative_error(close, exact) < 0.5 * error


@pytest.mark.usefixtures("as_a_user")
def test_what_is_refused():
    with pytest.raises(ValueError, match="about the tangent"):
        ltc.fit(brdf.kajiya_kay(8.0))
    with pytest.raises(ValueError, match="views must be an integer"):
        ltc.fit(brdf.lambertian(1.0), views=1)
