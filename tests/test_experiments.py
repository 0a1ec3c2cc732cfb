"""Each experiment's claim, asserted on the run itself."""

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest

import shjax
import shjax.vectors
from experiments import (
    figures_5,
    lighting_layer,
    prefiltering,
    recovery,
    stability,
    table_4_1,
    table_5_4,
    table_5_5,
)
from experiments.alternatives import importance
from experiments.benchmarks import nine_coefficients, reflection_maps
from shjax import brdf
from tests.helpers import relative_error, unit_vectors


def test_table_4_1(data):
    result = table_4_1.run(data / "probes")
    differences = {
        (probe, index, channel): abs(
            result["ours"][probe][index][channel]
            - result["printed"][probe][index][channel]
        )
        for probe in result["ours"]
        for index in range(9)
        for channel in range(3)
    }
    assert len(differences) == 81
    outside = [place for place, value in differences.items() if value > 0.008]
    # One printed number is wrong by 0.03; see ERRATA in the experiment.
    assert outside == [("st peters", 8, 1)]
    assert result["corrected"]["largest_difference"] <= 0.008
    assert result["as_printed"]["rounding_to_the_printed"] >= 75


def test_the_erratum_is_the_probes_own(data):
    """L22 green of St. Peter's by a plain sum over faces, in the paper's axes."""
    import OpenEXR

    file = OpenEXR.File(str(data / "probes" / "stpeters_cross.exr"))
    green = file.channels()["RGB"].pixels[..., 1].astype(float)
    n = 256
    u, v = np.meshgrid(*2 * [(np.arange(n) + 0.5) / n * 2 - 1])
    one = np.ones_like(u)
    faces = {
        (0, 1): (u, one, v),
        (1, 0): (-one, -v, u),
        (1, 1): (u, -v, one),
        (1, 2): (one, -v, -u),
        (2, 1): (u, -one, -v),
        (3, 1): (u, v, -one),
    }
    total = 0.0
    for (row, column), (x, y, z) in faces.items():
        tile = green[row * n : (row + 1) * n, column * n : (column + 1) * n]
        squared = x * x + y * y + z * z
        solid_angle = (2 / n) ** 2 / squared**1.5
        total += np.sum(tile * 0.546274 * (x * x - y * y) / squared * solid_angle)
    assert abs(0.1 * total + 0.0322) < 1e-4


@pytest.mark.slow
@pytest.mark.x64
def test_stability_keeps_its_digits():
    mpmath.mp.dps = 50
    for row in stability.basis_errors(20, degrees=(8, 60, 300)):
        growth = max(1, row["degree"] / 30)
        assert row["float32"] < 1.5e-6 * growth, row
        assert row["float64"] < 5e-15 * max(1, row["degree"]) ** 0.75, row
    for row in stability.wigner_errors(50, degrees=(3, 40)):
        assert row["float32"] < 5e-7, row
        assert row["float64"] < 2e-14, row
    for row in stability.coefficient_errors(n_theta=128, l_max=8):
        assert row["float32"] < 3e-6, row
        assert row["float64"] < 2e-14, row
    (row,) = stability.rotation_errors(count=100, l_max=12)
    assert row["float32"] < 1e-4
    assert row["float64"] < 1e-12


def test_the_benchmark_of_nine_coefficients_runs():
    result = nine_coefficients.run(rounds=1, normals=64)
    assert result["projection_over_sum"] > 0
    assert result["integral_over_nine"] > 1


@pytest.mark.slow
def test_table_5_4_at_a_small_size():
    """Frequency is far more accurate than a lobe cut at 5 %; times are only reported."""
    result = table_5_4.run(size=32, exponents=(8,))
    row = result["rows"][0]
    assert row["error"] < 0.02
    assert 0.03 < row["angular_error"] < 0.08
    assert row["ratio"] > 0
    assert row["importance"]["error"] < 0.1
    assert "| 8 | 7 |" in table_5_4.table(result)


@pytest.mark.slow
def test_table_5_5_at_a_small_size():
    result = table_5_5.run(size=32, sigmas=(0.4,))
    row = result["rows"][0]
    assert row["error"] < 0.12
    assert row["importance"]["error"] < 0.12
    assert "| 0.4 | 5, 2 |" in table_5_5.table(result)


