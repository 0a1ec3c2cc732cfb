"""Reading anything and refusing clearly: valid kinds arrive right, hostile ones are told."""

import os
import struct
import subprocess
import sys
import time

import numpy as np
import OpenEXR
import OpenImageIO as oiio
import pytest

from shjax import io
from shjax.io import colour_spaces, isolation
from shjax.srgb import decode_srgb
from tests.variants import (
    P_CG,
    VARIANTS,
    WIDTH,
    coloured,
    exr,
    parts,
    picture,
    plain_exr,
    with_alpha,
)


def write(folder, name):
    suffix, writer, tolerance, factor = VARIANTS[name]
    path = folder / f"a{suffix}"
    writer(path, picture())
    return path, max(tolerance, 1e-6), factor


@pytest.mark.parametrize("name", VARIANTS)
def test_valid_kinds_are_read_right(tmp_path, name):
    path, tolerance, factor = write(tmp_path, name)
    image = io.read_image(path)
    assert image.dtype == np.float32
    np.testing.assert_allclose(image / np.float32(factor), picture(), rtol=tolerance)


def test_valid_kinds_are_read_alike_by_the_worker(tmp_path):
    for number, name in enumerate(VARIANTS):
        folder = tmp_path / str(number)
        folder.mkdir()
        path, _, _ = write(folder, name)
        here, there = io.read_envmap(path), io.read_envmap(path, isolate=True)
        np.testing.assert_array_equal(here.image, there.image, err_msg=name)
        assert here.report == there.report
    assert len(VARIANTS) >= 40


def test_what_was_done_is_said(tmp_path):
    said = {
        "exr mixed": "OpenEXR half/float",
        "exr parts": "layer sky",
        "exr acescg": "ACEScg converted to Rec. 709",
        "exr xyz": "CIE XYZ converted to Rec. 709",
        "exr alpha": "alpha dropped",
        "exr overscan": "cropped to its display window",
        "hdr gamma": "gamma undone",
        "hdr exposure": "exposure undone",
        "png 16 bit": "16-bit sRGB decoded",
        "tiff float": "linear",
    }
    for name, words in said.items():
        path, _, _ = write(tmp_path, name)
        assert words in str(io.read_envmap(path).report), name


def test_parts_and_layers_by_name(tmp_path):
    path = tmp_path / "a.exr"
    parts(path, picture())
    np.testing.assert_array_equal(io.read_image(path, layer="other"), 2 * picture())
    with pytest.raises(ValueError, match=r"layer 'sun' is not among .*: sky, other"):
        io.read_image(path, layer="sun")
    with pytest.raises(ValueError, match="only an EXR has"):
        io.read_image(write(tmp_path, "pfm big")[0], layer="sky")


def test_alpha(tmp_path):
    path = tmp_path / "a.exr"
    with_alpha(path, picture())
    np.testing.assert_allclose(
        io.read_image(path, alpha="unpremultiply"), 2 * picture(), rtol=1e-6
    )
    with pytest.raises(ValueError, match="alpha must be one of drop, unpremultiply"):
        io.read_image(path, alpha="keep")


@pytest.mark.parametrize(
    ("name", "multiplied", "kind"),
    [("a.png", False, "uint8"), ("a.tif", False, "uint8"), ("b.tif", True, "float")],
)
def test_alpha_of_other_formats(tmp_path, rng, name, multiplied, kind):
    # A PNG's colours, and an unassociated TIFF's, are read as they are stored.
    colours = rng.uniform(0.2, 1, (4, 8, 3)).astype(np.float32)
    cover = np.full((4, 8, 1), 0.5, np.float32)
    stored = colours * cover if multiplied else colours
    spec = oiio.ImageSpec(8, 4, 4, kind)
    spec.attribute("oiio:UnassociatedAlpha", int(not multiplied))
    target = oiio.ImageOutput.create(str(tmp_path / name))
    assert target.open(str(tmp_path / name), spec)
    target.write_image(np.concatenate([stored, cover], axis=-1))
    target.close()
    if kind == "uint8":
        stored = colours = decode_srgb(np.round(colours * 255) / 255)
    for alpha, expected in (("drop", stored), ("unpremultiply", colours)):
        read = io.read_envmap(tmp_path / name, alpha=alpha)
        np.testing.assert_allclose(read.image, expected, rtol=1e-4, err_msg=alpha)
        divided = multiplied and alpha == "unpremultiply"
        assert ("divided by alpha" if divided else "alpha dropped") in str(read.report)


