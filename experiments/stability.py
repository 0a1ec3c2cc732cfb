"""Digits kept on hard cases, in float32 and float64, against 50-digit arithmetic.

    python experiments/stability.py --out experiments/results

Needs mpmath. Peers (scipy, jax.scipy, sphericart, ducc0) are measured where installed.
Errors are absolute over the largest value of the degree; "input" is what rounding the
direction itself to float32 costs any method, l^2 / 2 x 6e-8: printed, not charged, since
every method is compared at the rounded direction.
"""

from __future__ import annotations

import sys
from pathlib import Path

import click
import jax
import jax.numpy as jnp
import mpmath as mp
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import shjax
from experiments.versions import versions, versions_line
from experiments.writing import markdown_table, write_result
from shjax.harmonics import tables
from shjax.harmonics.grid import make_grid

DEGREES = (8, 30, 128, 512, 1024)
DIRECTIONS = {
    "pole": (0.0, 0.0, 1.0),
    "1e-6 from it": (6e-7, 8e-7, 1.0),
    "1e-3 from it": (6e-4, 8e-4, 1.0),
    "south, 0.1": (-0.06, 0.08, -0.995),
    "45 degrees": (0.5, 0.5, 0.7071),
    "equator": (0.6, 0.8, 0.0),
}
ANGLES = {
    "0": 0.0,
    "1e-6": 1e-6,
    "pi/2": np.pi / 2,
    "pi - 1e-6": np.pi - 1e-6,
    "pi": np.pi,
}


def exact_basis(point: np.ndarray, l: int, chosen: np.ndarray) -> np.ndarray:
    """``Y_lm`` at a direction as given, for some m, by the recurrence in 50 digits."""
    x, y, z = (mp.mpf(float(v)) for v in point)
    values = []
    for m in np.abs(chosen):
        m = int(m)
        value = mp.sqrt(mp.fprod(mp.mpf(2 * k + 1) / (2 * k) for k in range(1, m + 1)))
        value, last = value / mp.sqrt(4 * mp.pi), mp.mpf(0)
        for k in range(m + 1, l + 1):
            scale = mp.sqrt(mp.mpf(4 * k * k - 1) / (k * k - m * m))
            lag = mp.sqrt(mp.mpf((k - 1) ** 2 - m * m) / (4 * (k - 1) ** 2 - 1))
            last, value = value, scale * (z * value - lag * last)
        cosine, sine = mp.mpf(1), mp.mpf(0)
        for _ in range(m):
            cosine, sine = x * cosine - y * sine, x * sine + y * cosine
        values.append((value * cosine, value * sine, m))
    signs = zip(values, chosen, strict=True)
    return np.array(
        [
            float((s if m < 0 else c) * (mp.sqrt(2) if a else 1))
            for (c, s, a), m in signs
        ]
    )


def basis_errors(
    count: int, degrees: tuple[int, ...] = DEGREES, seed: int = 0
) -> list[dict]:
    """Errors of one degree's functions and of their row norm, for each direction."""
    rng = np.random.default_rng(seed)
    rows = []
    for l in degrees:
        drawn = rng.integers(-l, l + 1, min(count, 2 * l + 1))
        chosen = np.unique([-2, -1, 0, 1, 2, *drawn])  # what is not zero at a pole
        for name, direction in DIRECTIONS.items():
            unit = np.array(direction) / np.linalg.norm(direction)
            row: dict = {"degree": l, "where": name, "input": l * l / 2 * 6e-8}
            for kind in (np.float32, np.float64):
                point = unit.astype(kind)
                exact = exact_basis(point, l, chosen)
                values = _degree(shjax.basis(point, l_max=l), l)
                largest = max(np.abs(exact).max(), 1e-30)
                found = values[chosen + l]
                row[kind.__name__] = float(np.abs(found - exact).max() / largest)
                norm = np.sum(values**2) / ((2 * l + 1) / (4 * np.pi))
                row[f"{kind.__name__} row norm"] = float(abs(norm - 1))
                for peer, function in _basis_peers(l, kind).items():
                    theirs = _degree(function(point), l)[chosen + l]
                    row[peer] = float(np.abs(theirs - exact).max() / largest)
            rows.append(row)
            print(_line(row), file=sys.stderr)
    return rows


def _degree(values, l: int) -> np.ndarray:
    return np.asarray(values, np.float64)[l * l : (l + 1) ** 2]


