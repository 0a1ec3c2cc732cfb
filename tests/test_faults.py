"""Faults that were found by use, each with a small input and the right value."""

import json
import multiprocessing
import os
import resource
import signal
import subprocess
import sys
import threading
import warnings
from concurrent.futures import ThreadPoolExecutor

import click
import jax
import jax.numpy as jnp
import numpy as np
import OpenEXR
import OpenImageIO as oiio
import pytest
from click.testing import CliRunner

import shjax
from shjax import io, lights, metrics, render
from shjax.cli import pictures, surface
from shjax.cli.light import light
from shjax.cli.many import alone, expand
from shjax.cli.remap import remap
from shjax.io import isolation
from shjax.io.writing import json_text
from shjax.sphere import latlong_directions, latlong_solid_angles
from tests.helpers import relative_error, unit_vectors

pytestmark = pytest.mark.usefixtures("as_a_user")


@pytest.fixture
def numbered(tmp_path):
    """Sixteen files, each of which holds its own number."""
    for k in range(16):
        io.write_image(tmp_path / f"{k}.exr", np.full((8, 16, 3), k, np.float32))
    return tmp_path


def _own_number(folder_and_number) -> bool:
    folder, k = folder_and_number
    return bool(np.all(io.read_image(folder / f"{k}.exr", isolate=True) == k))


def test_threads_read_their_own_files(numbered):
    jobs = [(numbered, k % 16) for k in range(64)]
    with ThreadPoolExecutor(4) as threads:
        assert all(threads.map(_own_number, jobs))
        plain = lambda job: np.all(io.read_image(job[0] / f"{job[1]}.exr") == job[1])  # noqa: E731
        assert all(threads.map(plain, jobs))
    isolation.stop()


def test_forked_processes_read_their_own_files(numbered):
    assert _own_number((numbered, 0))  # the parent has a worker
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # JAX and Python warn of any fork
        context = multiprocessing.get_context("fork")
        with context.Pool(2) as pool:
            found = pool.map(_own_number, [(numbered, k) for k in range(16)])
    assert all(found)


def test_a_relative_path_is_of_the_current_folder(numbered, monkeypatch):
    monkeypatch.chdir(numbered)
    assert io.read_image("3.exr", isolate=True).max() == 3
    (numbered / "other").mkdir()
    io.write_image("other/3.exr", np.full((8, 16, 3), 77, np.float32))
    monkeypatch.chdir(numbered / "other")
    assert io.read_image("3.exr", isolate=True).max() == 77
    with pytest.raises(OSError, match=r"^gone.exr: "):
        io.read_image("gone.exr", isolate=True)


def test_modules_of_the_current_folder_are_not_run(numbered, monkeypatch):
    monkeypatch.chdir(numbered)
    for name in ("random", "jax", "numpy"):
        (numbered / f"{name}.py").write_text("raise SystemExit('was run')")
    isolation.stop()
    assert io.read_image("3.exr", isolate=True).max() == 3


@pytest.mark.parametrize("kind", [tuple, list, np.array])
def test_a_camera_of_whole_numbers_is_that_of_floats(kind):
    ball = render.sphere(64, render.Camera(origin=kind((-4, 0, 0)), width=2.1))
    assert float(ball.mask.mean()) == pytest.approx(np.pi / 2.1**2, abs=1e-3)
    assert render.Camera(origin=kind((-4, 0, 0))) == render.Camera()


def test_what_is_no_camera_is_refused_by_name():
    for name, value in (
        ("origin", (1, 2)),
        ("up", "z"),
        ("target", (0, np.nan, 0)),
        ("width", True),
        ("fov", [1]),
    ):
        with pytest.raises(ValueError, match=f"camera.{name} must be"):
            render.Camera(**{name: value})


def test_eight_bits_are_no_light_or_albedo():
    normals = np.tile(np.float32([0, 0, 1]), (2, 2, 1))
    white = np.full((2, 2, 3), 255, np.uint8)
    for call in (
        lambda: render.make_gbuffer(normals, albedo=white),
        lambda: render.sphere(8, albedo=np.uint8(255)),
        lambda: shjax.estimate_lighting(normals, normals, albedo=white),
    ):
        with pytest.raises(ValueError, match="albedo must hold floating-point"):
            call()
    with pytest.raises(ValueError, match="mask must hold floating-point"):
        shjax.estimate_lighting(normals, normals, mask=white[..., 0])
    with pytest.raises(ValueError, match="image must hold floating-point"):
        shjax.make_envmap(np.ones((8, 16, 3), np.uint8))


