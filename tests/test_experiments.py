"""Each experiment's claim, asserted on the run itself."""

import mpmath
import numpy as np
import pytest

from experiments import stability, table_4_1
from experiments.benchmarks import nine_coefficients


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
        (0, 1): (u, one, v), (1, 0): (-one, -v, u), (1, 1): (u, -v, one),
        (1, 2): (one, -v, -u), (2, 1): (u, -one, -v), (3, 1): (u, v, -one),
    }  # fmt: skip
    total = 0.0
    for (row, column), (x, y, z) in faces.items():
        tile = green[row * n : (row + 1) * n, column * n : (column + 1) * n]
        squared = x * x + y * y + z * z
        solid_angle = (2 / n) ** 2 / squared**1.5
        total += np.sum(tile * 0.546274 * (x * x - y * y) / squared * solid_angle)
    assert abs(0.1 * total + 0.0322) < 1e-4


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
