"""Layouts and environment maps: one light in every layout gives one answer."""

import numpy as np
import pytest

import shjax
from shjax.layouts import LAYOUTS, guess_layout
from shjax.layouts.resampling import resample
from shjax.sphere import fibonacci_directions
from tests.helpers import relative_error, unit_vectors

# Sides at which the pixels resolve a light of nine coefficients to 1e-5.
SIDES = {
    "latlong": 64,
    "angular": 1024,
    "mirror_ball": 2048,
    "vertical_cross": 128,
    "horizontal_cross": 128,
    "vertical_strip": 128,
    "horizontal_strip": 128,
    "octahedral": 512,
    "dual_paraboloid": 512,
    "openexr_latlong": 512,
    "openexr_cube": 128,
}
SIZES = {name: LAYOUTS[name].shape(side) for name, side in SIDES.items()}
OF_A_CUBE = ("vertical_cross", "horizontal_cross", "vertical_strip", "openexr_cube")


def light(rng, channels=3):
    coefs = rng.normal(size=((9, channels)))
    coefs[0] += 5
    return coefs


def drawn(coefs, layout, size):
    """A light drawn in a layout; pixels outside hold junk."""
    directions, solid_angles = LAYOUTS[layout].pixels(*size)
    image = shjax.evaluate(coefs.astype(np.float32), directions.astype(np.float32))
    return np.where((solid_angles > 0)[..., None], image, np.float32(1e4))


@pytest.mark.parametrize("layout", LAYOUTS)
def test_directions_are_unit_and_solid_angles_cover_the_sphere(layout):
    directions, solid_angles = LAYOUTS[layout].pixels(*LAYOUTS[layout].shape(32))
    np.testing.assert_allclose(np.linalg.norm(directions[solid_angles > 0], axis=-1), 1)
    assert solid_angles.sum() == pytest.approx(4 * np.pi, rel=1e-13)
    # First moments vanish: no side is favoured. Of the discs, up to the cut pixels.
    moment = np.einsum("hwi,hw->i", directions, solid_angles)
    limit = 0.05 if layout in ("mirror_ball", "dual_paraboloid", "angular") else 2e-3
    np.testing.assert_allclose(moment, 0, atol=limit)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_locate_undoes_towards(layout):
    height, width = LAYOUTS[layout].shape(16)
    directions, solid_angles = LAYOUTS[layout].pixels(height, width)
    inside = solid_angles > 0
    if layout.startswith(
        "openexr"
    ):  # pixels on the edges are on two faces or meridians
        inside[:] = False
        rows = np.arange(height) % 16
        within = (rows > 0) & (rows < 15)
        inside[within, 1 : width - 1] = True
    chart, row, column = LAYOUTS[layout].locate(directions[inside], height, width)
    rows, columns = np.indices((height, width))
    np.testing.assert_allclose(row, rows[inside], atol=1e-6)
    np.testing.assert_allclose(column, columns[inside], atol=1e-6)
    np.testing.assert_array_equal(chart, LAYOUTS[layout].charts(height, width)[inside])


@pytest.mark.parametrize("layout", [name for name in LAYOUTS if name != "octahedral"])
def test_centre_right_and_top(layout):
    height, width = LAYOUTS[layout].shape(16)
    towards = np.array([[1, 0, 0], [0.9, -0.4, 0], [0.9, 0, 0.4]], float)
    towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
    _, row, column = LAYOUTS[layout].locate(towards, height, width)
    assert column[1] > column[0]
    assert row[2] < row[0]


def test_the_octahedral_map_looks_up():
    towards = np.array([[0, 0, 1.0], [0.1, 0, 1], [0, -0.1, 1]])
    _, row, column = LAYOUTS["octahedral"].locate(towards, 16, 16)
    assert (row[0], column[0]) == (7.5, 7.5)
    assert row[1] > 7.5  # the panorama's centre is below
    assert column[2] > 7.5  # its right is to the right


def test_faces_are_those_of_the_graphics_interfaces():
    # ../shared's README: +X = (1, -V, -U), -X = (-1, -V, U), +Y = (U, 1, V), ...
    n, (u, v) = 4, (0.75, -0.25)  # column 3, row 1
    expected = [
        (1, -v, -u),
        (-1, -v, u),
        (u, 1, v),
        (u, -1, -v),
        (u, -v, 1),
        (-u, -v, -1),
    ]
    directions, _ = LAYOUTS["vertical_strip"].pixels(6 * n, n)
    for face, (x, y, z) in enumerate(expected):
        ours = directions[face * n + 1, 3]
        theirs = np.array([z, -x, y]) / np.linalg.norm([x, y, z])  # x is to the right
        np.testing.assert_allclose(ours, theirs, atol=1e-12)


