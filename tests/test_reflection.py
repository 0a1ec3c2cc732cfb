"""Reflection maps against the integral, rotation, explicit forms, interpolation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shjax
import shjax.vectors
from shjax import brdf, reflection
from shjax.harmonics.grid import Grid
from shjax.reflection.reading import FRAMES
from shjax.reflection.reflection_map import ReflectionMap
from shjax.sphere import (
    cube_directions,
    icosahedron,
    latlong_directions,
    spherical_directions,
)
from shjax.vectors import in_spherical_frame
from tests.helpers import (
    check_gradients,
    relative_error,
    rotation_matrix,
    unit_vectors,
)


def random_kernel(rng, l_max, p_max, channels):
    rho = rng.normal(size=(l_max + 1, p_max + 1, p_max + 1, channels))
    l, p, q = np.meshgrid(
        range(l_max + 1), range(p_max + 1), range(p_max + 1), indexing="ij"
    )
    rho[q > np.minimum(l, p)] = 0
    return rho


def integral(lighting, rho, directions, views):
    """``int L(w) rho(w, v) dw`` with the kernel summed term by term in R's frame."""
    l_max, p_max = rho.shape[0] - 1, rho.shape[1] - 1
    degree = int(np.sqrt(lighting.shape[0])) - 1
    grid = Grid(l_max + degree + 1, 2 * (l_max + degree) + 2)
    lights = latlong_directions(grid.n_theta, grid.n_phi).reshape(-1, 3)
    weights = np.repeat(grid.weights, grid.n_phi)
    radiance = np.asarray(shjax.evaluate(jnp.asarray(lighting), jnp.asarray(lights)))
    found = []
    for direction, view in zip(directions, views):
        theta, phi = np.arccos(direction[2]), np.arctan2(direction[1], direction[0])
        c, s, cp, sp = np.cos(theta), np.sin(theta), np.cos(phi), np.sin(phi)
        frame = np.array([[c * cp, c * sp, -s], [-sp, cp, 0], [s * cp, s * sp, c]])
        y_i = np.asarray(shjax.basis(jnp.asarray(lights @ frame.T), l_max=l_max))
        y_o = np.asarray(shjax.basis(jnp.asarray(frame @ view), l_max=p_max))
        kernel = 0.0
        for l in range(l_max + 1):
            for p in range(p_max + 1):
                for q in range(-min(l, p), min(l, p) + 1):
                    term = y_i[:, l * (l + 1) + q] * y_o[p * (p + 1) + q]
                    kernel = kernel + term[:, None] * rho[l, p, abs(q)]
        found.append(np.sum(radiance * kernel * weights[:, None], axis=0))
    return np.array(found)


@pytest.mark.x64
@pytest.mark.parametrize(
    ("l_max", "p_max", "degree"),
    [(6, 4, 6), (4, 1, 7), (7, 2, 3), (3, 5, 3), (0, 0, 2)],
)
def test_local_and_global_maps_are_the_integral(rng, l_max, p_max, degree):
    lighting = rng.normal(size=((degree + 1) ** 2, 2))
    rho = random_kernel(rng, l_max, p_max, 2)
    rows, columns = 5, 8
    directions = latlong_directions(rows, columns).reshape(-1, 3)
    views = unit_vectors(rng, rows * columns)
    exact = integral(lighting, rho, directions, views)
    arrays = [jnp.asarray(a) for a in (lighting, rho, directions, views)]
    local = reflection.prefilter(*arrays[:2], n_theta=rows, n_phi=columns)
    seen = in_spherical_frame(*arrays[2:])
    values = shjax.basis(seen, l_max=p_max)
    found = jnp.einsum(
        "nqc,nq->nc", local.coefs.reshape(-1, values.shape[-1], 2), values
    )
    assert relative_error(found, exact) < 1e-12
    world = reflection.prefilter(
        *arrays[:2], n_theta=rows, n_phi=columns, frame="global"
    )
    values = shjax.basis(arrays[3], l_max=p_max)
    found = jnp.einsum(
        "nqc,nq->nc", world.coefs.reshape(-1, values.shape[-1], 2), values
    )
    assert relative_error(found, exact) < 1e-12
    assert relative_error(shjax.reflection.reflect(*arrays), exact) < 1e-12