def test_writers_refuse_what_a_format_cannot_hold(tmp_path):
    pixel = np.array([[[1, -0.02, 0.5]]])
    for name, value, words in (
        ("a.hdr", pixel, "negative, the first at row 0, column 0, channel 1"),
        ("a.hdr", pixel * np.inf, "infinite"),
        ("a.png", pixel * np.nan, "NaN"),
        ("a.exr", pixel * 1e300, "beyond float32"),
        ("a.exr", np.ones((1, 1, 3), np.uint8), "floating point"),
    ):
        with pytest.raises(ValueError, match=words):
            io.write_image(tmp_path / name, value)
    assert not list(tmp_path.iterdir())
    with pytest.raises(ValueError, match="coefs must be finite"):
        io.write_coefs(tmp_path / "a.json", np.full((9, 3), np.nan), "json")
    with pytest.raises(ValueError, match=r"result.a is not a number"):
        json_text({"a": [1.0, np.nan]})
    assert json.loads(json_text({"a": np.inf})) == {"a": None}


def test_encoded_values_go_into_a_png_as_they_are(tmp_path):
    image = np.arange(48, dtype=np.uint8).reshape(4, 4, 3) * 5
    io.write_image(tmp_path / "a.png", image)
    held = oiio.ImageBuf(str(tmp_path / "a.png")).get_pixels(oiio.UINT8)
    np.testing.assert_array_equal(held, image)


def test_pipes_and_links_are_written_through(tmp_path):
    pipe, link, plain = (tmp_path / name for name in ("p.png", "l.png", "r.png"))
    os.mkfifo(pipe)
    read = []
    reader = threading.Thread(target=lambda: read.append(pipe.read_bytes()))
    reader.start()
    io.write_image(pipe, np.ones((4, 4, 3)))
    reader.join()
    assert read[0].startswith(b"\x89PNG")
    assert pipe.is_fifo()
    io.write_image(plain, np.ones((4, 4, 3)))
    link.symlink_to(plain)
    io.write_image(link, np.zeros((4, 4, 3)))
    assert link.is_symlink()
    assert io.read_image(plain).max() == 0


@pytest.mark.parametrize("name", ["a.png", "a.hdr", "a.exr"])
def test_a_full_disk_leaves_nothing_and_is_told(tmp_path, monkeypatch, rng, name):
    monkeypatch.chdir(tmp_path)
    image = rng.uniform(size=(64, 64, 3))
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, hard))
    try:
        with pytest.raises(OSError, match=f"^{name}: ") as caught:
            io.write_image(name, image)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, before)
    assert "/." not in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_results_in_a_folder_are_no_inputs(tmp_path):
    for name in ("a.exr", "b.exr", "a_irradiance.exr", "a_spheres.png", "c_light.exr"):
        (tmp_path / name).touch()
    record = {"schema": "shjax.estimate/1", "files": {"x": "far/c_light.exr"}}
    (tmp_path / "c_light.json").write_text(json.dumps(record))
    assert [path.name for path in expand([tmp_path])] == ["a.exr", "b.exr"]


def test_old_run_lengths_of_runs_upon_runs(tmp_path):
    """A second repeat counts 256 times: 1 + 3 + 2 x 256 pixels."""
    line = bytes([9, 8, 7, 130, 1, 1, 1, 3, 1, 1, 1, 2])
    head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2\t+X 516\n"
    (tmp_path / "a.hdr").write_bytes(head + 2 * line)
    image = io.read_image(tmp_path / "a.hdr")
    expected = np.ldexp(np.float32([9.5, 8.5, 7.5]), 130 - 136)
    np.testing.assert_array_equal(image, np.broadcast_to(expected, (2, 516, 3)))
    (tmp_path / "a.hdr").write_bytes(head + 2 * line[:-4])
    with pytest.raises(ValueError, match="damaged or cut off"):
        io.read_image(tmp_path / "a.hdr")