def test_openexrs_cube_is_the_specifications():
    # ImfEnvmap.cpp: +X has column z, row max - y; +Z has column max - x; ends on edges.
    n = 5
    directions, _ = LAYOUTS["openexr_cube"].pixels(6 * n, n)

    def at(face, row, column):
        y, z, x = directions[face * n + row, column]  # its (x, y, z) is our (y, z, x)
        vector = np.array([y, z, x])[[0, 1, 2]]
        forward, left, up = vector
        return np.array([left, up, forward]) / np.abs(vector).max()

    np.testing.assert_allclose(at(0, 0, 4), [1, 1, 1], atol=1e-12)
    np.testing.assert_allclose(at(0, 1, 2), [1, 0.5, 0], atol=1e-12)
    np.testing.assert_allclose(at(1, 1, 0), [-1, 0.5, 1], atol=1e-12)
    np.testing.assert_allclose(at(2, 0, 4), [1, 1, 1], atol=1e-12)
    np.testing.assert_allclose(at(3, 0, 4), [1, -1, -1], atol=1e-12)
    np.testing.assert_allclose(at(4, 1, 0), [1, 0.5, 1], atol=1e-12)
    np.testing.assert_allclose(at(5, 1, 4), [1, 0.5, -1], atol=1e-12)


def test_cube_texels_have_exact_solid_angles():
    for layout in OF_A_CUBE[:3]:
        _, solid_angles = LAYOUTS[layout].pixels(*LAYOUTS[layout].shape(1))
        np.testing.assert_allclose(solid_angles[solid_angles > 0], 4 * np.pi / 6)


@pytest.mark.parametrize("layout", [name for name in LAYOUTS if name != "latlong"])
def test_solid_angles_are_areas(layout):
    # Brute force: each of many uniform directions counts for the pixel it falls on.
    height, width = LAYOUTS[layout].shape(8)
    n = 3_200_000
    directions = fibonacci_directions(n)
    _, row, column = LAYOUTS[layout].locate(directions, height, width)
    row, column = (
        np.clip(np.round(x).astype(int), 0, size - 1)
        for x, size in ((row, height), (column, width))
    )
    counted = np.zeros((height, width))
    np.add.at(counted, (row, column), 4 * np.pi / n)
    solid_angles = LAYOUTS[layout].solid_angles(height, width)
    known = LAYOUTS[layout].charts(height, width) >= 0
    # The outside pixels' share of a disc is given to their neighbours within.
    own = known & (counted > 0)
    if layout in ("angular", "mirror_ball", "dual_paraboloid"):
        own[:] = False
        own[3:5, 3:5] = True
    np.testing.assert_allclose(solid_angles[own], counted[own], rtol=1e-2)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_gives_the_same_coefficients(layout, rng):
    coefs = light(rng)
    envmap = shjax.make_envmap(drawn(coefs, layout, SIZES[layout]), layout=layout)
    assert relative_error(envmap.lighting(l_max=2), coefs) < 1e-5


@pytest.mark.parametrize("layout", LAYOUTS)
def test_round_trip_of_a_smooth_panorama(layout, rng):
    coefs = light(rng)
    panorama = shjax.make_envmap(drawn(coefs, "latlong", (96, 192)))
    side = {"mirror_ball": 1024, "latlong": 96}.get(layout, min(SIDES[layout], 192))
    there = panorama.to_layout(layout, side)
    assert there.report.layout == layout
    assert there.image.shape == (*LAYOUTS[layout].shape(side), 3)
    assert there.image.dtype == np.float32
    back = there.to_latlong(96)
    error = back.radiance - panorama.radiance
    assert np.sqrt(np.mean(error**2) / np.mean(panorama.radiance**2)) < 1e-3
    # At the back of a mirror ball the pixels are 5 degrees apart.
    assert np.max(np.abs(error)) < (5e-2 if layout == "mirror_ball" else 5e-3) * np.max(
        panorama.radiance
    )
    assert relative_error(back.lighting(l_max=2), coefs) < 1e-3


