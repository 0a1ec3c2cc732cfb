"""Where the pixels of an environment image lie on the sphere, for each layout.

A layout knows the direction and the exact solid angle of every pixel (zero for pixels
that are not part of the map), and where in the image a direction falls. A new layout is a
new entry in :data:`LAYOUTS`; images are carried from one to another by
:func:`shjax.layouts.resampling.resample`.

Every layout but the octahedral one (which has the zenith at its middle) is read so that
the image's centre, or the middle of its front face, looks along +x, its right side along
-y and its top along +z: the same world as the lat-long panorama.
"""

from __future__ import annotations

from shjax.layouts import cubes, discs, latlong, octahedral
from shjax.layouts.layout import Layout as Layout

LAYOUTS = {
    "latlong": latlong.LATLONG,
    "angular": discs.ANGULAR,
    "mirror_ball": discs.MIRROR_BALL,
    "vertical_cross": cubes.VERTICAL_CROSS,
    "horizontal_cross": cubes.HORIZONTAL_CROSS,
    "vertical_strip": cubes.VERTICAL_STRIP,
    "horizontal_strip": cubes.HORIZONTAL_STRIP,
    "octahedral": octahedral.OCTAHEDRAL,
    "dual_paraboloid": discs.DUAL_PARABOLOID,
    "openexr_latlong": latlong.OPENEXR_LATLONG,
    "openexr_cube": cubes.OPENEXR_CUBE,
}


def guess_layout(height: int, width: int) -> str:
    """Guess the layout of an environment image from its aspect.

    Raises:
        ValueError: If no layout has it.

    >>> guess_layout(512, 1024)
    'latlong'
    """
    first: dict[tuple[int, int], str] = {}
    for name, layout in LAYOUTS.items():
        first.setdefault(layout.aspect, name)
    for name in first.values():
        if LAYOUTS[name].fits(height, width):
            return name
    known = ", ".join(f"{name} {w}:{h}" for (w, h), name in first.items())
    raise ValueError(
        f"layout cannot be told from {width} x {height} pixels ({known}); name it."
    )