def test_flat_pixels_that_look_like_an_encoding(tmp_path, rng):
    rgbe = rng.integers(2, 250, (3, 16, 4), dtype=np.uint8)
    rgbe[1, 0], rgbe[2, 5] = [2, 2, 0, 16], [1, 1, 1, 200]
    head = b"#?RADIANCE\n\n-Y 3 +X 16\n"
    (tmp_path / "a.hdr").write_bytes(head + rgbe.tobytes())
    expected = np.ldexp(
        rgbe[..., :3] + np.float32(0.5), rgbe[..., 3:].astype(int) - 136
    )
    np.testing.assert_array_equal(io.read_image(tmp_path / "a.hdr"), expected)


def test_channels_by_their_whole_names_and_red_alone(tmp_path, rng):
    image = rng.uniform(size=(4, 8, 3)).astype(np.float32)
    planes = dict(zip(("red", "green", "blue"), np.moveaxis(image, -1, 0), strict=True))
    planes = {name: plane.copy() for name, plane in planes.items()}
    OpenEXR.File({}, planes).write(str(tmp_path / "a.exr"))
    np.testing.assert_array_equal(io.read_image(tmp_path / "a.exr"), image)
    OpenEXR.File({}, {"R": planes["red"]}).write(str(tmp_path / "a.exr"))
    np.testing.assert_array_equal(io.read_image(tmp_path / "a.exr"), image[..., :1])


def test_normals_are_vectors_not_colours(tmp_path, rng):
    vectors = rng.normal(size=(4, 8, 3)).astype(np.float32)
    planes = {f"nn.{c}": vectors[..., k].copy() for k, c in enumerate("XYZ")}
    path = tmp_path / "n.exr"
    OpenEXR.File({}, planes).write(str(path))
    with pytest.raises(ValueError, match="are vectors, not colours"):
        io.read_image(path)
    for isolate in (False, True):
        np.testing.assert_array_equal(io.read_vectors(path, isolate=isolate), vectors)
    more = {f"ViewLayer.Normal.{c}": vectors[..., k] + 1 for k, c in enumerate("XYZ")}
    OpenEXR.File({}, planes | more).write(str(path))
    np.testing.assert_array_equal(io.read_vectors(path), vectors + 1)
    np.testing.assert_array_equal(io.read_vectors(path, layer="nn"), vectors)


def test_probes_of_editors_and_scenes(tmp_path, rng):
    grey = rng.normal(size=(9, 1)).astype(np.float32)
    path = tmp_path / "a.json"
    io.write_coefs(path, grey, "three")
    colour = np.repeat(grey, 3, axis=1)
    np.testing.assert_allclose(io.read_coefs(path), colour, atol=1e-6)
    probe = json.loads(path.read_text())["object"]
    scene = {"object": {"type": "Scene", "children": [{"type": "Group"}, probe]}}
    path.write_text(json.dumps(scene), encoding="utf-8-sig")
    np.testing.assert_allclose(io.read_coefs(path), colour, atol=1e-6)


def test_a_closed_pipe_and_a_name_of_no_encoding(tmp_path):
    name = os.fsencode(tmp_path) + b"/\xff.exr"
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "shjax",
            "convert",
            name,
            tmp_path / "a.json",
            "--to",
            "json",
        ],
        capture_output=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr.count(b"\n") == 1
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "shjax",
            "convert",
            io.shipped_panorama(),
            tmp_path / "a.json",
            "--to",
            "json",
        ],
        stdout=write,
        stderr=subprocess.PIPE,
        check=False,
    )
    os.close(write)
    assert (done.returncode, done.stderr) == (1, b"")
    assert io.read_coefs(tmp_path / "a.json").shape == (9, 3)


def test_derivatives_where_a_fit_ends(dtype):
    truth = jnp.ones((4, 4, 3), dtype).at[0, 0].set(0)
    mask = jnp.ones((4, 4), dtype)

    def total(picture):
        return sum(jax.tree.leaves(metrics.picture_errors(picture, truth, mask)))

    for picture in (truth, -truth, 0 * truth):
        assert np.all(np.isfinite(jax.grad(total)(picture)))
    nine = jnp.ones((9, 3), dtype)
    found = jax.grad(lambda c: metrics.lighting_error(c, nine).total)(nine)
    assert np.all(np.isfinite(found))


