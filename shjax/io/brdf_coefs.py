"""BRDF expansions in files: NumPy's .npz with frame, order of axes and version."""

from __future__ import annotations

import json
import os
import zipfile
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from shjax.brdf.expansion import BrdfExpansion, degrees_of_rho
from shjax.brdf.quadrature import Resolution
from shjax.io.writing import replacing

FORMAT, VERSION = "shjax.brdf-coefs", 1
_AXES = "rho[l, p, q, channel], q >= 0, equal for q and -q"
_BASIS = (
    "real orthonormal spherical harmonics without Condon-Shortley phase; light and view "
    "in the frame whose z is the centre"
)
_ARRAYS = ("rho", "degree_energy", "total_energy", "error")


def write_brdf_coefs(path: str | os.PathLike, expansion: BrdfExpansion) -> None:
    """Write a BRDF's expansion to a file, whole or not at all.

    Args:
        path: Ends in ``.npz``.
        expansion: From :func:`shjax.expand_brdf`.

    Raises:
        OSError: If it cannot be written.
        ValueError: If the name does not end in ``.npz``.
    """
    if Path(path).suffix != ".npz":
        raise ValueError(f"path must end in .npz; got {path}.")
    used = expansion.resolution
    about = {
        "format": FORMAT,
        "version": VERSION,
        "centre": expansion.centre,
        "axes": _AXES,
        "basis": _BASIS,
        "resolution": [used.light, used.phi, used.view],
    }
    arrays = {name: np.asarray(getattr(expansion, name)) for name in _ARRAYS}
    arrays["about"] = np.array(json.dumps(about))
    with replacing(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)  # pyright: ignore[reportArgumentType]


def read_brdf_coefs(path: str | os.PathLike) -> BrdfExpansion:
    """Read a BRDF's expansion that :func:`write_brdf_coefs` wrote.

    Raises:
        OSError: If the file cannot be opened.
        ValueError: If it is no such file, or of a later version; the message names it.
    """
    path = Path(path)
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            about = json.loads(str(file["about"]))
            arrays = {name: file[name] for name in _ARRAYS}
    except (KeyError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"{path}: no file of BRDF coefficients ({error}).") from None
    if about.get("format") != FORMAT or about.get("version") != VERSION:
        raise ValueError(
            f"{path}: must be {FORMAT} version {VERSION}; got {about.get('format')} "
            f"{about.get('version')}."
        )
    l_max, _ = degrees_of_rho(arrays["rho"])
    channels = arrays["rho"].shape[-1]
    if arrays["degree_energy"].shape != (l_max + 1, channels):
        raise ValueError(f"{path}: its energies do not fit its coefficients.")
    return BrdfExpansion(
        *(jnp.asarray(arrays[name]) for name in _ARRAYS),
        centre=about["centre"],
        resolution=Resolution(*about["resolution"]),
    )
