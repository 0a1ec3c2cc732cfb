"""Errors of lights: known values, and the commands that use them."""

import json
from io import StringIO
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image
from rich.console import Console

import shjax
from shjax import cli, io, metrics, render
from shjax.cli.estimate import estimate
from shjax.cli.estimate_report import show
from shjax.cli.score import score
from shjax.cli.surface import CAMERA_TO_WORLD
from shjax.inverse import decode
from tests.helpers import relative_error
from tests.mitsuba import environment


def test_lighting_error_in_total_and_per_degree(dtype):
    truth = np.zeros((16, 2), dtype)
    truth[0], truth[1:4], truth[9:] = 4, 1, 7
    guess = truth[:9].copy()
    guess[1] += 0.5
    guess[5] = 0.1
    error = metrics.lighting_error(guess, truth, l_max=2)
    whole = np.sqrt((2 * 0.25 + 2 * 0.01) / (2 * 16 + 6))
    assert float(error.total) == pytest.approx(whole, rel=1e-5)
    np.testing.assert_allclose(error.per_degree[:2], [0, np.sqrt(0.5 / 6)], rtol=1e-5)
    assert np.isinf(error.per_degree[2])
    assert metrics.lighting_error(guess[:4], truth, l_max=2).per_degree[2] == 0
    with pytest.raises(ValueError, match="truth must reach"):
        metrics.lighting_error(guess, truth, l_max=4)


def test_irradiance_errors():
    truth, guess = np.zeros((9, 1)), np.zeros((9, 1))
    truth[0], guess[0], guess[2] = 1, 1, 0.3
    up = np.array([[0.0, 0, 1], [0, 0, -1], [1, 0, 0]])
    found = metrics.irradiance_errors(guess, truth, up)
    # E = pi Y_00 L_00 + (2 pi / 3) Y_10 L_10
    share = 0.3 * 2 / 3 * np.sqrt(3)
    assert float(found.max) == pytest.approx(share, rel=1e-6)
    assert float(found.mean) == pytest.approx(share * 2 / 3, rel=1e-6)


def test_picture_errors_of_known_pictures(rng, dtype):
    truth = rng.uniform(0.5, 1, (8, 8, 3)).astype(dtype)
    mask = np.ones((8, 8), dtype)
    double = metrics.picture_errors(2 * truth, truth, mask)
    assert float(double.rmse) == pytest.approx(np.sqrt(np.mean(truth**2)), rel=1e-5)
    assert float(double.si_rmse) < 1e-6
    assert float(double.angular) < 1e-4
    red, green = np.zeros((2, 8, 8, 3), dtype)
    red[..., 0], green[..., 1] = 1, 1
    assert float(metrics.picture_errors(red, green, mask).angular) == pytest.approx(90)
    half = mask.copy()
    half[:4] = 0
    green[:4] = red[:4]
    assert float(metrics.picture_errors(red, green, half).angular) == pytest.approx(90)


@pytest.mark.usefixtures("as_a_user")
def test_pictures_of_two_sizes_are_refused():
    with pytest.raises((ValueError, TypeError), match="one shape|Type-check"):
        metrics.picture_errors(np.ones((4, 8, 3)), np.ones((8, 8, 3)), np.ones((8, 8)))


def test_three_spheres_under_constant_light(dtype):
    light = np.full((16, 32, 1), 0.7, dtype)
    spheres = metrics.three_spheres(light, size=16)
    whole = np.asarray(render.sphere(16).mask) == 1
    for name in ("mirror", "diffuse"):
        np.testing.assert_allclose(spheres[name][whole], 0.7, rtol=3e-3)
    assert 0.5 < float(spheres["glossy"][8, 8, 0]) < 0.701  # masking loses some
    same = metrics.three_sphere_errors(light, light, size=16)
    assert all(float(found.rmse) == 0 for found in same.values())


@pytest.fixture
def ball(data, tmp_path):
    """A picture of a sphere by another renderer, its light, in one folder."""
    image = data / "renders/lambert/sphere_real_city_front.exr"
    io.write_image(tmp_path / "truth.exr", environment(data / "renders", "real_city"))
    return image, tmp_path


