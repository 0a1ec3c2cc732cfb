"""Real panoramas from end to end: the numbers that are known of them."""

import pytest

import shjax
from shjax.reference import irradiance_error

# Mean and largest error of the irradiance from nine numbers, % of the total radiance.
KNOWN = {
    "city.exr": (0.97, 2.8),
    "courtyard.exr": (0.87, 2.4),
    "forest.exr": (0.65, 2.2),
    "interior.exr": (0.72, 3.2),
    "night.exr": (0.78, 4.3),
    "sunset.exr": (0.27, 0.89),
    "potsdamer_platz_1k.hdr": (0.24, 0.66),
    "sunrise.exr": (2.08, 6.1),
    "rooitou_park_1k.hdr": (2.21, 6.7),
    "studio.exr": (1.70, 5.9),
    "studio_small_03_1k.hdr": (2.02, 6.9),
}
RINGING = {"sunrise.exr": -0.023, "studio_small_03_1k.hdr": -0.021}


@pytest.mark.parametrize("name", KNOWN)
def test_irradiance_error_of_the_panoramas(data, name):
    envmap = shjax.io.read_envmap(data / "hdri" / name)
    error = irradiance_error(envmap.lighting(l_max=2), envmap)
    mean, largest = KNOWN[name]
    assert round(100 * float(error["mean"]), 2) == mean
    assert 100 * float(error["max"]) == pytest.approx(largest, abs=0.4)
    if name in RINGING:
        assert float(error["ringing"]) == pytest.approx(RINGING[name], abs=5e-4)
    else:
        assert float(error["ringing"]) > 0
