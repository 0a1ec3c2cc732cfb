"""The command as a person meets it, in a process of its own where that matters."""

import json
import os
import subprocess
import sys

import click
import jax
import numpy as np
import pytest

import shjax
import shjax.sphere
from shjax import io
from shjax.brdf.catalogue import BRDFS
from shjax.cli import Commands, cli, light_checks, light_run
from shjax.cli import words as choices
from shjax.cli.kept_energies import kept_energies
from shjax.cli.light import Settings
from shjax.cli.light_report import write_checks, write_light
from shjax.cli.light_run import run
from shjax.cli.options import Output, Reading
from shjax.cli.stage import TURNS
from shjax.cli.surface import NORMAL_FRAMES
from shjax.conventions import CONVENTIONS
from shjax.display import OPERATORS
from shjax.io.coefs import FORMATS
from shjax.io.envmaps import INVALID_CHOICES
from shjax.reflection.ranks import RANKS
from shjax.windows import NAMES


def light_of_file(path, **settings):
    """The result of ``shjax light`` on one file, written."""
    reading = Reading("auto", "error", "rec709")
    settings = Settings(size=16, checks=True, **settings)
    found, envmap = run(path, settings, reading)
    out = path.parent / "out"
    result = write_light(out, path.stem, found)
    checks = light_checks.check(envmap, found, settings, light_checks.Ahead(16))
    return write_checks(out, path.stem, found, checks, result)


def shell(*arguments, cwd=None):
    environment = {
        k: v for k, v in os.environ.items() if not k.startswith("JAX") or "CACHE" in k
    }
    return subprocess.run(
        [sys.executable, "-m", "shjax", *map(str, arguments)],
        capture_output=True,
        text=True,
        cwd=cwd,
        env=environment,
        check=False,
    )


@pytest.fixture(scope="module")
def main_job(tmp_path_factory):
    out = tmp_path_factory.mktemp("main")
    return shell("light", "--out", out, "--json"), out


def test_the_main_job(main_job):
    finished, out = main_job
    assert finished.returncode == 0, finished.stderr
    result = json.loads(finished.stdout)  # exactly one object
    assert np.array(result["coefficients"]).shape == (9, 3)
    assert result["l_max"] == 2
    assert "+z up" in result["frame"]
    assert "Condon-Shortley" in result["basis"]
    assert "radiance" in result["units"]
    error = result["irradiance_error"]
    assert round(100 * error["mean"], 2) == 0.97
    assert error["max"] == pytest.approx(0.028, abs=0.004)
    assert "int L dw" in error["relative_to"]
    assert result["recovered_error"]["self"] <= 1e-4
    recovered = result["recovered_error"]
    assert 0.01 < recovered["default"] < recovered["plain"] < 0.6
    assert result["integral"]["rows"] == 128
    assert 0 < result["integral"]["difference"] < 0.01
    expected = {
        "irradiance.exr",
        "irradiance.png",
        "lighting.json",
        "spheres.exr",
        "spheres.png",
    }
    assert {f"city_{name}" for name in expected} == set(os.listdir(out))
    stored = json.loads((out / "city_lighting.json").read_text())
    assert stored == result


def test_the_pictures_hold_what_they_say(main_job):
    _, out = main_job
    irradiance = io.read_image(out / "city_irradiance.exr")
    assert irradiance.shape == (64, 128, 3)
    lighting = np.array(
        json.loads((out / "city_lighting.json").read_text())["coefficients"]
    )
    mean = np.asarray(shjax.analyze(irradiance, l_max=0))[0] / np.sqrt(4 * np.pi)
    np.testing.assert_allclose(mean, lighting[0] * np.sqrt(np.pi / 4), rtol=1e-4)
    spheres = io.read_image(out / "city_spheres.exr")
    approximate, exact, difference = np.split(spheres, 3, axis=1)
    np.testing.assert_allclose(approximate - exact, difference, atol=1e-6)
    assert 0 < np.abs(difference).max() < 0.2 * exact.max()
    shown = io.read_image(out / "city_spheres.png")
    times = shown.shape[1] // spheres.shape[1]  # enlarged, with captions below
    assert shown.shape[1] == times * spheres.shape[1]
    assert shown.shape[0] > times * spheres.shape[0]
    assert shown.std() > 0.1