def _basis_peers(l: int, kind) -> dict:
    """Peers that evaluate single directions in this type to this degree."""
    from scipy.special import sph_harm_y

    def scipy_basis(point):
        x, y, z = np.asarray(point, np.float64)
        theta, phi = np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)
        m = np.arange(-l, l + 1)
        value = sph_harm_y(l, np.abs(m), theta, phi) * (-1.0) ** np.abs(m)
        real = np.where(m < 0, value.imag, value.real) * np.where(m, np.sqrt(2), 1)
        return np.concatenate([np.zeros(l * l), real])

    peers = {"scipy float64": scipy_basis} if kind == np.float64 else {}
    try:
        import sphericart.jax  # pyright: ignore[reportMissingImports]
    except ImportError:
        return peers
    if l <= 128:

        def theirs(point):
            values = np.asarray(sphericart.jax.spherical_harmonics(point[None], l))[0]
            signs = np.concatenate(
                [(-1.0) ** np.arange(-k, k + 1) for k in range(l + 1)]
            )
            same = np.sign(values[3]) == np.sign(np.asarray(point)[0])
            return values * (1.0 if same or values[3] == 0 else signs)

        peers[f"sphericart {kind.__name__}"] = theirs
    return peers


def exact_wigner_d(l: int, angle: float, pairs: np.ndarray) -> np.ndarray:
    """Entries of the real-basis matrix by Jacobi polynomials in 50 digits."""
    beta = mp.mpf(angle)

    def d(m: int, q: int):
        # To the region m >= |q| by symmetry; then one Jacobi polynomial [Edmonds].
        sign = 1
        if abs(q) > abs(m):
            m, q, sign = q, m, sign * (-1) ** ((m - q) % 2)
        if m < 0:
            m, q, sign = -m, -q, sign * (-1) ** ((m - q) % 2)
        a, b, k = m - q, m + q, l - m
        last, value = mp.mpf(0), mp.mpf(1)
        x = mp.cos(beta)
        for n in range(1, k + 1):
            s = 2 * n + a + b
            if n == 1:
                step = (a + 1) + (a + b + 2) * (x - 1) / 2
            else:
                step = (s - 1) * (s * (s - 2) * x + a * a - b * b) * value
                step -= 2 * (n + a - 1) * (n + b - 1) * s * last
                step /= 2 * n * (n + a + b) * (s - 2)
            last, value = value, step
        norm = mp.sqrt(
            mp.factorial(l + m)
            * mp.factorial(l - m)
            / (mp.factorial(l + q) * mp.factorial(l - q))
        )
        power = mp.sin(beta / 2) ** a * mp.cos(beta / 2) ** b
        return sign * (-1) ** (a % 2) * norm * power * value

    values = []
    for m, q in pairs:
        m, q = int(m), int(q)
        if (m < 0) != (q < 0):
            values.append(0.0)
            continue
        m, q, side = abs(m), abs(q), (-1 if m < 0 else 1)
        entry = d(m, q) if not m or not q else d(m, q) + side * (-1) ** q * d(m, -q)
        entry *= mp.sqrt(2) if bool(m) != bool(q) else 1
        values.append(float((-1) ** (m + q) * entry))
    return np.array(values)


def wigner_errors(
    count: int, degrees: tuple[int, ...] = (2, 30, 128, 1024), seed: int = 1
) -> list[dict]:
    """Errors of seeded entries, and of the rows' norms, for each angle."""
    rng = np.random.default_rng(seed)
    rows = []
    for l in degrees:
        pairs = rng.integers(-l, l + 1, (count, 2))
        pairs[:, 1] = np.where(
            (pairs[:, 0] < 0) != (pairs[:, 1] < 0), -pairs[:, 1], pairs[:, 1]
        )
        for name, angle in ANGLES.items():
            row: dict = {"degree": l, "where": f"angle {name}"}
            for kind in (np.float32, np.float64):
                given = kind(angle)
                matrix = np.asarray(shjax.wigner_d(l, given), np.float64)
                exact = exact_wigner_d(l, float(given), pairs)
                found = matrix[pairs[:, 0] + l, pairs[:, 1] + l]
                row[kind.__name__] = float(np.abs(found - exact).max())
                norms = np.sum(matrix**2, axis=1)
                row[f"{kind.__name__} row norm"] = float(np.abs(norms - 1).max())
            rows.append(row)
            print(_line(row), file=sys.stderr)
    return rows


