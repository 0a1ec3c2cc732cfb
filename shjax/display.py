"""From linear light to what a screen can show. NumPy only; nothing here is measured."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from shjax.arrays import check_channels, known_values
from shjax.colour import LUMINANCE
from shjax.srgb import decode_srgb, encode_srgb

OPERATORS = ("reinhard", "linear", "aces")
_ACES = ("sRGB - Display", "ACES 2.0 - SDR 100 nits (Rec.709)")


def tone_map(
    image: Float[np.ndarray, "H W C"],
    *,
    white: float | None = None,
    operator: str = "reinhard",
    encode: bool = False,
) -> Float[np.ndarray, "H W C"]:
    """Tone-map linear radiance to [0, 1], as display light or as sRGB display values.

    Args:
        image: Linear light, Rec. 709 if it has three channels.
        white: Luminance shown as white; default the image's 99.5 % quantile, and 1 for
            ``"linear"`` and ``"aces"`` (where it is no limit, only the scale). Values
            beside which a picture is to be compared need the same white.
        operator: ``"reinhard"`` [Reinhard et al. 2002, Eq. 4]; ``"linear"``, which clips;
            ``"aces"``, the ACES 2.0 rendering for an SDR screen, by OpenColorIO.
        encode: Whether the result is encoded by the sRGB curve, as ``imshow`` and 8-bit
            files show it; else it is linear display light, as
            :func:`shjax.io.write_image` takes it.

    Returns:
        Values in [0, 1].

    Raises:
        ValueError: If the operator is unknown, ``image`` no known array of floats, or the
            installed OpenColorIO has no such operator.
    """
    if operator not in OPERATORS:
        raise ValueError(
            f"operator must be one of {', '.join(OPERATORS)}; got {operator!r}."
        )
    check_channels("image", image, "H, W, C", 3)
    image = np.maximum(np.nan_to_num(known_values("image", image)), 0)
    if operator == "reinhard":
        shown = _reinhard(image, white)
    else:
        scaled = (image / (white or 1.0)).astype(np.float32)
        shown = np.clip(scaled, 0, 1) if operator == "linear" else _aces(scaled)
    return np.clip(encode_srgb(shown), 0, 1) if encode else shown


def _aces(image: np.ndarray) -> np.ndarray:
    import OpenImageIO as oiio

    rgb = np.ascontiguousarray(np.broadcast_to(image, (*image.shape[:2], 3)))
    shown = oiio.ImageBufAlgo.ociodisplay(
        oiio.ImageBuf(rgb),
        *_ACES,
        "Linear Rec.709 (sRGB)",
        colorconfig="ocio://default",
    )
    if shown.has_error:
        raise ValueError(f"operator 'aces' is not available: {shown.geterror()}.")
    encoded = np.clip(np.asarray(shown.get_pixels(oiio.FLOAT)), 0, 1)
    return decode_srgb(encoded)[..., : image.shape[-1]].astype(np.float32)


def _reinhard(image: np.ndarray, white: float | None) -> np.ndarray:
    weights = LUMINANCE if image.shape[-1] == 3 else (1 / image.shape[-1],)
    weights = np.resize(weights, image.shape[-1])
    light = np.sum(image * weights, axis=-1, keepdims=True)
    lit = light[light > 0]
    if not lit.size:
        return np.zeros_like(image)
    white = white or float(np.quantile(lit, 0.995))
    # The key: a white of 1.5 leaves the middle tones where they were.
    scaled, limit = light * (1.5 / white), 1.5
    gain = (1 + scaled / limit**2) / (1 + scaled) * (1.5 / white)
    return np.clip(image * gain, 0, 1).astype(np.float32)


def show_difference(
    difference: Float[np.ndarray, "H W C"], scale: float
) -> Float[np.ndarray, "H W 3"]:
    """Map signed differences to colours: red above zero, blue below, white at zero.

    Args:
        difference: Signed values; channels are averaged.
        scale: The value shown in full colour.
    """
    level = np.clip(np.mean(difference, axis=-1) / (scale or 1.0), -1, 1)[..., None]
    red, blue = np.array([0.65, 0.02, 0.05]), np.array([0.02, 0.1, 0.55])
    colour = np.where(level > 0, red, blue)
    return (1 + np.abs(level) * (colour - 1)).astype(np.float32)