def test_dark_channels_do_not_smooth_the_others(rng, dtype):
    lighting = rng.normal(size=(9, 3))
    lighting[0] = [8, 1e-6, 8]
    found = shjax.dering(jnp.asarray(lighting, dtype))
    np.testing.assert_array_equal(
        found.lighting[:, ::2], jnp.asarray(lighting[:, ::2], dtype)
    )
    assert found.smallest > -1e-5
    lighting[0, 1] = 0
    with pytest.raises(ValueError, match="channel 1 has L_00 = 0"):
        shjax.dering(jnp.asarray(lighting, dtype))
    lighting[:, 1] = 0
    assert shjax.dering(jnp.asarray(lighting, dtype)).strength == 0


def test_a_small_light_is_found_at_any_resolution(rng):
    rows = 64
    fine = latlong_directions(4 * rows, 8 * rows)
    solid = latlong_solid_angles(rows, 2 * rows)[:, None]
    for _ in range(6):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        disc = fine @ axis > np.cos(np.radians(2.5))
        share = disc.reshape(rows, 4, 2 * rows, 4).mean(axis=(1, 3))
        level = 4 * np.pi * 0.4 / 0.6 / np.sum(share * solid)
        image = np.ones((rows, 2 * rows, 3)) + (level * share)[..., None]
        found, _ = shjax.split_lights(shjax.make_envmap(image.astype(np.float32)))
        assert len(found.heights) == 1
        assert float(jnp.degrees(found.angles[0])) < 4
    image = np.ones((rows, 2 * rows, 3), np.float32)
    image[0] = 5000
    found, _ = shjax.split_lights(shjax.make_envmap(image))
    assert float(jnp.degrees(found.angles[0])) == pytest.approx(180 / rows, rel=1e-3)


@pytest.mark.parametrize("degrees", [5, 20, 90])
def test_caps_are_the_same_inside_jit_and_vmap(degrees, dtype):
    cap = lights.cap_light(
        jnp.asarray([0.0, 0.6, 0.8], dtype), np.radians(degrees), jnp.ones(3, dtype)
    )
    up = jnp.asarray([[0.0, 0, 1], [0, 0.6, 0.8]], dtype)
    shine = lambda some: lights.cap_reflection(some, shjax.brdf.ggx(0.3), up, up)  # noqa: E731
    plain = shine(cap)
    np.testing.assert_allclose(jax.jit(shine)(cap), plain, rtol=1e-5)
    many = jax.tree.map(lambda a: a[None], cap)
    np.testing.assert_allclose(jax.vmap(shine)(many)[0], plain, rtol=1e-5)


@pytest.mark.x64
def test_caps_over_smooth_surfaces(rng):
    """Against even directions, dense enough; a white furnace of two hemispheres."""
    normals = unit_vectors(rng, 12)
    views = normals + 0.7 * unit_vectors(rng, 12)
    views /= np.linalg.norm(views, axis=1, keepdims=True)
    facing = np.sum(normals * views, axis=1)
    towards = 2 * facing[:, None] * normals - views
    axis = towards[0] + 0.02 * unit_vectors(rng, 1)[0]
    axis /= np.linalg.norm(axis)
    model = shjax.brdf.ggx(0.05, 1.0)
    for angle, rings in ((3, 12), (90, 240)):
        cap = lights.cap_light(jnp.asarray(axis), np.radians(angle), jnp.ones(1))
        found = lights.cap_reflection(cap, model, normals, views)[:, 0]
        nodes, shares = lights.cap_nodes(cap, jnp.float64, rings, 2 * rings)
        light = shjax.EnvironmentMap.from_samples(
            jnp.ones((nodes.shape[1], 1)), nodes[0], shares * cap.flux[0, 0]
        )
        pair = (jnp.asarray(normals), jnp.asarray(views))
        exact = shjax.reference_reflection(light, model, *pair)[:, 0]
        assert relative_error(found, exact) < 3e-3
    sky = lights.hemisphere_light(jnp.asarray([0.3, 0, 1]), jnp.ones(1), jnp.ones(1))
    white = lights.cap_reflection(sky, model, normals, views)[:, 0]
    every = lights.cap_light(jnp.asarray(axis), np.pi, jnp.ones(1))
    np.testing.assert_allclose(
        white, lights.cap_reflection(every, model, normals, views)[:, 0], rtol=5e-3
    )
    assert np.all((white > 0.9) & (white < 1.001))