def coefficient_errors(n_theta: int = 2048, l_max: int = 30) -> list[dict]:
    """Float32 coefficients of 2^23 pixels against the same sums in float64."""
    rng = np.random.default_rng(2)
    noise = rng.random((n_theta, 2 * n_theta, 1)).astype(np.float32)
    sun = 0.5 + 0 * noise
    sun[n_theta // 3, n_theta // 2] = 5e4
    images = {"noise": noise, "sun 1e5 x the sky": sun, "constant": 1 + 0 * noise}
    grid = make_grid(n_theta, 2 * n_theta)
    rings = tables.ring_weights(grid, l_max)
    rows = []
    for name, image in images.items():
        reduced = np.einsum(
            "kh,hwc->kwc", rings, image.astype(np.float64), optimize=True
        )
        parts = []
        for part, azimuth, degree in zip(
            np.split(reduced, [l_max + 1]),
            tables.azimuth_weights(grid, l_max),
            tables.degree_tables(l_max),
            strict=True,
        ):
            waves = np.einsum("kwc,wms->mksc", part, azimuth, optimize=True)
            parts.append(np.einsum("mlk,mksc->mlsc", degree, waves))
        exact = np.concatenate(parts).reshape(-1, 1)[tables.flat_positions(l_max)]
        row: dict = {"degree": l_max, "where": f"{image.size} pixels, {name}"}
        row["float32"] = _relative(shjax.analyze(image, l_max=l_max), exact)
        wide = shjax.analyze(image.astype(np.float64), l_max=l_max)
        row["float64"] = _relative(wide, exact)
        row |= _ducc(image, l_max, exact)
        rows.append(row)
        print(_line(row), file=sys.stderr)
    return rows


def _relative(values, exact: np.ndarray) -> float:
    difference = np.asarray(values, np.float64) - exact
    return float(np.linalg.norm(difference) / np.linalg.norm(exact))


def _ducc(image: np.ndarray, l_max: int, exact: np.ndarray) -> dict:
    """ducc0's error in each degree's power, which does not depend on its phases."""
    try:
        import ducc0  # pyright: ignore[reportMissingImports]
    except ImportError:
        return {}
    alm = ducc0.sht.experimental.analysis_2d(
        map=image[None, :, :, 0], spin=0, lmax=l_max, geometry="F1"
    )[0].astype(complex)
    m = np.concatenate([np.full(l_max + 1 - k, k) for k in range(l_max + 1)])
    l = np.concatenate([np.arange(k, l_max + 1) for k in range(l_max + 1)])
    power = np.bincount(l, np.abs(alm) ** 2 * np.where(m, 2, 1))
    truth = np.asarray(shjax.power_spectrum(exact))[:, 0]
    difference = np.abs(np.sqrt(power) - np.sqrt(truth))
    return {
        "ducc0 float32 (power)": float(
            np.linalg.norm(difference) / np.linalg.norm(exact)
        )
    }


def rotation_errors(count: int = 1000, l_max: int = 30) -> list[dict]:
    """How far the power of a degree drifts in many rotations."""
    rng = np.random.default_rng(3)
    turns = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    start = rng.normal(size=((l_max + 1) ** 2, 1))
    row: dict = {"degree": l_max, "where": f"power after {count} rotations"}
    for kind in (np.float32, np.float64):
        coefs = jnp.asarray(start, kind)

        def turn(c, matrix):
            return shjax.rotate(c, matrix), None

        after = jax.jit(lambda c, t: jax.lax.scan(turn, c, t)[0])(
            coefs, jnp.asarray(turns, kind)
        )
        ratio = shjax.power_spectrum(after) / shjax.power_spectrum(coefs)
        row[kind.__name__] = float(jnp.abs(ratio - 1).max())
    print(_line(row), file=sys.stderr)
    return [row]


def _line(row: dict) -> str:
    cells = (f"{k} {v:.1e}" for k, v in row.items() if k not in ("degree", "where"))
    return f"  l = {row['degree']}, {row['where']}: {', '.join(cells)}"


def run(count: int = 500) -> dict:
    """All tables.

    Args:
        count: Orders, or pairs of orders, drawn for each degree.
    """
    mp.mp.dps = 50
    with jax.enable_x64(True):
        return {
            "versions": versions(),
            "harmonics": basis_errors(count),
            "Wigner d": wigner_errors(count),
            "coefficients": coefficient_errors(),
            "rotations": rotation_errors(),
        }


def markdown(results: dict) -> str:
    """The tables."""
    parts = ["# Digits kept on hard cases", versions_line(results["versions"])]
    for title in ("harmonics", "Wigner d", "coefficients", "rotations"):
        rows = results[title]
        names = list(dict.fromkeys(name for row in rows for name in row))
        cells = ([_shown(row.get(name, "")) for name in names] for row in rows)
        parts += [f"## {title}", markdown_table(names, cells)]
    return "\n\n".join(parts)


def _shown(cell: float | str) -> str:
    return f"{cell:.1e}" if isinstance(cell, float) else str(cell)


@click.command()
@click.option("--count", default=500, show_default=True, help="Orders drawn a degree.")
@click.option("--out", type=click.Path(path_type=Path), help="Folder for the results.")
def main(count: int, out: Path | None) -> None:
    """Print the tables; with --out also write stability.md and stability.json."""
    results = run(count)
    write_result(out, "stability", markdown(results), results)


if __name__ == "__main__":
    main()
