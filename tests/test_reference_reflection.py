"""The angular reference, and the predicted error against it."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import shjax
import shjax.vectors
from experiments.data import PANORAMAS
from shjax import brdf, io
from shjax.brdf.core import Local, transfer_local
from shjax.brdf.flux import lobe_angle
from shjax.harmonics.grid import Grid
from shjax.reference.random_orientations import draw_orientations, measured_error
from shjax.sphere import latlong_directions
from tests.helpers import check_gradients, relative_error, unit_vectors
from tests.test_brdf import models, write_merl


def test_reference_is_the_plain_sum(rng):
    """One point at a time, in NumPy's own frames."""
    radiance = rng.uniform(size=(9, 14, 3))
    directions = latlong_directions(9, 14).reshape(-1, 3)
    weights = np.repeat(Grid(9, 14).weights, 14)
    normals, views, tangents = (unit_vectors(rng, 70) for _ in range(3))
    for name in ("ggx", "sum", "lafortune", "kajiya-kay"):
        model = models()[name]
        found = shjax.reference_reflection(
            jnp.asarray(radiance),
            model,
            *(jnp.asarray(a) for a in (normals, views)),
            tangents=jnp.asarray(tangents),
        )
        for k in (0, 33, 69):
            axis = tangents[k] if name == "kajiya-kay" else normals[k]
            first = np.cross(axis, [0.3, -0.8, 0.5])
            first /= np.linalg.norm(first)
            frame = np.stack([first, np.cross(axis, first), axis])
            light = Local(*jnp.asarray(frame @ directions.T))
            view = Local(*(jnp.full_like(light.x, v) for v in frame @ views[k]))
            rho = np.asarray(transfer_local(model, light, view))[0]
            exact = (rho * weights) @ radiance.reshape(-1, 3)
            np.testing.assert_allclose(found[k], exact, rtol=1e-4, atol=1e-6)


def test_matte_is_the_irradiance(rng, dtype):
    radiance = jnp.asarray(rng.uniform(size=(16, 32, 3)), dtype)
    normals = jnp.asarray(unit_vectors(rng, 30), dtype)
    found = shjax.reference_reflection(radiance, brdf.lambertian(0.5), normals, normals)
    exact = 0.5 / np.pi * shjax.reference_irradiance(radiance, normals)
    np.testing.assert_allclose(found, exact, rtol=1e-4)


def test_lobe_truncation_visits_less_and_loses_what_it_says(rng):
    radiance = jnp.asarray(rng.uniform(0.5, 1.5, size=(64, 128, 2)))
    normals = unit_vectors(rng, 300)
    views = normals + 0.5 * unit_vectors(rng, 300)
    views /= np.linalg.norm(views, axis=1, keepdims=True)
    pair = (jnp.asarray(normals), jnp.asarray(views))
    model = brdf.phong(64.0)
    assert np.cos(lobe_angle(model, 0.95)) == pytest.approx(
        0.05 ** (1 / 65), abs=2e-3
    )  # [T5, 5.30]
    whole = shjax.reference_reflection(radiance, model, *pair)
    cut = shjax.reference_reflection(radiance, model, *pair, lobe_energy=0.95)
    share = float(jnp.sum(cut) / jnp.sum(whole))
    assert share == pytest.approx(0.95, abs=0.01)
    everything = shjax.reference_reflection(radiance, model, *pair, lobe_energy=1.0)
    assert relative_error(everything, whole) < 1e-4
    colour = 0.3 * brdf.ggx(0.2, np.array([0.9, 0.5]))
    cut = shjax.reference_reflection(radiance, colour, *pair, lobe_energy=0.999)
    assert (
        relative_error(cut, shjax.reference_reflection(radiance, colour, *pair)) < 0.02
    )


@pytest.mark.x64
def test_gradients(rng):
    radiance = jnp.asarray(rng.uniform(size=(6, 9, 2)))
    normals = unit_vectors(rng, 3)
    views = normals + 0.4 * unit_vectors(rng, 3)

    def out(light, alpha, n, v):
        n, v = shjax.vectors.normalize(n), shjax.vectors.normalize(v)
        return shjax.reference_reflection(light, brdf.ggx(alpha, 0.1), n, v)

    check_gradients(
        out,
        radiance,
        jnp.asarray(0.4),
        jnp.asarray(normals),
        jnp.asarray(views),
        tolerance=1e-6,
    )