@pytest.mark.slow
@pytest.mark.usefixtures("as_a_user")
def test_estimate_and_score_a_sphere(ball):
    image, folder = ball
    circle = "64,64,60.95"  # radius 1 in a view of width 2.1
    run = CliRunner().invoke(
        estimate, [str(image), "--sphere", circle, "-o", str(folder), "--json"]
    )
    assert run.exit_code == 0, run.output
    result = json.loads(run.output)
    assert result["schema"] == "shjax.estimate/1"
    assert result["ok"]
    assert len(result["words"]) == 3
    assert result["residual_rms_over_mean"] < 0.02
    assert all(Path(name).exists() for name in result["files"].values())
    printed = StringIO()
    show(Console(file=printed), result)
    assert "degree 1: within" in printed.getvalue()
    assert "residual" in printed.getvalue()
    # Their camera looks along -z of theirs, -x of the library: half a turn about z.
    coefs = io.read_coefs(result["files"]["light.json"])
    assert coefs is not None
    turned = shjax.rotate(jnp.asarray(coefs), np.diag([-1.0, -1, 1]))
    io.write_coefs(folder / "turned.json", np.asarray(turned), format="json")
    run = CliRunner().invoke(
        score, [str(folder / "turned.json"), str(folder / "truth.exr"), "--json"]
    )
    assert run.exit_code == 0, run.output
    found = json.loads(run.output)
    assert found["lighting_error"] < 0.03
    assert found["irradiance_error"]["mean"] < 0.02
    assert found["spheres"]["diffuse"]["si_rmse"] < 0.04
    assert found["spheres"]["mirror"]["rmse"] > found["spheres"]["diffuse"]["rmse"]


@pytest.mark.usefixtures("as_a_user")
def test_estimate_from_normals_of_both_frames(ball):
    image, folder = ball
    world = np.asarray(render.sphere(128).normals, np.float32)
    io.write_image(folder / "world.exr", world)
    camera = world @ CAMERA_TO_WORLD
    seen = np.any(world != 0, axis=-1, keepdims=True)
    io.write_image(folder / "camera.exr", np.where(seen, (camera + 1) / 2, 0))
    mask = (np.asarray(render.sphere(128).mask) == 1) & (world[..., 0] < -0.2)
    io.write_image(folder / "mask.exr", mask[..., None].astype(np.float32))
    values = []
    for name, frame, span in (
        ("world", "world", "signed"),
        ("camera", "camera", "unsigned"),
    ):
        run = CliRunner().invoke(
            estimate,
            [
                str(image),
                "--normals",
                str(folder / f"{name}.exr"),
                "--normals-frame",
                frame,
                "--normals-range",
                span,
                "--mask",
                str(folder / "mask.exr"),
                "--plain",
                "-o",
                str(folder / name),
                "--json",
            ],
        )
        assert run.exit_code == 0, run.output
        values.append(np.array(json.loads(run.output)["coefficients"]))
    assert relative_error(values[0], values[1]) < 1e-4


@pytest.mark.usefixtures("as_a_user")
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "one of --sphere, --normals and --mesh"),
        (["--normals", "n.exr"], "--normals needs --normals-frame"),
        (["--mesh", "m.ply"], "--mesh needs --camera"),
        (["--sphere", "1,2"], "is not CX,CY,R"),
        (["--sphere", "900,900,3"], "covers no pixel"),
        (["--sphere", "64,64,60", "--mesh", "m.ply"], "got sphere and mesh"),
    ],
)
def test_estimate_says_what_it_needs(
    data, tmp_path, monkeypatch, capsys, options, message
):
    image = data / "renders/lambert/sphere_band2_front.exr"
    arguments = ["shjax", "estimate", str(image), "-o", str(tmp_path), *options]
    monkeypatch.setattr("sys.argv", arguments)
    with pytest.raises(SystemExit) as stop:
        cli.main()
    assert stop.value.code == 2
    assert message in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.x64
def test_the_light_of_real_photographs(data):
    """The gray sphere: every other pixel predicts the rest, 12 photographs."""
    folder = data / "photos/psm/gray"
    errors = []
    for k in range(12):
        image = np.asarray(Image.open(folder / f"gray.{k}.png"))[..., :3]
        height, width = image.shape[:2]
        row, column = np.mgrid[:height, :width]
        across, up = (column - 244.5) / 108, -(row - 144.5) / 108
        squared = 1 - across**2 - up**2
        inside = squared > 0.04
        toward = np.sqrt(np.where(inside, squared, 1))
        normals = np.stack([across, up, toward], axis=-1)[inside]
        values = image[inside]
        radiance = np.asarray(decode(jnp.asarray(values), encoding="linear").radiance)
        lit = np.all((values >= 5) & (values <= 250), axis=-1)
        fitted = (row + column)[inside] % 2 == 0
        found = shjax.estimate_lighting(
            radiance, normals, mask=(lit & fitted).astype(float)
        )
        made = (
            np.asarray(shjax.irradiance(found.full_value, jnp.asarray(normals))) / np.pi
        )
        held = lit & ~fitted
        apart = np.sqrt(np.mean((made - radiance)[held] ** 2))
        errors.append(apart / radiance[held].mean())
    assert max(errors) < 0.04, errors