def test_any_program_may_have_written_a_radiance_picture(tmp_path):
    path = tmp_path / "a.hdr"
    head = b"#?%s\nEXPOSURE=4\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n"
    images = []
    for program in (b"RADIANCE", b"AUTOPANO"):
        path.write_bytes(head % program + bytes((100, 50, 20, 130)) * 2)
        images.append(io.read_image(path))
    np.testing.assert_array_equal(*images)
    np.testing.assert_allclose(images[1][0, 0], [0.3926, 0.1973, 0.0801], rtol=1e-3)


def test_colours_that_the_conversion_makes_negative_are_told_apart(tmp_path):
    green = np.zeros((4, 8, 3), np.float32)
    green[..., 1] = 1
    coloured(np.eye(3), P_CG)(tmp_path / "a.exr", green)
    # They are the conversion's, not the file's: integrated, and said.
    found = io.read_envmap(tmp_path / "a.exr")
    assert "colours outside Rec. 709) integrated as they stand" in str(found.report)
    assert found.report.negative == 64
    kept = io.read_envmap(tmp_path / "a.exr", primaries="keep")
    np.testing.assert_array_equal(kept.image, green)
    assert "ACEScg kept" in str(kept.report)
    assert io.read_envmap(tmp_path / "a.exr", invalid="clamp").image.min() == 0
    coloured(np.eye(3), P_CG)(tmp_path / "a.exr", green - 0.01)
    for isolate in (False, True):
        with pytest.raises(ValueError, match="negative values hold"):
            io.read_envmap(tmp_path / "a.exr", isolate=isolate)


def test_comments_in_a_pfm(tmp_path):
    path = tmp_path / "a.pfm"
    numbers = np.arange(6, dtype="<f4")
    path.write_bytes(b"PF\n# one\n# 3 x\n2 1\n#two\n-1\n" + numbers.tobytes())
    np.testing.assert_array_equal(io.read_image(path).ravel(), numbers)


def test_channels_that_are_left_out_are_said(tmp_path):
    for count, words in (
        (2, "the first of 2"),
        (4, "the first 3 of 4"),
        (3, "float32,"),
    ):
        np.save(tmp_path / "a.npy", np.ones((4, 8, count), np.float32))
        assert words in str(io.read_envmap(tmp_path / "a.npy").report)


@pytest.mark.filterwarnings("error")
def test_numbers_beyond_float32_and_single_pixels(tmp_path):
    np.save(tmp_path / "a.npy", np.full((4, 8), 1e39))
    with pytest.raises(
        ValueError, match="32 values are NaN, infinite or beyond float32"
    ):
        io.read_envmap(tmp_path / "a.npy")
    np.save(tmp_path / "a.npy", np.ones((1, 1)))
    _, _, weights = io.read_envmap(tmp_path / "a.npy").samples()
    np.testing.assert_allclose(np.sum(weights), 4 * np.pi, rtol=1e-6)


def test_luminance_only(tmp_path):
    path = tmp_path / "a.exr"
    OpenEXR.File({}, {"Y": picture()[..., 1].copy()}).write(str(path))
    np.testing.assert_array_equal(io.read_image(path), picture()[..., 1:2])


