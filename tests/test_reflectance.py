"""Reflectance under known light, and lighting and reflectance together."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shjax
from shjax import render
from shjax.brdf import ggx, lafortune, lambertian, phong
from shjax.brdf.transfer_rows import table_to
from shjax.harmonics.degrees import degrees
from shjax.inverse import General, Radial, lobe
from shjax.inverse.reflectance.kernel_basis import kernel_basis
from shjax.inverse.reflectance.lobes import FAMILIES
from tests.helpers import check_gradients, relative_error, unit_vectors
from tests.mitsuba import FRONT, environment


def pixels_of(rng, count, least=0.35):
    """Normals and views that face each other."""
    normals, views = unit_vectors(rng, 8 * count), unit_vectors(rng, 8 * count)
    kept = np.sum(normals * views, axis=-1) > least
    return normals[kept][:count], views[kept][:count]


@pytest.fixture
def scene(rng):
    """A broad light of degree 8, normals and views, and pictures by the exact integral."""
    lighting = rng.normal(size=(81, 2)) / (1 + degrees(8))[:, None] ** 1.5
    lighting[0] += 4
    panorama = shjax.synthesize(jnp.asarray(lighting), n_theta=64, n_phi=128)
    normals, views = pixels_of(rng, 300)

    def picture(surface):
        flat = (jnp.asarray(normals), jnp.asarray(views))
        return np.asarray(shjax.reference_reflection(panorama, surface, *flat))

    return lighting, normals, views, picture


def test_radial_gains(rng, dtype):
    lighting = rng.normal(size=(81, 3))
    normals, views = pixels_of(rng, 400)
    truth = np.asarray(shjax.brdf.radial_coefs(phong(30.0), l_max=8), float)
    mirror = 2 * np.sum(normals * views, axis=-1, keepdims=True) * normals - views
    image = np.asarray(shjax.basis(mirror, l_max=8)) @ (lighting * truth[degrees(8)])
    found = shjax.estimate_brdf(
        *(np.asarray(a, dtype) for a in (image, normals, views, lighting)),
        lobe=Radial(6),
    )
    assert found.ok
    assert found.names[3] == "a_3"
    assert found.value.dtype == dtype
    tolerance = 1e-4 if dtype == np.float32 else 1e-11
    assert relative_error(found.value, np.tile(truth[:7], 3)) < tolerance


@pytest.mark.x64
def test_general_coefficients(rng):
    """The picture by ``reflect``: another way through the light's rotation."""
    lighting = rng.normal(size=(25, 2))
    rho = np.zeros((5, 3, 3, 2))
    for l in range(5):
        for p in range(3):
            rho[l, p, : min(l, p) + 1] = rng.normal(size=(min(l, p) + 1, 2))
    normals, views = pixels_of(rng, 500)
    mirror = 2 * np.sum(normals * views, axis=-1, keepdims=True) * normals - views
    image = shjax.reflection.reflect(
        *(jnp.asarray(a) for a in (lighting, rho, mirror, views))
    )
    found = shjax.estimate_brdf(image, normals, views, lighting, lobe=General(4, 2))
    assert found.ok
    names = {name: i for i, name in enumerate(found.names)}
    for name, row in names.items():
        l, p, q = (int(digit) for digit in name.removeprefix("rho_"))
        np.testing.assert_allclose(found.value[row], rho[l, p, q], rtol=1e-8)


@pytest.mark.x64
def test_gains_beyond_the_light_are_not_determined(rng):
    """Under light that ends at degree 4 nothing beyond a_4 is."""
    normals, views = pixels_of(rng, 400)
    lighting = np.zeros((81, 1))
    lighting[:25] = rng.normal(size=(25, 1))
    mirror = 2 * np.sum(normals * views, axis=-1, keepdims=True) * normals - views
    gains = np.asarray(shjax.brdf.radial_coefs(phong(20.0), l_max=8))[degrees(8)]
    image = np.asarray(shjax.basis(mirror, l_max=8)) @ (lighting * gains)
    found = shjax.estimate_brdf(image, normals, views, lighting, lobe=Radial(8))
    assert found.null_space.shape == (4, 9)
    assert not found.ok
    assert "not determined: a_5, a_6, a_7, a_8" in found.message
    assert np.all(np.isfinite(found.value))
    assert np.all(np.isinf(np.asarray(found.standard_deviation)[5:]))