@pytest.mark.parametrize("layout", LAYOUTS)
def test_no_seams(layout, rng):
    # Read at directions everywhere, those on edges and corners among them; 1.1 to 1.8 %
    # off where what lies beyond an edge is clipped to it.
    coefs = light(rng, 1)
    side = 64 if LAYOUTS[layout].aspect in ((1, 1), (2, 1)) else 32
    image = drawn(coefs, layout, LAYOUTS[layout].shape(side))
    target = resample(image, layout, "openexr_latlong", (129, 258))
    expected = drawn(coefs, "openexr_latlong", (129, 258))
    # The octahedron has creases, the mirror ball 14 degrees at its back.
    limit = {"mirror_ball": 0.3, "octahedral": 0.015, "dual_paraboloid": 0.012}
    error = np.max(np.abs(target - expected)) / np.max(expected)
    assert error < limit.get(layout, 3e-3)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_constant_light_stays_constant(layout):
    image = np.full((64, 128, 1), 3, np.float32)
    for side in (8, 64):
        there = resample(image, "latlong", layout, LAYOUTS[layout].shape(side))
        inside = LAYOUTS[layout].solid_angles(*there.shape[:2]) > 0
        np.testing.assert_allclose(there[inside], 3, rtol=2e-4)
        assert np.all(there[~inside] == 0)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_shrinking_keeps_a_sun_of_one_pixel(layout, rng):
    for row, column in ((3, 77), (31, 5), (63, 127), tuple(rng.integers(0, 64, 2))):
        image = np.ones((64, 128, 1), np.float32)
        image[row, column] = 1e5
        there = resample(image, "latlong", layout, LAYOUTS[layout].shape(16))
        assert total(there, layout) == pytest.approx(total(image, "latlong"), rel=1e-3)
    big = LAYOUTS[layout].shape(64)
    known = np.argwhere(LAYOUTS[layout].solid_angles(*big) > 0)
    image = np.ones((*big, 1), np.float32)
    image[tuple(rng.choice(known))] = 1e5
    there = resample(image, layout, "latlong", (16, 32))
    assert total(there, "latlong") == pytest.approx(total(image, layout), rel=1e-3)


def total(image, layout):
    angles = LAYOUTS[layout].solid_angles(*image.shape[:2])
    return float(np.sum(image.astype(float) * angles[..., None]))


@pytest.mark.parametrize("n_theta", [7, 16, 64, 100])
def test_latlong_to_latlong_is_exact(n_theta):
    image = np.ones((64, 128, 3), np.float32)
    image[11, 77] = 1e5
    small = shjax.make_envmap(image).to_latlong(n_theta)
    assert total(small.radiance, "latlong") == pytest.approx(
        total(image, "latlong"), rel=1e-5
    )


def test_samples_integrate_constants():
    for layout in LAYOUTS:
        size = LAYOUTS[layout].shape(32)
        envmap = shjax.make_envmap(np.ones((*size, 1), np.float32), layout=layout)
        radiance, directions, weights = envmap.samples()
        assert directions.shape == (radiance.shape[0], 3)
        assert np.sum(weights) == pytest.approx(4 * np.pi, rel=1e-4)


def test_layout_is_guessed_and_said():
    shapes = {
        "angular": (100, 100),
        "vertical_cross": (80, 60),
        "horizontal_cross": (60, 80),
        "vertical_strip": (60, 10),
        "horizontal_strip": (10, 60),
    }
    for name, shape in shapes.items():
        assert guess_layout(*shape) == name
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
        ((9, 9, 3), "octahedral", "even side"),
        ((8, 6, 3), "horizontal_cross", "aspect 4:3"),
    ],
)
def test_wrong_layouts_are_refused(shape, layout, message):
    with pytest.raises(ValueError, match=message):
        shjax.make_envmap(np.ones(shape, np.float32), layout=layout)


def test_zero_rows_are_refused():
    with pytest.raises(ValueError, match="n_theta must be positive"):
        shjax.make_envmap(np.ones((8, 16, 3), np.float32)).to_latlong(0)
    envmap = shjax.make_envmap(np.ones((8, 16, 3), np.float32))
    with pytest.raises(ValueError, match=r"side must be positive and even .* got 9"):
        envmap.to_layout("octahedral", 9)
    with pytest.raises(ValueError, match="layout must be one of"):
        envmap.to_layout("sphere", 9)


def test_lookup_near_a_pole_reads_the_polar_rows(rng):
    near = np.concatenate([unit_vectors(rng, 20) * 1e-9 + [0, 0, s] for s in (1, -1)])
    near /= np.linalg.norm(near, axis=-1, keepdims=True)
    _, row, column = LAYOUTS["latlong"].locate(near, 8, 16)
    assert np.all((row[:20] <= 0) & (row[20:] >= 7))
    assert np.all(np.isfinite(column))
