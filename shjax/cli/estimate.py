"""``shjax estimate``: the light from one picture of a known object."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import click
import jax.numpy as jnp
import numpy as np
from rich.console import Console

import shjax
from shjax.cli import surface
from shjax.cli.estimate_report import show, words, write
from shjax.cli.light import BASIS
from shjax.cli.many import alone
from shjax.cli.options import BrdfText, FiniteRange
from shjax.cli.pictures import FRAME
from shjax.estimate import Estimate
from shjax.io.colour import decode_srgb, encode_srgb
from shjax.io.images import MAX_PIXELS, decode, in_memory
from shjax.io.writing import check_folder, json_text, protecting
from shjax.render import Camera
from shjax.render.shading import covered

SCHEMA = "shjax.estimate/1"
_LDR = (".png", ".jpg", ".jpeg")


class _Numbers(click.ParamType):
    """So many numbers with commas between."""

    def __init__(self, name: str, counts: tuple[int, ...]):
        self.name, self.counts = name, counts

    def convert(self, value, param, ctx):
        """Text to floats."""
        if not isinstance(value, str):
            return value
        try:
            numbers = tuple(float(part) for part in value.split(","))
        except ValueError:
            numbers = ()
        if len(numbers) not in self.counts or not np.all(np.isfinite(numbers)):
            self.fail(f"{value!r} is not {self.name}", param, ctx)
        return numbers


@click.command(short_help="The light from a picture of a known object.")
@click.argument("image", type=click.Path(path_type=Path))
@click.option(
    "-o", "--out", required=True, type=click.Path(path_type=Path), metavar="DIR",
    help="Folder for the results; made if it is missing.",
)  # fmt: skip
@click.option(
    "--sphere", type=_Numbers("CX,CY,R", (3,)),
    help="The picture shows a sphere: middle and radius in pixels from the upper left "
    "corner (the first pixel's middle is 0.5,0.5).",
)  # fmt: skip
@click.option(
    "--normals", type=click.Path(path_type=Path), metavar="EXR",
    help="The pixels' normals; 0,0,0 where nothing is seen.",
)  # fmt: skip
@click.option(
    "--normals-frame", type=click.Choice(list(surface.NORMAL_FRAMES)),
    help="camera: x right, y up, z towards the camera; opencv: y down, z away; world: "
    "shjax's; blender: the same; mitsuba: y up. Needed with --normals.",
)  # fmt: skip
@click.option("--layer", help="Layer of the normals' EXR, like nn or ViewLayer.Normal.")
@click.option(
    "--normals-range", type=click.Choice(["signed", "unsigned"]),
    help="[-1, 1] or [0, 1]. Needed with --normals.",
)  # fmt: skip
@click.option(
    "--mesh", type=click.Path(path_type=Path), metavar="MESH",
    help="The picture shows this mesh (OBJ, OFF, PLY, glTF), its own shadows included.",
)  # fmt: skip
@click.option(
    "--camera", type=_Numbers("X,Y,Z[,TX,TY,TZ]", (3, 6)),
    help="Where the mesh's camera stands, and what it looks at (0,0,0).",
)  # fmt: skip
@click.option(
    "--up", type=_Numbers("X,Y,Z", (3,)), default="0,0,1", show_default=True,
    help="Up in the picture, of the mesh's camera.",
)  # fmt: skip
@click.option(
    "--fov", type=FiniteRange(0.1, 170), metavar="DEGREES",
    help="Horizontal field of view of the mesh's camera; orthographic without.",
)  # fmt: skip
@click.option(
    "--width", type=FiniteRange(0, min_open=True), default=2.1, show_default=True,
    help="Width of an orthographic camera's view.",
)  # fmt: skip
@click.option(
    "--mask", type=click.Path(path_type=Path), metavar="PICTURE",
    help="Pixels to use: those above one half.",
)  # fmt: skip
@click.option(
    "--albedo", default="1", show_default=True, type=_Numbers("A or R,G,B", (1, 3)),
    help="Of the object.",
)  # fmt: skip
@click.option(
    "--brdf", type=BrdfText(), help="A reflectance in place of the matte one."
)
@click.option(
    "--l-max", default=2, show_default=True, type=click.IntRange(0, 10),
    help="Highest degree of the coefficients returned.",
)  # fmt: skip
@click.option(
    "--exposure", default=1.0, show_default=True,
    type=FiniteRange(0, min_open=True),
    help="What the picture was multiplied by.",
)  # fmt: skip
@click.option(
    "--transfer", type=click.Choice(["auto", "srgb", "linear"]), default="auto",
    show_default=True,
    help="How an 8- or 16-bit picture stores light; auto: sRGB unless the file says "
    "otherwise.",
)  # fmt: skip
@click.option(
    "--nonnegative", is_flag=True, help="Allow no light of negative radiance."
)
@click.option(
    "--loss", default="squares", show_default=True,
    type=click.Choice(["squares", "huber", "cauchy"]),
    help="Of the residuals; huber and cauchy bear outliers.",
)  # fmt: skip
@click.option(
    "--plain", is_flag=True,
    help="Least squares of these degrees alone: light of higher ones is an error of them.",
)  # fmt: skip
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
@click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")
def estimate(image: Path, out: Path, as_json: bool, quiet: bool, **options) -> int:
    """Estimate the light from a picture of an object whose shape is known.

    IMAGE is linear (EXR, HDR) or an 8- or 16-bit picture, decoded as sRGB unless
    --transfer linear says that it is not; values
    at its white count as "at least that". Say what it shows by one of --sphere, --normals
    or --mesh. A sphere and normals of the camera's frame are seen along +x with +z up:
    that frame is the light's.

    \b
    DIR receives
      NAME_light.json       coefficients, standard deviations, what is determined
                            (shjax convert and shjax score read it)
      NAME_light.exr, .png  the estimated light as a panorama
      NAME_pictures.exr     drawn from the estimate; the picture; their difference
                            (.png: full colour at a tenth of white)

    \b
    Examples:
      shjax estimate ball.png --sphere 244.5,144.5,108 --out results
      shjax estimate photo.exr --normals normals.exr --normals-frame camera \\
        --normals-range signed --albedo 0.6,0.5,0.4 --out results
      shjax estimate bunny.exr --mesh bunny.ply --camera 0,0,4 --up 0,1,0 --out results
    """
    check_folder(out)
    click.get_current_context().with_resource(protecting(image))
    _check(options)
    with alone(out, image.stem):
        result = run(image, out, **options)
    if as_json and not quiet:
        print(json_text(result))
    elif not quiet:
        show(Console(highlight=False), result)
    return 0


def _check(options: dict) -> None:
    ways = [name for name in ("sphere", "normals", "mesh") if options[name] is not None]
    if len(ways) != 1:
        raise click.UsageError(
            "say what the picture shows by one of --sphere, --normals and --mesh; got "
            f"{' and '.join(ways) or 'none'}."
        )
    named = options["normals_frame"] and options["normals_range"]
    if ways == ["normals"] and not named:
        raise click.UsageError(
            "--normals needs --normals-frame (world or camera) and --normals-range "
            "(signed or unsigned): neither can be told from the numbers."
        )
    if ways == ["mesh"] and options["camera"] is None:
        raise click.UsageError("--mesh needs --camera.")
    if options["brdf"] is not None and ways == ["mesh"]:
        raise click.UsageError("--brdf does not go with --mesh: its shadows are matte.")
    if (
        options["brdf"] is not None
        and ways == ["normals"]
        and options["normals_frame"] not in surface.SEEN_FRAMES
    ):
        raise click.UsageError(
            "--brdf needs views, which normals in the world's frame do not tell."
        )


def _shown(size: tuple[int, int], options: dict) -> surface.Shown:
    if options["sphere"] is not None:
        return surface.of_sphere(size, options["sphere"])
    if options["normals"] is not None:
        return surface.of_normals(
            size, options["normals"], options["normals_frame"],
            options["normals_range"] == "signed", options["mask"],
            options["layer"],
        )  # fmt: skip
    place = options["camera"]
    fov = None if options["fov"] is None else float(np.radians(options["fov"]))
    camera = Camera(
        origin=place[:3], target=place[3:] or (0.0, 0.0, 0.0), up=options["up"],
        width=options["width"], fov=fov,
    )  # fmt: skip
    degree = options["l_max"] if options["plain"] else 10
    shown = surface.of_mesh(size, options["mesh"], camera, degree)
    if options["mask"] is None:
        return shown
    weights = surface.read_mask(options["mask"], size)
    weights = weights if shown.mask is None else weights * shown.mask
    return dataclasses.replace(shown, mask=weights)


def run(image: Path, out: Path, **options) -> dict:
    """The whole job; writes into ``out`` and returns what it found."""
    picture, transfer = _light_of(image, options["transfer"])
    size = picture.shape[:2]
    ldr = image.suffix.lower() in _LDR
    clipped = picture >= 1 - 1e-6 if ldr else np.zeros(picture.shape, bool)
    picture = picture / options["exposure"]
    if options["sphere"] is not None:
        window, factor, circle = surface.crop_to_sphere(size, options["sphere"])
        picture = surface.averaged(picture[window], factor)
        clipped = surface.averaged(clipped[window].astype(float), factor) > 0
        shown = surface.of_sphere(picture.shape[:2], circle)
        if options["mask"] is not None:
            whole = surface.read_mask(options["mask"], size)[window][..., None]
            weights = (surface.averaged(whole, factor)[..., 0] == 1).astype(float)
            shown = dataclasses.replace(shown, mask=weights)
    else:
        shown = _shown(size, options)
    normals, mask, brdf = shown.normals, shown.mask, options["brdf"]
    more = {}
    if brdf is not None:
        normals = np.asarray(shown.gbuffer.normals)
        inside = (np.asarray(shown.gbuffer.mask) == 1).astype(float)
        mask = inside if mask is None else mask * inside
        more = {"brdf": brdf, "views": shown.gbuffer.views}
    albedo = np.array(options["albedo"])
    found = shjax.estimate_lighting(
        picture, normals, mask=mask, albedo=albedo, l_max=options["l_max"],
        prior=None if options["plain"] else "picture", rows=shown.rows,
        clipped=clipped if clipped.any() else None, loss=options["loss"],
        nonnegative=options["nonnegative"], **more,
    )  # fmt: skip
    again = _again(found, shown, albedo)
    result = {
        "schema": SCHEMA,
        "source": str(image),
        "shows": shown.about,
        "transfer": transfer,
        "l_max": options["l_max"],
        "frame": FRAME if options["mesh"] is None else "the mesh's own coordinates",
        "basis": BASIS,
        "convention": "shjax",
        "coefficients": np.asarray(found.value, float).tolist(),
        "standard_deviation": _finite(found.standard_deviation),
        "prior_fraction": np.asarray(found.prior_fraction, float).tolist(),
        "condition_number": found.condition_number,
        "ok": found.ok,
        "message": found.message,
        "clipped_share": float(clipped.mean()),
        "noise": _finite(found.noise),
        "residual_rms_over_mean": _residual(picture, again, shown),
    }
    result["words"] = words(result)
    result["files"] = write(out, image.stem, result, found, picture, again, shown)
    return result


def _light_of(image: Path, transfer: str) -> tuple[np.ndarray, str]:
    """A picture's linear light, and how it was decoded, in words."""
    decoded = decode(image, max_pixels=MAX_PIXELS, isolate=True)
    picture = in_memory(image, decoded).astype(float)
    if not np.all(np.isfinite(picture)):
        bad = int(np.sum(~np.isfinite(picture)))
        raise ValueError(f"{image}: {bad} values are NaN or infinite.")
    stored_as_srgb = "sRGB decoded" in decoded.kind
    if transfer == "linear" and stored_as_srgb:
        return encode_srgb(picture), "taken as linear, as --transfer says"
    if transfer == "srgb" and not stored_as_srgb:
        return decode_srgb(
            np.clip(picture, 0, 1)
        ), "decoded as sRGB, as --transfer says"
    if stored_as_srgb:
        return picture, "decoded as sRGB (--transfer linear if it is not)"
    return picture, "linear"


def _finite(values) -> list:
    array = np.asarray(values, float)
    finite = array.astype(object)
    finite[~np.isfinite(array)] = None
    return finite.tolist()


def _again(found: Estimate, shown: surface.Shown, albedo):
    """The picture drawn from the estimate."""
    if shown.rows is None:
        picture = np.asarray(found.predict(shown.gbuffer)[0])
        return picture * albedo
    made = jnp.asarray(shown.rows) @ found.full_value[: shown.rows.shape[-1]]
    return np.asarray(covered(shown.gbuffer, made)) * albedo


def _residual(picture, again, shown: surface.Shown) -> float:
    whole = np.asarray(shown.gbuffer.mask) == 1
    if shown.mask is not None:
        whole = whole & (shown.mask > 0)
    mean = picture[whole].mean()
    return float(np.sqrt(np.mean((picture - again)[whole] ** 2)) / (mean or 1.0))