def test_a_person_reads_a_table_and_the_reasons(tmp_path):
    finished = shell("light", "--out", tmp_path, "--size", 16)
    assert finished.returncode == 0, finished.stderr
    for words in (
        "L_lm",
        "irradiance_error",
        "recovered_error",
        "One view",
        "condition",  # the end of a long paragraph
        "written:",
    ):
        assert words in finished.stdout
    assert finished.stderr == ""


def test_quiet_prints_nothing(tmp_path):
    finished = shell("light", "--out", tmp_path, "--size", 16, "--quiet")
    assert (finished.returncode, finished.stdout, finished.stderr) == (0, "", "")


def test_several_maps_and_a_bad_one(tmp_path):
    io.write_image(tmp_path / "a.exr", np.ones((16, 32, 3), np.float32))
    io.write_image(tmp_path / "grey.exr", np.ones((32, 32, 1), np.float32))
    (tmp_path / "bad.hdr").write_bytes(b"rubbish")
    names = ["a.exr", "bad.hdr", "grey.exr"]
    out = tmp_path / "new" / "folder"
    finished = shell(
        "light",
        *names,
        "--out",
        out,
        "--json",
        "--size",
        16,
        "--l-max",
        1,
        cwd=tmp_path,
    )
    assert finished.returncode == 2
    assert finished.stderr.startswith("shjax: bad.hdr: ")
    assert finished.stderr.count("\n") == 1
    first, second = (json.loads(line) for line in finished.stdout.splitlines())
    assert np.array(first["coefficients"]).shape == (4, 3)
    assert np.array(second["coefficients"]).shape == (4, 1)
    assert second["report"]["layout"] == "angular"
    assert (out / "grey_lighting.json").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["light", "missing.exr", "--out", "x"], "missing.exr"),
        (["light"], "--out"),
        (["light", "--out", "x", "--l-max", "many"], "--l-max"),
        (["light", "a/b.exr", "c/b.exr", "--out", "x"], "named b"),
        (["dark"], "dark"),
    ],
)
def test_errors_are_one_line_and_status_two(tmp_path, arguments, words):
    finished = shell(*arguments, cwd=tmp_path)
    assert finished.returncode == 2
    assert finished.stdout == ""
    assert finished.stderr.count("\n") == 1
    assert words in finished.stderr
    assert list(tmp_path.iterdir()) == []


def test_help_is_laid_out():
    for command in ("light", "convert"):
        text = shell(command, "--help").stdout
        assert "\\" not in text
        assert "Examples:\n    shjax" in text


def test_what_cannot_work_is_refused_at_once(tmp_path):
    image = np.ones((16, 32, 3), np.float32)
    image[0, 0] = np.nan
    io.write_image(tmp_path / "nan.exr", image)
    (tmp_path / "file").write_text("")
    for arguments, words in (
        (
            ["nan.exr", "--invalid", "keep", "--out", "x"],
            "nan.exr: values that are not finite",
        ),
        (["--out", "file"], "file: cannot be a folder"),
        (["--out", "x", "--size", "5000"], "--size"),
    ):
        finished = shell("light", *arguments, cwd=tmp_path)
        assert finished.returncode == 2
        assert finished.stderr.count("\n") == 1
        assert words in finished.stderr


def test_options_are_refused_by_name(tmp_path):
    map_ = tmp_path / "a.npy"
    np.save(map_, np.ones((8, 16, 3), np.float32))
    np.save(tmp_path / "bright.npy", np.full((8, 16, 3), 1e38, np.float32))
    out = ("--out", "o")
    for words, message in (
        (("remap", map_, "x.exr", "--exposure", "nan"), "'--exposure': 'nan' is not a"),
        (
            ("reflect", map_, *out, "--rms-error", "nan"),
            "'--rms-error': 'nan' is not a",
        ),
        (("light", "bright.npy", *out), "bright.npy: the light overflows float32"),
        (
            ("convert", map_, "x.h", "--to", "c", "--axes=x,y,-z"),
            "--convention must name it",
        ),
        (
            (
                *("reflect", map_, *out, "--material", "roughness=0.5"),
                *("--brdf", "phong exponent=8"),
            ),
            "--material takes the place of --brdf",
        ),
    ):
        finished = shell(*words, cwd=tmp_path)
        assert finished.returncode == 2
        assert message in finished.stderr
        assert finished.stderr.count("\n") == 1


