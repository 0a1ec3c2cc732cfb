"""Pictures: cameras, G-buffers of spheres and meshes, and the radiance in them."""

from shjax.render.camera import Camera, camera_rays
from shjax.render.gbuffer import GBuffer, footprints, make_gbuffer, sphere
from shjax.render.meshes import Trace, mesh, trace_mesh, visibility
from shjax.render.pictures import (
    area_lit,
    background,
    image,
    mirrored,
    panorama_at,
    reference,
)

__all__ = [
    "Camera",
    "GBuffer",
    "Trace",
    "area_lit",
    "background",
    "camera_rays",
    "footprints",
    "image",
    "make_gbuffer",
    "mesh",
    "mirrored",
    "panorama_at",
    "reference",
    "sphere",
    "trace_mesh",
    "visibility",
]
