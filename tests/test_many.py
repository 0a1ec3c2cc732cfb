"""Many files by one command: bad ones, folders, resuming, killing; maps in and out."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import OpenEXR
import OpenImageIO as oiio
import pytest

from shjax import io
from shjax.cli.many import expand, output_names, stamp
from shjax.display import tone_map
from shjax.io.writing import protecting, replacing
from tests.helpers import relative_error
from tests.test_cli import shell


@pytest.fixture
def folder(tmp_path, rng):
    maps = tmp_path / "maps"
    maps.mkdir()
    for name in ("a.exr", "b.exr", "c.hdr"):
        io.write_image(maps / name, rng.uniform(0.5, 2, (16, 32, 3)).astype(np.float32))
    (maps / "bad.exr").write_bytes((maps / "a.exr").read_bytes()[:700])
    (maps / "notes.txt").write_text("not a map")
    return maps


@pytest.mark.slow
def test_a_folder_with_a_bad_file(folder):
    out = folder.parent / "out"
    call = ("light", folder, "--out", out, "--size", 16)
    first = shell(*call)
    assert first.returncode == 2
    assert first.stderr.startswith("shjax: ")
    assert "bad.exr" in first.stderr
    assert first.stderr.count("\n") == 1
    lines = first.stdout.splitlines()
    assert [line.split(":")[0] for line in lines[:3]] == ["a.exr", "b.exr", "c.hdr"]
    assert lines[3].startswith("4 files: 3 done, 1 refused")
    before = {p.name: p.stat().st_mtime_ns for p in out.iterdir()}
    (out / "b_irradiance.png").unlink()
    io.write_image(folder / "c.hdr", np.ones((16, 32, 3), np.float32))
    second = shell(*call)
    assert "4 files: 2 done, 1 kept, 1 refused" in second.stdout
    after = {p.name: p.stat().st_mtime_ns for p in out.iterdir()}
    assert after.keys() == before.keys()
    assert {n[0] for n in after if after[n] == before[n]} == {"a"}
    third = shell(*call, "--json", "--force")
    objects = [json.loads(line) for line in third.stdout.splitlines()]
    assert [o["source"][-5:] for o in objects] == ["a.exr", "b.exr", "c.hdr"]
    assert (out / "a_lighting.json").stat().st_mtime_ns > after["a_lighting.json"]


def test_killed_at_any_moment(folder):
    out = folder.parent / "out"
    call = [
        sys.executable,
        "-m",
        "shjax",
        "light",
        folder,
        "--out",
        out,
        "--size",
        "16",
        "--checks",
    ]
    for seconds in (3,):
        # Without the others' cache, which it could leave half written.
        alone = {k: v for k, v in os.environ.items() if not k.startswith("JAX")}
        alone["SHJAX_CACHE"] = str(folder.parent / "cache")
        process = subprocess.Popen(
            call, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=alone
        )
        time.sleep(seconds)
        process.send_signal(signal.SIGKILL)
        process.wait()
        for path in out.glob("[abc]*"):  # whatever is there is whole
            if path.suffix == ".json":
                assert json.loads(path.read_text())["files"]
            else:
                assert io.read_image(path).size
    assert shell(*call[3:]).returncode == 2  # for the bad file
    assert {p.name for p in out.iterdir()} == {
        f"{n}_{part}"
        for n in "abc"
        for part in (
            "lighting.json",
            "irradiance.exr",
            "irradiance.png",
            "spheres.exr",
            "spheres.png",
        )
    }


def test_what_a_killed_process_left_is_removed(tmp_path):
    target = tmp_path / "a.exr"
    gone = subprocess.Popen(["true"])
    gone.wait()
    left = tmp_path / f".a-{gone.pid}-x1y2.exr"
    mine = tmp_path / f".a-{os.getpid()}-x1y2.exr"
    other = tmp_path / f".b-{gone.pid}-x1y2.exr"
    for path in (left, mine, other):
        path.write_text("half")
    io.write_image(target, np.ones((2, 4, 3), np.float32))
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(
        [mine.name, other.name, "a.exr"]
    )


def test_inputs_are_never_written_over(tmp_path):
    path = tmp_path / "a_irradiance.exr"
    io.write_image(path, np.ones((8, 16, 3), np.float32))
    with (
        protecting(path),
        pytest.raises(FileExistsError, match="is an input"),
        replacing(path),
    ):
        pass
    os.link(path, tmp_path / "a.exr")  # the same file by another name
    before = path.read_bytes()
    finished = shell("light", tmp_path / "a.exr", "--out", tmp_path, "--size", 16)
    assert finished.returncode == 2
    assert "is an input, which is not written over" in finished.stderr
    assert path.read_bytes() == before
    finished = shell("remap", path, path, "--to", "angular")
    assert finished.returncode == 2
    assert path.read_bytes() == before


def test_folders_and_names(folder, tmp_path):
    assert [p.name for p in expand([folder])] == ["a.exr", "b.exr", "bad.exr", "c.hdr"]
    assert len(expand([folder, folder / "a.exr"])) == 4
    assert output_names(
        [tmp_path / "a.exr", tmp_path / "a.hdr", tmp_path / "b.exr"]
    ) == ["a_exr", "a_hdr", "b"]
    empty = tmp_path / "empty"
    empty.mkdir()
    finished = shell("light", empty, "--out", tmp_path / "out")
    assert finished.returncode == 2
    assert "holds no environment map" in finished.stderr


def test_remap(tmp_path, rng):
    smooth = io.read_envmap(io.shipped_panorama()).to_latlong(64)
    source = tmp_path / "a.exr"
    io.write_image(source, smooth.radiance)
    coefs = smooth.lighting(l_max=2)
    for layout in ("mirror_ball", "openexr_cube"):
        target = tmp_path / "out" / f"{layout}.exr"
        finished = shell(
            "remap",
            source,
            target,
            "--to",
            layout,
            "--half",
            "--compression",
            "piz",
            "--json",
        )
        assert finished.returncode == 0, finished.stderr
        assert json.loads(finished.stdout)["files"] == [str(target)]
        header = OpenEXR.File(str(target), header_only=True).header()
        assert header["compression"] == OpenEXR.PIZ_COMPRESSION
        assert header["layout"] == layout
        assert header["source"] == "a.exr"
        assert "frame" in header
        read = io.read_envmap(
            target, layout="mirror_ball" if layout == "mirror_ball" else "auto"
        )
        assert "half" in read.report.format
        assert read.layout == layout
        assert relative_error(read.lighting(l_max=2), coefs) < 1e-2
    finished = shell(
        "remap", source, tmp_path / "sky.hdr", "--to", "faces", "--size", 64
    )
    assert finished.returncode == 0, finished.stderr
    faces = sorted(tmp_path.glob("sky_*.hdr"))
    assert len(faces) == 6
    cube = tmp_path / "cube"
    cube.mkdir()
    for face in faces:
        face.rename(cube / face.name)
    finished = shell("remap", cube, tmp_path / "back.exr", "--size", 64)
    assert finished.returncode == 0, finished.stderr
    assert "six faces" in finished.stdout
    assert (
        relative_error(io.read_envmap(tmp_path / "back.exr").lighting(l_max=2), coefs)
        < 1e-2
    )


def test_remap_turns_and_brightens(tmp_path):
    image = np.full((32, 64, 3), 0.1, np.float32)
    image[14:18, 30:34] = 5  # ahead
    io.write_image(tmp_path / "a.exr", image)
    shell(
        "remap",
        tmp_path / "a.exr",
        tmp_path / "b.exr",
        "--rotate",
        "90,0,0",
        "--exposure",
        1,
    )
    turned = io.read_image(tmp_path / "b.exr")
    assert np.unravel_index(turned[..., 0].argmax(), turned.shape[:2])[1] in range(
        14, 18
    )  # the left
    assert turned.max() == pytest.approx(10, rel=0.01)


def test_tone_mapping_by_aces_is_opencolorios(rng):
    image = rng.lognormal(size=(4, 5, 3)).astype(np.float32)
    shown = tone_map(image, operator="aces")
    config = oiio.ColorConfig("ocio://default")
    assert any("ACES 2.0" in view for view in config.getViewNames("sRGB - Display"))
    theirs = oiio.ImageBufAlgo.ociodisplay(
        oiio.ImageBuf(image),
        "sRGB - Display",
        "ACES 2.0 - SDR 100 nits (Rec.709)",
        "Linear Rec.709 (sRGB)",
        colorconfig="ocio://default",
    ).get_pixels(oiio.FLOAT)
    encoded = np.where(
        shown <= 0.0031308, 12.92 * shown, 1.055 * shown ** (1 / 2.4) - 0.055
    )
    np.testing.assert_allclose(encoded, np.clip(theirs, 0, 1), atol=2e-5)
    grey = tone_map(np.full((1, 1, 1), 0.18, np.float32), operator="aces")
    assert 0.05 < float(grey[0, 0, 0]) < 0.2
    np.testing.assert_allclose(tone_map(image, operator="linear"), np.clip(image, 0, 1))
    with pytest.raises(ValueError, match="operator must be one of"):
        tone_map(image, operator="filmic")


@pytest.mark.parametrize("compression", ["none", "zips", "piz", "dwaa"])
@pytest.mark.parametrize("half", [False, True])
def test_writing_options(tmp_path, rng, compression, half):
    image = rng.uniform(0.5, 2, (16, 32, 3)).astype(np.float32)
    path = tmp_path / "a.exr"
    io.write_image(
        path, image, half=half, compression=compression, layout="openexr_latlong"
    )
    file = OpenEXR.File(str(path), separate_channels=True)
    assert file.channels()["R"].pixels.dtype == (np.float16 if half else np.float32)
    assert io.read_envmap(path).layout == "openexr_latlong"
    limit = 0.05 if compression == "dwaa" else 1e-3 if half else 0
    np.testing.assert_allclose(io.read_image(path), image, rtol=limit)


def test_half_is_clipped_where_it_ends(tmp_path):
    image = np.full((2, 4, 3), 1e6, np.float32)
    io.write_image(tmp_path / "a.exr", image, half=True)
    assert np.all(io.read_image(tmp_path / "a.exr") == 65504)
    with pytest.raises(ValueError, match="compression must be one of"):
        io.write_image(tmp_path / "a.exr", image, compression="best")


def test_a_file_that_is_missing_is_named_first(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"^.*missing\.exr: No such file"):
        stamp(tmp_path / "missing.exr")