def test_a_long_table_is_cut(tmp_path):
    io.write_image(tmp_path / "[bold]a.exr", np.ones((16, 32, 3), np.float32))
    finished = shell(
        "light", tmp_path / "[bold]a.exr", "--out", tmp_path, "--l-max", 6, "--size", 16
    )
    assert "24 more in the JSON file" in finished.stdout
    assert "[bold]a_irradiance.exr" in finished.stdout.replace("\n", "")


def test_convert_says_what_it_did(tmp_path):
    io.write_image(tmp_path / "small.exr", np.ones((8, 16, 3), np.float32))
    finished = shell(
        "convert",
        tmp_path / "small.exr",
        tmp_path / "a.csv",
        "--to",
        "csv",
        "--l-max",
        6,
    )
    assert "16 x 8 OpenEXR float, latlong" in finished.stdout
    assert "fewer than 13 rows or columns" in finished.stdout


@pytest.mark.parametrize(
    ("listed", "table"),
    [
        (choices.BRDFS, BRDFS),
        (choices.CONVENTIONS, CONVENTIONS),
        (choices.FORMATS, FORMATS),
        (choices.INVALID, INVALID_CHOICES),
        (choices.MAPS, map(str, RANKS)),
        (choices.NORMAL_FRAMES, NORMAL_FRAMES),
        (choices.OPERATORS, OPERATORS),
        (choices.UP_AXES, TURNS),
        (choices.WINDOWS, NAMES),
    ],
)
def test_the_words_of_help_are_those_of_the_library(listed, table):
    assert sorted(listed) == sorted(table)


def test_commands_are_listed_as_they_call_themselves():
    context = click.Context(cli)
    for name, (_, text) in Commands.known.items():
        command = cli.get_command(context, name)
        assert command is not None
        assert command.short_help == text


def test_what_was_asked_comes_before_the_checks(tmp_path, monkeypatch):
    """Interrupted in the checks: coefficients are there, and the next run does the rest."""
    io.write_image(tmp_path / "a.exr", np.ones((16, 32, 3), np.float32))

    def interrupted(*_):
        raise ValueError("interrupted")

    call = (tmp_path / "a.exr",), tmp_path, Settings(size=16)
    reading, output = Reading("auto", "error", "rec709"), Output(False, True)
    with monkeypatch.context() as patch:
        patch.setattr(light_checks, "check", interrupted)
        with pytest.raises(ValueError, match="interrupted"):
            light_run.main(*call, reading, False, output)
    stored = json.loads((tmp_path / "a_lighting.json").read_text())
    assert len(stored["coefficients"]) == 9
    assert stored["irradiance_error"] is None
    assert not (tmp_path / "a_spheres.exr").exists()
    light_run.main(*call, reading, False, output)
    stored = json.loads((tmp_path / "a_lighting.json").read_text())
    assert stored["irradiance_error"]["max"] < 1e-2
    assert (tmp_path / "a_spheres.exr").exists()


def test_checks_are_made_where_they_are_asked_for(tmp_path):
    for name in "ab":
        io.write_image(tmp_path / f"{name}.exr", np.ones((16, 32, 3), np.float32))
    many = ("light", "a.exr", "b.exr", "--out", "o", "--size", 16, "--json")
    for options, checked in ((many, False), ((*many, "--checks"), True)):
        finished = shell(*options, cwd=tmp_path)
        assert finished.returncode == 0, finished.stderr
        for line in finished.stdout.splitlines():
            result = json.loads(line)
            assert (result["recovered_error"] is not None) == checked
            assert ("spheres.exr" in result["files"]) == checked
    finished = shell(*many[:2], *many[3:-1], "--no-checks", cwd=tmp_path)
    assert "recovered_error" not in finished.stdout