@pytest.mark.parametrize(("step", "x", "y"), [(2, 0, 0), (2, 6, -4), (4, -8, 4)])
def test_chroma_is_upsampled_bilinearly(tmp_path, rng, step, x, y):
    # Affine chroma is what a bilinear reading keeps, up to the last sample.
    height, width = 16, 24
    rows, columns = np.indices((height, width))
    red, blue = 0.1 + 0.02 * rows - 0.01 * columns, -0.2 + 0.01 * rows + 0.005 * columns
    luminance = rng.uniform(0.5, 2, (height, width))
    planes = {"Y": luminance, "RY": red[::step, ::step], "BY": blue[::step, ::step]}
    box = (x, y, x + width - 1, y + height - 1)
    file = plain_exr(planes, {"Y": 1, "RY": step, "BY": step}, data=box, display=box)
    path = tmp_path / "a.exr"
    path.write_bytes(_moved(file, y, height))
    expected = np.stack(
        [(red + 1) * luminance, 0 * red, (blue + 1) * luminance], axis=-1
    )
    expected[..., 1] = (
        luminance - 0.2126 * expected[..., 0] - 0.0722 * expected[..., 2]
    ) / 0.7152
    inner = np.s_[: height - step + 1, : width - step + 1]
    np.testing.assert_allclose(io.read_image(path)[inner], expected[inner], rtol=1e-3)


def _moved(file, first, height):
    """The chunks of ``plain_exr`` count rows from the data window's first."""
    offsets = len(file)
    data = bytearray(file)
    table = np.frombuffer(file, "<u8", height, _table(file))
    for row, offset in enumerate(table):
        data[int(offset) : int(offset) + 4] = struct.pack("<i", first + row)
    assert len(data) == offsets
    return bytes(data)


def _table(file):
    """Where the offsets start: the header ends with an empty name."""
    at = 8
    while file[at]:
        at = file.index(b"\0", file.index(b"\0", at) + 1) + 1
        at += 4 + struct.unpack_from("<i", file, at)[0]
    return at + 1


def test_a_data_window_within_the_display_window(tmp_path):
    image = picture()
    window = {
        "dataWindow": (np.array([4, 2], np.int32), np.array([35, 17], np.int32)),
        "displayWindow": (np.zeros(2, np.int32), np.array([39, 19], np.int32)),
    }
    OpenEXR.File(window, {"RGB": image}).write(str(tmp_path / "a.exr"))
    read = io.read_envmap(tmp_path / "a.exr")
    assert "black outside its data window" in read.report.format
    np.testing.assert_array_equal(read.image[2:18, 4:36], image)
    assert read.image.sum() == pytest.approx(image.sum())


def test_the_envmap_attribute_names_the_layout(tmp_path):
    for mark, size, layout in (
        (OpenEXR.ENVMAP_LATLONG, (16, 32), "openexr_latlong"),
        (OpenEXR.ENVMAP_CUBE, (48, 8), "openexr_cube"),
    ):
        path = tmp_path / "a.exr"
        OpenEXR.File({"envmap": mark}, {"RGB": np.ones((*size, 3), np.float32)}).write(
            str(path)
        )
        envmap = io.read_envmap(path)
        assert envmap.layout == layout
        assert not envmap.report.layout_guessed
        assert (
            io.read_envmap(
                path,
                layout="angular"
                if size[0] == size[1]
                else "vertical_strip"
                if layout == "openexr_cube"
                else "latlong",
            ).layout
            != layout
        )


def test_known_colours():
    # Linear ACEScg of Rec. 709's primaries, by OpenColorIO (its studio config).
    matrix, name = colour_spaces.to_rec709(
        (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)
    )
    assert name == "ACEScg"
    theirs = oiio.ImageBuf(oiio.ImageSpec(1, 1, 3, "float"))
    theirs.setpixel(0, 0, (0.2, 0.5, 0.9))
    theirs = oiio.ImageBufAlgo.colorconvert(theirs, "ACEScg", "Linear Rec.709 (sRGB)")
    np.testing.assert_allclose(
        matrix @ [0.2, 0.5, 0.9], theirs.getpixel(0, 0), rtol=1e-3
    )
    assert colour_spaces.to_rec709(colour_spaces.REC709)[0] is None
    np.testing.assert_allclose(
        colour_spaces.luminance_weights(colour_spaces.REC709),
        [0.2126, 0.7152, 0.0722],
        atol=1e-4,
    )


