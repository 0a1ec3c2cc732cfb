"""Files in and out: what a format says is what arrives; what is broken is refused."""

import os

import numpy as np
import OpenEXR
import OpenImageIO as oiio
import pytest

import shjax
from shjax import io
from shjax.io.writing import replacing
from shjax.srgb import decode_srgb, encode_srgb
from tests.variants import new_runs, old_runs


def radiance_file(path, rgbe, *, header=b"FORMAT=32-bit_rle_rgbe\n", encode=None):
    """Write RGBE bytes (H, W, 4) as a Radiance picture; flat scanlines by default."""
    height, width, _ = rgbe.shape
    size = f"-Y {height} +X {width}\n".encode()
    body = rgbe.tobytes() if encode is None else b"".join(map(encode, rgbe))
    path.write_bytes(b"#?RADIANCE\n" + header + b"\n" + size + body)
    return path


def test_radiance_decodes_the_half_step(tmp_path):
    rgbe = np.array([[[128, 64, 0, 129], [0, 0, 0, 0], [255, 1, 2, 136]]], np.uint8)
    image = io.read_image(radiance_file(tmp_path / "a.hdr", rgbe))
    expected = [[[128.5 / 128, 64.5 / 128, 0.5 / 128], [0, 0, 0], [255.5, 1.5, 2.5]]]
    np.testing.assert_array_equal(image, np.float32(expected))


