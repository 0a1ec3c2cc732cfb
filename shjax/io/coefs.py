"""Coefficients in the files of other tools, and our own.

A format is a name in :data:`FORMATS`: a writer and the convention it writes in. Reading
tells the format from the contents.
"""

from __future__ import annotations

import dataclasses
import json
import os
import re
import uuid
from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float

from shjax.conventions import convert
from shjax.harmonics.degrees import degree_of_coefs, degrees, orders
from shjax.io.writing import write_text

SCHEMA = "shjax.coefficients/1"

_COMMENTS = {  # what cmgen writes behind a coefficient's name, by its scale
    "cmgen": "",
    "cmgen irradiance": ", irradiance",
    "cmgen shader": ", irradiance, pre-scaled base",
}
_LINE = re.compile(
    r"\(\s*([^,\s]+),\s*([^,\s]+),\s*([^,\s)]+)\);\s*//\s*L([-\d]+)(, .*)?\s*$"
)


def _rows(values: np.ndarray):
    l_max = degree_of_coefs(values)
    return zip(degrees(l_max).tolist(), orders(l_max).tolist(), values, strict=True)


def _three(values: np.ndarray, convention: str) -> str:
    if values.shape != (9, 3):
        raise ValueError(
            f"a LightProbe holds 9 x 3 coefficients, l_max=2; got {values.shape}."
        )
    flat = [float(x) for x in values.ravel()]
    # Named by its contents: the same light gives the same file.
    name = str(uuid.uuid5(uuid.NAMESPACE_URL, json.dumps(flat)))
    body = {
        "metadata": {"version": 4.7, "type": "Object", "generator": "shjax"},
        "object": {
            "uuid": name,
            "type": "LightProbe",
            "layers": 1,
            "matrix": np.eye(4).ravel().tolist(),
            "up": [0, 1, 0],
            "color": 0xFFFFFF,
            "intensity": 1,
            "sh": flat,
        },
    }
    return json.dumps(body, indent=1) + "\n"


def _cmgen(values: np.ndarray, convention: str) -> str:
    if values.shape[-1] != 3:
        raise ValueError(f"sh.txt holds RGB; got {values.shape[-1]} channels.")
    comment = _COMMENTS[convention.replace(" no-mirror", "")]
    lines = []
    for l, m, rgb in _rows(values):
        numbers = ", ".join(f"{x:18.15f}" for x in rgb)
        lines.append(f"({numbers}); // L{l}{m}{comment}")
    return "\n".join(lines) + "\n"


def _gltf(values: np.ndarray, convention: str) -> str:
    if values.shape != (9, 3):
        raise ValueError(f"the extension holds 9 x 3 coefficients; got {values.shape}.")
    light = {
        "rotation": [0, 0, 0, 1],
        "intensity": 1,
        "irradianceCoefficients": [[float(x) for x in rgb] for rgb in values],
    }
    block = {"extensions": {"EXT_lights_image_based": {"lights": [light]}}}
    return json.dumps(block, indent=1) + "\n"


def _c_header(values: np.ndarray, convention: str) -> str:
    count, channels = values.shape
    lines = [
        f"/* {count} spherical harmonic coefficients, {channels} channels, as stored by: "
        f"{convention}. Index l (l + 1) + m. */",
        f"static const float sh_coefficients[{count}][{channels}] = {{",
    ]
    for l, m, row in _rows(values):
        numbers = ", ".join(f"{x: .9e}f" for x in row)
        lines.append(f"    {{{numbers}}}, /* l={l} m={m} */")
    return "\n".join([*lines, "};"]) + "\n"


def _csv(values: np.ndarray, convention: str) -> str:
    channels = values.shape[-1]
    names = ["R", "G", "B"] if channels == 3 else [f"c{k}" for k in range(channels)]
    lines = [",".join(["l", "m", *names])]
    for l, m, row in _rows(values):
        lines.append(",".join([str(l), str(m), *(f"{x:.9g}" for x in row)]))
    return "\n".join(lines) + "\n"


def _own(values: np.ndarray, convention: str) -> str:
    body = {
        "schema": SCHEMA,
        "l_max": degree_of_coefs(values),
        "convention": convention,
        "coefficients": values.tolist(),
    }
    return json.dumps(body, indent=1) + "\n"


@dataclasses.dataclass(frozen=True)
class Format:
    """File format of coefficients.

    Attributes:
        write: Values ``(K, C)`` and the convention's name to the file's text.
        convention: The convention it holds; None: any, chosen by the writer.
        colour: Whether it holds three channels; grey light is written three times.
    """

    write: Callable[[np.ndarray, str], str]
    convention: str | None
    colour: bool = False


FORMATS = {
    "json": Format(_own, None),
    "csv": Format(_csv, None),
    "c": Format(_c_header, None),
    "three": Format(_three, "three.js", True),
    "gltf": Format(_gltf, "gltf", True),
    **{
        name.replace(" ", "-"): Format(_cmgen, name, True)
        for scale in _COMMENTS
        for name in (scale, scale.replace("cmgen", "cmgen no-mirror"))
    },
}

OTHER_NAMES = {"three.js": "three", "threejs": "three"}  # of formats