def test_what_is_printed_fits_a_screen(dtype):
    envmap = shjax.make_envmap(np.ones((8, 16, 3), np.float32))
    light = shjax.prefilter_light(jnp.ones((9, 3), dtype), maps=4)
    for thing in (envmap, light, lights.cap_light(jnp.eye(3)[0], 0.1, jnp.ones(3))):
        assert len(repr(thing).splitlines()) <= 3
        assert type(thing).__name__ in repr(thing)


def test_normals_and_masks_of_other_tools(tmp_path):
    """OpenCV's frame in a layer, NaN outside the mask, which is a PNG of 0 and 1."""
    ball = render.sphere(32)
    world, inside = np.asarray(ball.normals), np.asarray(ball.mask) == 1
    camera = world @ surface.CAMERA_TO_WORLD
    opencv = np.where(inside[..., None], camera * [1, -1, -1], np.nan)
    planes = {
        f"ViewLayer.Normal.{c}": opencv[..., k].astype(np.float32)
        for k, c in enumerate("XYZ")
    }
    normals, mask = tmp_path / "n.exr", tmp_path / "m.png"
    OpenEXR.File({}, planes).write(str(normals))
    io.write_image(mask, np.repeat(inside[..., None], 3, axis=-1).astype(np.uint8))
    shown = surface.of_normals((32, 32), normals, "opencv", True, mask, None)
    used = np.asarray(shown.mask) > 0
    facing = inside & (camera[..., 2] > 0.2)
    np.testing.assert_array_equal(used, facing)
    np.testing.assert_allclose(shown.normals[used], world[used], atol=1e-6)
    with pytest.raises(click.UsageError, match="no normal of .* faces the camera"):
        surface.of_normals((32, 32), normals, "camera", True, mask, None)
    io.write_image(mask, np.ones((32, 32, 3)))
    with pytest.raises(click.UsageError, match="not finite where --mask is white"):
        surface.of_normals((32, 32), normals, "opencv", True, mask, None)


