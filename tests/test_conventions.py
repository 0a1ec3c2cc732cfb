"""Other tools' numbers: the measured table, and what the tools themselves printed."""

import json
from pathlib import Path

import numpy as np
import pytest

import shjax
from shjax.conventions import CONVENTIONS
from shjax.io.coefs import FORMATS
from tests.helpers import relative_error, unit_vectors

CLIENTS = Path(__file__).parent / "data" / "clients"
C = np.sqrt(3) / 2

# The nine coefficients in each frame in terms of ours: (l, m) = 00, 1-1, 10, 11, ...
FRAMES = {
    "three.js": lambda z: [
        z[0],
        z[2],
        -z[1],
        z[3],
        z[7],
        -z[5],
        -0.5 * z[6] - C * z[8],
        -z[4],
        -C * z[6] + 0.5 * z[8],
    ],
    "openexr": lambda z: [
        z[0],
        z[2],
        z[3],
        z[1],
        z[5],
        z[7],
        -0.5 * z[6] + C * z[8],
        z[4],
        -C * z[6] - 0.5 * z[8],
    ],
    "rh01": lambda z: [
        z[0],
        z[2],
        z[3],
        -z[1],
        -z[5],
        z[7],
        -0.5 * z[6] + C * z[8],
        -z[4],
        -C * z[6] - 0.5 * z[8],
    ],
    "google spherical-harmonics": lambda z: [
        z[0],
        z[1],
        z[2],
        -z[3],
        -z[4],
        z[5],
        z[6],
        -z[7],
        z[8],
    ],
    "debevec": lambda z: [
        z[0],
        z[2],
        -z[3],
        -z[1],
        -z[5],
        -z[7],
        -0.5 * z[6] + C * z[8],
        z[4],
        -C * z[6] - 0.5 * z[8],
    ],
    "blender": lambda z: list(z),
}

CLIENT_FILES = {
    "three_light_probe": "three.js",
    "mitsuba": "mitsuba",
    "babylon_harmonics": "babylon.js",
    "babylon_prescaled": "babylon.js shader",
    "cmgen_radiance": "cmgen",
    "cmgen_irradiance": "cmgen irradiance",
    "cmgen_shader": "cmgen shader",
    "cmgen_deploy": "cmgen shader",
    "cmgen_radiance_no_mirror": "cmgen no-mirror",
    "cmgen_irradiance_no_mirror": "cmgen no-mirror irradiance",
    "cmgen_shader_no_mirror": "cmgen no-mirror shader",
    "cmgen_deploy_no_mirror": "cmgen no-mirror shader",
}


def client(name):
    return json.loads((CLIENTS / f"{name}.json").read_text())


@pytest.mark.parametrize("name", FRAMES)
def test_frames_are_the_measured_ones(name, rng, dtype):
    coefs = rng.normal(size=(9, 3))
    expected = np.stack(FRAMES[name](coefs))
    if CONVENTIONS[name].phase:
        expected = expected * np.array([1, -1, 1, -1, 1, -1, 1, -1, 1])[:, None]
    ours = shjax.convert(coefs.astype(dtype), to=name)
    assert relative_error(ours, expected) < 50 * np.finfo(dtype).eps


@pytest.mark.parametrize("name", CLIENT_FILES)
def test_what_the_tools_stored(name):
    record = client(name)
    given, stored = (np.array(record[key], np.float32) for key in ("input", "output"))
    limit = record["tolerance"]["value"]
    assert relative_error(shjax.convert(given, to=CLIENT_FILES[name]), stored) < limit
    assert (
        relative_error(shjax.convert(stored, from_=CLIENT_FILES[name]), given) < limit
    )


def test_every_client_file_is_used():
    names = {path.stem for path in CLIENTS.glob("*.json")}
    assert names == set(CLIENT_FILES) | {"babylon_polynomial"}


def test_babylons_polynomial_holds_the_cosine_twice(rng):
    """x, y, z, xx, yy, zz, yz, zx, xy of sum (Ahat / pi)^2 L Y, in Babylon's axes."""
    record = client("babylon_polynomial")
    axes = np.array(CONVENTIONS["babylon.js"].axes)
    gains = (np.asarray(shjax.cosine_kernel(2)) / np.pi) ** 2
    lighting = (
        np.array(record["input"]) * np.asarray(shjax.harmonics.spread(gains))[:, None]
    )
    normals = unit_vectors(rng, 50)
    expected = shjax.evaluate(lighting, normals)
    x, y, z = (normals @ axes.T).T
    terms = np.stack([x, y, z, x * x, y * y, z * z, y * z, z * x, x * y], axis=-1)
    found = terms @ np.array(record["output"])
    assert relative_error(found, expected) < record["tolerance"]["value"]