@pytest.mark.x64
@pytest.mark.parametrize("frame", ["local", "global"])
def test_cube_maps_are_the_integral(rng, frame):
    lighting, rho = rng.normal(size=(25, 1)), random_kernel(rng, 5, 3, 1)
    maps = reflection.prefilter_cube(
        jnp.asarray(lighting), jnp.asarray(rho), size=3, frame=frame
    )
    assert maps.coefs.shape == (6, 3, 3, 16, 1)
    directions = cube_directions(3).reshape(-1, 3)
    views = unit_vectors(rng, 54)
    exact = integral(lighting, rho, directions, views)
    seen = jnp.asarray(views)
    if frame == "local":
        seen = in_spherical_frame(jnp.asarray(directions), seen)
    values = shjax.basis(seen, l_max=3)
    found = jnp.einsum("nqc,nq->nc", maps.coefs.reshape(54, 16, 1), values)
    assert relative_error(found, exact) < 1e-12


def test_float32_at_a_useful_size(rng):
    lighting, rho = rng.normal(size=(61**2, 3)), random_kernel(rng, 60, 3, 3)
    single = reflection.prefilter(
        *(jnp.asarray(a, jnp.float32) for a in (lighting, rho)), n_theta=30, n_phi=60
    )
    assert single.coefs.dtype == np.float32
    if jax.config.read("jax_enable_x64"):
        double = reflection.prefilter(
            jnp.asarray(lighting), jnp.asarray(rho), n_theta=30, n_phi=60
        )
        assert relative_error(single.coefs, double.coefs) < 2e-6


@pytest.mark.parametrize("alpha", [pytest.param(0.1, marks=pytest.mark.slow), 0.5])
def test_uniform_light_gives_the_directional_albedo(alpha, dtype):
    """White metal returns 1 seen from anywhere, as far as P goes; others their albedo."""
    white = jnp.zeros((4, 1), dtype).at[0].set(np.sqrt(4 * np.pi))
    rho = shjax.brdf_coefs(brdf.ggx(alpha, 1.0, multiscatter=True), l_max=1, p_max=12)
    maps = reflection.prefilter(white, rho.astype(dtype), n_theta=8, n_phi=16)
    directions = jnp.asarray(unit_vectors(np.random.default_rng(0), 20), dtype)
    views = jnp.asarray(unit_vectors(np.random.default_rng(1), 20), dtype)
    found = maps.read(directions, views)
    # l = 0 has q = 0 only: the map is the albedo over theta_o, 1 at every view.
    np.testing.assert_allclose(found, 1, atol=1e-3)
    matte = shjax.brdf_coefs(brdf.lambertian(0.3), l_max=1, p_max=4)
    maps = reflection.prefilter(white, matte.astype(dtype), n_theta=8, n_phi=16)
    np.testing.assert_allclose(maps.read(directions, views), 0.3, atol=1e-4)
    shiny = brdf.ggx(alpha, 0.04)
    exact = shjax.reference_reflection(
        jnp.ones((64, 128, 1), dtype),
        shiny,
        *(jnp.asarray(a, dtype) for a in _pair(0.6)),
    )
    angle = float(np.degrees(0.6))
    report = np.interp(angle, brdf.check(shiny).views, brdf.check(shiny).albedo[:, 0])
    assert float(exact[0, 0]) == pytest.approx(report, rel=0.05)


def _pair(theta):
    normal = np.array([[0.0, 0.0, 1.0]])
    return normal, spherical_directions(np.array([theta]), np.array([0.4]))


def test_rotating_the_light_rotates_the_map(rng, dtype):
    lighting = jnp.asarray(rng.normal(size=(49, 3)), dtype)
    rho = jnp.asarray(random_kernel(rng, 6, 3, 1), dtype)
    turn = jnp.asarray(rotation_matrix(rng), dtype)
    directions, views = (jnp.asarray(unit_vectors(rng, 30), dtype) for _ in range(2))
    turned = shjax.rotate(lighting, turn)
    limit = 1e-12 if dtype == np.float64 else 1e-4
    there = shjax.reflection.reflect(turned, rho, directions @ turn.T, views @ turn.T)
    assert (
        relative_error(
            there, shjax.reflection.reflect(lighting, rho, directions, views)
        )
        < limit
    )
    for frame in FRAMES:
        one, other = (
            reflection.prefilter(c, rho, n_theta=64, n_phi=128, frame=frame)
            for c in (lighting, turned)
        )
        plain = one.read(directions, views)
        moved = other.read(directions @ turn.T, views @ turn.T)
        assert relative_error(moved, plain) < 2e-3  # cubic interpolation


