"""Area lights: known values, quadrature over their surfaces, horizons, gradients."""

import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shjax
from experiments import area_lights as report
from experiments.alternatives import area_lights as tricks
from shjax import brdf, lights, render
from tests.helpers import check_gradients, relative_error, unit_vectors

DATA = Path(__file__).parent / "data"
ORIGIN, UP = np.zeros((1, 3)), np.array([[0.0, 0, 1]])
FACE = np.array([[1, 1, 1], [1, -1, 1], [-1, -1, 1], [-1, 1, 1.0]])  # it faces 0
L_MAX = 6


def index(l, m):
    return l * (l + 1) + m


@pytest.mark.parametrize("method", ["boundary", "recurrence"])
def test_octant_and_cube_face(method, dtype):
    """Closed values; in single precision to 1e-6."""
    octant = lights.polygon(np.eye(3, dtype=dtype), 1.0, two_sided=True)
    face = lights.polygon(FACE.astype(dtype), 1.0)
    origin = ORIGIN.astype(dtype)
    first, second = (
        np.asarray(lights.area_coefs(one, origin, l_max=L_MAX, method=method))[0, :, 0]
        for one in (octant, face)
    )
    assert first.dtype == dtype
    tolerance = 1e-6 if dtype == np.float32 else 1e-9
    expected = [0.443113463, *[0.383747515] * 3]
    expected += [0.364182810, 0.364182810, 0, 0.364182810, 0]
    np.testing.assert_allclose(first[:9], expected, atol=tolerance)
    of_face = {
        (0, 0): 2 * np.pi / 3 / np.sqrt(4 * np.pi),
        (1, 0): 0.850578554,
        (2, 0): 0.728365620,
        (3, 0): 0.392185290,
        (4, 0): 0.027144584,
        (4, 4): -0.032117905,
        (6, 0): -0.254465093,
        (6, 4): -0.096178765,
    }
    for place, value in of_face.items():
        assert abs(second[index(*place)] - value) < tolerance


def test_closed_values_of_irradiance(dtype):
    origin, up = ORIGIN.astype(dtype), UP.astype(dtype)
    tolerance = 1e-6 if dtype == np.float32 else 1e-9

    def received(light):
        return float(lights.area_irradiance(light, origin, up)[0, 0])

    corner = lights.polygon(
        np.array([[0, 0, 1], [0, 1, 1], [1, 1, 1], [1, 0, 1]], dtype), 1.0
    )
    assert abs(received(corner) / np.pi - 0.138531606) < tolerance
    disk = lights.disk(np.array([0, 0, 2], dtype), -up[0], 1.0, 1.0)
    assert abs(received(disk) / np.pi - 0.2) < tolerance
    # A cap of half angle 30 degrees, centred on the horizon.
    sphere = lights.sphere(np.array([2, 0, 0], dtype), 1.0, 1.0)
    assert abs(received(sphere) - 0.090586074) < tolerance
    octant = lights.polygon(np.eye(3, dtype=dtype), 1.0, two_sided=True)
    vector = lights.vector_irradiance(octant, origin)[0, :, 0]
    np.testing.assert_allclose(vector, np.pi / 4, atol=tolerance)


@pytest.mark.x64
@pytest.mark.parametrize("method", ["boundary", "recurrence"])
def test_a_closed_box_is_a_constant(method, rng):
    faces = []
    for axis in range(3):
        u, v, n = (np.roll(np.eye(3), -axis, axis=0)[k] for k in range(3))
        for side in (1, -1):
            corners = np.array(
                [
                    side * n + a * u + b * v
                    for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))
                ]
            )
            faces.append(lights.polygon(corners, 2.0, two_sided=True))
    inside = rng.uniform(-0.8, 0.8, (3, 3))
    coefs = np.asarray(lights.area_coefs(faces, inside, l_max=16, method=method))
    np.testing.assert_allclose(coefs[:, 0, 0], 2 * np.sqrt(4 * np.pi), rtol=1e-13)
    assert np.abs(coefs[:, 1:]).max() < 1e-12