@pytest.mark.parametrize("option", ["", "--no-cache", "variable"])
def test_commands_keep_what_they_compile(tmp_path, option):
    np.save(tmp_path / "a.npy", np.ones((8, 16, 1), np.float32))
    own = {k: v for k, v in os.environ.items() if not k.startswith("JAX")}
    own["SHJAX_CACHE"] = "off" if option == "variable" else str(tmp_path / "kept")
    call = [sys.executable, "-m", "shjax", *([option] if option[:2] == "--" else [])]
    call += ["convert", str(tmp_path / "a.npy"), str(tmp_path / "a.csv"), "--to", "csv"]
    for _ in range(2):
        finished = subprocess.run(call, env=own, capture_output=True, check=False)
        assert finished.returncode == 0, finished.stderr
        assert finished.stderr == b""
    kept = list((tmp_path / "kept").glob("*/*-cache"))
    assert bool(kept) == (option == "")


def test_energies_are_kept(tmp_path, monkeypatch):
    monkeypatch.setenv("SHJAX_CACHE", str(tmp_path))
    brdf = shjax.brdf.lambertian(0.3) + shjax.brdf.ggx(0.5, f0=0.8)
    degrees = {"l_max": 8, "p_max": 3}
    first = kept_energies(brdf, **degrees)
    monkeypatch.setattr("shjax.cli.kept_energies.brdf_energies", None)
    again = kept_energies(brdf, **degrees)
    for one, other in zip(jax.tree.leaves(first), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(one, other)
    assert jax.tree.structure(first) == jax.tree.structure(again)
    with pytest.raises(TypeError):  # another material has its own
        kept_energies(0.9 * brdf, **degrees)
    (file,) = tmp_path.glob("energies/*.npz")
    file.write_bytes(b"half")  # as an interrupted disk leaves it
    with pytest.raises(TypeError):  # found anew, by what is not there in this test
        kept_energies(brdf, **degrees)


def test_help_and_version():
    assert shell("--version").stdout.strip() == f"shjax, version {shjax.__version__}"
    text = shell("light", "--help").stdout
    for words in ("Usage:", "--l-max", "--json", "--quiet", "Examples:"):
        assert words in text


def test_too_small_a_map_is_taken_as_constant_pixels_and_says_so(tmp_path):
    io.write_image(tmp_path / "tiny.exr", np.ones((4, 8, 3), np.float32))
    result = light_of_file(tmp_path / "tiny.exr")
    assert result["quadrature"] == "pixel"
    assert result["coefficients"][0][0] == pytest.approx(np.sqrt(4 * np.pi), rel=1e-5)
    finished = shell("light", tmp_path / "tiny.exr", "--out", tmp_path, "--size", 16)
    assert "fewer than 5 rows or columns" in finished.stdout


def test_rotating_the_light_rotates_everything(tmp_path):
    image = np.random.default_rng(0).random((32, 64, 3)).astype(np.float32)
    io.write_image(tmp_path / "a.exr", image)
    io.write_image(tmp_path / "b.exr", np.roll(image, -16, axis=1))
    quarter = shjax.sphere.yaw_pitch_roll(np.pi / 2, 0.0, 0.0)
    turned = light_of_file(tmp_path / "a.exr", rotate=quarter)
    moved = light_of_file(tmp_path / "b.exr")
    np.testing.assert_allclose(turned["coefficients"], moved["coefficients"], atol=1e-5)
    for key in ("mean", "max"):
        assert turned["irradiance_error"][key] == pytest.approx(
            moved["irradiance_error"][key], rel=0.05
        )
    assert turned["recovered_error"]["plain"] == pytest.approx(
        moved["recovered_error"]["plain"], rel=1e-3
    )


def test_convert_through_every_reader(tmp_path):
    steps = [
        (io.shipped_panorama(), "probe.json", "--to", "three"),
        ("probe.json", "sh.txt", "--to", "cmgen-irradiance"),
        ("sh.txt", "own.json", "--to", "json", "--json"),
        ("own.json", "light.csv", "--to", "csv", "--rotate", "90,0,0"),
    ]
    for source, target, *options in steps:
        finished = shell("convert", source, target, *options, cwd=tmp_path)
        assert finished.returncode == 0, finished.stderr
        assert target in finished.stdout
    rows = np.genfromtxt(tmp_path / "light.csv", delimiter=",", skip_header=1)
    lighting = io.read_envmap(io.shipped_panorama()).lighting(l_max=2)
    quarter = shjax.sphere.yaw_pitch_roll(np.pi / 2, 0.0, 0.0)
    np.testing.assert_allclose(rows[:, 2:], shjax.rotate(lighting, quarter), atol=1e-5)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["own.json", "x", "--to", "yaml"], "--to"),
        (["own.json", "own.json", "--to", "csv"], "overwritten"),
        (["own.json", "x", "--to", "csv", "--l-max", "5"], "at most 1"),
        (["own.json", "x", "--to", "three"], "9 x 3"),
        (["own.json", "x", "--to", "csv", "--rotate", "1,2"], "three numbers"),
        (["own.json", "x", "--to", "gltf", "--axes=x,x,z"], "each axis once"),
        (["gone.json", "x", "--to", "csv"], "gone.json"),
        (["own.json", ".", "--to", "csv"], "is a folder"),
    ],
)
def test_convert_refuses_in_one_line(tmp_path, arguments, words):
    io.write_coefs(tmp_path / "own.json", np.ones((4, 3), np.float32), format="json")
    finished = shell("convert", *arguments, cwd=tmp_path)
    assert finished.returncode == 2
    assert finished.stderr.count("\n") == 1
    assert words in finished.stderr
    assert sorted(os.listdir(tmp_path)) == ["own.json"]


