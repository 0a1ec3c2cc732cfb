"""Files of many valid kinds, all holding one picture, written by other means than ours."""

import struct

import numpy as np
import OpenEXR
import OpenImageIO as oiio

HEIGHT, WIDTH = 16, 32


def picture():
    """Smooth and positive, each channel of its own; no symmetry that hides a flip."""
    v, u = np.meshgrid(
        (np.arange(HEIGHT) + 0.5) / HEIGHT,
        (np.arange(WIDTH) + 0.5) / WIDTH,
        indexing="ij",
    )
    image = np.stack([0.2 + u, 0.3 + v * v, 0.9 - 0.5 * u * v], axis=-1)
    return image.astype(np.float32)


def exr(header=None, kind=np.float32, names="RGB"):
    def write(path, image):
        planes = {n: image[..., "RGB".index(n[-1])].astype(kind).copy() for n in names}
        OpenEXR.File(header or {}, planes).write(str(path))

    return write


def compressed(name, kind=np.float16):
    return exr({"compression": getattr(OpenEXR, f"{name}_COMPRESSION")}, kind)


def tiled(path, image):
    tile = OpenEXR.TileDescription()
    tile.xSize, tile.ySize = 8, 8
    OpenEXR.File({"type": OpenEXR.tiledimage, "tiles": tile}, {"RGB": image}).write(
        str(path)
    )


def mip_mapped(path, image):
    spec = oiio.ImageSpec()
    spec.attribute("maketx:filtername", "box")
    assert oiio.ImageBufAlgo.make_texture(
        oiio.MakeTxTexture, oiio.ImageBuf(image), str(path), spec
    )


def mixed(path, image):
    planes = {
        "R": image[..., 0].astype(np.float16),
        "G": image[..., 1].copy(),
        "B": image[..., 2].copy(),
    }
    OpenEXR.File({}, planes).write(str(path))


def uint(path, image):
    planes = {
        n: np.round(1000 * image[..., k]).astype(np.uint32) for k, n in enumerate("RGB")
    }
    OpenEXR.File({}, planes).write(str(path))


def layered(path, image):
    planes = {f"env.{n}": image[..., k].copy() for k, n in enumerate("RGB")}
    OpenEXR.File({}, {"Z": np.zeros(image.shape[:2], np.float32), **planes}).write(
        str(path)
    )


def parts(path, image):
    depth = OpenEXR.Part({}, {"Z": np.zeros(image.shape[:2], np.float32)}, "depth")
    sky = OpenEXR.Part({}, {"RGB": image}, "sky")
    other = OpenEXR.Part({}, {"RGB": image * 2}, "other")
    OpenEXR.File([depth, sky, other]).write(str(path))


def with_alpha(path, image):
    planes = {n: image[..., k].copy() for k, n in enumerate("RGB")}
    OpenEXR.File({}, {**planes, "A": np.full(image.shape[:2], 0.5, np.float32)}).write(
        str(path)
    )


def windowed(path, image):
    """A data window larger than the display window: overscan of 3 and 2."""
    wide = np.pad(image, ((2, 2), (3, 3), (0, 0)), constant_values=77)
    window = {
        "dataWindow": (
            np.array([-3, -2], np.int32),
            np.array([WIDTH + 2, HEIGHT + 1], np.int32),
        ),
        "displayWindow": (
            np.zeros(2, np.int32),
            np.array([WIDTH - 1, HEIGHT - 1], np.int32),
        ),
    }
    OpenEXR.File(window, {"RGB": wide}).write(str(path))


def shifted(path, image):
    """Both windows start elsewhere than at 0."""
    window = (
        np.array([40, -7], np.int32),
        np.array([39 + WIDTH, HEIGHT - 8], np.int32),
    )
    OpenEXR.File({"dataWindow": window, "displayWindow": window}, {"RGB": image}).write(
        str(path)
    )


TO_XYZ = np.array(
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
)
# Rec. 709 to ACEScg with a Bradford adaptation, as OpenColorIO's studio config has it.
TO_ACESCG = np.array(
    [
        [0.613097, 0.339523, 0.047379],
        [0.070194, 0.916354, 0.013452],
        [0.020616, 0.109570, 0.869815],
    ]
)


def coloured(matrix, chromaticities):
    def write(path, image):
        other = (image @ matrix.T).astype(np.float32)
        OpenEXR.File({"chromaticities": chromaticities}, {"RGB": other}).write(
            str(path)
        )

    return write


def xyz_channels(path, image):
    other = (image @ TO_XYZ.T).astype(np.float32)
    OpenEXR.File({}, {n: other[..., k].copy() for k, n in enumerate("XYZ")}).write(
        str(path)
    )


def luminance_chroma(path, image, step=2):
    y = image @ np.array([0.2126, 0.7152, 0.0722], np.float32)
    planes = {
        "Y": y,
        "RY": (image[..., 0] / y - 1)[::step, ::step],
        "BY": (image[..., 2] / y - 1)[::step, ::step],
    }
    path.write_bytes(plain_exr(planes, {n: 1 if n == "Y" else step for n in planes}))


