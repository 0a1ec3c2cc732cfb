"""Layouts and environment maps: one light in every layout gives one answer."""

import numpy as np
import pytest

import shjax
from shjax.layouts import LAYOUTS, guess_layout
from tests.helpers import relative_error, unit_vectors

SIZES = {"latlong": (64, 128), "angular": (256, 256), "vertical_cross": (256, 192)}


def smooth_image(layout, rng, channels=3):
    """A degree-2 light drawn in a layout, and its coefficients."""
    coefs = rng.normal(size=((9, channels)))
    coefs[0] += 5
    directions, _ = LAYOUTS[layout].pixels(*SIZES[layout])
    image = np.asarray(
        shjax.evaluate(coefs.astype(np.float32), directions.astype(np.float32))
    )
    return coefs, image


@pytest.mark.parametrize("layout", LAYOUTS)
def test_directions_are_unit_and_solid_angles_cover_the_sphere(layout):
    directions, solid_angles = LAYOUTS[layout].pixels(*SIZES[layout])
    np.testing.assert_allclose(np.linalg.norm(directions[solid_angles > 0], axis=-1), 1)
    # The angular map loses the slivers of pixels whose centre lies outside the circle.
    limit = 1e-4 if layout == "angular" else 1e-13
    assert solid_angles.sum() == pytest.approx(4 * np.pi, rel=limit)
    # First moments vanish: no side is favoured.
    moment = np.einsum("hwi,hw->i", directions, solid_angles)
    np.testing.assert_allclose(moment, 0, atol=2e-4)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_lookup_undoes_pixels(layout):
    height, width = SIZES[layout]
    directions, solid_angles = LAYOUTS[layout].pixels(height, width)
    inside = solid_angles > 0
    row, column = LAYOUTS[layout].lookup(directions[inside], height, width)
    rows, columns = np.indices((height, width))
    np.testing.assert_allclose(row, rows[inside], atol=1e-6)
    np.testing.assert_allclose(column, columns[inside], atol=1e-6)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_centre_right_and_top(layout):
    height, width = SIZES[layout]
    towards = np.array([[1, 0, 0], [0.9, -0.4, 0], [0.9, 0, 0.4]], float)
    towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
    row, column = LAYOUTS[layout].lookup(towards, height, width)
    assert column[1] > column[0]
    assert row[2] < row[0]
    if layout != "vertical_cross":  # its centre tile is the second of four
        np.testing.assert_allclose(
            [row[0], column[0]], [(height - 1) / 2, (width - 1) / 2]
        )


def test_cube_texels_have_exact_solid_angles():
    _, solid_angles = LAYOUTS["vertical_cross"].pixels(4, 3)
    np.testing.assert_allclose(solid_angles[solid_angles > 0], 4 * np.pi / 6)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_gives_the_same_coefficients(layout, rng):
    coefs, image = smooth_image(layout, rng)
    envmap = shjax.make_envmap(image, layout=layout)
    # The pixels' own quadrature: midpoints on the angular map and the cube, exact here.
    limit = {"latlong": 1e-6, "angular": 1e-4, "vertical_cross": 1e-4}[layout]
    assert relative_error(envmap.lighting(l_max=2), coefs) < limit


@pytest.mark.parametrize("layout", LAYOUTS)
def test_resampling_keeps_a_smooth_light(layout, rng):
    coefs, image = smooth_image(layout, rng)
    latlong = shjax.make_envmap(image, layout=layout).to_latlong(32)
    assert latlong.layout == "latlong"
    assert latlong.radiance.shape == (32, 64, 3)
    assert latlong.radiance.dtype == image.dtype
    assert relative_error(latlong.lighting(l_max=2), coefs) < 2e-3


@pytest.mark.parametrize("n_theta", [7, 16, 64, 100])
def test_shrinking_keeps_the_energy_of_one_bright_pixel(n_theta):
    image = np.ones((64, 128, 3), np.float32)
    image[11, 77] = 1e5
    envmap = shjax.make_envmap(image)
    small = envmap.to_latlong(n_theta)
    exact = _total(image)
    assert _total(small.radiance) == pytest.approx(exact, rel=1e-5)


def _total(radiance):
    from shjax.sphere import latlong_solid_angles

    n_theta, n_phi, _ = radiance.shape
    rows = latlong_solid_angles(n_theta, n_phi)
    return float(np.sum(radiance.astype(float) * rows[:, None, None]))


def test_samples_integrate_constants():
    for layout, size in SIZES.items():
        envmap = shjax.make_envmap(np.ones((*size, 1), np.float32), layout=layout)
        radiance, directions, weights = envmap.samples()
        assert directions.shape == (radiance.shape[0], 3)
        assert np.sum(weights) == pytest.approx(4 * np.pi, rel=1e-4)


def test_layout_is_guessed_and_said():
    assert guess_layout(100, 100) == "angular"
    envmap = shjax.make_envmap(np.ones((8, 16, 3), np.float32))
    assert envmap.report.layout_guessed
    assert "latlong (told from its shape)" in str(envmap.report)
    named = shjax.make_envmap(np.ones((8, 10, 3), np.float32), layout="latlong")
    assert not named.report.layout_guessed


@pytest.mark.parametrize(
    ("shape", "layout", "message"),
    [
        ((8, 10, 3), "auto", "cannot be told from 10 x 8"),
        ((8, 16, 3), "sphere", "layout must be one of"),
        ((8, 16, 3), "angular", "aspect 1:1"),
        ((8, 16, 0), "latlong", "H, W, C"),
    ],
)
def test_wrong_layouts_are_refused(shape, layout, message):
    with pytest.raises(ValueError, match=message):
        shjax.make_envmap(np.ones(shape, np.float32), layout=layout)


def test_zero_rows_are_refused():
    with pytest.raises(ValueError, match="n_theta must be positive"):
        shjax.make_envmap(np.ones((8, 16, 3), np.float32)).to_latlong(0)


def test_lookup_near_a_pole_reads_the_polar_rows(rng):
    near = np.concatenate([unit_vectors(rng, 20) * 1e-9 + [0, 0, s] for s in (1, -1)])
    near /= np.linalg.norm(near, axis=-1, keepdims=True)
    row, column = LAYOUTS["latlong"].lookup(near, 8, 16)
    assert np.all((row[:20] <= 0) & (row[20:] >= 7))
    assert np.all(np.isfinite(column))