def test_six_faces(tmp_path):
    names = ["px", "nx", "py", "ny", "pz", "nz"]
    for number, name in enumerate(names):
        io.write_image(
            tmp_path / f"sky_{name}.exr", np.full((4, 4, 3), number, np.float32)
        )
    envmap = io.read_envmap(tmp_path)
    assert envmap.layout == "vertical_strip"
    assert envmap.image[::4, 0, 0].tolist() == [0, 1, 2, 3, 4, 5]
    assert "six faces" in str(envmap.report)
    io.write_image(tmp_path / "sky_nz.exr", np.ones((4, 5, 3), np.float32))
    with pytest.raises(
        ValueError, match=r"sky_nz\.exr: the faces of a cube are square"
    ):
        io.read_envmap(tmp_path)
    (tmp_path / "sky_nz.exr").unlink()
    with pytest.raises(IsADirectoryError, match="nor the six faces of a cube"):
        io.read_envmap(tmp_path)


def test_raw_float_probes_in_either_byte_order(tmp_path, rng):
    image = rng.lognormal(size=(8, 8, 3)).astype(np.float32)
    for order in "<>":
        (tmp_path / "a.float").write_bytes(image.astype(f"{order}f4").tobytes())
        envmap = io.read_envmap(tmp_path / "a.float")
        assert envmap.layout == "angular"
        np.testing.assert_array_equal(envmap.image, image)


def deep(path):
    spec = oiio.ImageSpec(4, 2, 5, "float")
    spec.channelnames = ("R", "G", "B", "A", "Z")
    spec.deep = True
    data = oiio.DeepData()
    data.init(8, 5, [oiio.TypeDesc("float")] * 5, spec.channelnames)
    for pixel in range(8):
        data.set_samples(pixel, 1)
    target = oiio.ImageOutput.create(str(path))
    assert target.open(str(path), spec)
    assert target.write_deep_image(data)
    target.close()


def huge_exr(width, height):
    plain = plain_exr({"Y": np.ones((1, 1))}, {"Y": 1})
    box = struct.pack("<4i", 0, 0, 0, 0)
    return plain.replace(box, struct.pack("<4i", 0, 0, width - 1, height - 1))


