"""Energies of a material for the choice of its model, kept on disk between commands."""

from __future__ import annotations

import hashlib
import zipfile
from pathlib import Path

import jax
import numpy as np

import shjax
from shjax.brdf import Brdf
from shjax.cli.compiled import cache_folder
from shjax.io.writing import replacing
from shjax.reflection.energies import (
    Energies,
    brdf_energies,
    energies_as_arrays,
    energies_from_arrays,
)

_MOST = 200  # files; the oldest leave


def kept_energies(brdf: Brdf, *, l_max: int, p_max: int) -> Energies:
    """Energies as :func:`shjax.reflection.brdf_energies` finds them, found once.

    Args:
        brdf: The reflectance.
        l_max: Degree of the light's coefficients.
        p_max: Highest degree of the view.
    """
    folder = cache_folder()
    if folder is None:
        return brdf_energies(brdf, l_max=l_max, p_max=p_max)
    file = folder / "energies" / f"{_key(brdf, l_max, p_max)}.npz"
    try:
        with np.load(file) as stored:
            return energies_from_arrays(dict(stored), brdf)
    except (OSError, ValueError, KeyError, zipfile.BadZipFile):
        pass
    found = brdf_energies(brdf, l_max=l_max, p_max=p_max)
    try:
        with replacing(file) as temporary, open(temporary, "wb") as target:
            np.savez(target, allow_pickle=False, **energies_as_arrays(found))
        _forget_old(file.parent)
    except OSError:  # a cache that cannot be written keeps nothing
        pass
    return found


def _key(brdf: Brdf, l_max: int, p_max: int) -> str:
    """Name of all that the energies depend on: the material, the degrees, the code."""
    digest = hashlib.sha256(f"{shjax.__version__} {l_max} {p_max}".encode())
    package = Path(shjax.__file__).parent
    for room in ("brdf", "reflection", "harmonics"):
        for source in sorted((package / room).glob("*.py")):
            digest.update(f"{source.name} {source.stat().st_mtime_ns}".encode())
    for part in brdf.parts:
        model = part.model
        about = model.name, model.centre, model.horizon, sorted(part.parameters)
        digest.update(repr(about).encode())
    for leaf in jax.tree.leaves(brdf):
        values = np.asarray(leaf)
        digest.update(f"{values.shape} {values.dtype}".encode() + values.tobytes())
    return digest.hexdigest()[:32]


def _forget_old(folder: Path) -> None:
    files = sorted(folder.glob("*.npz"), key=lambda file: file.stat().st_mtime_ns)
    for file in files[:-_MOST]:
        file.unlink(missing_ok=True)