def test_a_sphere_costs_its_own_pixels():
    window, factor, circle = surface.crop_to_sphere((3000, 4000), (2000.5, 900, 600))
    assert factor == 3
    rows, columns = (part.stop - part.start for part in window)
    assert max(rows, columns) < 1210
    shown = surface.of_sphere((rows // 3, columns // 3), circle)
    area = float(np.asarray(shown.gbuffer.mask).sum())
    assert area == pytest.approx(np.pi * 200**2, rel=1e-3)


def test_large_tables_are_arguments_of_programs(dtype):
    """Neither in a program anew nor computed with while it is compiled."""

    def constants(jaxpr):
        held = [np.asarray(c).nbytes for c in jaxpr.consts]
        for eqn in jaxpr.jaxpr.eqns:
            inner = eqn.params.get("jaxpr")
            if hasattr(inner, "consts"):
                held += constants(inner)
        return held

    image = jnp.ones((258, 512, 1), dtype)
    coefs = jnp.ones((129**2, 1), dtype)
    large = jnp.ones((402, 804, 1), dtype)
    rho = jnp.ones((129, 2, 2, 1), dtype)
    calls = {
        "_analyze_by": (lambda a: shjax.analyze(a, l_max=128), image),
        "_analyze_by above": (lambda a: shjax.analyze(a, l_max=200), large),
        "_synthesize_by": (
            lambda a: shjax.synthesize(a, n_theta=258, n_phi=512),
            coefs,
        ),
        "_on_grids": (lambda a: shjax.prefilter_light(a, maps=4), coefs),
        "_rotate": (lambda a: shjax.rotate(a, jnp.eye(3, dtype=dtype)), coefs),
        "on_grid": (lambda a: shjax.prefilter(a, rho), coefs),
    }
    for name, (call, argument) in calls.items():
        outer = jax.make_jaxpr(call)(argument)
        own = [e for e in outer.jaxpr.eqns if e.params.get("name") == name.split()[0]]
        assert len(own) == 1, name
        assert max(constants(own[0].params["jaxpr"]), default=0) < 2**20, name


def test_runs_that_meet_in_a_folder(tmp_path, rng):
    """One name is written by one run: another leaves it, and says so; none is left over."""
    new = tmp_path / "new"
    busy = pytest.raises(ValueError, match="another run")
    with alone(new, "a"), busy, alone(new, "a"):
        pass
    assert not (tmp_path / "new").exists()
    for name in "ab":
        image = rng.uniform(1, 2, (8, 16, 3)).astype(np.float32)
        io.write_image(tmp_path / f"{name}.exr", image)
    out = tmp_path / "out"
    call = [str(tmp_path), "--out", str(out), "--size", "8"]
    with alone(out, "a"):
        run = CliRunner().invoke(light, call)
    assert run.exit_code == 0, run.output
    assert "2 files: 1 done, 1 left to another run" in run.output
    run = CliRunner().invoke(light, call)
    assert "b.exr" in run.output
    assert "(kept, from 20" in run.output
    assert "1 done, 1 kept" in run.output
    assert not [path for path in out.iterdir() if path.suffix == ".lock"]


def test_negative_colours_of_a_conversion(tmp_path):
    """``--primaries keep`` leaves a file's own; .hdr holds none that are negative."""
    chromaticities = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)
    pixels = np.zeros((8, 16, 3), np.float32)
    pixels[...] = [0.02, 1, 0.02]  # greener than Rec. 709 can be
    path = tmp_path / "aces.exr"
    header = {"chromaticities": chromaticities}
    OpenEXR.File(header, {"RGB": pixels}).write(str(path))
    for target, extra in (("a.exr", ["--primaries", "keep"]), ("b.hdr", [])):
        run = CliRunner().invoke(
            remap, [str(path), str(tmp_path / target), "--to", "latlong", *extra]
        )
        assert run.exit_code == 0, run.output
    assert "are black in .hdr" in run.output
    kept = io.read_image(tmp_path / "a.exr", primaries="keep")
    np.testing.assert_allclose(kept, pixels, rtol=1e-3)
    assert 0 <= io.read_image(tmp_path / "b.hdr").min() < 0.005  # of RGBE


def test_pictures_say_what_they_show():
    values, shown = pictures.compare(
        np.full((16, 16, 3), 0.5), np.full((16, 16, 3), 0.6), "ours | theirs | apart"
    )
    assert values.shape == (16, 48, 3)
    assert shown.shape[1] >= 3 * 288
    captions = shown[shown.shape[1] // 3 :]
    for panel in np.split(captions, 3, axis=1):
        assert 0.005 < np.mean(panel > 0.5) < 0.5


@pytest.mark.parametrize("faces", [1, 3])
def test_error_bars_of_a_box_know_what_it_does_not_show(faces, dtype):
    """One face, or three, and a lamp where none looks: no number beyond four deviations."""
    box = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]])[:faces]
    normals = jnp.asarray(np.repeat(box, 150, axis=0), dtype)
    rng = np.random.default_rng(3)
    panorama = np.asarray(io.read_envmap(io.shipped_panorama()).to_latlong(64).radiance)
    directions = latlong_directions(64, 128)
    for strength in (1.0, 30.0, 300.0):
        towards = -np.abs(unit_vectors(rng, 1)[0])  # behind all the faces
        lamp = strength * np.exp(80 * (directions @ towards - 1))[..., None]
        light = shjax.analyze(jnp.asarray(panorama + lamp, dtype), l_max=30)
        picture = np.asarray(shjax.irradiance(light, normals) / np.pi)
        noisy = picture + 0.01 * picture.mean() * rng.normal(size=picture.shape)
        found = shjax.estimate_lighting(jnp.asarray(noisy, dtype), normals)
        z = np.abs(np.asarray(found.value - light[:9])) / found.standard_deviation
        assert np.max(z) < 4, strength