def _surfaces(kind, rng, nodes=32):
    """A random light, and quadrature over its surface: points, normals, areas."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    x, w = (x + 1) / 2, w / 2
    turn = 2 * np.pi * (np.arange(2 * nodes) + 0.5) / (2 * nodes)
    towards = unit_vectors(rng, 1)[0]
    centre = towards * rng.uniform(1.3, 3)
    if kind == "triangle":
        a, b, c = centre + 0.8 * rng.normal(size=(3, 3)) * [[1, 1, 1]]
        u, v = np.meshgrid(x, x, indexing="ij")
        places = a + u[..., None] * ((b - a) + v[..., None] * (c - b))
        normal = np.cross(b - a, c - a)
        area = w[:, None] * w * u * np.linalg.norm(normal)
        light = lights.polygon(np.stack([a, b, c]), 1.0, two_sided=True)
    elif kind in ("disk", "ellipse"):
        axes = 0.7 * rng.normal(size=(2, 3))
        normal = np.cross(*axes)
        if kind == "disk":
            light = lights.disk(centre, normal, 0.6, 1.0, two_sided=True)
            axes = np.asarray(light.axes)
        else:
            light = lights.ellipse(centre, axes, 1.0, two_sided=True)
        around = np.cos(turn)[:, None] * axes[0] + np.sin(turn)[:, None] * axes[1]
        places = centre + x[:, None, None] * around
        area = (x * w)[:, None] * np.full(2 * nodes, np.pi / nodes)
        area = area * np.linalg.norm(np.cross(*axes))
    elif kind == "sphere":
        # The part that is seen: a cap about the direction to the origin.
        radius = 0.5
        z = 1 - (1 - radius / np.linalg.norm(centre)) * x
        frame = np.asarray(shjax.vectors.frames(jnp.asarray(-towards)))
        around = np.cos(turn)[:, None] * frame[0] + np.sin(turn)[:, None] * frame[1]
        normals = np.sqrt(1 - z * z)[:, None, None] * around
        normals = normals - z[:, None, None] * towards
        area = radius**2 * (1 - z[-1] + 0 * z)[:, None]
        area = radius**2 * (1 - radius / np.linalg.norm(centre)) * w[:, None]
        area = area * np.full(2 * nodes, np.pi / nodes)
        light = lights.sphere(centre, radius, 1.0)
        places = centre + radius * normals
        return light, places.reshape(-1, 3), normals.reshape(-1, 3), area.ravel()
    places = places.reshape(-1, 3)
    normal = normal / np.linalg.norm(normal) * -np.sign(normal @ places[0])
    return light, places, np.broadcast_to(normal, places.shape), area.ravel()


@pytest.mark.x64
@pytest.mark.parametrize("kind", ["triangle", "disk", "ellipse", "sphere"])
def test_coefficients_are_those_of_the_surface(kind, rng):
    """200 random lights of each kind, by quadrature over their surfaces."""
    made = []
    while len(made) < 200:
        one = _surfaces(kind, rng)
        if np.linalg.norm(one[1], axis=1).min() > 0.7:
            made.append(one)
    stacked = jax.tree.map(lambda *a: jnp.stack(a), *[one[0] for one in made])
    origin = jnp.asarray(ORIGIN)
    found = jax.vmap(lambda light: lights.area_coefs(light, origin, l_max=L_MAX))(
        stacked
    )[:, 0, :, 0]
    errors = []
    for own, (_, places, normals, area) in zip(found, made, strict=True):
        distance = np.linalg.norm(places, axis=1)
        towards = places / distance[:, None]
        solid = -np.sum(towards * normals, axis=1) * area / distance**2
        exact = solid @ np.asarray(shjax.basis(jnp.asarray(towards), l_max=L_MAX))
        errors.append(relative_error(own, exact))
    # Of those that pass nearest the quadrature over the surface is the worse one.
    assert np.median(errors) < 1e-12
    assert np.max(errors) < 1e-5


@pytest.mark.x64
def test_a_tube_is_what_rays_hit(rng):
    """Its directions: those that pass a point of its axis within the radius."""
    towards = shjax.sphere.fibonacci_directions(40_000)
    values = np.asarray(shjax.basis(jnp.asarray(towards), l_max=3))
    radius, made, exact = 0.3, [], []
    while len(made) < 200:
        start = unit_vectors(rng, 1)[0] * rng.uniform(0.6, 2)
        end = start + rng.normal(size=3)
        along = np.linspace(0, 1, 65)[:, None] * (end - start) + start
        distance = np.linalg.norm(along, axis=1)
        if distance.min() < 1.2 * radius:
            continue
        cosine = np.sqrt(1 - (radius / distance) ** 2)
        hit = np.any(towards @ (along / distance[:, None]).T > cosine, axis=1)
        made.append(lights.capsule(start, end, radius, 1.0))
        exact.append(hit @ values * 4 * np.pi / len(towards))
    stacked = jax.tree.map(lambda *a: jnp.stack(a), *made)
    found = jax.vmap(lambda a: lights.area_coefs(a, jnp.asarray(ORIGIN), l_max=3))(
        stacked
    )[:, 0, :, 0]
    errors = [relative_error(a, b) for a, b in zip(found, exact, strict=True)]
    assert np.max(errors) < 0.02  # of the mask
    assert np.mean(errors) < 4e-3
    # A thin one tends to a line; one whose ends agree is a sphere.
    ends = np.array([[-1.0, 0.3, 1.5], [0.8, 0.1, 1.0]])
    thin = lights.capsule(*ends, 1e-4, 1.0)
    line = lights.line(*ends, 1e-4, 1.0)
    origin = jnp.asarray(ORIGIN)
    both = [lights.area_coefs(one, origin, l_max=3) for one in (thin, line)]
    assert relative_error(*both) < 3e-4
    same = lights.capsule(ends[0], ends[0], 0.3, 1.0)
    ball = lights.sphere(ends[0], 0.3, 1.0)
    both = [lights.area_coefs(one, origin, l_max=3) for one in (same, ball)]
    assert relative_error(*both) < 1e-10


def some_lights(dtype=np.float64):
    """One of each kind; together they cross the horizon of most normals."""
    concave = [[-0.5, -1, 2], [-0.5, 1, 2], [0.5, 1, 2], [0, 0, 2], [0.5, -1, 2]]
    made = [
        lights.polygon(np.array(concave), [1.0, 2.0], two_sided=True),
        lights.disk(np.array([0.4, 1.2, 0.5]), np.array([-0.3, -1.0, 0]), 0.9, 1.5),
        lights.ellipse(
            np.array([-1.5, 0.2, 0.3]),
            np.array([[0, 0.9, 0.2], [0.1, 0, 0.6]]),
            1.0,
            True,
        ),
        lights.sphere(np.array([1.1, -0.4, -0.1]), 0.6, 0.7),
        lights.capsule(np.array([-1, -1, -0.3]), np.array([0.3, -1.2, 0.9]), 0.3, 0.5),
        lights.line(np.array([-1, 1, -0.4]), np.array([0.7, 0.9, 1.2]), 0.02, 9.0),
    ]
    return jax.tree.map(lambda a: jnp.asarray(a, dtype), made)


@pytest.mark.x64
@pytest.mark.parametrize("which", range(6))
def test_irradiance_is_the_integral_above_the_horizon(which, rng):
    """Two ways: along the clipped outline, and over its inside in polar coordinates."""
    light = some_lights()[which]
    points = 0.2 * rng.normal(size=(60, 3))
    normals = unit_vectors(rng, 60)
    found = lights.area_irradiance(light, points, normals)
    white = brdf.lambertian(np.float64(1.0))
    views = normals + 0.6 * unit_vectors(rng, 60)
    views = views / np.linalg.norm(views, axis=1, keepdims=True)
    integral = lights.area_reflection(light, white, points, normals, views, nodes=48)
    scale = float(jnp.max(found))
    assert scale > 0
    np.testing.assert_allclose(found, np.pi * integral, atol=1e-6 * scale)
    whole = np.einsum(
        "nic,ni->nc", np.asarray(lights.vector_irradiance(light, points)), normals
    )
    # Never less than the net flux, and equal to it where all is above the horizon.
    assert np.all(found >= whole - 1e-12 * scale)


def test_reflection_by_harmonics_tends_to_the_integral(rng, dtype):
    made = some_lights(dtype)
    points = (0.2 * rng.normal(size=(12, 3))).astype(dtype)
    normals = np.broadcast_to(UP, (12, 3)).astype(dtype)
    views = normals + 0.7 * unit_vectors(rng, 12)
    views = (views / np.linalg.norm(views, axis=1, keepdims=True)).astype(dtype)
    surface = brdf.lambertian(0.4) + brdf.phong(12.0) + 0.6 * brdf.ggx(0.4, 0.3)
    surface = jax.tree.map(lambda a: a.astype(dtype), surface)
    exact = lights.area_reflection(made, surface, points, normals, views)
    for l_max, error in ((6, 0.07), (18, 5e-3)):
        found = lights.area_shade(made, surface, points, normals, views, l_max=l_max)
        assert found.shape == (12, 2)
        assert relative_error(found, exact) < error
    # From below nothing is seen of a surface that ends at its horizon.
    views = views * np.array([1, 1, -1], dtype)
    glossy = jax.tree.map(lambda a: a.astype(dtype), 0.6 * brdf.ggx(0.4, 0.3))
    given = (made[:1], glossy, points, normals, views)
    assert not np.any(lights.area_shade(*given, l_max=6))
    assert not np.any(lights.area_reflection(*given))


@pytest.mark.slow
@pytest.mark.x64
def test_gradients(rng):
    """In points, vertices, radii and radiance, of coefficients and of irradiance."""
    points, normals = 0.2 * rng.normal(size=(4, 3)), unit_vectors(rng, 4)

    leaves, kinds = jax.tree.flatten(some_lights())

    def everything(leaves, points, normals):
        made = jax.tree.unflatten(kinds, leaves)
        normals = shjax.vectors.normalize(normals)
        coefs = lights.area_coefs(made, points, l_max=2)
        received = lights.area_irradiance(made, points, normals)
        return jnp.concatenate([coefs, received[:, None]], axis=1)

    check_gradients(
        everything,
        leaves,
        jnp.asarray(points),
        jnp.asarray(normals),
        tolerance=1e-6,
    )


@pytest.mark.slow
@pytest.mark.x64
def test_gradients_of_reflection(rng):
    points = jnp.asarray(0.2 * rng.normal(size=(3, 3)))
    normals = jnp.asarray(np.broadcast_to(UP, (3, 3)))
    views = shjax.vectors.normalize(normals + 0.5 * jnp.asarray(unit_vectors(rng, 3)))

    leaves, kinds = jax.tree.flatten([some_lights()[k] for k in (0, 3)])

    def reflected(leaves, alpha, points):
        made = jax.tree.unflatten(kinds, leaves)
        surface = brdf.ggx(alpha, 0.3)
        exact = lights.area_reflection(
            made[:1], surface, points, normals, views, nodes=10
        )
        other = brdf.lambertian(0.4) + brdf.phong(4 / alpha)
        smooth = lights.area_shade(made[1:], other, points, normals, views, l_max=4)
        return jnp.concatenate([exact, smooth], axis=1)

    check_gradients(reflected, leaves, jnp.asarray(0.4), points, tolerance=1e-6)


def test_where_nothing_is_seen(dtype):
    """In the plane, behind, inside, on: zero or the hemisphere, with finite gradients."""
    face = lights.polygon(FACE.astype(dtype), 1.0)
    disk = lights.disk(
        np.array([0, 0, 1], dtype), np.array([0, 0, -1], dtype), 1.0, 1.0
    )
    ball = lights.sphere(np.array([0, 0, 1], dtype), 0.5, 1.0)
    tube = lights.capsule(
        np.array([0, 0, 1], dtype), np.array([0, 0, 2], dtype), 0.5, 1.0
    )
    cases = {
        "in the plane": (face, [3.0, 0, 1]),
        "in the disk's plane": (disk, [3.0, 0, 1]),
        "on a corner": (face, [1.0, 1, 1]),
        "behind": (face, [0, 0, 2.0]),
        "inside": (ball, [0.1, 0, 1]),
        "inside a tube": (tube, [0.1, 0, 1.5]),
    }
    made = [light for light, _ in cases.values()]
    places = jnp.asarray([place for _, place in cases.values()], dtype)

    def each(made, places):
        up, found = jnp.asarray(UP, dtype), []
        for k, light in enumerate(made):
            here = places[k : k + 1]
            received = lights.area_irradiance(light, here, up)
            coefs = lights.area_coefs(light, here, l_max=1)
            found.append(jnp.sum(coefs) + jnp.sum(received))
        return jnp.stack(found)

    value, pull = jax.vjp(jax.jit(each), made, places)
    assert dict(zip(cases, value.tolist(), strict=True)) == dict.fromkeys(cases, 0)
    for slope in jax.tree.leaves(pull(jnp.ones_like(value))):
        assert np.all(np.isfinite(slope))
    on = jnp.asarray([[0, 0, 0.5]], dtype)
    received = lights.area_irradiance(ball, on, jnp.asarray(UP, dtype))
    np.testing.assert_allclose(
        received, np.pi, rtol=1e-3 if dtype == np.float32 else 1e-7
    )
    below = lights.area_irradiance(
        face, jnp.asarray(ORIGIN, dtype), -jnp.asarray(UP, dtype)
    )
    assert below == 0


@pytest.mark.x64
def test_lights_add_up_and_batch(rng):
    made, points = some_lights(), rng.normal(size=(2, 3, 3)) * 0.1
    every = lights.area_coefs(made, points, l_max=2)
    assert every.shape == (2, 3, 9, 2)
    total = sum(lights.area_coefs(one, points, l_max=2) for one in made)
    assert relative_error(every, total) < 1e-12
    # A square in two halves.
    halves = [lights.polygon(FACE[some], 1.0) for some in ([0, 1, 2], [0, 2, 3])]
    whole = lights.polygon(FACE, 1.0)
    both = (lights.area_coefs(a, points, l_max=9) for a in (whole, halves))
    assert relative_error(*both) < 1e-12
    assert lights.area_coefs(whole, np.zeros((0, 3)), l_max=2).shape == (0, 9, 1)


def test_a_picture_under_area_lights(dtype):
    """A sphere under a sphere: radiance at the pole, and nothing behind."""
    ball = render.sphere(21, render.Camera(origin=(0.0, 0.0, 3.0), up=(1.0, 0.0, 0.0)))
    ball = jax.tree.map(lambda a: a.astype(dtype), ball)
    light = lights.parse("sphere centre=0,0,3 radius=0.5 radiance=2,4,6")
    matte = render.area_lit(ball, light)
    # The top is 2 from the centre: pi sin^2 of the half angle, times albedo over pi.
    np.testing.assert_allclose(
        matte[10, 10], np.array([2, 4, 6]) / 16, rtol=2e-3
    )  # of the middle pixel's slope
    white = render.area_lit(ball, light, brdf.lambertian(np.asarray(1.0, dtype)))
    assert relative_error(white, matte) < 0.01
    assert np.all(np.isfinite(matte))
    bare = render.make_gbuffer(np.ones((2, 2, 3), dtype))
    with pytest.raises(ValueError, match="must have positions"):
        render.area_lit(bare, light)


@pytest.mark.x64
def test_wraps_and_isotropic_lines(rng):
    """What the text's cheap forms are: wraps too bright, a line's printed form wrong."""
    cosine = jnp.asarray(np.polynomial.legendre.leggauss(400)[0])
    for k in (0.0, 0.3, 1.0):
        assert (
            abs(np.mean(tricks.wrap(jnp.linspace(-1, 1, 20_001), k)) - (1 + k) / 4)
            < 1e-4
        )
    share = np.polynomial.legendre.leggauss(400)[1] / 2
    assert abs(tricks.valves_wrap(cosine) @ share - 1 / 3) < 1e-12
    start, end, normal = np.array([[-1.0, 0.3, 1], [0.7, 0.5, 2], [0.1, 0.2, 1]])
    along = start + (1 + np.asarray(cosine)[:, None]) / 2 * (end - start)
    own = along @ normal / np.linalg.norm(along, axis=1) ** 3
    exact = own @ share * np.linalg.norm(end - start)
    assert abs(tricks.isotropic_line(start, end, normal) - exact) < 1e-10


@pytest.mark.slow
@pytest.mark.x64
def test_harmonics_beside_ltc_and_the_usual_tricks():
    """A cell of the report: GGX 0.4 under a sphere."""
    rng, normals, views = report.scene(64)
    points = report._places(rng, normals, views, 1.5, 64)
    given = (points, normals, views)
    errors = report._errors("sphere", 1.5, 0.4, 1.0, given, rng)
    assert errors["harmonics, F = 16"] < 0.1 * errors["LTC"]
    assert errors["quadrature, 12"] < 1e-3
    assert errors["Monte Carlo, 256"] < 0.5 * errors["Monte Carlo, 16"]
    assert errors["LTC"] < min(
        errors["roughness modified"], errors["representative point"]
    )


def test_lights_in_words():
    square = lights.parse("polygon vertices=0,0,1;0,1,1;1,1,1;1,0,1 radiance=2")
    assert square.vertices.shape == (4, 3)
    assert lights.parse("DISK centre=0,0,1 normal=0,0,-1 radius=1 radiance=1").circular
    with pytest.raises(ValueError, match="light must be one of polygon, disk"):
        lights.parse("lamp radius=1")
    with pytest.raises(ValueError, match=r"sphere needs radius=\.\.\., radiance"):
        lights.parse("sphere centre=0,0,1")


@pytest.mark.usefixtures("as_a_user")
@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: lights.polygon([[0, 0, 1.0], [1, 0, 1]], 1.0), "V >= 3"),
        (lambda: lights.polygon([[0.0, 0, 1], [1, 0, 1], [2, 0, 1]], 1), "degenerate"),
        (lambda: lights.polygon([*FACE[:3], [-1, 1, 1.3]], 1.0), "lie in one plane"),
        (lambda: lights.polygon(FACE[[0, 2, 1, 3]], 1.0), "edges 0 and 2 cross"),
        (lambda: lights.polygon(FACE, np.ones((2, 3))), "radiance must be a number"),
        (lambda: lights.polygon(np.full((3, 3), np.nan), 1.0), "finite"),
        (
            lambda: lights.disk([0, 0, 1], [0, 0, 0.0], 1.0, 1.0),
            "normal must not be zero",
        ),
        (lambda: lights.disk([0, 0, 1.0], [0, 0, 1], -1.0, 1.0), "not be negative"),
        (lambda: lights.ellipse([0, 0, 1.0], [[1, 0, 0], [2, 0, 0]], 1.0), "parallel"),
        (lambda: lights.sphere([0, 1.0], 1.0, 1.0), "centre must have shape"),
        (lambda: lights.area_coefs(np.ones((9, 3)), ORIGIN, l_max=2), "area light"),
        (lambda: lights.area_coefs([], ORIGIN, l_max=2), "at least one"),
        (
            lambda: lights.area_coefs(
                lights.sphere([0, 0, 2], 1, 1), ORIGIN, l_max=2, method="recurrence"
            ),
            "recurrence is of polygons",
        ),
        (
            lambda: lights.area_irradiance(
                lights.sphere([0, 0, 2], 1, 1), ORIGIN, np.ones((2, 3))
            ),
            "normals must have the shape of points",
        ),
        (
            lambda: lights.area_shade(
                lights.sphere([0, 0, 2], 1, 1), brdf.kajiya_kay(8.0), ORIGIN, UP, UP
            ),
            "about the tangent",
        ),
    ],
)
def test_what_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def _mitsubas_ggx(alpha):
    """Its rough conductor of reflectance 1: GGX with separable Smith masking."""

    def transfer(parameters, light, view):
        a2 = parameters["alpha"] ** 2
        half = [x + y for x, y in zip(light, view, strict=True)]
        squared = sum(x * x for x in half)
        across = half[0] ** 2 + half[1] ** 2
        slope = a2 * half[2] ** 2 + across
        density = a2 * squared**2 / (np.pi * slope**2)
        masked = 1.0
        for z in (light.z, view.z):
            masked = masked / (z + jnp.sqrt(a2 + (1 - a2) * z * z))
        return density * masked * light.z

    model = brdf.core.ReflectanceModel("separable ggx", transfer)
    return brdf.core.make_brdf(model, alpha=np.float64(alpha))


@pytest.mark.x64
def test_spheres_under_mitsubas_area_emitters():
    """Radiance at single rays within its noise; tests/clients has the script."""
    found = json.loads((DATA / "mitsuba_area_lights.json").read_text())
    about = found["emitters"]
    square = about["rectangle"]
    made = {
        "disk": lights.disk(
            *(np.array(about["disk"][k]) for k in ("centre", "normal")),
            about["disk"]["radius"],
            1.0,
        ),
        "sphere": lights.sphere(
            np.array(about["sphere"]["centre"]), about["sphere"]["radius"], 1.0
        ),
        "capsule": lights.capsule(
            *(np.array(about["capsule"][k]) for k in ("start", "end")),
            about["capsule"]["radius"],
            1.0,
        ),
        "line": lights.line(
            *(np.array(about["line"][k]) for k in ("start", "end")),
            about["line"]["radius"],
            1.0,
        ),
    }
    # Mitsuba's look_at: its square stands upright in the plane of up and normal.
    towards = np.array(square["normal"]) / np.linalg.norm(square["normal"])
    left = np.cross([0, 0, 1.0], towards)
    left = square["half"] * left / np.linalg.norm(left)
    up = np.cross(towards, left)
    centre = np.array(square["centre"])
    corners = [
        centre + a * left + b * up for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))
    ]
    made["rectangle"] = lights.polygon(np.stack(corners), 1.0)
    surfaces = {
        "diffuse": brdf.lambertian(np.float64(found["albedo"])),
        "ggx": _mitsubas_ggx(found["alpha"]),
    }
    apart = []
    for name, light in made.items():
        for material, surface in surfaces.items():
            rows = found["radiance"][f"{name}, {material}"]
            normals, views = (
                np.array([row[k] for row in rows]) for k in ("normal", "view")
            )
            points = found["sphere radius"] * normals
            ours = lights.area_reflection(light, surface, points, normals, views)[:, 0]
            theirs = np.array([row["radiance"] for row in rows])
            noise = np.array([row["standard_error"] for row in rows])
            assert np.max(noise / theirs.max()) < 3e-3
            # A thin tube is a line up to its radius over its distance.
            limit = 4.5 * noise + (0.004 if name == "line" else 1e-5) * theirs.max()
            assert np.all(np.abs(ours - theirs) < limit), (name, material)
            apart.append((np.asarray(ours) - theirs) / np.maximum(noise, 1e-9))
    assert abs(np.mean(np.concatenate(apart[:8]))) < 0.5