def plain_exr(planes, steps, **windows):
    """An uncompressed EXR by hand: OpenEXR's binding writes no subsampled channels."""

    def attribute(name, kind, data):
        return (
            name.encode()
            + b"\0"
            + kind.encode()
            + b"\0"
            + struct.pack("<i", len(data))
            + data
        )

    height, width = planes["Y"].shape
    box = struct.pack("<4i", *windows.get("data", (0, 0, width - 1, height - 1)))
    frame = struct.pack("<4i", *windows.get("display", (0, 0, width - 1, height - 1)))
    names = sorted(planes)
    channels = (
        b"".join(
            n.encode() + b"\0" + struct.pack("<iB3xii", 2, 0, steps[n], steps[n])
            for n in names
        )
        + b"\0"
    )
    header = (
        b"\x76\x2f\x31\x01"
        + struct.pack("<i", 2)
        + b"".join(
            [
                attribute("channels", "chlist", channels),
                attribute("compression", "compression", b"\0"),
                attribute("dataWindow", "box2i", box),
                attribute("displayWindow", "box2i", frame),
                attribute("lineOrder", "lineOrder", b"\0"),
                attribute("pixelAspectRatio", "float", struct.pack("<f", 1)),
                attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0)),
                attribute("screenWindowWidth", "float", struct.pack("<f", 1)),
            ]
        )
        + b"\0"
    )
    lines = []
    for y in range(height):
        data = b"".join(
            planes[n][y // steps[n]].astype("<f4").tobytes()
            for n in names
            if y % steps[n] == 0
        )
        lines.append(struct.pack("<2i", y, len(data)) + data)
    at = len(header) + 8 * height
    offsets = at + np.concatenate([[0], np.cumsum([len(line) for line in lines])[:-1]])
    return header + offsets.astype("<u8").tobytes() + b"".join(lines)


def rgbe(image):
    """Radiance's own encoding, ``(H, W, 4)``: the mantissa is cut off, not rounded."""
    largest = image.max(axis=-1)
    mantissa, exponent = np.frexp(largest)
    scale = mantissa * 256 / largest
    return np.concatenate(
        [image * scale[..., None], exponent[..., None] + 128], axis=-1
    ).astype(np.uint8)


def new_runs(row):
    out = bytes([2, 2, len(row) // 256, len(row) % 256])
    for plane in row.T:
        at = 0
        while at < len(plane):
            run = 1
            while at + run < len(plane) and run < 127 and plane[at + run] == plane[at]:
                run += 1
            out += bytes([128 + run, plane[at]]) if run > 2 else bytes([1, plane[at]])
            at += run if run > 2 else 1
    return out


def old_runs(row):
    out, at = b"", 0
    while at < len(row):
        run = 1
        while at + run < len(row) and run < 200 and np.all(row[at + run] == row[at]):
            run += 1
        out += row[at].tobytes() + (bytes([1, 1, 1, run - 1]) if run > 1 else b"")
        at += run
    return out


def hdr(
    order="-Y {h} +X {w}", header=b"FORMAT=32-bit_rle_rgbe\n", encode=None, change=None
):
    """A Radiance picture, its scanlines in one of the eight orders."""

    def write(path, image):
        bytes_ = rgbe(image if change is None else change(image).astype(np.float32))
        first, second = order[:2], order.split()[2]
        if "+Y" in (first, second):
            bytes_ = bytes_[::-1]
        if "-X" in (first, second):
            bytes_ = bytes_[:, ::-1]
        if first[1] == "X":
            bytes_ = bytes_.transpose(1, 0, 2)
        size = order.format(h=HEIGHT, w=WIDTH).encode() + b"\n"
        body = (
            bytes_.tobytes()
            if encode is None
            else b"".join(encode(row) for row in np.ascontiguousarray(bytes_))
        )
        path.write_bytes(b"#?RADIANCE\n" + header + b"\n" + size + body)

    return write


def pfm(order, channels=3):
    def write(path, image):
        kind = b"PF" if channels == 3 else b"Pf"
        scale = b"-1.0" if order == "<" else b"1.0"
        data = image[::-1] if channels == 3 else image[::-1, :, 0]
        path.write_bytes(
            kind
            + b"\n%d %d\n" % (WIDTH, HEIGHT)
            + scale
            + b"\n"
            + data.astype(order + "f4").tobytes()
        )

    return write


def npy(kind):
    def write(path, image):
        with path.open("wb") as file:
            np.save(file, image.astype(kind))

    return write


def by_oiio(kind, encode=False, orientation=1):
    def write(path, image):
        values = encode_srgb(np.clip(image / 1.3, 0, 1)) if encode else image
        spec = oiio.ImageSpec(WIDTH, HEIGHT, 3, kind)
        if orientation == 3:
            values = values[::-1, ::-1]
        spec.attribute("Orientation", orientation)
        spec.attribute("CompressionQuality", 100)
        spec.attribute("jpeg:subsampling", "4:4:4")
        target = oiio.ImageOutput.create(str(path))
        assert target.open(str(path), spec)
        assert target.write_image(np.ascontiguousarray(values, np.float32))
        target.close()

    return write


def encode_srgb(x):
    return np.where(
        x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-9) ** (1 / 2.4) - 0.055
    )


P_XYZ, P_CG = (
    (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1 / 3, 1 / 3),
    (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767),
)
ORDERS = (
    "-Y {h} +X {w}",
    "-Y {h} -X {w}",
    "+Y {h} +X {w}",
    "+Y {h} -X {w}",
    "+X {w} -Y {h}",
    "-X {w} -Y {h}",
    "+X {w} +Y {h}",
    "-X {w} +Y {h}",
)
_HDR = 0.01  # half a step of the largest channel is 0.4 %, of the others more

# Name: suffix, writer, relative tolerance, factor that the file's values carry.
VARIANTS = {
    **{
        f"exr {c.lower()} half": (".exr", compressed(c), 1e-3, 1)
        for c in ("NO", "RLE", "ZIPS", "ZIP", "PIZ", "PXR24")
    },
    **{
        f"exr {c.lower()} half": (".exr", compressed(c), 2e-2, 1)
        for c in ("B44", "B44A", "DWAA", "DWAB")
    },
    **{
        f"exr {c.lower()}": (".exr", compressed(c), 1e-3, 1)
        for c in ("HTJ2K32", "HTJ2K256", "ZSTD")
    },
    "exr float": (".exr", exr(), 0, 1),
    "exr float piz": (".exr", compressed("PIZ", np.float32), 0, 1),
    "exr uint": (".exr", uint, 3e-3, 1000),
    "exr mixed": (".exr", mixed, 1e-3, 1),
    "exr tiled": (".exr", tiled, 0, 1),
    "exr mip-mapped": (".exr", mip_mapped, 0, 1),
    "exr layered": (".exr", layered, 0, 1),
    "exr parts": (".exr", parts, 0, 1),
    "exr alpha": (".exr", with_alpha, 0, 1),
    "exr overscan": (".exr", windowed, 0, 1),
    "exr shifted": (".exr", shifted, 0, 1),
    "exr xyz": (".exr", coloured(TO_XYZ, P_XYZ), 1e-3, 1),
    "exr xyz channels": (".exr", xyz_channels, 1e-3, 1),
    "exr acescg": (".exr", coloured(TO_ACESCG, P_CG), 1e-3, 1),
    "exr luminance-chroma": (".exr", luminance_chroma, 0.25, 1),
    "exr decreasing y": (".exr", exr({"lineOrder": OpenEXR.DECREASING_Y}), 0, 1),
    **{f"hdr {o[:2]}{o.split()[2]}": (".hdr", hdr(o), _HDR, 1) for o in ORDERS},
    "hdr new runs": (".hdr", hdr(encode=new_runs), _HDR, 1),
    "hdr old runs": (".hdr", hdr(encode=old_runs), _HDR, 1),
    "hdr runs by columns": (".hdr", hdr(ORDERS[5], encode=new_runs), _HDR, 1),
    "hdr exposure": (
        ".hdr",
        hdr(header=b"EXPOSURE=4\nFORMAT=32-bit_rle_rgbe\n"),
        _HDR,
        0.25,
    ),
    "hdr colour correction": (
        ".hdr",
        hdr(
            header=b"COLORCORR=1.2 .9 1.1\n",
            change=lambda i: i * np.float32([1.2, 0.9, 1.1]),
        ),
        3e-2,
        1,
    ),
    "hdr gamma": (
        ".hdr",
        hdr(header=b"GAMMA=2.2\n", change=lambda i: i ** (1 / 2.2)),
        2e-2,
        1,
    ),
    "hdr xyze": (
        ".hdr",
        hdr(header=b"FORMAT=32-bit_rle_xyze\n", change=lambda i: i @ TO_XYZ.T),
        8e-2,
        1,
    ),
    "hdr photoshop": (
        ".hdr",
        hdr(header=b"GAMMA=1\nPRIMARIES=0 0 0 0 0 0 0 0\n"),
        _HDR,
        1,
    ),
    "pfm little": (".pfm", pfm("<"), 0, 1),
    "pfm big": (".pfm", pfm(">"), 0, 1),
    "npy float32": (".npy", npy(np.float32), 0, 1),
    "npy float64": (".npy", npy(np.float64), 0, 1),
    "npy half": (".npy", npy(np.float16), 1e-3, 1),
    "tiff float": (".tif", by_oiio("float"), 0, 1),
    "tiff half": (".tif", by_oiio("half"), 1e-3, 1),
    "tiff 16 bit": (".tif", by_oiio("uint16", encode=True), 1e-4, 1 / 1.3),
    "png 8 bit": (".png", by_oiio("uint8", encode=True), 1e-2, 1 / 1.3),
    "png 16 bit": (".png", by_oiio("uint16", encode=True), 1e-4, 1 / 1.3),
    "jpeg": (".jpg", by_oiio("uint8", encode=True), 5e-2, 1 / 1.3),
    "tiff turned": (".tif", by_oiio("float", orientation=3), 0, 1),
}