def test_matte_about_r_holds_the_irradiance_map(rng):
    """The Lambertian SHRM at (4, 5) holds 99 % of the irradiance map's energy."""
    expansion = shjax.brdf.expand(brdf.lambertian(1.0), l_max=20, p_max=5)
    lights = (
        rng.normal(size=(21**2, 1))
        / np.repeat(np.arange(1, 22), 2 * np.arange(21) + 1)[:, None]
    )
    spectrum = shjax.power_spectrum(jnp.asarray(lights))
    assert (
        float(shjax.brdf.predicted_energy_error(spectrum, expansion, l_max=4, p_max=5))
        < 0.01
    )
    assert shjax.brdf.energy_held(expansion)[4, 5] > 0.99


def test_both_paths_of_a_sum_agree(rng, dtype):
    """Diffuse about the normal plus specular about R is the sum about R."""
    lighting = jnp.asarray(rng.normal(size=(9, 3)), dtype)
    matte, shiny = brdf.lambertian(0.6), 0.3 * brdf.phong(12.0)
    normals, views = (jnp.asarray(unit_vectors(rng, 40), dtype) for _ in range(2))
    normals = jnp.where(
        jnp.sum(normals * views, -1, keepdims=True) > 0.3, normals, views
    )
    directions = shjax.vectors.mirror(normals, views)
    whole = shjax.reflection.reflect(
        lighting,
        shjax.brdf_coefs(matte + shiny, l_max=2, p_max=24).astype(dtype),
        directions,
        views,
    )
    about_n = shjax.evaluate(
        shjax.reflection.convolve(lighting, shjax.brdf.radial_coefs(matte, l_max=2)),
        normals,
    )
    about_r = shjax.evaluate(
        shjax.reflection.convolve(lighting, shjax.brdf.radial_coefs(shiny, l_max=2)),
        directions,
    )
    assert relative_error(about_n + about_r, whole) < 3e-3  # P = 24 of a series in P
    np.testing.assert_allclose(
        about_n, 0.6 / np.pi * shjax.irradiance(lighting, normals), rtol=2e-4, atol=1e-5
    )


def test_reflected_coefs_are_the_product(rng, dtype):
    lighting = jnp.asarray(rng.normal(size=(3, 25, 1)), dtype)
    rho = jnp.asarray(random_kernel(rng, 3, 2, 2), dtype)
    found = shjax.reflection.reflected_coefs(lighting, rho)
    assert found.shape == (3, 16, 3, 3, 2)
    l = np.repeat(np.arange(4), 2 * np.arange(4) + 1)
    exact = np.asarray(lighting)[:, :16, None, None] * np.asarray(rho)[l]
    np.testing.assert_allclose(found, exact, rtol=1e-6)


def test_batches_over_lights_and_brdfs(rng, dtype):
    lighting = jnp.asarray(rng.normal(size=(3, 1, 16, 1)), dtype)
    rho = jnp.asarray(np.stack([random_kernel(rng, 3, 1, 2) for _ in range(2)]), dtype)
    maps = reflection.prefilter(lighting, rho, n_theta=4, n_phi=6)
    assert maps.coefs.shape == (3, 2, 4, 6, 4, 2)
    for i in range(3):
        for j in range(2):
            one = reflection.prefilter(lighting[i, 0], rho[j], n_theta=4, n_phi=6)
            np.testing.assert_allclose(maps.coefs[i, j], one.coefs, atol=1e-5)
    cubes = reflection.prefilter_cube(lighting, rho, size=2)
    assert cubes.coefs.shape == (3, 2, 6, 2, 2, 4, 2)


@pytest.mark.parametrize("frame", FRAMES)
def test_reading_a_map_over_the_poles(rng, frame):
    lighting = jnp.asarray(
        rng.normal(size=(64, 2))
        / np.repeat(np.arange(1, 9), 2 * np.arange(8) + 1)[:, None]
    )
    rho = jnp.asarray(random_kernel(rng, 7, 3, 2))
    near = np.concatenate(
        [
            unit_vectors(rng, 200),
            np.array([[0.0, 0, 1], [0, 0, -1], [1e-4, 0, 1], [0.01, -0.02, -1]]),
        ]
    )
    near[:100, :2] *= 0.05
    near /= np.linalg.norm(near, axis=1, keepdims=True)
    directions, views = jnp.asarray(near), jnp.asarray(unit_vectors(rng, near.shape[0]))
    exact = shjax.reflection.reflect(lighting, rho, directions, views)
    maps = reflection.prefilter(lighting, rho, frame=frame)
    cubic = maps.read(directions, views)
    linear = maps.read(directions, views, interpolation="linear")
    assert relative_error(cubic, exact) < 0.006
    assert relative_error(linear, exact) < 0.05
    worst = np.abs(cubic - exact).max() / np.abs(exact).max()
    assert worst < 0.02