def write_coefs(
    path: str | os.PathLike,
    coefs: Float[np.ndarray, "K C"],
    format: str,
    *,
    convention: str = "shjax",
    axes: Float[np.ndarray, "3 3"] | None = None,
) -> None:
    """Write lighting coefficients as another tool reads them.

    Args:
        path: The file.
        coefs: Radiance coefficients in the library's frame and basis.
        format: A name in :data:`FORMATS`.
        convention: For ``json``, ``csv`` and ``c``: a name in
            :data:`shjax.conventions.CONVENTIONS`.
        axes: As in :func:`shjax.convert`; ``gltf`` needs it.

    Raises:
        OSError: If the file cannot be written.
        ValueError: If the format is unknown, fixes another convention, or cannot hold
            these coefficients.
    """
    if isinstance(format, str):
        format = OTHER_NAMES.get(format.lower(), format.lower())
    if format not in FORMATS:
        raise ValueError(f"format must be one of {', '.join(FORMATS)}; got {format!r}.")
    chosen = FORMATS[format]
    if chosen.convention is not None and convention != "shjax":
        raise ValueError(
            f"convention must be left out for {format!r}, which is {chosen.convention!r}; "
            f"got {convention!r}."
        )
    name = chosen.convention or convention
    given = np.asarray(coefs)
    if given.dtype.kind == "f" and not np.all(np.isfinite(given)):
        raise ValueError("coefs must be finite; a file holds numbers only.")
    values = np.asarray(convert(given, to=name, axes=axes), np.float64)
    if chosen.colour and values.shape[-1] == 1:
        values = np.repeat(values, 3, axis=-1)  # grey is a colour too
    text = chosen.write(values, name)
    if format == "json" and axes is not None:  # so that it can be read back
        body = json.loads(text) | {"axes": np.asarray(axes, float).tolist()}
        text = json.dumps(body, indent=1) + "\n"
    write_text(path, text)


def read_coefs(
    path: str | os.PathLike, *, no_mirror: bool = False
) -> Float[np.ndarray, "K C"] | None:
    """Read lighting coefficients of shjax, a three.js LightProbe or cmgen's sh.txt.

    Args:
        path: The file.
        no_mirror: Whether an sh.txt was made with ``--no-mirror``, which it does not say.

    Returns:
        Radiance coefficients in the library's frame and basis, float32; None if the file
        is of another kind (an image, say).

    Raises:
        OSError: If the file cannot be opened.
        ValueError: If it is of such a kind but damaged; the message names the file.
    """
    path = Path(path)
    with path.open("rb") as file:
        start = file.read(4096)
    text = start.removeprefix(b"\xef\xbb\xbf").lstrip()  # some editors' byte order mark
    if not (text.startswith(b"{") or (text.startswith(b"(") and b"// L00" in start)):
        return None
    try:
        whole = path.read_text(encoding="utf-8-sig")
        parse = _parse_json if text.startswith(b"{") else _parse_cmgen
        values, convention, axes = parse(whole)
        degree_of_coefs(values, "coefficients")
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{path}: damaged coefficients ({error}).") from None
    if not np.all(np.isfinite(values)):
        raise ValueError(f"{path}: holds coefficients that are not finite.")
    if no_mirror and convention.startswith("cmgen"):
        convention = convention.replace("cmgen", "cmgen no-mirror")
    try:
        given = values.astype(np.float32)
        return np.asarray(convert(given, from_=convention, axes=axes))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _parse_json(text: str) -> tuple[np.ndarray, str, np.ndarray | None]:
    body = json.loads(text)
    if "extensions" in body:
        raise ValueError("a glTF block is written only, not read")
    probes = _light_probes(body)
    if len(probes) > 1:
        raise ValueError(f"the scene holds {len(probes)} light probes, not one")
    if probes:
        values = np.asarray(probes[0]["sh"], np.float64).reshape(9, 3)
        return values * float(probes[0].get("intensity", 1)), "three.js", None
    if "object" in body:
        raise ValueError("a scene of three.js without a light probe")
    values = np.asarray(body["coefficients"], np.float64)
    axes = body.get("axes")
    axes = None if axes is None else np.asarray(axes, np.float64).reshape(3, 3)
    return values, str(body.get("convention", "shjax")), axes


def _light_probes(content) -> list[dict]:
    """The light probes of a scene of three.js, wherever they hang in it."""
    if isinstance(content, list):
        return [probe for part in content for probe in _light_probes(part)]
    if not isinstance(content, dict):
        return []
    if content.get("type") == "LightProbe" and "sh" in content:
        return [content]
    return _light_probes([v for v in content.values() if isinstance(v, dict | list)])


def _parse_cmgen(text: str) -> tuple[np.ndarray, str, None]:
    lines = list(filter(None, map(str.strip, text.splitlines())))
    l_max = degree_of_coefs(np.empty((len(lines), 3)), "sh.txt")
    values, comments = [], set()
    # By place: the name of (10, 0), L100, could also be that of (1, 0) and a 0.
    places = zip(lines, degrees(l_max), orders(l_max), strict=True)
    for line, l, m in places:
        found = _LINE.match(line)
        if found is None or found[4] != f"{l}{m}":
            raise ValueError(f"not the line of L{l}{m}: {line[:60]!r}")
        values.append([float(found[k]) for k in (1, 2, 3)])
        comments.add(found[5] or "")
    by_comment = {comment: name for name, comment in _COMMENTS.items()}
    if len(comments) != 1 or not comments <= set(by_comment):
        raise ValueError(f"unknown comments: {sorted(comments)}")
    return np.array(values), by_comment[comments.pop()], None