def test_measured_error_knows_its_own_error(rng):
    samples = draw_orientations(4000, seed=1)
    assert np.mean(samples.weights) == pytest.approx(1, abs=0.01)
    cosine = np.sum(samples.reflected * samples.views, axis=1)
    assert np.mean(samples.weights * cosine) == pytest.approx(0, abs=0.01)
    assert np.mean(samples.weights * cosine**2) == pytest.approx(1 / 3, abs=0.01)
    exact = rng.normal(size=(4000, 3))
    noisy = exact + 0.1 * rng.normal(size=exact.shape)
    found = measured_error(noisy, exact, np.ones(4000))
    assert abs(found.rms - 0.1) < 4 * found.standard_error < 0.01
    assert measured_error(exact, exact, np.ones(4000)) == (0.0, 0.0)


ORDERS = [(2, 0), (4, 2), (8, 1), (12, 3), (24, 2), (40, 6)]
DEGREE = 64  # to which the panoramas' samples are expanded


@pytest.fixture(scope="module")
def measured_models(tmp_path_factory, data):
    """Every model of :mod:`shjax.brdf`, measured ones too."""
    path = tmp_path_factory.mktemp("merl") / "lobe.binary"
    write_merl(
        path,
        lambda h, d, phi: np.exp(-((h / 0.3) ** 2)) + 0.1 + 0 * d + 0 * phi,
        (30, 30, 60),
    )
    material = json.loads((data / "brdf" / "cornell_lafortune.json").read_text())[
        "materials"
    ]["skin"]
    lobes = [
        np.array([lobe[k] for lobe in material["lobes"]]) for k in ("cxy", "cz", "n")
    ]
    folder = data / "brdf" / "curet"
    angles = np.linspace(0, np.pi / 2, 12)
    table = (1 + np.cos(angles))[:, None, None, None] * np.ones((12, 8, 5, 1)) * 0.1
    return {
        **models(),
        "lafortune": brdf.lafortune(*lobes, np.array(material["diffuse"])),
        "table": brdf.from_table(jnp.asarray(table)),
        "curet": brdf.read_curet(folder / "abrdf.dat", folder / "table.txt", 5),
        "merl": brdf.read_merl(path),
    }


@pytest.fixture(scope="module")
def lights(data):
    """The eight CC0 panoramas at 256 x 128 and their exact coefficients."""
    found = {}
    for name in PANORAMAS[:8]:
        radiance, directions, weights = (
            io.read_envmap(data / "hdri" / name).to_latlong(128).samples()
        )
        samples = tuple(
            jnp.asarray(a, jnp.float32) for a in (radiance, directions, weights)
        )
        found[name] = (samples, shjax.project_samples(*samples, l_max=DEGREE))
    return found


def _turned_light(lighting, samples, degree, p_max):
    """Coefficients in each direction's frame, and the views there."""
    frames = shjax.vectors.frames(jnp.asarray(samples.reflected, jnp.float32))
    kept = lighting[: (degree + 1) ** 2]

    def one(frame):
        return shjax.rotate(kept, frame)

    turned = jax.lax.map(one, frames, batch_size=64)
    views = jnp.einsum("nij,nj->ni", frames, jnp.asarray(samples.views, jnp.float32))
    return turned, shjax.basis(views, l_max=p_max)