@pytest.mark.parametrize(("rows", "columns"), [(9, 12), (16, 32), (33, 66)])
def test_reading_is_exact_on_the_pixels(rng, dtype, rows, columns):
    rho = jnp.asarray(random_kernel(rng, 4, 2, 1), dtype)
    lighting = jnp.asarray(rng.normal(size=(25, 1)), dtype)
    maps = reflection.prefilter(lighting, rho, n_theta=rows, n_phi=columns)
    directions = jnp.asarray(latlong_directions(rows, columns), dtype)
    views = jnp.asarray(unit_vectors(rng, rows * columns), dtype)
    views = views.reshape(rows, columns, 3)
    exact = shjax.reflection.reflect(lighting, rho, directions, views)
    for interpolation in ("linear", "cubic"):
        found = maps.read(directions, views, interpolation=interpolation)
        assert relative_error(found, exact) < (1e-9 if dtype == np.float64 else 2e-4)


def test_explicit_forms_and_back(rng, dtype):
    lighting = jnp.asarray(rng.normal(size=(36, 3)), dtype)
    rho = jnp.asarray(random_kernel(rng, 5, 2, 3), dtype)
    world = reflection.prefilter(lighting, rho, n_theta=6, n_phi=8, frame="global")
    local = reflection.prefilter(lighting, rho, n_theta=6, n_phi=8)
    limit = 1e-11 if dtype == np.float64 else 2e-4
    twelve = reflection.icosahedral_maps(world)
    assert twelve.shape == (12, 6, 8, 3)
    directions = jnp.asarray(latlong_directions(6, 8), dtype)
    for view, image in zip(icosahedron(), twelve):
        towards = jnp.broadcast_to(jnp.asarray(view, dtype), directions.shape)
        assert (
            relative_error(
                image, shjax.reflection.reflect(lighting, rho, directions, towards)
            )
            < limit
        )
    assert (
        relative_error(
            reflection.dynamic_map(world, jnp.asarray(icosahedron()[3], dtype)),
            twelve[3],
        )
        < limit
    )
    again = reflection.fit_views(twelve, icosahedron(), p_max=2)
    assert relative_error(again, world.coefs) < limit
    views = reflection.view_grid(8)
    table = reflection.view_maps(local, jnp.asarray(views, dtype))
    assert table.shape == (8, 8, 6, 8, 3)
    again = reflection.fit_views(
        table.reshape(64, 6, 8, 3), views.reshape(-1, 3), p_max=2
    )
    assert relative_error(again, local.coefs) < limit
    with pytest.raises(ValueError, match="determine 16 functions"):
        reflection.fit_views(twelve, icosahedron(), p_max=3)


def test_azimuthal_texture_is_the_mean_over_azimuth(rng, dtype):
    coefs = jnp.asarray(rng.normal(size=(3, 4, 16, 2)), dtype)
    local = ReflectionMap.from_coefs(coefs, frame="local")
    theta = jnp.asarray([0.2, 1.5, 2.9], dtype)
    texture = reflection.azimuthal_texture(local, theta)
    assert texture.shape == (3, 4, 3, 2)
    phi = 2 * np.pi * np.arange(12) / 12
    for k, angle in enumerate(np.asarray(theta)):
        views = jnp.asarray(spherical_directions(np.full(12, angle), phi), dtype)
        mean = jnp.mean(reflection.view_maps(local, views), axis=0)
        np.testing.assert_allclose(texture[:, :, k], mean, atol=1e-5)


@pytest.mark.x64
@pytest.mark.parametrize("place", ["general", "pole", "n = h", "grazing"])
def test_gradients_of_one_radiance(rng, place):
    """With respect to light, rho, direction and view, without a map."""
    lighting = jnp.asarray(rng.normal(size=(25, 2)))
    rho = jnp.asarray(random_kernel(rng, 4, 3, 2))
    normal, view = unit_vectors(rng, 2)
    if place == "pole":
        normal, view = np.array([0.0, 0, 1]), np.array([0.0, 0, 1])
    if place == "n = h":  # seen along the normal: R = v
        view = normal
    if place == "grazing":
        view = np.cross(normal, view)
        view /= np.linalg.norm(view)

    def out(light, kernel, n, v):
        n, v = shjax.vectors.normalize(n), shjax.vectors.normalize(v)
        return shjax.reflection.reflect(
            light, kernel, shjax.vectors.mirror(n, v)[None], v[None]
        )

    check_gradients(
        out, lighting, rho, jnp.asarray(normal), jnp.asarray(view), tolerance=1e-6
    )


