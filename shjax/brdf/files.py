"""Files of measured reflectance: MERL's binary, Cornell's text, CUReT's tables.

References:
    [M03] W. Matusik et al., A Data-Driven Reflectance Model, SIGGRAPH 2003: MERL.
"""

from __future__ import annotations

import os
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from shjax.brdf.core import Brdf, make_brdf
from shjax.brdf.measured import MERL
from shjax.brdf.zernike import from_samples
from shjax.sphere import spherical_directions

_MERL_SCALE = np.array([1 / 1500, 1.15 / 1500, 1.66 / 1500])
_MERL_LIMIT = 2**24  # bins: ten times the format's 90 x 90 x 180


def read_merl(path: str | os.PathLike) -> Brdf:
    """Read a measured BRDF of the MERL database [M03].

    The stored angles are theta_h (by its square root), theta_d and phi_d; read
    trilinearly, times the cosine. Bins that were not measured hold -1 in the file; they
    take the value of the nearest measured bin along theta_d, or 0.

    Raises:
        OSError: If the file cannot be opened.
        ValueError: If it is not of this format; the message names the file.
    """
    path = Path(path)
    with path.open("rb") as file:
        sizes = np.fromfile(file, "<i4", 3)
        if sizes.size != 3 or np.any(sizes <= 0):
            raise ValueError(f"{path}: no MERL file, its header gives sizes {sizes}.")
        count = int(np.prod(sizes.astype(np.int64)))
        length = path.stat().st_size
        if count > _MERL_LIMIT or length != 12 + 24 * count:
            raise ValueError(
                f"{path}: no MERL file, {length} bytes for {' x '.join(map(str, sizes))} "
                f"bins where {12 + 24 * count} are needed."
            )
        values = np.fromfile(file, "<f8", 3 * count)
    table = values.reshape(3, *sizes) * _MERL_SCALE[:, None, None, None]
    if not np.all(np.isfinite(table)):
        raise ValueError(f"{path}: holds values that are not finite.")
    return make_brdf(MERL, table=jnp.asarray(_fill(np.moveaxis(table, 0, -1))))


def _fill(table: np.ndarray) -> np.ndarray:
    """Replace negative bins by the nearest measured one along theta_d, else by 0."""
    measured = np.all(table >= 0, axis=-1)
    place = np.arange(table.shape[1])[None, :, None]
    nearest = np.where(measured, place, -1)
    below = np.maximum.accumulate(nearest, axis=1)
    beyond = table.shape[1] * 2
    above = np.where(measured, place, beyond)
    above = np.minimum.accumulate(above[:, ::-1], axis=1)[:, ::-1]
    use_below = (below >= 0) & (place - below <= above - place)
    source = np.where(use_below, below, np.where(above < beyond, above, below))
    filled = np.take_along_axis(table, np.maximum(source, 0)[..., None], axis=1)
    return np.where((source >= 0)[..., None], filled, 0)


def _numbers(path: Path, rows: list[str], columns: int) -> np.ndarray:
    try:
        table = np.array([[float(word) for word in row.split()] for row in rows])
    except ValueError as error:
        raise ValueError(f"{path}: holds a row of the wrong form ({error}).") from None
    if table.ndim != 2 or table.shape[1] != columns or not np.all(np.isfinite(table)):
        raise ValueError(f"{path}: must hold rows of {columns} finite numbers.")
    return table


def read_cornell(
    path: str | os.PathLike, *, order: int = 8, ridge: float = 0.01
) -> tuple[Brdf, np.ndarray]:
    """Read measured reflectance in Cornell's text format, by :func:`from_samples`.

    Args:
        path: Text: a count of wavelengths, the wavelengths, then rows of theta_i, phi_i,
            theta_o, phi_o and one value a wavelength; lines of ``#`` are comments.
        order: As in :func:`from_samples`.
        ridge: As in :func:`from_samples`.

    Returns:
        The BRDF, one channel a wavelength, and the wavelengths in nm.

    Raises:
        OSError: If the file cannot be opened.
        ValueError: If it is not of this format; the message names the file.
    """
    path = Path(path)
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    lines = [line for line in lines if line.strip() and not line.startswith("#")]
    try:
        count = int(lines[0])
        first, wavelengths = 1, []
        while len(wavelengths) < count:
            wavelengths += [float(word) for word in lines[first].split()]
            first += 1
    except (IndexError, ValueError) as error:
        raise ValueError(f"{path}: no Cornell BRDF file ({error}).") from None
    rows = _numbers(path, lines[first:], 4 + count)
    lights = spherical_directions(rows[:, 0], rows[:, 1])
    views = spherical_directions(rows[:, 2], rows[:, 3])
    brdf = from_samples(lights, views, rows[:, 4:], order=order, ridge=ridge)
    return brdf, np.array(wavelengths)


def read_curet(
    values: str | os.PathLike,
    directions: str | os.PathLike,
    sample: int,
    *,
    order: int = 8,
    ridge: float = 0.01,
) -> Brdf:
    """Read one sample of the CUReT database, completed by :func:`from_samples`.

    Args:
        values: Its BRDF file, rows of a sample's number and 205 values; the three columns
            of colour that may follow are not used, nor are rows without values.
        directions: Its table of theta_v, phi_v, theta_i, phi_i after a number.
        sample: Number of the sample, from 1.
        order: As in :func:`from_samples`.
        ridge: As in :func:`from_samples`.

    Raises:
        OSError: If a file cannot be opened.
        ValueError: If a file is not of this format or lacks the sample.
    """
    values, directions = Path(values), Path(directions)
    angles = _numbers(directions, directions.read_text().splitlines(), 5)
    rows = {
        int(float(words[0])): words[1:]
        for words in (line.split() for line in values.read_text().splitlines())
        if len(words) > len(angles)
    }
    if sample not in rows:
        raise ValueError(f"{values}: has no sample {sample:g}.")
    row = _numbers(values, [" ".join(rows[sample][: len(angles)])], len(angles))
    return from_samples(
        spherical_directions(angles[:, 3], angles[:, 4]),
        spherical_directions(angles[:, 1], angles[:, 2]),
        row.T,
        order=order,
        ridge=ridge,
    )
