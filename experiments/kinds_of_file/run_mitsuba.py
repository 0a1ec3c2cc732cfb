"""Read files by Mitsuba 3: python run_mitsuba.py FILE ...; one JSON line for each."""

import json
import sys

import mitsuba as mi  # pyright: ignore[reportMissingImports]
import numpy as np

mi.set_variant("scalar_rgb")
mi.set_log_level(mi.LogLevel.Error)
for path in sys.argv[1:]:
    try:
        bitmap = mi.Bitmap(path)
        linear = bitmap.convert(
            mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, srgb_gamma=False
        )
        image = np.array(linear)
        answer = {"height": image.shape[0], "width": image.shape[1], "channels": 3}
        answer |= {"flipped": False, "data": image.ravel().tolist()}
        answer["data"] = [float(x) if np.isfinite(x) else None for x in answer["data"]]
    except Exception as error:
        answer = {"error": str(error).strip().splitlines()[-1]}
    print(json.dumps(answer), flush=True)