@pytest.mark.x64
@pytest.mark.parametrize(
    ("model", "surface", "truth", "tolerance"),
    [
        ("phong", 0.8 * phong(3.0), [3, 0.8], 1e-3),
        pytest.param(
            "ggx_dielectric",
            0.7 * ggx(0.3, 0.04),
            [0.3, 0.7],
            1e-2,
            marks=pytest.mark.slow,
        ),
        pytest.param(
            "gaussian_microfacet",
            0.7 * shjax.brdf.gaussian_microfacet(0.3),
            [0.3, 0.7],
            3e-3,
            marks=pytest.mark.slow,
        ),
        (
            "diffuse + ggx",
            lambertian(0.5) + 0.3 * ggx(0.4, 1.0),
            [0.4, 0.5, 0.3],
            5e-3,
        ),
        pytest.param(
            "lafortune",
            0.5 * (12 / (2 * np.pi)) * lafortune([-0.9], [1.09087], [10.0]),
            [10, 1.09087 / 0.9, 0.5],
            2e-2,
            marks=pytest.mark.slow,
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_parametric_models(scene, model, surface, truth, tolerance):
    lighting, normals, views, picture = scene
    found = shjax.estimate_brdf(picture(surface), normals, views, lighting, lobe=model)
    assert found.converged
    np.testing.assert_allclose(found.value[:, 0], truth, rtol=tolerance)
    np.testing.assert_allclose(found.value[:, 1], truth, rtol=tolerance)
    assert found.ok, found.message
    assert found.names[-1] == "ks"


def test_a_model_and_its_channels(scene, dtype):
    """One shape for all channels, amplitudes of each, in single precision too."""
    lighting, normals, views, picture = scene
    surface = lambertian(np.array([0.2, 0.6])) + phong(16.0) * np.array([0.7, 0.1])
    arguments = (picture(surface), normals, views, lighting)
    found = shjax.estimate_brdf(
        *(np.asarray(a, dtype) for a in arguments), lobe="diffuse + phong"
    )
    tolerance = 1e-2 if dtype == np.float32 else 2e-3
    np.testing.assert_allclose(found.value[0], 16, rtol=tolerance)
    np.testing.assert_allclose(found.value[1], [0.2, 0.6], rtol=tolerance)
    np.testing.assert_allclose(found.value[2], [0.7, 0.1], rtol=tolerance)
    assert np.all(np.asarray(found.value[1:]).sum(axis=0) <= 1)


@pytest.mark.x64
@pytest.mark.parametrize("start", [pytest.param(1.5, marks=pytest.mark.slow), 1000.0])
def test_from_every_start(scene, start):
    lighting, normals, views, picture = scene
    image = picture(phong(64.0))
    found = shjax.estimate_brdf(
        image, normals, views, lighting, lobe=lobe("phong", starts=np.array([start]))
    )
    np.testing.assert_allclose(found.value[0], 64, rtol=0.01)


@pytest.mark.slow
@pytest.mark.x64
def test_an_exponent_under_uniform_light_is_not_determined(rng):
    normals, views = pixels_of(rng, 300)
    image = np.full((300, 1), 0.7) + 1e-3 * rng.normal(size=(300, 1))
    light = np.zeros((81, 1))
    light[0] = np.sqrt(4 * np.pi)
    one = shjax.estimate_brdf(image, normals, views, light, lobe="phong")
    assert not one.ok
    assert one.message.endswith("not determined: exponent")
    np.testing.assert_allclose(one.value[1], 0.7, rtol=1e-3)
    assert np.all(np.isfinite(one.value))
    np.testing.assert_allclose(one.prior_fraction[0], 1)
    both = shjax.estimate_brdf(image, normals, views, light, lobe="diffuse + phong")
    assert "kd, ks" in both.message


@pytest.mark.slow
def test_many_pixels_without_noise_converge(rng, dtype):
    """A hundredth of their deviation is less than single precision tells."""
    normals, views = (a.astype(dtype) for a in pixels_of(rng, 3000))
    light = np.zeros((625, 3), dtype)
    light[0] = [3.391, 3.415, 3.32]
    image = np.asarray(0.2 * shjax.irradiance(jnp.asarray(light), jnp.asarray(normals)))
    found = shjax.estimate_brdf(image, normals, views, light, lobe="phong")
    assert found.converged
    assert found.message.endswith("not determined: exponent")


@pytest.mark.slow
@pytest.mark.x64
@pytest.mark.usefixtures("as_a_user")
def test_exponents_under_real_light_are_determined(data, rng):
    """Six places, exponent 20: none is flagged."""
    normals, views = pixels_of(rng, 600)
    for name in ("city", "forest", "night", "studio", "sunset", "workshop"):
        panorama = environment(data / "renders", f"real_{name}", 128).astype(float)
        lighting = shjax.analyze(panorama, l_max=24)
        mirror = 2 * np.sum(normals * views, axis=-1, keepdims=True) * normals - views
        gains = shjax.brdf.radial_coefs(phong(20.0), l_max=24)
        image = shjax.evaluate(
            shjax.reflection.convolve(lighting, gains), jnp.asarray(mirror)
        )
        image = image * (1 + 0.01 * rng.normal(size=image.shape))
        found = shjax.estimate_brdf(image, normals, views, lighting, lobe="phong")
        assert found.ok, (name, found.message)
        np.testing.assert_allclose(found.value[0], 20, rtol=0.02)


@pytest.mark.slow
@pytest.mark.x64
def test_gradients_of_reflectance(scene, rng):
    lighting, normals, views, picture = scene
    image = jnp.asarray(picture(lambertian(0.4) + 0.3 * phong(9.0)))
    image = image + 0.01 * rng.normal(size=image.shape)

    def parameters(image, lighting):
        found = shjax.estimate_brdf(
            image, normals, views, lighting, lobe="diffuse + phong", noise=0.01
        )
        return found.value

    check_gradients(
        parameters, image, jnp.asarray(lighting), tolerance=1e-6, transpose=1e-9
    )
    check_gradients(
        lambda i: (
            shjax.estimate_brdf(i, normals, views, lighting, lobe=Radial(3)).value
        ),
        image,
        tolerance=1e-6,
    )


@pytest.mark.slow
@pytest.mark.x64
@pytest.mark.parametrize(
    ("name", "model", "degree", "least", "truth", "tolerance"),
    [
        ("phongRH_n64", "phong", 40, 0.3, 64, 0.01),
        ("ggx_a0.2", "ggx", 32, 0.3, 0.2, 0.005),
    ],
)
def test_pictures_by_another_renderer(
    data, name, model, degree, least, truth, tolerance
):
    """Every 9th pixel, for time; the whole table is experiments/inverse_reflectance.py."""
    renders = data / "renders"
    ball = render.sphere(128, FRONT)
    image = shjax.io.read_image(renders / f"glossy/sphere_{name}_real_city_front.exr")
    panorama = environment(renders, "real_city", 512).astype(float)
    lighting = shjax.analyze(panorama, l_max=degree)
    some = (slice(None, None, 3), slice(1, None, 3))
    found = shjax.estimate_brdf(
        image[some].astype(float),
        ball.normals[some],
        ball.views[some],
        lighting,
        lobe=model,
        mask=(np.asarray(ball.mask) == 1)[some],
        min_cosine=least,
    )
    np.testing.assert_allclose(found.value[0], truth, rtol=tolerance)
    assert found.ok


@pytest.mark.x64
def test_gains_of_a_picture_by_another_renderer(data):
    renders = data / "renders"
    ball = render.sphere(128, FRONT)
    image = shjax.io.read_image(
        renders / "glossy/sphere_phongRH_n64_real_city_front.exr"
    )
    panorama = environment(renders, "real_city", 512).astype(float)
    whole = np.asarray(ball.mask) == 1
    found = shjax.estimate_brdf(
        image.astype(float),
        ball.normals,
        ball.views,
        shjax.analyze(panorama, l_max=16),
        mask=whole,
    )
    truth = np.asarray(shjax.brdf.radial_coefs(phong(64.0), l_max=8))
    np.testing.assert_allclose(found.value, np.tile(truth, 3), rtol=0.005)


@pytest.fixture
def views_of_a_sphere(rng):
    """Normals that one camera sees, and another 60 degrees from it, with pictures."""
    lighting = rng.normal(size=(25, 1)) / (1 + degrees(4))[:, None]
    lighting[0] = 4
    panorama = shjax.synthesize(jnp.asarray(lighting), n_theta=32, n_phi=64)
    normals, views = [], []
    for view in ([1.0, 0, 0], [0.5, 0.75**0.5, 0]):
        some = unit_vectors(rng, 2000)
        normals.append(some[some @ np.array(view) > 0.35][:250])
        views.append(np.tile(view, (250, 1)))
    normals, views = jnp.asarray(np.stack(normals)), jnp.asarray(np.stack(views))

    def picture(surface):
        return np.asarray(shjax.reference_reflection(panorama, surface, normals, views))

    return lighting, normals, views, picture


@pytest.mark.x64
@pytest.mark.parametrize(
    ("model", "surface", "dimension"),
    [
        ("radial", phong(20.0), 5),
        pytest.param(
            "diffuse + phong",
            lambertian(0.5) + 0.3 * phong(20.0),
            1,
            marks=pytest.mark.slow,
        ),
    ],
)
def test_one_view_leaves_light_and_reflectance_open(
    views_of_a_sphere, model, surface, dimension
):
    """The gain of each degree; the albedo."""
    _, normals, views, picture = views_of_a_sphere
    image = picture(surface)
    found = shjax.estimate_joint(
        image[:1], normals[:1], views[:1], lobe=model, noise=1e-3
    )
    assert found.null_space.shape[0] == dimension
    assert not found.ok
    assert "not determined" in found.message
    assert np.all(np.isfinite(found.value))
    deviation = np.asarray(found.standard_deviation)[:, 0]
    assert np.isinf(deviation[found.names.index("L_0+0")])
    # Along each direction the picture does not change, to first order.
    size = len(found.names) - 25
    for direction in found.null_space:
        assert np.any(np.abs(direction[:size]) > 1e-3)


@pytest.mark.x64
def test_nine_gains_are_open_for_nine_degrees(rng):
    normals, views = pixels_of(rng, 500)
    found = shjax.estimate_joint(
        np.ones((1, 500, 1)), normals[None], views[None], lobe="radial", l_max=8
    )
    assert found.null_space.shape == (9, 90)


@pytest.mark.slow
@pytest.mark.x64
def test_what_is_known_closes_the_rest(views_of_a_sphere):
    lighting, normals, views, picture = views_of_a_sphere
    image = picture(0.7 * phong(20.0))
    found = shjax.estimate_joint(
        image[:1],
        normals[:1],
        views[:1],
        lobe=lobe("phong", known={"exponent": 20.0, "total": 0.7}),
        noise=1e-3,
    )
    assert found.ok, found.message
    np.testing.assert_allclose(found.value[2:], lighting, atol=1e-3)
    both = picture(lambertian(0.5) + 0.3 * phong(12.0))
    found = shjax.estimate_joint(
        both,
        normals,
        views,
        lobe=lobe("diffuse + phong", known={"total": 0.8}),
        noise=1e-3,
    )
    assert found.ok, found.message
    np.testing.assert_allclose(found.value[:3, 0], [12, 0.5, 0.3], rtol=0.02)
    np.testing.assert_allclose(found.value[3:], lighting, atol=0.03)


@pytest.mark.slow
@pytest.mark.x64
def test_two_lights(views_of_a_sphere, rng):
    lighting, normals, views, picture = views_of_a_sphere
    first = picture(0.5 * phong(8.0))
    found = shjax.estimate_joint(
        np.concatenate([first, 2 * first]),
        jnp.concatenate([normals] * 2),
        jnp.concatenate([views] * 2),
        lobe=lobe("phong", known={"exponent": 8.0, "total": 0.5}),
        lights=(0, 0, 1, 1),
    )
    assert found.value.shape == (2 + 2 * 25, 1)
    np.testing.assert_allclose(found.value[2:27], lighting, atol=1e-3)
    np.testing.assert_allclose(found.value[27:], 2 * lighting, atol=2e-3)
    del rng


@pytest.mark.slow
@pytest.mark.x64
def test_a_prediction_of_the_estimated_reflectance(scene):
    lighting, normals, views, picture = scene
    surface = lambertian(0.4) + 0.3 * phong(9.0)
    ball = render.sphere(24)
    panorama = shjax.synthesize(jnp.asarray(lighting), n_theta=64, n_phi=128)
    exact = render.reference(ball, panorama, surface)
    facing = np.sum(np.asarray(ball.normals * ball.views), axis=-1) > 0.3
    seen = (np.asarray(ball.mask) == 1) & facing
    found = shjax.estimate_brdf(
        picture(surface), normals, views, lighting, lobe="diffuse + phong"
    )
    again, deviation = found.predict(ball)
    assert relative_error(again[seen], exact[seen]) < 3e-3
    assert np.all(np.isfinite(deviation))


@pytest.mark.usefixtures("as_a_user")
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"lobe": "velvet"}, "lobe must be radial, general, or one of"),
        ({"views": np.ones((4, 3))}, "views must have shape"),
        ({"views": np.full((5, 3), 0.9)}, "unit length"),
        ({"lighting": np.ones((9, 2))}, "lighting must have one channel"),
        ({"lighting": np.ones((8, 1))}, "lighting"),
        ({"lobe": Radial(9)}, "must reach l_max"),
        (
            {"lobe": lobe("phong", starts=np.array([-1.0]))},
            "inside the parameters' range",
        ),
        ({"lobe": lobe("phong", starts=np.ones((2, 2)))}, "starts must have shape"),
        ({"image": np.full((5, 1), np.nan)}, "image must be finite"),
    ],
)
def test_wrong_arguments_are_refused(change, message):
    up = np.tile([0.0, 0, 1], (5, 1))
    arguments = {
        "image": np.ones((5, 1)),
        "normals": up,
        "views": up,
        "lighting": np.ones((9, 1)),
    } | change
    with pytest.raises(ValueError, match=message):
        shjax.estimate_brdf(**{"lobe": Radial(2)} | arguments)