@pytest.mark.parametrize("name", CONVENTIONS)
def test_there_and_back(name, rng, dtype):
    axes = (
        None
        if CONVENTIONS[name].axes
        else np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
    )
    coefs = rng.normal(size=(2, 9, 3)).astype(dtype)
    stored = shjax.convert(coefs, to=name, axes=axes)
    assert stored.dtype == dtype
    back = shjax.convert(stored, from_=name, axes=axes)
    assert relative_error(back, coefs) < 100 * np.finfo(dtype).eps


def test_scales_are_the_documented_ones():
    white = np.zeros((9, 1), np.float32)
    white[0] = 1
    for name, expected in {
        "cmgen irradiance": np.pi,
        "cmgen shader": np.sqrt(1 / (4 * np.pi)),
        "babylon.js": 1,
        "materialx irradiance": 1,
        "cmft": 1,
    }.items():
        assert float(shjax.convert(white, to=name)[0, 0]) == pytest.approx(expected)


@pytest.mark.parametrize("l_max", [0, 1, 4])
def test_any_degree_where_the_scale_is_known(l_max, rng, dtype):
    coefs = rng.normal(size=((l_max + 1) ** 2, 1)).astype(dtype)
    back = shjax.convert(shjax.convert(coefs, to="mitsuba"), from_="mitsuba")
    assert relative_error(back, coefs) < 100 * np.finfo(dtype).eps
    between = shjax.convert(
        shjax.convert(coefs, to="mitsuba"), from_="mitsuba", to="three.js"
    )
    assert (
        relative_error(between, shjax.convert(coefs, to="three.js"))
        < 100 * np.finfo(dtype).eps
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"to": "renderman"}, "to must be one of"),
        ({"from_": "renderman"}, "from_ must be one of"),
        ({"to": "unreal"}, "axes must be given for 'unreal'"),
        ({"axes": np.eye(3)}, "axes must belong to one tool"),
        (
            {"to": "three.js", "from_": "unity", "axes": np.eye(3)},
            "axes must belong to one tool",
        ),
        ({"from_": "cmgen irradiance"}, r"hold nothing of the degrees \[3\]"),
        ({"to": "cmgen shader"}, "l_max=2"),
    ],
)
def test_what_cannot_be_converted_is_refused(arguments, words):
    with pytest.raises(ValueError, match=words):
        shjax.convert(np.ones((16, 3), np.float32), **arguments)


@pytest.fixture
def nine(rng):
    return rng.normal(size=(9, 3)).astype(np.float32)


@pytest.mark.parametrize(
    "name", [n for n, f in FORMATS.items() if n not in ("csv", "c", "gltf")]
)
def test_files_there_and_back(tmp_path, name, nine):
    path = tmp_path / "light"
    shjax.io.write_coefs(path, nine, format=name)
    back = shjax.io.read_coefs(path, no_mirror="no-mirror" in name)
    assert relative_error(back, nine) < 1e-5


@pytest.mark.parametrize("name", [n for n in CLIENT_FILES if n.startswith("cmgen")])
def test_cmgens_own_text_is_read_and_written(tmp_path, name):
    record = client(name)
    (tmp_path / "sh.txt").write_text(record["text"])
    read = shjax.io.read_coefs(tmp_path / "sh.txt", no_mirror="no_mirror" in name)
    assert relative_error(read, record["input"]) < record["tolerance"]["value"]
    shjax.io.write_coefs(
        tmp_path / "ours.txt", read, format=CLIENT_FILES[name].replace(" ", "-")
    )
    ours, theirs = (
        (tmp_path / f).read_text().splitlines() for f in ("ours.txt", "sh.txt")
    )
    assert [line.split(");")[1] for line in ours] == [
        line.split(");")[1] for line in theirs
    ]
    assert [len(line) for line in ours] == [len(line) for line in theirs]


def test_threes_own_json_is_read(tmp_path):
    record = client("three_light_probe")
    (tmp_path / "probe.json").write_text(json.dumps(record["light_probe"]))
    read = shjax.io.read_coefs(tmp_path / "probe.json")
    assert relative_error(read, record["input"]) < record["tolerance"]["value"]
    shjax.io.write_coefs(tmp_path / "ours.json", read, format="three")
    ours = json.loads((tmp_path / "ours.json").read_text())
    assert set(ours) == set(record["light_probe"])
    assert set(ours["object"]) <= set(record["light_probe"]["object"])