def test_a_black_map_gives_no_nan(tmp_path):
    io.write_image(tmp_path / "black.exr", np.zeros((8, 16, 3), np.float32))
    result = light_of_file(tmp_path / "black.exr")
    assert result["recovered_error"] == {"self": 0, "plain": 0, "default": 0}
    assert result["irradiance_error"]["max"] == 0


@pytest.mark.slow
def test_reflect(tmp_path):
    image = np.random.default_rng(0).random((32, 64, 3)).astype(np.float32) + 0.5
    image[:16] += 1
    io.write_image(tmp_path / "a.exr", image)
    finished = shell(
        "reflect",
        "a.exr",
        "--brdf",
        "lambertian albedo=0.4,0.3,0.2 + 0.5 * ggx alpha=0.5 f0=0.9",
        "--rms-error",
        "0.05",
        "--size",
        "32",
        "--out",
        "out",
        "--json",
        cwd=tmp_path,
    )
    assert finished.returncode == 0, finished.stderr
    result = json.loads(finished.stdout)
    for key in (
        "model",
        "l_max",
        "p_max",
        "predicted_rms_error",
        "measured_rms_error",
        "met",
    ):
        assert key in result
    assert result["met"]
    limit = 1.02 * 0.05 + 3 * result["measured_standard_error"]
    assert result["measured_rms_error"] <= limit
    assert result["schema"] == "shjax.reflect/1"
    assert result["lights"] == []
    spheres = io.read_image(tmp_path / "out" / "a_reflection.exr")
    model, exact, difference = np.split(spheres, 3, axis=1)
    np.testing.assert_allclose(model - exact, difference, atol=1e-6)
    assert np.abs(difference).max() < 0.3 * exact.max()
    import OpenEXR

    channels = OpenEXR.File(
        str(tmp_path / "out" / "a_shrm.exr"), separate_channels=True
    ).channels()
    views = (
        (result["p_max"] + 1) ** 2 if result["model"] == "shrm" else result["p_max"] + 1
    )
    assert len(channels) == 3 * views
    assert "p0q0.R" in channels
    assert json.loads((tmp_path / "out" / "a_reflect.json").read_text()) == result
    again = shell(
        "reflect",
        "a.exr",
        "--brdf",
        "phong exponent=8",
        "--rotate",
        "90,0,0",
        "--size",
        "16",
        "--out",
        "b",
        cwd=tmp_path,
    )
    for words in ("predicted error", "rms", "energy", "measured", "written:"):
        assert words in again.stdout