@pytest.mark.usefixtures("as_a_user")
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"lobe": lobe("phong", known={"gloss": 1.0})},
            "known must name exponent or total",
        ),
        (
            {"lobe": lobe("phong", known={"total": 1.5})},
            "known total must lie inside its range",
        ),
        ({"lights": (0, 2)}, "lights must number"),
        ({"lobe": lobe("radial", known={"a_9": 1.0})}, "known must name one of a_0"),
    ],
)
def test_wrong_joint_arguments_are_refused(change, message):
    up = np.tile([0.0, 0, 1], (2, 5, 1))
    arguments = {
        "images": np.ones((2, 5, 1)),
        "normals": up,
        "views": up,
        "lobe": "phong",
    }
    with pytest.raises(ValueError, match=message):
        shjax.estimate_joint(**(arguments | change))


def test_jit_and_vmap(rng, dtype):
    lighting = rng.normal(size=(25, 2)).astype(dtype)
    normals, views = (a.astype(dtype) for a in pixels_of(rng, 60))
    images = jnp.asarray(rng.uniform(0.5, 1, (2, 60, 2)), dtype)

    def one(image):
        return shjax.estimate_brdf(
            image, normals, views, lighting, lobe=Radial(2)
        ).value

    both = jax.vmap(one)(images)
    assert relative_error(both[1], jax.jit(one)(images[1])) < 1e-4


@pytest.mark.parametrize(("name", "shape"), [("ggx", 0.23), ("phong_cosine", 37.0)])
def test_the_basis_of_a_lobe_gives_its_kernels(name, shape):
    """Any shape between the basis' own, within the type's rounding or a millionth."""
    kind, table = FAMILIES[name], table_to(0.2)
    dtype = jnp.result_type(float)
    basis = kernel_basis(kind, table, 12, np.dtype(dtype))
    free = jnp.asarray(kind.shapes[0].free(np.array(shape)), dtype)
    exact = table.kernels(kind.lobe(kind.shapes[0].natural(free)[None]), 12)[..., 0]
    found = jnp.einsum("r,rolq->olq", basis.shares(free), basis.kernels)
    assert relative_error(found, exact) < 5e-6
    slope = jax.jacfwd(basis.shares)(free)
    step = 1e-2
    apart = (basis.shares(free + step) - basis.shares(free - step)) / (2 * step)
    assert relative_error(slope, apart) < 1e-3
    assert np.all(np.isfinite(jax.jacfwd(basis.shares)(free + 1e3)))  # far outside
