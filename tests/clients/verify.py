"""What the tools' numbers should be, from their frames and scales, in NumPy alone."""

import re

import numpy as np
from panorama import basis

# The tool's axes in the library's frame, and its nine harmonics in the library's.
RIGHT_HANDED = (
    [[0, 1, 0], [0, 0, 1], [1, 0, 0]],
    "+00; +10; +11; +1-1; +2-1; +21; -.5 20 +c 22; +2-2; -c 20 -.5 22",
)
LEFT_HANDED = (
    [[0, -1, 0], [0, 0, 1], [1, 0, 0]],
    "+00; +10; +11; -1-1; -2-1; +21; -.5 20 +c 22; -2-2; -c 20 -.5 22",
)
THREE = (
    [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    "+00; +10; -1-1; +11; +21; -2-1; -.5 20 -c 22; -2-2; -c 20 +.5 22",
)
FRAMES = {
    "three.js": THREE,
    "cmgen default": RIGHT_HANDED,
    "Mitsuba 3": RIGHT_HANDED,
    "cmgen --no-mirror": LEFT_HANDED,
    "Babylon.js": LEFT_HANDED,
}

NAMES = ["00", "1-1", "10", "11", "2-2", "2-1", "20", "21", "22"]
TERM = re.compile(r"([+-])(?:(c|\.5) )?(\d-?\d)")
DEGREE = np.array([0, 1, 1, 1, 2, 2, 2, 2, 2])
SIGN = np.array([1, -1, 1, -1, 1, -1, 1, -1, 1])
COSINE = np.array([np.pi, 2 * np.pi / 3, np.pi / 4])[DEGREE]
BASIS = np.sqrt([1, 3, 3, 3, 15, 15, 5 / 4, 15, 15 / 4]) / np.sqrt(4 * np.pi)
SCALES = {
    "three.js LightProbe (27 floats)": np.ones(9),
    "cmgen --sh=3": SIGN,
    "cmgen --sh=3 -i": COSINE * SIGN,
    "cmgen --sh-shader": BASIS * COSINE / np.pi,
    "Babylon SphericalHarmonics": COSINE * SIGN / np.pi,
    "Mitsuba dr.sh_eval basis": SIGN,
}


def table_matrix(frame: str) -> np.ndarray:
    """From the library's coefficients to the frame's, as the table says it."""
    matrix = np.zeros((9, 9))
    for row, terms in zip(matrix, FRAMES[frame][1].split(";"), strict=True):
        for sign, factor, name in TERM.findall(terms):
            value = {"": 1.0, "c": np.sqrt(3) / 2, ".5": 0.5}[factor]
            row[NAMES.index(name)] = -value if sign == "-" else value
    return matrix


def axes_matrix(frame: str) -> np.ndarray:
    """The same matrix from the axes: the frame's harmonics in the library's."""
    vectors = np.random.default_rng(0).normal(size=(100, 3))
    vectors /= np.linalg.norm(vectors, axis=-1, keepdims=True)
    theirs = basis(vectors @ np.array(FRAMES[frame][0], float).T)
    return np.linalg.lstsq(basis(vectors), theirs, rcond=None)[0].T


def polynomial(harmonics: np.ndarray) -> np.ndarray:
    """Babylon's SphericalPolynomial of radiance coefficients in its frame.

    It holds the cosine twice: sum of (A / pi)^2 L Y as x, y, z, xx, yy, zz, yz, zx, xy.
    """
    _, y, z, x, xy, yz, z2, zx, x2 = (
        harmonics * ((COSINE / np.pi) ** 2 * BASIS)[:, None]
    )
    constant = harmonics[0] * BASIS[0]
    xx, yy, zz = constant - z2 + x2, constant - z2 - x2, constant + 2 * z2
    return np.stack([x, y, z, xx, yy, zz, yz, zx, xy])


def expected(record: dict) -> np.ndarray:
    """The nine rows that a record should hold."""
    matrix = table_matrix(record["frame"])
    if not np.allclose(matrix, axes_matrix(record["frame"]), atol=1e-12):
        raise ValueError(f"the table and the axes of {record['frame']} disagree")
    harmonics = matrix @ np.array(record["input"])
    if record["convention"] == "Babylon SphericalPolynomial":
        return polynomial(harmonics)
    return harmonics * SCALES[record["convention"]][:, None]


def error(record: dict) -> float:
    """The largest relative error of a record over its three groups of rows.

    The groups are the degrees, or x y z, xx yy zz and yz zx xy of a polynomial.
    """
    ends = [3, 6] if record["convention"] == "Babylon SphericalPolynomial" else [1, 4]
    truth = np.split(expected(record), ends)
    found = np.split(np.array(record["output"]), ends)
    return max(
        float(np.linalg.norm(a - b) / np.linalg.norm(b))
        for a, b in zip(found, truth, strict=True)
    )
