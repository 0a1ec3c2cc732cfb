"""Where the measured data lie that the experiments and some tests read.

Nothing of it is part of the package. The folder is named by the environment variable
``SHJAX_DATA``; by default it is ``shared/data`` beside the checkout.
"""

from __future__ import annotations

import os
from pathlib import Path


def data_folder() -> Path:
    """The data folder; it may be missing."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    return Path(os.environ.get("SHJAX_DATA", beside))


PANORAMAS = [
    "city.exr",
    "courtyard.exr",
    "forest.exr",
    "interior.exr",
    "night.exr",
    "studio.exr",
    "sunrise.exr",
    "sunset.exr",
    "potsdamer_platz_1k.hdr",
    "rooitou_park_1k.hdr",
    "studio_small_03_1k.hdr",
]
