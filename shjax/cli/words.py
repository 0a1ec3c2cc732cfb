"""Words that options take, of tables that need JAX, so that help does not.

A test compares each with the table it names.
"""

from __future__ import annotations

BRDFS = (
    "lambertian",
    "phong",
    "phong_cosine",
    "gaussian_microfacet",
    "ggx",
    "metallic_roughness",
    "lafortune",
    "kajiya_kay",
    "charlie",
    "merl",
    "cornell",
    "curet",
)
CONVENTIONS = (
    "shjax",
    "blender",
    "three.js",
    "cmgen",
    "cmgen irradiance",
    "cmgen shader",
    "cmgen no-mirror",
    "cmgen no-mirror irradiance",
    "cmgen no-mirror shader",
    "mitsuba",
    "openexr",
    "usd",
    "babylon.js",
    "babylon.js shader",
    "cmft",
    "rh01",
    "google spherical-harmonics",
    "materialx",
    "materialx irradiance",
    "debevec",
    "skylibs",
    "nvdiffrec",
    "gltf",
    "unity",
    "unreal",
    "arkit",
    "arcore",
    "directxmath",
)
FORMATS = (
    "json",
    "csv",
    "c",
    "three",
    "gltf",
    "cmgen",
    "cmgen-no-mirror",
    "cmgen-irradiance",
    "cmgen-no-mirror-irradiance",
    "cmgen-shader",
    "cmgen-no-mirror-shader",
)
INVALID = ("error", "clamp", "zero", "keep")
MAPS = ("4", "9", "16", "21")
NORMAL_FRAMES = ("world", "blender", "mitsuba", "camera", "opencv")
SEEN_FRAMES = ("camera", "opencv")  # in which the direction to the camera is known
OPERATORS = ("reinhard", "linear", "aces")
UP_AXES = ("y", "z")
WINDOWS = ("none", "hann", "lanczos", "sinc^4", "automatic")