def hostile(folder):
    """Files that must be refused, and a word of the reason."""
    good = folder / "good.exr"
    exr()(good, picture())
    data = good.read_bytes()
    multi = folder / "multi.exr"
    parts(multi, picture())
    cases = {
        "empty.exr": (b"", "empty"),
        "text.exr": (b"not an image at all", "not an image"),
        "cut.exr": (data[: len(data) // 2], "cannot"),
        "header.exr": (data[:200], "cannot"),
        "magic.exr": (data[:4], "cannot"),
        "zeros.exr": (data[:60] + bytes(len(data) - 60), "cannot"),
        "lastpart.exr": (multi.read_bytes()[:-600], ""),
        "huge.exr": (huge_exr(2**30, 2**30), ""),
        "wide.exr": (huge_exr(2**31 - 1, 1), ""),
        "negative.exr": (huge_exr(-5, 3), ""),
        "claims.exr": (huge_exr(2**14, 2**14), ""),
        "cut.hdr": (
            b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 10 +X 20\nxx",
            "cut off",
        ),
        "axes.hdr": (b"#?RADIANCE\n\n-Y 10 +Y 20\n", "line for its size"),
        "kind.hdr": (
            b"#?RADIANCE\nFORMAT=32-bit_rle_cmyk\n\n-Y 1 +X 2\n12345678",
            "FORMAT=",
        ),
        "huge.hdr": (b"#?RADIANCE\n\n-Y 99999999 +X 99999999\n", "the limit is"),
        "claims.hdr": (b"#?RADIANCE\n\n-Y 16000 +X 16000\n\2\2", "fewer bytes"),
        "none.hdr": (b"#?RADIANCE\n\n-Y 0 +X 5\n", "it is empty"),
        "exposure.hdr": (
            b"#?RADIANCE\nEXPOSURE=much\n\n-Y 1 +X 1\n1234",
            "EXPOSURE=much",
        ),
        "dark.hdr": (b"#?RADIANCE\nEXPOSURE=0\n\n-Y 1 +X 1\n1234", "not positive"),
        "gamma.hdr": (b"#?RADIANCE\nGAMMA=-1\n\n-Y 1 +X 1\n1234", "GAMMA"),
        "run.hdr": (b"#?RADIANCE\n\n-Y 1 +X 9\n\2\2\0\x09\xff\1", "cut off"),
        "endless.hdr": (b"#?RADIANCE\n" + b"A=1\n" * 10, "line for its size"),
        "cut.pfm": (b"PF\n8 4\n-1.0\n" + bytes(100), "cut off"),
        "scale.pfm": (b"PF\n8 4\n0.0\n" + bytes(384), "scale"),
        "word.pfm": (b"PF\n8 x\n-1\n", "PFM without"),
        "huge.pfm": (b"PF\n999999999 999999999\n-1\n", "the limit is"),
        "odd.float": (bytes(100), "side"),
        "objects.npy": (
            b"\x93NUMPY\1\0v\0{'descr': '|O', 'fortran_order': False, 'shape': (2, 4), }"
            + b" " * 55
            + b"\n",
            "NumPy cannot",
        ),
        "a.null": (b"RGB", "not an image"),
        "cut.png": (b"\x89PNG\r\n\x1a\n" + bytes(40), ""),
        "cut.tif": (b"II*\0\x08\0\0\0" + bytes(20), ""),
        "cut.jpg": (b"\xff\xd8\xff\xe0\0\x10JFIF\0", ""),
    }
    for name, (content, _) in cases.items():
        (folder / name).write_bytes(content)
    words = {name: word for name, (_, word) in cases.items()}
    with (folder / "whole.npy").open("wb") as file:
        np.save(file, np.ones((4, 8, 3), np.uint8))
    deep(folder / "deep.exr")
    (folder / "folder.exr").mkdir()
    (folder / "loop.exr").symlink_to("loop.exr")
    os.mkfifo(folder / "pipe.exr")
    return words | {
        "whole.npy": "floating-point",
        "deep.exr": "deep",
        "folder.exr": "folder",
        "loop.exr": "",
        "missing.exr": "",
        "pipe.exr": "not a file",
    }


@pytest.mark.parametrize("isolate", [False, True])
def test_hostile_files_are_one_clear_line(tmp_path, capfd, isolate):
    for name, word in hostile(tmp_path).items():
        start = time.perf_counter()
        with pytest.raises((ValueError, OSError)) as caught:
            io.read_envmap(tmp_path / name, isolate=isolate)
        message = str(caught.value)
        assert name in message, (name, message)
        assert word in message, (name, message)
        assert "\n" not in message.strip(), (name, message)
        assert time.perf_counter() - start < 10, name
    assert capfd.readouterr() == ("", "")


def test_limits_hold_before_anything_is_decoded(tmp_path):
    with pytest.raises(ValueError, match="the limit is 100"):
        io.read_image(io.shipped_panorama(), max_pixels=100)
    path = tmp_path / "many.exr"
    names = [f"c{k}" for k in range(30)]
    planes = {name: picture()[..., 0].copy() for name in ["R", "G", "B", *names]}
    OpenEXR.File({}, planes).write(str(path))
    assert io.read_image(path, max_pixels=10 * picture()[..., 0].size).shape[2] == 3
    with pytest.raises(ValueError, match="samples in all channels"):
        io.read_image(path, max_pixels=picture()[..., 0].size)
    OpenEXR.File({}, {"Z": picture()[..., 0].copy()}).write(str(path))
    with pytest.raises(ValueError, match="no R, G, B or Y channels; found Z"):
        io.read_image(path)


def test_no_permission_is_told(tmp_path):
    path, _, _ = write(tmp_path, "exr float")
    path.chmod(0)
    if os.access(path, os.R_OK):  # root reads everything: take the right away by a file
        path.unlink()
        (tmp_path / "file").write_text("")
        path = tmp_path / "file" / "a.exr"
    with pytest.raises(OSError, match=r"a\.exr"):
        io.read_image(path, isolate=True)


def test_the_worker_is_restarted_after_a_crash(tmp_path, monkeypatch):
    path, _, _ = write(tmp_path, "exr float")
    isolation.stop()
    io.read_image(path, isolate=True)
    first = isolation._pool._idle[-1]._process
    first.kill()
    first.wait()
    with pytest.raises(ValueError, match=r"a\.exr: crashed the reader"):
        io.read_image(path, isolate=True)
    np.testing.assert_array_equal(io.read_image(path, isolate=True), picture())
    assert isolation._pool._idle[-1]._process.pid != first.pid


def test_the_worker_is_restarted_when_a_file_takes_too_long(tmp_path, monkeypatch):
    path, _, _ = write(tmp_path, "exr float")
    io.read_image(path, isolate=True)
    os.kill(isolation._pool._idle[-1]._process.pid, 19)  # SIGSTOP
    monkeypatch.setattr(isolation, "SECONDS", 0.3)
    start = time.perf_counter()
    with pytest.raises(ValueError, match=r"a\.exr: took longer than"):
        io.read_image(path, isolate=True)
    assert time.perf_counter() - start < 10
    monkeypatch.undo()
    np.testing.assert_array_equal(io.read_image(path, isolate=True), picture())


def test_the_worker_ends_with_its_caller(tmp_path):
    path, _, _ = write(tmp_path, "exr float")
    script = (
        "import sys; from shjax import io; from shjax.io import isolation\n"
        f"io.read_image({str(path)!r}, isolate=True)\n"
        "print(isolation._pool._idle[-1]._process.pid)"
    )
    run = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert run.stderr == ""
    assert not os.path.exists(f"/proc/{run.stdout.strip()}/exe")


def test_readers_are_not_chosen_by_suffix(tmp_path):
    path, _, _ = write(tmp_path, "hdr new runs")
    other = path.rename(tmp_path / "b.exr")
    assert "Radiance" in io.read_envmap(other).report.format
    assert io.read_image(other).shape[1] == WIDTH


def test_mutated_files_are_read_or_refused(tmp_path):
    from experiments.fuzzing import run

    result = run(300, 7, tmp_path)
    assert result["files"] == result.get("refused", 0) + result.get("read", 0)
    assert result["refused"] > 100
    assert result["read"] > 30


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize("suffix", ["exr", "npy"])
def test_memory_of_a_large_panorama(tmp_path, suffix):
    """8192 x 4096 floats, read by the worker and analysed: both processes together."""
    small, large = tmp_path / f"small.{suffix}", tmp_path / f"large.{suffix}"
    script = """
import sys
from pathlib import Path
import numpy as np
from shjax import io
for path, rows in zip(sys.argv[1:], (8, 4096)):
    row = np.linspace(0.5, 1.5, 6 * rows, dtype=np.float32).reshape(1, 2 * rows, 3)
    image = np.broadcast_to(row, (rows, 2 * rows, 3))
    (np.save if path.endswith("npy") else io.write_image)(path, image)
"""
    paths = [str(small), str(large)]
    subprocess.run([sys.executable, "-c", script, *paths], check=True)
    script = """
import sys
from pathlib import Path
import shjax
from shjax.io import isolation

def peaks():
    lines = [
        line.split()
        for pid in ("self", isolation._pool._idle[-1]._process.pid)
        for line in Path(f"/proc/{pid}/status").read_text().splitlines()
    ]
    return sum(int(line[1]) for line in lines if line[0] == "VmHWM:")

shjax.io.read_envmap(sys.argv[1], isolate=True)  # JAX is imported before, too
before = peaks()
light = shjax.io.read_envmap(sys.argv[2], isolate=True).lighting(l_max=2)
print(peaks() - before, light[0].mean())
"""
    run = subprocess.run(
        [sys.executable, "-c", script, *paths],
        capture_output=True,
        text=True,
        check=True,
    )
    kilobytes, mean = map(float, run.stdout.split())
    assert kilobytes * 1024 < 2.5 * 8192 * 4096 * 12
    assert abs(mean - np.sqrt(4 * np.pi)) < 1e-5
