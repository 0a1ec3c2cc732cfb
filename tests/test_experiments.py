"""Each experiment's claim, asserted on the run itself."""

import numpy as np

from experiments import table_4_1


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
