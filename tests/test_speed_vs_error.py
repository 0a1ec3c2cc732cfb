"""The report in a quick mode: what is known of its numbers, and that it goes on."""

import json

import click
import jax.numpy as jnp
import numpy as np
import pytest

import shjax
from experiments import speed_vs_error
from experiments.speed import measure, methods, report, results, scenes
from shjax.reference import irradiance_error
from shjax.reference.random_orientations import draw_orientations

FEWEST = methods.Steps(
    radial=(16, 32), views=(1, 2), errors=(0.1,), maps=(), samples=(16,), l_max=64
)


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    """One panorama, one material, few methods; the report written."""
    out = tmp_path_factory.mktemp("report")
    told = []
    options = {
        "panoramas": ("city",),
        "materials": ("microfacet 0.3",),
        "rows": 64,
        "pairs": 512,
        "rounds": 1,
        "steps": FEWEST,
        "memory": False,
        "full_size": False,
    }
    result = speed_vs_error.run(out, **options, progress=told.append)
    report.write(out, result)
    again = speed_vs_error.run(out, **options, progress=told.append)
    return out, result, again, told


@pytest.mark.slow
def test_irradiance_errors_are_those_of_the_mathematics(quick):
    # Nine coefficients on city: .97 % in the mean and 2.8 % at most of the total radiance.
    _, result, _, _ = quick
    rows = result["irradiance"]["city"]["methods"]
    assert rows["degree 0"]["rms"] > rows["degree 1"]["rms"] > rows["degree 2"]["rms"]
    assert rows["degree 2"]["rms"] > rows["degree 4"]["rms"] > rows["degree 8"]["rms"]
    where = scenes.scene("city", rows=64, pairs=64)
    found = irradiance_error(where.envmap.lighting(l_max=2), where.envmap)
    assert float(found["mean"]) == pytest.approx(0.0097, abs=2e-4)
    assert float(found["max"]) == pytest.approx(0.028, abs=2.5e-3)
    assert rows["brute force"]["rms"] < 1e-6


@pytest.mark.slow
def test_predicted_is_measured(quick):
    _, result, _, _ = quick
    entry = result["glossy"]["city"]["microfacet 0.3"]
    for name, row in entry["methods"].items():
        if row["family"] in ("SHRM", "radial maps", "choose_model"):
            assert row["rms"] == pytest.approx(row["predicted"], rel=0.15), name


@pytest.mark.slow
def test_two_jobs_measure_every_material_once(tmp_path):
    steps = methods.Steps(
        radial=(8,), views=(), errors=(), maps=(), samples=(), l_max=16
    )
    told = []
    options = {
        "panoramas": ("city",),
        "materials": ("Phong 8", "Phong 32"),
        "rows": 32,
        "pairs": 64,
        "rounds": 1,
        "steps": steps,
        "jobs": 2,
        "memory": False,
        "full_size": False,
        "progress": told.append,
    }
    found = speed_vs_error.run(tmp_path, **options)["glossy"]["city"]
    assert sorted(told) == ["Phong 32: city", "Phong 8: city", "city, irradiance"]
    errors = [found[f"Phong {s}"]["methods"]["radial map F=8"]["rms"] for s in (8, 32)]
    assert errors[0] < errors[1]  # the narrower lobe needs more degrees
    speed_vs_error.run(tmp_path, **options)
    assert len(told) == 3


def test_one_process_measures_other_numbers_of_orientations():
    white = methods.Method(
        "white",
        "none",
        lambda: jnp.ones((1, 3), jnp.float32),
        lambda built, n, _: built + 0 * n,
    )
    measuring = measure.Measure(1)
    for pairs in (16, 8):
        where = scenes.scene("city", rows=8, pairs=pairs)
        weights = where.samples.weights
        row = measuring(white, where, np.ones((pairs, 3)), weights=weights)
        assert row["points"] == pairs
        assert row["rms"] == 0


CONVERGED = {
    "radial maps": 2e-3,
    "SHRM": 2e-3,
    "choose_model": 0.02,
    "low-rank maps": 0.02,
    "Kautz-McCool": 0.02,
    "Cabral": 0.02,
    "uniform sampling": 0.1,
    "importance sampling": 0.03,
    "filtered importance sampling": 0.03,
}


@pytest.mark.slow
def test_every_method_converges_to_the_one_reference(tmp_path, rng):
    # Light of degree 4 and a lobe about R: nothing but sampling and tables is left.
    l = np.repeat(np.arange(5), 2 * np.arange(5) + 1)
    coefs = 0.3 * rng.normal(size=(25, 3)) / (1 + l[:, None])
    coefs[0] = 4.0
    light = shjax.synthesize(jnp.asarray(coefs, jnp.float32), n_theta=64, n_phi=128)
    samples = draw_orientations(256, seed=2)
    places = (jnp.asarray(a, jnp.float32) for a in (samples.normals, samples.views))
    where = scenes.Scene("smooth", shjax.make_envmap(light), light, samples, *places)
    material = next(m for m in scenes.materials() if m.name == "Phong 8")
    steps = methods.Steps(
        radial=(8,), views=(2,), errors=(0.01,), maps=(21,), samples=(1024,), l_max=16
    )
    prepared = methods.Prepared(material, tmp_path, steps)
    exact, own = scenes.glossy_reference(where, material, tmp_path)
    measuring, found = measure.Measure(1), {}
    for method in methods.glossy_methods(where, prepared):
        row = measuring(method, where, exact, weights=samples.weights)
        found[method.family] = row["rms"]
        assert row["rms"] < CONVERGED[method.family], method.name
    assert found.keys() == CONVERGED.keys()
    assert own < 1e-3
    assert min(rms for name, rms in found.items() if "sampling" in name) > own


@pytest.mark.slow
def test_every_method_has_all_numbers(quick):
    _, result, _, _ = quick
    for _, _, entry in results.entries(result):
        assert entry["reference's own error"] < 0.01
        for name, row in entry["methods"].items():
            for key in (
                "build seconds",
                "seconds",
                "rms",
                "mean",
                "max",
                "compile seconds",
                "compiled bytes",
                "stored bytes",
            ):
                assert np.isfinite(row[key]), (name, key)
            assert row["mean"] <= row["rms"] * 1.0001 <= row["max"] * 2, name
            assert row["most negative"] <= 0


@pytest.mark.slow
def test_it_goes_on_where_it_stopped(quick):
    out, _, again, told = quick
    assert again == json.loads((out / "results.json").read_text())
    assert len(told) == 2  # nothing was measured twice
    with pytest.raises(click.UsageError, match="out must be a new folder"):
        speed_vs_error.run(out, panoramas=("city",))


@pytest.mark.slow
def test_the_report_is_readable(quick):
    out, _, _, _ = quick
    text = (out / "report.md").read_text()
    for words in (
        "# Speed against error",
        "own error of the reference",
        "choose_model",
        "| city |",
    ):
        assert words in text
    page = (out / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 2
    assert 'src="http' not in page
    assert (out / "microfacet_0_3.png").stat().st_size > 5000


def test_fronts_and_the_cheapest():
    rows = {
        "a": {"seconds": 1, "rms": 0.1, "build seconds": 9},
        "b": {"seconds": 2, "rms": 0.2, "build seconds": 0},
        "c": {"seconds": 3, "rms": 0.05, "build seconds": 0},
    }
    assert results.front(rows) == ["a", "c"]
    assert results.cheapest(rows, 0.1) == "a"
    assert results.cheapest(rows, 0.1, whole=True) == "c"
    assert results.cheapest(rows, 0.01) is None