def test_other_texts(tmp_path, nine):
    write = shjax.io.write_coefs
    write(tmp_path / "a.csv", nine, format="csv", convention="three.js")
    rows = np.genfromtxt(tmp_path / "a.csv", delimiter=",", skip_header=1)
    np.testing.assert_allclose(
        rows[:, 2:], shjax.convert(nine, to="three.js"), rtol=1e-6
    )
    assert rows[:, :2].tolist()[:3] == [[0, 0], [1, -1], [1, 0]]
    write(
        tmp_path / "a.json",
        nine,
        format="gltf",
        axes=np.array([[0.0, -1, 0], [0, 0, 1], [-1, 0, 0]]),
    )
    block = json.loads((tmp_path / "a.json").read_text())["extensions"][
        "EXT_lights_image_based"
    ]
    stored = np.array(block["lights"][0]["irradianceCoefficients"])
    np.testing.assert_allclose(stored[0], np.pi * nine[0], rtol=1e-6)
    write(tmp_path / "a.h", nine, format="c")
    assert (tmp_path / "a.h").read_text().count("f, ") == 18


def test_own_files_remember_given_axes(tmp_path, nine):
    axes = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
    for convention in ("three.js", "unity"):
        shjax.io.write_coefs(
            tmp_path / "a.json", nine, format="json", convention=convention, axes=axes
        )
        assert relative_error(shjax.io.read_coefs(tmp_path / "a.json"), nine) < 1e-5


def test_cmgens_text_of_a_high_degree(tmp_path, rng):
    many = rng.normal(size=(144, 3)).astype(np.float32)
    shjax.io.write_coefs(tmp_path / "sh.txt", many, format="cmgen")
    assert relative_error(shjax.io.read_coefs(tmp_path / "sh.txt"), many) < 1e-5


def test_the_c_header_compiles(tmp_path, nine):
    import shutil
    import subprocess

    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler")
    shjax.io.write_coefs(tmp_path / "light.h", nine, format="c")
    source = tmp_path / "main.c"
    source.write_text(
        '#include <stdio.h>\n#include "light.h"\n'
        'int main(void) { printf("%.9g", sh_coefficients[8][2]); return 0; }\n'
    )
    subprocess.run(
        [compiler, "-Wall", "-Werror", "-o", tmp_path / "main", source], check=True
    )
    printed = subprocess.run(
        [tmp_path / "main"], capture_output=True, text=True, check=True
    )
    assert float(printed.stdout) == pytest.approx(float(nine[8, 2]), rel=1e-6)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{ not json", "damaged coefficients"),
        ('{"coefficients": [[1, 2, 3], [4, 5, 6]]}', "damaged coefficients"),
        ('{"other": 1}', "damaged coefficients"),
        ("( 1, 2, 3); // L00\n" + 3 * "rubbish\n", "not the line of L1-1"),
        ("( 1, 2, 3); // L00\nrubbish\n", "damaged coefficients"),
        ('{"coefficients": [[1, 2, 3]], "object": 3}', "damaged coefficients"),
        ('{"coefficients": [[1, 2, 3]], "convention": 7}', "from_ must be one of"),
        ('{"extensions": {}}', "written only"),
        ("( 1, 2, 3); // L00, unheard of\n", "unknown comments"),
        ('{"coefficients": [[NaN, 2, 3]]}', "not finite"),
    ],
)
def test_damaged_files_are_one_clear_line(tmp_path, text, words):
    (tmp_path / "light.json").write_text(text)
    with pytest.raises(ValueError, match=words) as caught:
        shjax.io.read_coefs(tmp_path / "light.json")
    assert "light.json" in str(caught.value)


def test_wrong_formats_are_refused(tmp_path, nine):
    for arguments, words in (
        ({"format": "yaml"}, "format must be one of"),
        ({"format": "three", "convention": "cmgen"}, "convention must be left out"),
        ({"format": "gltf"}, "axes must be given"),
    ):
        with pytest.raises(ValueError, match=words):
            shjax.io.write_coefs(tmp_path / "a", nine, **arguments)
    with pytest.raises(ValueError, match="9 x 3"):
        shjax.io.write_coefs(tmp_path / "a", nine[:4], format="three")
    assert list(tmp_path.iterdir()) == []
    assert shjax.io.read_coefs(shjax.io.shipped_panorama()) is None