@pytest.mark.slow
@pytest.mark.parametrize("panorama", ["city.exr", "courtyard.exr", "night.exr"])
def test_predicted_error_is_the_measured_one(panorama, lights, measured_models):
    """At six (F, P): within 5 % plus three standard errors.

    Every other model on one panorama, the others on the next.
    """
    samples, lighting = lights[panorama]
    light = shjax.EnvironmentMap.from_samples(*samples)
    spectrum = shjax.power_spectrum(lighting)
    # A dielectric's rare highlights at grazing views need more samples for an honest
    # standard error.
    drawn = {n: draw_orientations(n, seed=11) for n in (2048, 16384)}
    seen = {n: _turned_light(lighting, samples, 40, 6) for n, samples in drawn.items()}
    wrong, half = [], PANORAMAS.index(panorama) % 2
    for name, model in list(measured_models.items())[half::2]:
        n = 16384 if name == "ggx" else 2048
        samples, (turned, values) = drawn[n], seen[n]
        normals, views, tangents = (
            jnp.asarray(a, jnp.float32)
            for a in (samples.normals, samples.views, samples.reflected)
        )
        exact = shjax.reference_reflection(
            light, model, normals, views, tangents=tangents
        )
        expansion = _expansion(name, model)
        for f, p in ORDERS:
            approximate = _sum(
                turned,
                values,
                expansion.rho[: f + 1, : p + 1, : p + 1].astype(jnp.float32),
            )
            found = measured_error(approximate, exact, samples.weights)
            expected = float(
                shjax.brdf.predicted_rms_error(spectrum, expansion, l_max=f, p_max=p)
            )
            if expected < 2e-3:  # float32's own rounding of an energy
                continue
            if abs(found.rms - expected) > 0.05 * expected + 3 * found.standard_error:
                wrong.append((name, f, p, expected, found))
    assert not wrong


_EXPANSIONS: dict = {}


def _expansion(name, model):
    if name not in _EXPANSIONS:
        nodes = (
            None
            if "merl" not in name and "table" not in name
            else shjax.brdf.Resolution(96, 40, 96)
        )
        _EXPANSIONS[name] = shjax.brdf.expand(
            model, l_max=DEGREE, p_max=6, accuracy=1e-3, resolution=nodes
        )
    return _EXPANSIONS[name]


@jax.jit
def _sum(turned, values, rho):
    """``sum_lpq L'_lq rho_lp|q| Y_pq`` at every sample, by the definition."""
    f, p_max = rho.shape[0] - 1, rho.shape[1] - 1
    total = 0.0
    for p in range(p_max + 1):
        for q in range(-p, p + 1):
            l = np.arange(abs(q), f + 1)
            if l.size:
                light = jnp.take(turned, l * (l + 1) + q, axis=1)  # [n, l, c]
                kernel = jnp.broadcast_to(
                    rho[abs(q) :, p, abs(q)][None], (*light.shape[:2], rho.shape[-1])
                )
                shape = (*light.shape[:2], max(light.shape[-1], rho.shape[-1]))
                product = jnp.sum(
                    jnp.broadcast_to(light, shape) * jnp.broadcast_to(kernel, shape),
                    axis=1,
                )
                total = total + product * values[:, p * (p + 1) + q, None]
    return total


@pytest.mark.usefixtures("as_a_user")
@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: shjax.reference_reflection(
                np.ones((4, 8)), brdf.phong(3.0), np.ones((1, 3)), np.ones((1, 3))
            ),
            "light must have shape",
        ),
        (
            lambda: shjax.reference_reflection(
                np.ones((4, 8, 1)), brdf.phong(3.0), np.ones((1, 3)), np.ones((2, 3))
            ),
            "views must have the shape",
        ),
        (
            lambda: shjax.reference_reflection(
                np.ones((4, 8, 2)),
                brdf.phong(np.ones(3)),
                np.ones((1, 3)),
                np.ones((1, 3)),
            ),
            "number of channels",
        ),
        (
            lambda: shjax.reference_reflection(
                np.ones((4, 8, 1)),
                brdf.kajiya_kay(3.0),
                np.ones((1, 3)),
                np.ones((1, 3)),
            ),
            "tangents must be given",
        ),
        (
            lambda: shjax.reference_reflection(
                np.ones((4, 8, 1)),
                brdf.phong(3.0),
                np.ones((1, 3)),
                np.ones((1, 3)),
                lobe_energy=0.0,
            ),
            "lobe_energy must lie",
        ),
        (
            lambda: jax.jit(
                lambda n: shjax.reference_reflection(
                    np.ones((4, 8, 1)), brdf.phong(3.0), n, n, lobe_energy=0.9
                )
            )(np.ones((1, 3))),
            "does not run in jit",
        ),
        (
            lambda: shjax.EnvironmentMap.from_samples(
                np.ones((4, 1)), np.ones((3, 3)), np.ones(4)
            ),
            r"directions must have shape \(4, 3\)",
        ),
    ],
)
def test_wrong_arguments_are_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()
