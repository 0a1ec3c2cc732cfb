"""Reflectance models: known values, energy, reciprocity, tables, files, derivatives."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shjax
import shjax.vectors
from shjax import brdf
from shjax.brdf.core import Local, transfer_local
from shjax.brdf.ggx import albedo_at, albedo_terms, directional_albedo
from shjax.brdf.measured import _half_difference
from shjax.brdf.models import squared_angle
from shjax.brdf.zernike import zernike_products
from shjax.sphere import spherical_directions
from shjax.vectors import frames
from tests.helpers import check_gradients, relative_error, unit_vectors

UP = np.array([0.0, 0.0, 1.0])


def models():
    return {
        "lambertian": brdf.lambertian(0.7),
        "phong": brdf.phong(20.0),
        "phong with horizon": brdf.phong(5.0, horizon=True),
        "phong with cosine": brdf.phong_cosine(32.0),
        "microfacet": brdf.gaussian_microfacet(0.3),
        "ggx": brdf.ggx(0.2, 0.04),
        "ggx, all scattering": brdf.ggx(0.4, 1.0, multiscatter=True),
        "lafortune": brdf.lafortune([-1.0, 0.4], [0.9, -0.3], [12.0, 3.0], diffuse=0.2),
        "kajiya-kay": brdf.kajiya_kay(32.0),
        "sum": brdf.lambertian(0.6) + 0.3 * brdf.phong_cosine(30.0),
    }


def upper(rng, n):
    vectors = unit_vectors(rng, n)
    vectors[:, 2] = np.abs(vectors[:, 2])
    return vectors


def value(model, light, view, normal=UP, tangent=None):
    """Transfer function of single directions."""
    vectors = [jnp.asarray(np.atleast_2d(v)) for v in (normal, light, view)]
    tangents = None if tangent is None else jnp.asarray(np.atleast_2d(tangent))
    return np.asarray(brdf.transfer(model, *vectors, tangents))[0]


def test_values_by_the_formulas(dtype):
    light, view = (
        spherical_directions(np.array(t), np.array(p))
        for t, p in ((0.4, 0.3), (0.7, 2.8))
    )
    mirror = 2 * view[2] * UP - view
    half = (light + view) / np.linalg.norm(light + view)
    theta = np.arccos(half[2])
    s, alpha = 20.0, 0.2
    d = alpha**2 / (np.pi * (half[2] ** 2 * (alpha**2 - 1) + 1) ** 2)
    lam = [
        (np.sqrt(1 + alpha**2 * (1 / c**2 - 1)) - 1) / 2 for c in (light[2], view[2])
    ]
    fresnel = 0.04 + 0.96 * (1 - half @ view) ** 5
    expected = {
        "lambertian": 0.7 / np.pi * light[2],
        "phong": (s + 1) / (2 * np.pi) * (mirror @ light) ** s,
        "phong with cosine": 34 / (2 * np.pi) * (mirror @ light) ** 32 * light[2],
        "microfacet": np.exp(-((theta / 0.3) ** 2)) / (4 * np.pi * 0.09),
        "ggx": d * fresnel / (1 + sum(lam)) / (4 * view[2]),
        "sum": 0.6 / np.pi * light[2]
        + 0.3 * 32 / (2 * np.pi) * (mirror @ light) ** 30 * light[2],
    }
    for name, number in expected.items():
        found = value(models()[name], light, view)[0]
        assert found == pytest.approx(
            number, rel=3e-5 if dtype == np.float32 else 1e-12
        ), name


def test_lafortune_by_its_formula():
    light, view = unit_vectors(np.random.default_rng(3), 2)
    light[2], view[2] = abs(light[2]), abs(view[2])
    lobes = [(-1.0, 0.9, 12.0), (0.4, -0.3, 3.0)]
    base = [
        cxy * (light[:2] @ view[:2]) + cz * light[2] * view[2] for cxy, cz, _ in lobes
    ]
    powers = sum(max(b, 0) ** n for b, (_, _, n) in zip(base, lobes))
    expected = (0.2 / np.pi + powers) * light[2]
    assert value(models()["lafortune"], light, view)[0] == pytest.approx(
        expected, rel=1e-5
    )


def test_kajiya_kay_depends_on_the_tangent_alone(rng):
    tangent = unit_vectors(rng, 1)[0]
    light, view = unit_vectors(rng, 2)
    difference = np.arccos(light @ tangent) - np.arccos(view @ tangent)
    found = value(
        models()["kajiya-kay"], light, view, unit_vectors(rng, 1)[0], tangent
    )[0]
    assert found == pytest.approx(max(np.cos(difference), 0) ** 32, rel=1e-4)


@pytest.mark.parametrize("name", models())
def test_isotropy(name, rng, dtype):
    """Turning everything about any axis changes nothing."""
    normals, tangents, lights, views = (
        jnp.asarray(unit_vectors(rng, 50), dtype) for _ in range(4)
    )
    turn = jnp.asarray(frames(jnp.asarray(unit_vectors(rng, 1)[0])), dtype)
    model = models()[name]
    plain = brdf.transfer(model, normals, lights, views, tangents)
    turned = brdf.transfer(
        model, *(a @ turn.T for a in (normals, lights, views, tangents))
    )
    np.testing.assert_allclose(
        turned, plain, atol=2e4 * np.finfo(dtype).eps * float(plain.max())
    )


@pytest.mark.parametrize("name", sorted(set(models()) - {"phong", "kajiya-kay"}))
def test_nothing_below_the_horizon(name, rng, dtype):
    lights, views = upper(rng, 40), upper(rng, 40)
    lights[:20, 2] *= -1
    views[20:, 2] *= -1
    normals = np.broadcast_to(UP, lights.shape)
    found = brdf.transfer(
        models()[name], *(jnp.asarray(a, dtype) for a in (normals, lights, views))
    )
    assert np.all(np.asarray(found) == 0)


def test_checks_report_and_do_not_raise():
    reports = {name: brdf.check(model) for name, model in models().items()}
    assert reports["lambertian"].albedo == pytest.approx(0.7, abs=1e-5)
    assert reports["phong"].albedo == pytest.approx(1, abs=1e-4)
    for name in ("lambertian", "phong with cosine", "ggx", "lafortune", "sum"):
        assert np.all(reports[name].reciprocity < 1e-4), name
    for name in ("phong", "microfacet"):  # the thesis's own: no BRDFs
        assert np.all(reports[name].reciprocity > 0.5), name
    assert np.max(reports["kajiya-kay"].albedo) > 1
    assert "more than they receive" in reports["kajiya-kay"].message
    assert np.all(reports["ggx"].albedo < 1)
    assert all(np.all(r.negative == 0) for r in reports.values())
    table = -np.ones((2, 2, 2, 1))
    table[1:] = 3
    assert 0 < brdf.check(brdf.from_table(jnp.asarray(table))).negative[0] < 0.5


@pytest.mark.parametrize("alpha", [0.03, 0.1, 0.4, 0.7, 1.0])
def test_white_metal_with_all_scattering_returns_everything(alpha):
    found = brdf.check(brdf.ggx(alpha, 1.0, multiscatter=True)).albedo
    np.testing.assert_allclose(found, 1, atol=1e-3)
    single = brdf.check(brdf.ggx(alpha, 1.0)).albedo
    assert np.all(single < 1 + 1e-6)
    if alpha > 0.5:
        assert np.min(single) < 0.95


@pytest.mark.parametrize(
    "alpha", [pytest.param(0.02, marks=pytest.mark.slow), 0.15, 0.6, 1.0]
)
def test_directional_albedo_by_brute_force(alpha, dtype):
    cosine = jnp.asarray([0.05, 0.3, 0.8, 1.0], dtype)
    x, w = np.polynomial.legendre.leggauss(1500)
    height, phi = (1 + x[:, None]) / 2, (np.arange(1500) + 0.5) * np.pi / 1500
    sine = np.sqrt(1 - height**2)
    ones = np.ones_like(height * phi)
    light = Local(
        *(
            jnp.asarray(a * ones)
            for a in (sine * np.cos(phi), sine * np.sin(phi), height)
        )
    )
    exact = []
    for mu in np.asarray(cosine, float):
        # Dense in the half vector instead where the lobe is narrow.
        view = Local(jnp.asarray(np.sqrt(1 - mu**2)), jnp.asarray(0.0), jnp.asarray(mu))
        rho = transfer_local(brdf.ggx(alpha, 1.0), light, view)[0]
        exact.append(float(np.sum(np.asarray(rho) * w[:, None]) * np.pi / 1500))
    found = directional_albedo(jnp.asarray(alpha, dtype), cosine)
    limit = 4e-4 if alpha > 0.1 else 0.02  # the brute force itself misses the peak
    np.testing.assert_allclose(found, exact, atol=limit)
    fitted = albedo_at(
        albedo_terms(jnp.asarray(alpha, dtype)), jnp.asarray(alpha, dtype), cosine
    )
    np.testing.assert_allclose(fitted, found, atol=4e-4)


def test_squared_angle_is_smooth_and_exact(dtype):
    angle = np.array([0.0, 1e-6, 1e-3, 0.03, 0.0316, 0.032, 0.5, 1.5])
    across, z = (
        jnp.asarray(np.sin(angle) ** 2, dtype),
        jnp.asarray(np.cos(angle), dtype),
    )
    found = squared_angle(across, z)
    np.testing.assert_allclose(found, angle**2, rtol=300 * np.finfo(dtype).eps)
    slope = jax.vmap(jax.grad(squared_angle))(across, z)
    assert np.all(np.isfinite(slope))
    assert slope[0] == pytest.approx(1)


def test_narrow_lobes_keep_their_digits_in_float32(rng):
    """Near the peak against float64: no arccosine, no 1 - cos."""
    view = upper(rng, 200)
    mirror = np.stack([-view[:, 0], -view[:, 1], view[:, 2]], axis=-1)
    light = mirror + 0.01 * rng.normal(size=mirror.shape)
    light /= np.linalg.norm(light, axis=1, keepdims=True)
    keep = light[:, 2] > 0.05
    light, view = light[keep].astype(np.float32), view[keep].astype(np.float32)
    for model in (
        lambda t: brdf.ggx(t(0.03), t(1.0)),
        lambda t: brdf.phong_cosine(t(512.0)),
        lambda t: brdf.gaussian_microfacet(t(0.02)),
    ):
        single = brdf.transfer(
            model(np.float32),
            *(
                jnp.asarray(a)
                for a in (
                    np.broadcast_to(UP, light.shape).astype(np.float32),
                    light,
                    view,
                )
            ),
        )
        if jax.config.read("jax_enable_x64"):
            double = brdf.transfer(
                model(np.float64),
                *(
                    jnp.asarray(a, jnp.float64)
                    for a in (np.broadcast_to(UP, light.shape), light, view)
                ),
            )
            assert relative_error(single, double) < 1e-4


def test_channels_and_sums(rng, dtype):
    lights, views = (jnp.asarray(upper(rng, 20), dtype) for _ in range(2))
    normals = jnp.broadcast_to(jnp.asarray(UP, dtype), lights.shape)
    colour = brdf.lambertian(
        jnp.asarray([0.2, 0.5, 0.9], dtype)
    ) + 0.5 * brdf.phong_cosine(20.0)
    assert colour.channels == 3
    both = brdf.transfer(colour, normals, lights, views)
    matte = brdf.transfer(
        brdf.lambertian(jnp.asarray([0.2, 0.5, 0.9], dtype)), normals, lights, views
    )
    shiny = brdf.transfer(brdf.phong_cosine(20.0), normals, lights, views)
    np.testing.assert_allclose(
        both, matte + 0.5 * jnp.broadcast_to(shiny, matte.shape), rtol=1e-5
    )
    per_channel = brdf.transfer(
        brdf.phong(jnp.asarray([5.0, 10.0, 20.0], dtype)), normals, lights, views
    )
    for c, s in enumerate((5.0, 10.0, 20.0)):
        one = brdf.transfer(brdf.phong(s), normals, lights, views)[:, 0]
        np.testing.assert_allclose(per_channel[:, c], one, rtol=1e-5)
    for listed in ([5.0, 10.0, 20.0], [5, 10, 20], np.array([5, 10, 20])):
        found = brdf.transfer(brdf.phong(listed), normals, lights, views)
        np.testing.assert_allclose(found, per_channel, rtol=1e-5)
    many = brdf.phong(jnp.linspace(1.0, 30.0, 31, dtype=dtype))
    assert brdf.transfer(many, normals, lights, views).shape == (20, 31)


def test_a_grey_brdf_takes_a_colour_as_factor(rng, dtype):
    lights, views = (jnp.asarray(upper(rng, 9), dtype) for _ in range(2))
    normals = jnp.broadcast_to(jnp.asarray(UP, dtype), lights.shape)
    colour = np.array([0.9, 0.5, 0.2])
    for grey in (
        brdf.ggx(0.4, multiscatter=True),
        brdf.phong(9.0),
        brdf.lambertian(0.5),
    ):
        for tinted in (
            colour * grey,
            grey * jnp.asarray(colour, dtype),
            grey * [0.9, 0.5, 0.2],
        ):
            found = brdf.transfer(tinted, normals, lights, views)
            plain = brdf.transfer(grey, normals, lights, views)
            np.testing.assert_allclose(
                found, plain * jnp.asarray(colour, dtype)[None], rtol=1e-5
            )
            rho = shjax.brdf_coefs(tinted, l_max=3, p_max=1)
            whole = shjax.brdf_coefs(grey, l_max=3, p_max=1)
            np.testing.assert_allclose(rho, np.asarray(whole) * colour, atol=1e-5)


def test_a_table_is_read_multilinearly(rng, dtype):
    def smooth(i, o, phi):
        return 0.3 + 0.1 * i - 0.05 * o + 0.02 * phi

    i, o, phi = (
        np.linspace(0, 1.5, 7),
        np.array([0.0, 0.2, 0.9, 1.5]),
        np.linspace(0, np.pi, 5),
    )
    table = smooth(*np.meshgrid(i, o, phi, indexing="ij"))[..., None] * np.array(
        [1.0, 2.0]
    )
    model = brdf.from_table(jnp.asarray(table, dtype), theta_i=i, theta_o=o, phi=phi)
    angles = rng.uniform([0.01, 0.01, 0.0], [1.49, 1.49, np.pi], (30, 3))
    lights = spherical_directions(angles[:, 0], 0.4 + angles[:, 2])
    views = spherical_directions(angles[:, 1], np.full(30, 0.4))
    normals = np.broadcast_to(UP, lights.shape)
    found = brdf.transfer(
        model, *(jnp.asarray(a, dtype) for a in (normals, lights, views))
    )
    exact = smooth(*angles.T) * lights[:, 2]
    np.testing.assert_allclose(found, exact[:, None] * [1, 2], rtol=1e-4)


def test_samples_of_a_product_are_completed_to_it(rng):
    coefs = rng.normal(size=55)
    coefs[0] = 12.0  # mostly constant, so that nothing is clamped
    model = brdf.from_samples(
        jnp.asarray(upper(rng, 9)), jnp.asarray(upper(rng, 9)), jnp.ones((9, 1))
    )
    part = model.parts[0]
    true = brdf.Brdf(
        (type(part)(part.model, {"coefs": jnp.asarray(coefs[:, None])}, part.weight),)
    )
    lights, views = upper(rng, 600), upper(rng, 600)
    lights[:, 2], views[:, 2] = (
        np.maximum(lights[:, 2], 0.05),
        np.maximum(views[:, 2], 0.05),
    )
    lights, views = (
        a / np.linalg.norm(a, axis=1, keepdims=True) for a in (lights, views)
    )
    normals = jnp.asarray(np.broadcast_to(UP, lights.shape))
    values = (
        brdf.transfer(true, normals, jnp.asarray(lights), jnp.asarray(views))
        / lights[:, 2:]
    )
    fitted = brdf.from_samples(
        jnp.asarray(lights), jnp.asarray(views), values, ridge=1e-9
    )
    again = (
        brdf.transfer(fitted, normals, jnp.asarray(lights), jnp.asarray(views))
        / lights[:, 2:]
    )
    assert relative_error(again, values) < (1e-3 if again.dtype == np.float32 else 1e-5)
    assert np.all(brdf.check(fitted).reciprocity < 1e-3)
    assert len(zernike_products(8)) == 55


def test_half_and_difference_angles(rng):
    """Against the rotations of [R98] written out."""
    lights, views = upper(rng, 50), upper(rng, 50)
    found = _half_difference(*(Local(*jnp.asarray(a.T)) for a in (lights, views)))
    for k, (light, view) in enumerate(zip(lights, views)):
        half = (light + view) / np.linalg.norm(light + view)
        theta_h, phi_h = np.arccos(half[2]), np.arctan2(half[1], half[0])
        c, s = np.cos(-phi_h), np.sin(-phi_h)
        turned = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ light
        c, s = np.cos(-theta_h), np.sin(-theta_h)
        turned = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ turned
        theta_d, phi_d = (
            np.arccos(np.clip(turned[2], -1, 1)),
            np.arctan2(turned[1], turned[0]),
        )
        for angle, exact in zip(found, (theta_h, theta_d, np.mod(phi_d, np.pi))):
            off = abs(float(angle[k]) - exact)
            assert min(off, np.pi - off) < 1e-4


def write_merl(path, function, sizes=(90, 90, 180)):
    """A file of the format from a function of theta_h, theta_d, phi_d, as RGB."""
    n_h, n_d, n_phi = sizes
    theta_h = (np.arange(n_h) / n_h) ** 2 * np.pi / 2
    theta_d = np.arange(n_d) / n_d * np.pi / 2
    phi_d = np.arange(n_phi) / n_phi * np.pi
    values = function(theta_h[:, None, None], theta_d[None, :, None], phi_d[None, None])
    values = np.broadcast_to(values, (n_h, n_d, n_phi))
    scale = np.array([1500, 1500 / 1.15, 1500 / 1.66])
    stored = (
        values[None]
        * np.array([1.0, 0.5, 0.25])[:, None, None, None]
        * scale[:, None, None, None]
    )
    with path.open("wb") as file:
        np.array(sizes, "<i4").tofile(file)
        stored.astype("<f8").tofile(file)


def test_merl(tmp_path, rng, dtype):
    def lobe(h, d, phi):
        return (
            np.exp(-((h / 0.6) ** 2)) * (1 + 0.3 * d) * (1 + 0.1 * np.cos(2 * phi))
            + 0.05
        )

    write_merl(tmp_path / "lobe.binary", lobe)
    assert (tmp_path / "lobe.binary").stat().st_size > 33e6
    model = brdf.read_merl(tmp_path / "lobe.binary")
    lights, views = upper(rng, 300), upper(rng, 300)
    keep = (lights[:, 2] > 0.2) & (views[:, 2] > 0.2)
    lights, views = lights[keep], views[keep]
    angles = [
        np.asarray(a)
        for a in _half_difference(*(Local(*jnp.asarray(a.T)) for a in (lights, views)))
    ]
    exact = lobe(*angles)[:, None] * [1.0, 0.5, 0.25] * lights[:, 2:]
    normals = np.broadcast_to(UP, lights.shape)
    found = brdf.transfer(
        model, *(jnp.asarray(a, dtype) for a in (normals, lights, views))
    )
    np.testing.assert_allclose(found, exact, rtol=2e-3)
    assert np.all(brdf.check(model).reciprocity < 1e-3)


def test_unmeasured_merl_bins_take_their_neighbours(tmp_path):
    def holes(h, d, phi):
        grid = np.broadcast_arrays(h, d, phi)
        return np.where(grid[1] > 1.0, -1.0, 0.5)

    write_merl(tmp_path / "holes.binary", holes, (6, 8, 10))
    table = np.asarray(
        brdf.read_merl(tmp_path / "holes.binary").parts[0].parameters["table"]
    )
    np.testing.assert_allclose(table[..., 0], 0.5, rtol=1e-5)


def test_files_of_the_wrong_form_are_refused_by_name(tmp_path):
    short = tmp_path / "short.binary"
    short.write_bytes(b"\x5a\0\0\0\x5a\0\0\0\xb4\0\0\0abc")
    text = tmp_path / "text.brdf"
    text.write_text("31\n400 410\n")
    rows = tmp_path / "rows.brdf"
    rows.write_text("1\n500\n0.1 0.2 0.3\n")
    empty = tmp_path / "empty.binary"
    empty.write_bytes(b"")
    for path, read in (
        (short, brdf.read_merl),
        (empty, brdf.read_merl),
        (text, brdf.read_cornell),
        (rows, brdf.read_cornell),
    ):
        with pytest.raises(ValueError, match=path.name):
            read(path)
    with pytest.raises(OSError, match="gone"):
        brdf.read_merl(tmp_path / "gone.binary")


def test_measured_files(data):
    krylon, wavelengths = brdf.read_cornell(data / "brdf" / "krylon_blue.brdf")
    assert krylon.channels == 31
    assert wavelengths[[0, -1]].tolist() == [400, 700]
    blue, red = (int(np.argmin(np.abs(wavelengths - nm))) for nm in (460, 620))
    albedo = brdf.check(krylon).albedo[2]
    assert albedo[blue] > 2 * albedo[red]
    folder = data / "brdf" / "curet"
    felt = brdf.read_curet(folder / "abrdf.dat", folder / "table.txt", 1)
    assert 0.05 < brdf.check(felt).albedo[0, 0] < 1
    with pytest.raises(ValueError, match="sample 99"):
        brdf.read_curet(folder / "abrdf.dat", folder / "table.txt", 99)
    materials = json.loads((data / "brdf" / "cornell_lafortune.json").read_text())[
        "materials"
    ]
    for material in materials.values():
        lobes = {
            k: np.array([lobe[k] for lobe in material["lobes"]])
            for k in ("cxy", "cz", "n")
        }
        model = brdf.lafortune(
            lobes["cxy"], lobes["cz"], lobes["n"], np.array(material["diffuse"])
        )
        assert model.channels == 3
        assert np.all(brdf.check(model).reciprocity < 1e-3)


PARAMETERS = {
    "lambertian": (brdf.lambertian, (0.6,)),
    "phong": (brdf.phong, (14.0,)),
    "phong near 0": (brdf.phong, (0.02,)),
    "phong, 300": (brdf.phong, (300.0,)),
    "phong with horizon": (lambda s: brdf.phong(s, horizon=True), (6.0,)),
    "phong with cosine": (brdf.phong_cosine, (25.0,)),
    "microfacet": (brdf.gaussian_microfacet, (0.3,)),
    "microfacet, 0.02": (brdf.gaussian_microfacet, (0.02,)),
    "ggx": (brdf.ggx, (0.25, 0.3)),
    "ggx, alpha near 0": (brdf.ggx, (0.02, 0.9)),
    "ggx, alpha near 1": (brdf.ggx, (0.98, 0.02)),
    "ggx, all scattering": (lambda a, f: brdf.ggx(a, f, multiscatter=True), (0.5, 0.7)),
    "lafortune": (
        lambda a, b, n, d: brdf.lafortune(a, b, n, d),
        (np.array([-1.0]), np.array([0.9]), np.array([12.0]), 0.3),
    ),
    "kajiya-kay": (brdf.kajiya_kay, (20.0,)),
}


@pytest.mark.x64
@pytest.mark.parametrize("name", PARAMETERS)
@pytest.mark.parametrize("where", ["off the peak", "n = h", "grazing"])
def test_gradients(name, where):
    """In every parameter and in light and view, as points off the sphere too."""
    make, parameters = PARAMETERS[name]
    light = spherical_directions(np.array(0.5), np.array(0.2))
    view = spherical_directions(np.array(0.55), np.array(3.2))
    if where == "n = h":
        view = light * [-1, -1, 1]
    if where == "grazing":
        light, view = (
            spherical_directions(np.array(t), np.array(p))
            for t, p in ((1.5, 0.1), (1.54, 3.0))
        )

    def out(arguments, towards, seen):
        towards, seen = (shjax.vectors.normalize(a) for a in (towards, seen))
        tangent = jnp.asarray(spherical_directions(np.array(0.7), np.array(0.4)))
        return (
            brdf.transfer(
                make(*arguments),
                jnp.asarray(UP)[None],
                towards[None],
                seen[None],
                tangent[None],
            )
            + 0.1 * towards[0]
        )

    start = tuple(jnp.asarray(p, jnp.float64) for p in parameters)
    # The central difference itself errs as the third derivative, large in a narrow lobe.
    narrow = any(word in name for word in ("near 0", "300", "0.02"))
    check_gradients(
        out,
        start,
        jnp.asarray(light),
        jnp.asarray(view),
        tolerance=1e-4 if narrow else 1e-6,
    )


def test_parameters_jit_and_batch(dtype):
    exponents = jnp.asarray([4.0, 8.0, 16.0], dtype)
    lights = jnp.asarray(upper(np.random.default_rng(0), 5), dtype)
    normals = jnp.broadcast_to(jnp.asarray(UP, dtype), lights.shape)

    def total(s):
        return jnp.sum(brdf.transfer(brdf.phong(s), normals, lights, lights))

    batch = jax.jit(jax.vmap(total))(exponents)
    np.testing.assert_allclose(batch, [total(s) for s in exponents], rtol=1e-5)


@pytest.mark.usefixtures("as_a_user")
@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: brdf.lambertian(1.2), r"albedo must lie in \[0, 1\]; got 1.2"),
        (lambda: brdf.phong(-1.0), "exponent"),
        (lambda: brdf.phong(float("nan")), "exponent"),
        (lambda: brdf.ggx(0.0), r"alpha must lie in \(0, 1\]"),
        (lambda: brdf.ggx(0.3, 2.0), "f0"),
        (lambda: brdf.gaussian_microfacet(0.0), "sigma"),
        (lambda: brdf.ggx(np.ones(2) / 2, np.ones(3) / 2), "number of channels"),
        (lambda: brdf.phong("shiny"), "exponent must be a number"),
        (lambda: brdf.lafortune([1.0], [1.0, 2.0], [3.0]), "cxy, cz and exponent"),
        (lambda: brdf.lambertian(np.ones(3)) + brdf.phong(np.ones(2)), "same number"),
        (lambda: brdf.lambertian(0.5) * np.ones((2, 2)), "scaled by a number"),
        (lambda: brdf.from_table(np.ones((2, 2, 2))), "table must have shape"),
        (
            lambda: brdf.from_table(np.full((2, 2, 2, 1), np.nan)),
            "table must be finite",
        ),
        (
            lambda: brdf.from_table(np.ones((2, 2, 2, 1)), phi=np.array([1.0, 0.5])),
            "phi must hold 2 rising",
        ),
        (
            lambda: brdf.from_table(
                np.ones((2, 2, 2, 1)), theta_i=np.array([0.0, 2.0])
            ),
            "theta_i must lie",
        ),
        (
            lambda: brdf.from_samples(
                np.ones((3, 3)), np.ones((2, 3)), np.ones((3, 1))
            ),
            "lights, views and values",
        ),
        (
            lambda: brdf.from_samples(
                -np.ones((3, 3)), np.ones((3, 3)), np.ones((3, 1))
            ),
            "above the surface",
        ),
        (
            lambda: brdf.from_samples(
                np.ones((3, 3)), np.ones((3, 3)), np.ones((3, 1)), order=40
            ),
            "order",
        ),
        (
            lambda: brdf.transfer(
                brdf.kajiya_kay(3.0), np.ones((1, 3)), np.ones((1, 3)), np.ones((1, 3))
            ),
            "tangents must be given",
        ),
        (
            lambda: brdf.transfer(
                brdf.phong(3.0), np.ones((1, 3)), np.ones((2, 3)), np.ones((1, 3))
            ),
            "lights must have the shape",
        ),
    ],
)
def test_wrong_arguments_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()