def test_importance_sampling_is_the_integral(dtype):
    """Unfiltered and with many samples; filtered, under constant light, with few."""
    panorama = prefiltering.light(32).astype(dtype)
    towards = jnp.asarray(unit_vectors(np.random.default_rng(0), 40), dtype)
    model = brdf.phong(12.0)

    def draw(n, v, count=4096):
        return importance.draw_phong(12.0, count, shjax.vectors.mirror(n, v))

    exact = shjax.reference_reflection(panorama, model, towards, towards)
    found = importance.reflect(
        (panorama,), model, towards, towards, draw=draw, filtered=False
    )
    assert relative_error(found, exact) < 0.02
    levels = importance.pyramid(jnp.ones((32, 32, 3), dtype))
    sigma, few = brdf.gaussian_microfacet(0.3), 256
    views = shjax.vectors.normalize(towards + 0.3)
    found = importance.reflect(
        levels,
        sigma,
        towards,
        views,
        draw=lambda n, v: importance.draw_microfacet(0.3, few, n, v),
    )
    exact = shjax.reference_reflection(
        jnp.ones((128, 256, 3), dtype), sigma, towards, views
    )
    assert relative_error(found, exact) < 0.05


@pytest.mark.slow
def test_figures_of_chapter_5(tmp_path, data):
    numbers = figures_5.run(tmp_path, size=32, samples=2)
    estimates = numbers["5.5"]
    np.testing.assert_allclose(
        estimates["predicted from the spectrum"], estimates["exact"], atol=1e-5
    )
    # Both of the thesis's estimates are conservative.
    for name in ("minimum of errors", "residual heuristic (5.19)"):
        assert np.all(np.array(estimates[name]) <= np.array(estimates["exact"]) + 1e-6)
    rms = list(numbers["5.6"]["rms"].values())
    assert rms[0] > rms[1] > rms[2]
    velvet = numbers["5.8"]["rms"]
    assert velvet["SHRM, P = 5"] < velvet["q = 0 (Kautz and McCool)"] / 2
    for case in numbers["5.9"].values():
        shrm_error, cabral_error = case.values()
        assert shrm_error < cabral_error / 2
    assert len(list(tmp_path.glob("*.png"))) == len(list(tmp_path.glob("*.json"))) == 6


def test_reflection_maps_are_timed():
    result = reflection_maps.run(rounds=1)
    assert result["bytes"]["local"]["output"] == 128 * 128 * 16 * 3 * 4
    assert (
        result["bytes"]["local"]["temporary"] <= 2 * result["bytes"]["local"]["output"]
    )
    assert "dynamic map over product" in reflection_maps.table(result)


@pytest.mark.slow
def test_the_lighting_layer_beats_split_sum_and_the_harmonics(data):
    """By the exact prediction, at three roughnesses."""
    rows = lighting_layer.all_roughnesses(3)
    for f0 in ("0.04", "1"):
        errors = {name: row[f"mean {f0}"] for name, row in rows.items()}
        assert errors["low-rank 9"] < 0.5 * errors["thesis 9"]
        assert errors["low-rank 9"] < 0.25 * errors["split-sum"]
        assert errors["low-rank 21"] < errors["low-rank 16"] < errors["low-rank 9"]
    assert rows["low-rank 9"]["worst 0.04"] < 1.1 * 7.1
    assert "low-rank 9" in lighting_layer.markdown(
        {
            "one over l squared": rows,
            "panoramas, GGX 0.2": {},
            "split, GGX 0.2, f0 0.04": {},
        }
    )


@pytest.mark.slow
def test_recovery_descends(data):
    with jax.numpy_dtype_promotion("standard"):  # optax's schedules need it
        result = recovery.run(size=12, steps=25)
    for method in ("lighting layer", "split-sum"):
        assert (
            result[method]["picture, relative"]
            < 0.5 * result["start"]["picture, relative"]
        )
    assert "split-sum" in recovery.markdown(result)


@pytest.mark.slow
@pytest.mark.x64
def test_hard_cases():
    from experiments import hard_cases

    some = [
        case
        for case in hard_cases.CASES
        if "8192" not in case.name and "roughness" not in case.name
    ]
    for row in hard_cases.run(some):
        if "degree 9 of" in row["case"]:
            assert row["result"].startswith("refused")
            continue
        assert row["result"] == "finite", row
        assert row["float32 - float64"] < 5e-6, row
        assert row.get("float64 - exact", 0) < 1e-12, row