@pytest.mark.parametrize("encode", [None, new_runs, old_runs])
@pytest.mark.parametrize("width", [8, 300])
def test_radiance_encodings_are_one_picture(tmp_path, rng, encode, width):
    rgbe = rng.integers(2, 250, (5, width, 4), dtype=np.uint8)
    rgbe[:, width // 4 :] = rgbe[:, width // 4 : width // 4 + 1]  # long runs
    rgbe[..., 3] = 128
    image = io.read_image(radiance_file(tmp_path / "a.hdr", rgbe, encode=encode))
    np.testing.assert_array_equal(image, (rgbe[..., :3] + np.float32(0.5)) / 256)


def test_radiance_is_openimageios_plus_half_a_step(tmp_path, rng):
    # The library's own writer and reader, which leaves the half step out.
    truth = rng.uniform(0.01, 50, (9, 20, 3)).astype(np.float32)
    io.write_image(tmp_path / "a.hdr", truth)
    ours = io.read_image(tmp_path / "a.hdr")
    theirs = oiio.ImageBuf(str(tmp_path / "a.hdr")).get_pixels(oiio.FLOAT)
    step = 2.0 ** (np.floor(np.log2(truth.max(axis=-1, keepdims=True))) - 7)
    np.testing.assert_allclose(
        ours - theirs, np.broadcast_to(step / 2, ours.shape), rtol=1e-4
    )
    assert np.max(np.abs(ours - truth) / step) <= 0.5001
    assert np.max(np.abs(theirs - truth) / step) > 0.9


def test_radiance_exposure_is_divided_out(tmp_path):
    rgbe = np.full((1, 2, 4), 128, np.uint8)
    header = b"EXPOSURE=2.0\nSOFTWARE=x\nEXPOSURE=4\n"
    image = io.read_image(radiance_file(tmp_path / "a.hdr", rgbe, header=header))
    np.testing.assert_allclose(image, 128.5 / 256 / 8)


@pytest.mark.parametrize("channels", [1, 3, 4, 9])
def test_exr_keeps_every_bit(tmp_path, rng, channels):
    image = rng.normal(size=(5, 6, channels)).astype(np.float32)
    path = tmp_path / "a.exr"
    io.write_image(path, image, attributes={"frame": "z up"})
    file = OpenEXR.File(str(path), separate_channels=True)
    assert file.header()["frame"] == "z up"
    if channels in (1, 3):
        np.testing.assert_array_equal(io.read_image(path), image)
    elif channels == 4:
        np.testing.assert_array_equal(io.read_image(path), image[..., :3])
    else:
        names = sorted(file.channels())
        planes = np.stack([file.channels()[n].pixels for n in names], axis=-1)
        np.testing.assert_array_equal(planes, image)


@pytest.mark.parametrize("kind", [np.float16, np.float32])
@pytest.mark.parametrize(
    "compression", ["NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24", "B44", "DWAA"]
)
def test_exr_of_any_compression(tmp_path, rng, kind, compression):
    image = rng.uniform(0.5, 2, (16, 32, 3)).astype(kind)
    header = {"compression": getattr(OpenEXR, f"{compression}_COMPRESSION")}
    OpenEXR.File(header, {"RGB": image}).write(str(tmp_path / "a.exr"))
    read = io.read_image(tmp_path / "a.exr")
    assert read.dtype == np.float32
    limit = 0 if compression in ("NO", "RLE", "ZIPS", "ZIP", "PIZ") else 0.05
    np.testing.assert_allclose(read, image.astype(np.float32), rtol=limit)


def test_png_is_srgb(tmp_path):
    linear = np.array([[[0.0, 0.18, 1.0], [0.0031308, 0.5, 2.0]]], np.float32)
    io.write_image(tmp_path / "a.png", linear)
    stored = oiio.ImageBuf(str(tmp_path / "a.png")).get_pixels(oiio.UINT8)
    assert stored[0, 0].tolist() == [0, 118, 255]
    assert stored[0, 1].tolist() == [10, 188, 255]
    np.testing.assert_allclose(
        io.read_image(tmp_path / "a.png"), np.clip(linear, 0, 1), atol=5e-3
    )


def test_srgb_curves_are_inverse():
    levels = np.linspace(0, 1, 1001)
    np.testing.assert_allclose(decode_srgb(encode_srgb(levels)), levels, atol=1e-7)


def test_the_shipped_panorama_reads():
    envmap = io.read_envmap(io.shipped_panorama())
    assert envmap.radiance.shape == (512, 1024, 3)
    assert envmap.report.negative > 0
    assert 0 < envmap.report.negative_energy < 1e-6
    assert "integrated as they stand" in envmap.report.action
    assert io.shipped_panorama().stat().st_size <= 250_000


def write_env(path, image):
    io.write_image(path, image.astype(np.float32))
    return path


def test_nan_is_refused_with_count_and_place(tmp_path):
    image = np.ones((8, 16, 3))
    image[3, 5, 1], image[6, 2, 0] = np.nan, np.inf
    path = write_env(tmp_path / "bad.exr", image)
    with pytest.raises(
        ValueError, match="2 values .* row 3, column 5, channel 1"
    ) as caught:
        io.read_envmap(path)
    assert "bad.exr" in str(caught.value)


def test_invalid_values_are_treated_as_asked(tmp_path):
    image = np.ones((8, 16, 3))
    image[0, 0, 0], image[1, 1, 1], image[2, 2, 2] = np.nan, np.inf, -3
    image[3, 3, 0] = 7
    path = write_env(tmp_path / "bad.exr", image)
    clamped = io.read_envmap(path, invalid="clamp")
    assert clamped.radiance[0, 0].tolist() == [0, 1, 1]
    assert clamped.radiance[1, 1].tolist() == [1, 7, 1]
    assert clamped.radiance[2, 2].tolist() == [1, 1, 0]
    zeroed = io.read_envmap(path, invalid="zero")
    assert zeroed.radiance[0, 0].tolist() == [0, 0, 0]
    assert zeroed.radiance[2, 2].tolist() == [0, 0, 0]
    kept = io.read_envmap(path, invalid="keep")
    assert np.isnan(kept.radiance[0, 0, 0])
    for envmap, word in ((clamped, "clamped"), (zeroed, "made black"), (kept, "kept")):
        assert envmap.report.non_finite == 2
        assert envmap.report.negative == 1
        assert word in str(envmap.report)
        assert envmap.report.layout_guessed


def test_much_negative_energy_is_refused(tmp_path, data):
    image = np.ones((8, 16, 3))
    image[4, 4] = -0.005  # 6e-5 of the energy
    io.read_envmap(write_env(tmp_path / "few.exr", image))
    image[4, 4] = -0.1
    with pytest.raises(ValueError, match="negative values hold .* of the energy"):
        io.read_envmap(write_env(tmp_path / "much.exr", image))
    with pytest.raises(ValueError, match="negative values hold"):
        io.read_envmap(data / "hdri" / "esplanade_negative_ringing.exr")


def test_pixels_outside_the_probe_do_not_count(tmp_path):
    image = np.ones((64, 64, 3))
    image[0, 0] = np.nan  # a corner, outside the circle
    path = write_env(tmp_path / "probe.exr", image)
    assert io.read_envmap(path).report.layout == "angular"
    image[32, 32] = np.nan
    with pytest.raises(ValueError, match="row 32, column 32"):
        io.read_envmap(write_env(path, image))


@pytest.mark.usefixtures("as_a_user")
@pytest.mark.parametrize(
    ("path", "shape", "message"),
    [
        ("a.jpg", (2, 2, 3), "must end in"),
        ("a.exr", (2, 2), r"\(H, W, C\)"),
        ("a.png", (2, 2, 5), "1 or 3 channels"),
    ],
)
def test_wrong_outputs_are_refused(tmp_path, path, shape, message):
    with pytest.raises(ValueError, match=message):
        io.write_image(tmp_path / path, np.ones(shape, np.float32))
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_choice_is_refused(tmp_path):
    with pytest.raises(ValueError, match="invalid must be one of"):
        io.read_envmap(io.shipped_panorama(), invalid="ignore")


def test_a_failed_write_leaves_the_old_file(tmp_path):
    path = tmp_path / "a.txt"
    io.write_text(path, "old")
    with pytest.raises(RuntimeError), replacing(path) as temporary:  # noqa: PT012
        temporary.write_text("half")
        raise RuntimeError
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_reading_matches_the_library_in_python():
    ours = io.read_image(io.shipped_panorama())
    theirs = OpenEXR.File(str(io.shipped_panorama())).channels()["RGB"].pixels
    np.testing.assert_array_equal(ours, theirs)
    assert shjax.io is io