@pytest.mark.slow
def test_reflect_tells_the_lights_that_are_in_no_map(tmp_path):
    image = np.ones((64, 128, 3), np.float32)
    image[20, 40] = [4000.0, 2000.0, 1000.0]
    io.write_image(tmp_path / "sun.exr", image)
    finished = shell(
        "reflect",
        "sun.exr",
        "--brdf",
        "ggx alpha=0.2 f0=0.04",
        "--rms-error",
        "0.05",
        "--size",
        "16",
        "--out",
        "out",
        "--json",
        cwd=tmp_path,
    )
    assert finished.returncode == 0, finished.stderr
    (light,) = json.loads(finished.stdout)["lights"]
    towards = shjax.sphere.latlong_directions(64, 128)[20, 40]
    np.testing.assert_allclose(light["direction"], towards, atol=1e-4)
    area = shjax.sphere.latlong_solid_angles(64, 128)[20]
    np.testing.assert_allclose(light["flux"], area * (image[20, 40] - 1), rtol=1e-3)


@pytest.mark.slow
def test_render_a_turntable_that_resumes(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.icosphere(subdivisions=3).export(tmp_path / "ball.obj")
    image = np.ones((16, 32, 3), np.float32)
    image[:8] = [0.5, 1.0, 2.0]
    io.write_image(tmp_path / "sky.exr", image)
    call = (
        "render",
        "ball.obj",
        "sky.exr",
        "--brdf",
        "lambertian albedo=0.8",
        "--light",
        "sphere centre=0,0,3 radius=1 radiance=0,0,9",
        "--size",
        "24",
        "--turntable",
        "3",
        "--out",
        "out",
    )
    finished = shell(*call, "--json", cwd=tmp_path)
    assert finished.returncode == 0, finished.stderr
    result = json.loads(finished.stdout)
    assert len(result["files"]) == 6
    frame = io.read_image(tmp_path / "out" / "ball_0001.exr")
    assert frame.shape == (24, 24, 3)
    assert frame[1, 12, 2] > 1.3 > 0.8 > frame[1, 12, 0]  # the sky behind
    assert 0.4 < frame[12, 12, :2].mean() < 1.2  # the ball
    record = json.loads((tmp_path / "out" / "ball_render.json").read_text())
    assert record["area_lights"] == ["sphere centre=0,0,3 radius=1 radiance=0,0,9"]
    lit = frame[:, 12, 2] - frame[:, 12, 1] * 1.5  # blue, from above
    assert lit[6] > 0.5 > abs(lit[16])
    times = {name: os.stat(tmp_path / name).st_mtime_ns for name in result["files"]}
    os.remove(tmp_path / result["files"][2])
    assert shell(*call, cwd=tmp_path).returncode == 0
    after = {name: os.stat(tmp_path / name).st_mtime_ns for name in result["files"]}
    assert [name for name in times if after[name] != times[name]] == result["files"][
        2:4
    ]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["reflect", "--brdf", "chrome", "--out", "x"], "brdf must be one of"),
        (["reflect", "--brdf", "ggx alpha=2", "--out", "x"], "alpha must lie in"),
        (["reflect", "--brdf", "ggx", "--out", "x"], "ggx needs alpha="),
        (
            ["reflect", "--brdf", "ggx alpha=0.3 gloss=1", "--out", "x"],
            "ggx takes alpha=",
        ),
        (["reflect", "--brdf", "merl path=gone.binary", "--out", "x"], "gone.binary"),
        (["reflect", "--rms-error", "0", "--out", "x"], "--rms-error"),
        (["reflect", "gone.exr", "--out", "x"], "gone.exr"),
        (["render", "gone.obj", "--out", "x"], "gone.obj"),
        (
            ["render", "own.obj", "--brdf", "kajiya_kay exponent=8", "--out", "x"],
            "no tangents",
        ),
        (
            ["render", "x.obj", "--light", "disk radius=1", "--out", "x"],
            "disk needs centre=..., normal=..., radiance=...",
        ),
    ],
)
def test_reflect_and_render_refuse_in_one_line(tmp_path, arguments, words):
    finished = shell(*arguments, cwd=tmp_path)
    assert finished.returncode == 2
    assert finished.stdout == ""
    assert finished.stderr.count("\n") == 1
    assert words in finished.stderr
    assert list(tmp_path.iterdir()) == []


