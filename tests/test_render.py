import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shjax
from shjax import render
from shjax.display import show_difference, tone_map
from tests.helpers import check_gradients, relative_error, unit_vectors

TILTED = render.Camera(origin=(2.0, -3.0, 1.0), up=(0.1, 0.0, 1.0))


def test_default_view_looks_along_the_panoramas_centre():
    ball = render.sphere(65)
    normals = np.asarray(ball.normals)
    np.testing.assert_allclose(normals[32, 32], [-1, 0, 0], atol=1e-6)
    assert normals[5, 32, 2] > 0.8  # the top of the picture is up
    assert normals[32, 59, 1] < -0.8  # its right side is -y, as in the panorama
    np.testing.assert_allclose(np.asarray(ball.views)[32, 32], [-1, 0, 0], atol=1e-6)


@pytest.mark.parametrize("fov", [None, 0.6])
@pytest.mark.parametrize("camera", [render.Camera(), TILTED])
def test_normals_are_unit_and_face_the_camera(camera, fov):
    camera = render.Camera(camera.origin, camera.target, camera.up, fov=fov)
    ball = render.sphere((40, 60), camera)
    normals, mask = np.asarray(ball.normals), np.asarray(ball.mask)
    assert mask.shape == (40, 60)
    seen = mask > 0
    lengths = np.linalg.norm(normals, axis=-1)
    np.testing.assert_allclose(lengths[seen], 1, rtol=1e-5)
    assert np.all(lengths[~seen] == 0)
    facing = np.sum(normals * np.asarray(ball.views), axis=-1)
    assert np.all(facing[mask == 1] > 0)


def test_coverage_is_the_area_of_the_disc():
    ball = render.sphere(200)
    mask = np.asarray(ball.mask)
    area = mask.sum() * (2.1 / 200) ** 2
    assert area == pytest.approx(math.pi, rel=1e-3)
    assert np.any((mask > 0) & (mask < 1))


def test_perspective_hits_lie_on_the_sphere():
    camera = render.Camera(origin=(0.0, -3.0, 0.0), fov=0.8)
    ball = render.sphere(33, camera)
    origins, directions = (np.asarray(a) for a in render.camera_rays(33, 33, camera))
    normals = np.asarray(ball.normals)
    whole = np.asarray(ball.mask) == 1
    away = (normals - origins)[whole]
    away /= np.linalg.norm(away, axis=-1, keepdims=True)
    np.testing.assert_allclose(away, directions[whole], atol=1e-5)
    # The outline of a sphere at distance 3 is seen under asin(1/3).
    widest = np.flatnonzero(np.asarray(ball.mask)[16] > 0.5)
    half = (widest[-1] - widest[0] + 1) / 33 * math.tan(0.4)
    assert half == pytest.approx(math.tan(math.asin(1 / 3)), abs=0.02)


def test_a_sphere_behind_the_camera_is_not_seen():
    camera = render.Camera(target=(-8.0, 0.0, 0.0))
    assert not np.any(np.asarray(render.sphere(16, camera).mask))


def test_white_light_on_albedo_one_is_radiance_one():
    white = jnp.zeros((9, 3)).at[0].set(math.sqrt(4 * math.pi))
    ball = render.sphere(32)
    picture = np.asarray(render.image(ball, white))
    inside = np.asarray(ball.mask) == 1
    np.testing.assert_allclose(picture[inside], 1, rtol=1e-5)
    assert np.all(picture[np.asarray(ball.mask) == 0] == 0)


def test_albedo_scales_the_radiance(rng):
    lighting = jnp.asarray(rng.normal(size=(9, 3)), jnp.result_type(float))
    normals = jnp.asarray(unit_vectors(rng, 12).reshape(3, 4, 3), lighting.dtype)
    full = render.image(render.make_gbuffer(normals), lighting)
    albedo = jnp.asarray(rng.uniform(size=(3, 4, 3)), lighting.dtype)
    scaled = render.image(render.make_gbuffer(normals, albedo=albedo), lighting)
    assert relative_error(scaled, full * albedo) < 1e-6
    grey = render.image(render.make_gbuffer(normals, albedo=0.25), lighting)
    assert relative_error(grey, full * 0.25) < 1e-6


def test_reference_picture_agrees_on_band_limited_light(rng, dtype):
    lighting = jnp.asarray(rng.normal(size=(9, 3)), dtype)
    radiance = shjax.synthesize(lighting, n_theta=128, n_phi=256)
    ball = render.sphere(24, TILTED)
    exact = render.reference(ball, radiance)
    assert relative_error(exact, render.image(ball, lighting)) < 1e-4


def test_pixels_without_normal_stay_black_and_finite(dtype):
    gbuffer = render.make_gbuffer(jnp.zeros((2, 2, 3), dtype))
    picture = render.image(gbuffer, jnp.ones((9, 1), dtype))
    assert np.all(np.asarray(picture) == 0)
    gradient = jax.grad(
        lambda n: jnp.sum(render.image(render.make_gbuffer(n), jnp.ones((9, 1), dtype)))
    )(jnp.zeros((2, 2, 3), dtype))
    assert np.all(np.isfinite(np.asarray(gradient)))


@pytest.mark.x64
def test_gradients(rng):
    lighting = jnp.asarray(rng.normal(size=(9, 2)))
    normals = jnp.asarray(rng.normal(size=(2, 3, 3)))
    albedo = jnp.asarray(rng.uniform(size=(2, 3, 2)))

    def picture(light, n, reflectance):
        gbuffer = render.make_gbuffer(n, mask=jnp.full((2, 3), 0.7), albedo=reflectance)
        return render.image(gbuffer, light)

    check_gradients(picture, lighting, normals, albedo)


@pytest.mark.usefixtures("as_a_user")
@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: render.sphere(0), "size must be positive"),
        (lambda: render.sphere(8, render.Camera(up=(1.0, 0.0, 0.0))), "up vector"),
        (lambda: render.sphere(8, render.Camera(fov=4.0)), "fov"),
        (lambda: render.sphere(8, render.Camera(width=0.0)), "width"),
        (lambda: render.make_gbuffer(np.ones((4, 3))), r"\(H, W, 3\)"),
        (lambda: render.make_gbuffer(np.ones((4, 4, 3)), mask=np.ones((3, 4))), "mask"),
        (
            lambda: render.make_gbuffer(np.ones((4, 4, 3)), views=np.ones((4, 3))),
            "views",
        ),
        (
            lambda: render.make_gbuffer(np.ones((4, 4, 3)), albedo=np.ones((3, 4, 1))),
            "albedo",
        ),
    ],
)
def test_wrong_arguments_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_tone_map_keeps_order_and_range(rng):
    image = rng.uniform(0, 1000, (20, 20, 3))
    shown = tone_map(image)
    assert shown.min() >= 0
    assert shown.max() <= 1
    grey = np.repeat(np.linspace(0, 50, 400).reshape(20, 20, 1), 3, axis=-1)
    assert np.all(np.diff(tone_map(grey)[..., 0].ravel()) >= 0)
    assert np.all(tone_map(np.zeros((2, 2, 3))) == 0)
    assert tone_map(np.ones((2, 2, 1))).shape == (2, 2, 1)


def test_difference_is_white_at_zero_and_coloured_by_sign():
    shown = show_difference(np.array([[[0.0], [1.0], [-1.0]]]), 1.0)
    assert shown[0, 0].tolist() == [1, 1, 1]
    assert shown[0, 1, 0] > shown[0, 1, 2]
    assert shown[0, 2, 2] > shown[0, 2, 0]
