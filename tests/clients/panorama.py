"""The panorama that every tool is given: nine known coefficients and their picture.

Frame and basis: right-handed, +z up, row 0 of the picture is up, its centre looks
along +x, u = 0.25 is +y; real orthonormal spherical harmonics without the
Condon-Shortley phase, index l (l + 1) + m. Nothing here uses shjax.
"""

import argparse
from pathlib import Path

import numpy as np

# One row for each (l, m), one column for each of R, G, B.
COEFFICIENTS = np.array(
    [
        [3.00, 2.60, 2.20],  # 0,  0
        [0.37, -0.21, 0.16],  # 1, -1
        [0.52, 0.41, -0.33],  # 1,  0
        [-0.29, 0.34, 0.27],  # 1,  1
        [0.13, -0.17, 0.31],  # 2, -2
        [-0.23, 0.11, 0.19],  # 2, -1
        [0.26, -0.14, -0.09],  # 2,  0
        [0.31, 0.24, -0.15],  # 2,  1
        [-0.18, 0.28, 0.12],  # 2,  2
    ]
)


def basis(direction: np.ndarray) -> np.ndarray:
    """The nine harmonics at unit vectors (..., 3), as (..., 9)."""
    x, y, z = np.moveaxis(direction, -1, 0)
    polynomials = np.stack(
        [
            np.ones_like(x),
            y,
            z,
            x,
            x * y,
            y * z,
            3 * z * z - 1,
            x * z,
            x * x - y * y,
        ],
        axis=-1,
    )
    norms = np.sqrt([1, 3, 3, 3, 15, 15, 5 / 4, 15, 15 / 4]) / np.sqrt(4 * np.pi)
    return polynomials * norms


def directions(theta: np.ndarray, n_phi: int) -> np.ndarray:
    """Unit vectors of a lat-long grid with rows at theta, columns at pixel centres."""
    theta = np.asarray(theta)[:, None]
    phi = np.pi - 2 * np.pi * (np.arange(n_phi) + 0.5) / n_phi
    ring = np.stack([np.cos(phi), np.sin(phi), np.zeros(n_phi)], axis=-1)
    return np.sin(theta)[..., None] * ring + np.cos(theta)[..., None] * [0, 0, 1]


def picture(n_theta: int, *, corners: bool = False) -> np.ndarray:
    """The map as (n_theta, 2 n_theta, 3) float32.

    Rows are pixel centres; with corners, the first and the last row are the poles.
    """
    if corners:
        theta = np.pi * np.arange(n_theta) / (n_theta - 1)
    else:
        theta = np.pi * (np.arange(n_theta) + 0.5) / n_theta
    radiance = basis(directions(theta, 2 * n_theta)) @ COEFFICIENTS
    if radiance.min() <= 0:
        raise ValueError(f"the map is not positive: {radiance.min():.3g}")
    return radiance.astype(np.float32)


def write_exr(path: Path, image: np.ndarray) -> None:
    """Write an uncompressed 32-bit float RGB EXR file."""
    import OpenEXR

    header = {
        "compression": OpenEXR.NO_COMPRESSION,
        "type": OpenEXR.scanlineimage,
    }
    with OpenEXR.File(header, {"RGB": np.ascontiguousarray(image)}) as file:
        file.write(str(path))


def write_raw(path: Path, image: np.ndarray) -> None:
    """Write the pixels as little-endian float32, row by row, RGB interleaved."""
    path.write_bytes(np.ascontiguousarray(image, "<f4").tobytes())


def main() -> None:
    """Write the picture to a file whose extension says how: .exr or .raw."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("path", type=Path)
    parser.add_argument("--rows", type=int, default=256)
    parser.add_argument("--corners", action="store_true")
    arguments = parser.parse_args()
    image = picture(arguments.rows, corners=arguments.corners)
    writer = {".exr": write_exr, ".raw": write_raw}[arguments.path.suffix]
    writer(arguments.path, image)


if __name__ == "__main__":
    main()
