"""From linear light to what a screen can show. NumPy only; nothing here is measured."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from shjax.reference import LUMINANCE


def tone_map(
    image: Float[np.ndarray, "H W C"], *, white: float | None = None
) -> Float[np.ndarray, "H W C"]:
    """Compress radiance to [0, 1] [Reinhard et al. 2002, Eq. 4].

    Args:
        image: Linear light.
        white: Luminance shown as white; default the image's 99.5 % quantile. Values
            beside which a picture is to be compared need the same white.

    Returns:
        Linear display light, for an sRGB encoder.
    """
    image = np.maximum(np.nan_to_num(image), 0)
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
    """Signed values as colours: red above zero, blue below, white at zero.

    Args:
        difference: Signed values; channels are averaged.
        scale: The value shown in full colour.
    """
    level = np.clip(np.mean(difference, axis=-1) / (scale or 1.0), -1, 1)[..., None]
    red, blue = np.array([0.65, 0.02, 0.05]), np.array([0.02, 0.1, 0.55])
    colour = np.where(level > 0, red, blue)
    return (1 + np.abs(level) * (colour - 1)).astype(np.float32)