@pytest.mark.x64
@pytest.mark.parametrize("frame", FRAMES)
def test_gradients_through_a_map(rng, frame):
    lighting = jnp.asarray(rng.normal(size=(25, 2)))
    rho = jnp.asarray(random_kernel(rng, 4, 2, 2))
    directions, views = (jnp.asarray(unit_vectors(rng, 4)) for _ in range(2))

    def out(light, kernel, towards, seen):
        maps = reflection.prefilter(light, kernel, n_theta=12, n_phi=24, frame=frame)
        return maps.read(towards, seen)

    check_gradients(out, lighting, rho, directions, views, tolerance=1e-6)


@pytest.mark.x64
def test_gradients_in_brdf_parameters_through_a_map(rng):
    lighting = jnp.asarray(rng.normal(size=(25, 3)))
    directions, views = (jnp.asarray(unit_vectors(rng, 4)) for _ in range(2))

    def out(alpha, f0):
        rho = shjax.brdf_coefs(brdf.ggx(alpha, f0), l_max=4, p_max=2)
        return reflection.prefilter(lighting, rho, n_theta=8, n_phi=16).read(
            directions, views
        )

    check_gradients(
        out, jnp.asarray(0.4), jnp.asarray([0.04, 0.5, 0.9]), tolerance=1e-6
    )


LIGHT, RHO = np.ones((9, 1)), np.ones((3, 2, 2, 1))
FOUR = ReflectionMap.from_coefs(np.ones((4, 8, 4, 1), np.float32), frame="global")


@pytest.mark.usefixtures("as_a_user")
@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: reflection.prefilter(np.ones((8, 1)), RHO),
            "lighting must have shape",
        ),
        (
            lambda: reflection.prefilter(LIGHT, np.ones((3, 2, 3, 1))),
            "rho must have shape",
        ),
        (
            lambda: reflection.prefilter(LIGHT, RHO, frame="world"),
            "frame must be one of local, global",
        ),
        (lambda: reflection.prefilter(LIGHT, RHO, n_theta=0), "must be positive"),
        (
            lambda: reflection.prefilter(np.ones((9, 2)), np.ones((3, 2, 2, 3))),
            "number of channels",
        ),
        (
            lambda: reflection.prefilter(np.ones((130**2, 1)), np.ones((130, 1, 1, 1))),
            "degree 128",
        ),
        (
            lambda: reflection.prefilter_cube(LIGHT, RHO, size=0),
            "size must be positive",
        ),
        (
            lambda: ReflectionMap.from_coefs(np.ones((4, 7, 4, 1)), frame="local"),
            "even number of columns",
        ),
        (
            lambda: ReflectionMap.from_coefs(np.ones((4, 8, 5, 1)), frame="local"),
            "coefs must have",
        ),
        (
            lambda: FOUR.read(
                np.ones((1, 3)), np.ones((1, 3)), interpolation="nearest"
            ),
            "interpolation",
        ),
        (lambda: FOUR.read(np.ones((1, 3)), np.ones((2, 3))), "shape of reflected"),
        (lambda: reflection.dynamic_map(FOUR, np.ones((1, 3))), "view must have shape"),
        (lambda: reflection.view_maps(FOUR, np.ones((0, 3))), "at least one"),
        (
            lambda: reflection.fit_views(np.ones((3, 4, 1)), np.ones((2, 3)), p_max=0),
            "values and views",
        ),
        (
            lambda: shjax.reflection.reflect(
                LIGHT, RHO, np.ones((2, 3)), np.ones((1, 3))
            ),
            "shape of reflected",
        ),
        (
            lambda: shjax.reflection.convolve(np.ones((9, 2)), np.ones((3, 3))),
            "number of channels",
        ),
    ],
)
def test_wrong_arguments_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_view_bases_are_told_apart_by_jax():
    # Two dataclasses of equal static fields are one tree structure to JAX 0.10: now and
    # then a jitted function ran what it had compiled for the other.
    from shjax.reflection.view_basis import HarmonicViews, ZonalViews

    one, other = (jax.tree.structure(views(3)) for views in (HarmonicViews, ZonalViews))
    assert one != other