def test_light_splits_off_a_sun(tmp_path):
    image = np.ones((64, 128, 3), np.float32)
    image[20, 40] = [4000.0, 2000.0, 1000.0]
    io.write_image(tmp_path / "sun.exr", image)
    finished = shell(
        "light",
        "sun.exr",
        "--split",
        "--size",
        "16",
        "--out",
        "out",
        "--json",
        cwd=tmp_path,
    )
    assert finished.returncode == 0, finished.stderr
    result = json.loads(finished.stdout)
    (light,) = result["lights"]
    stored = json.loads((tmp_path / "out" / "sun_lights.json").read_text())
    assert stored["lights"] == [light]
    assert stored["schema"] == "shjax.lights/1"
    x, y, z = shjax.sphere.latlong_directions(64, 128)[20, 40]
    assert light["azimuth"] == pytest.approx(np.degrees(np.arctan2(y, x)), abs=0.01)
    assert light["elevation"] == pytest.approx(np.degrees(np.arcsin(z)), abs=0.01)
    rest = io.read_image(tmp_path / "out" / "sun_rest.exr")
    solid = shjax.sphere.latlong_solid_angles(64, 128)[:, None, None]
    kept = np.sum(rest * solid, (0, 1)) + light["flux"]
    np.testing.assert_allclose(kept, np.sum(image * solid, (0, 1)), rtol=1e-5)
    np.testing.assert_allclose(rest, 1.0, atol=1e-4)


@pytest.mark.slow
def test_reflect_and_render_a_material(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    image = np.ones((32, 64, 3), np.float32)
    image[:16] = [0.5, 1.0, 2.0]
    io.write_image(tmp_path / "sky.exr", image)
    finished = shell(
        "reflect",
        "sky.exr",
        "--material",
        "roughness=0.5,metallic=1,albedo=1,0.8,0.4",
        "--maps",
        "4",
        "--size",
        "16",
        "--out",
        "out",
        "--json",
        cwd=tmp_path,
    )
    assert finished.returncode == 0, finished.stderr
    result = json.loads(finished.stdout)
    assert result["model"] == "lighting layer"
    assert result["maps"] == 4
    np.testing.assert_allclose(result["material"]["albedo"], [1, 0.8, 0.4], rtol=1e-6)
    difference = abs(result["measured_rms_error"] - result["predicted_rms_error"])
    limit = 3 * result["measured_standard_error"] + 0.01
    assert difference < limit
    assert (tmp_path / "out" / "sky_light.json").exists()
    trimesh.creation.icosphere(subdivisions=2).export(tmp_path / "ball.ply")
    drawn = shell(
        "render",
        "ball.ply",
        "sky.exr",
        "--material",
        "roughness=0.5,albedo=0.2",
        "--size",
        "24",
        "--maps",
        "4",
        "--out",
        "out",
        "--json",
        cwd=tmp_path,
    )
    assert drawn.returncode == 0, drawn.stderr
    record = json.loads(drawn.stdout)
    assert record["model"] == "lighting layer"
    assert record["material"] == {"roughness": 0.5, "albedo": pytest.approx(0.2)}
    assert np.all(np.isfinite(io.read_image(tmp_path / "out" / "ball.exr")))


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ("roughness=2", "roughness must lie in [0, 1]"),
        ("roughness=0", "roughness must lie in (0, 1]"),
        ("gloss=1", "'gloss=1' is not one of mesh"),
        ("metallic=1,0", "metallic takes one number"),
        ("mesh", "needs a mesh"),
    ],
)
def test_materials_that_are_refused(wrong, words, tmp_path):
    from click.testing import CliRunner

    from shjax.cli.reflect import reflect

    call = ["--material", wrong, "--out", str(tmp_path)]
    refused = CliRunner().invoke(reflect, call)
    assert refused.exit_code == 2
    assert words in refused.output
