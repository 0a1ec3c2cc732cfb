"""Pictures: cameras, G-buffers of spheres and meshes, and the radiance in them."""

from shjax.render.camera import Camera as Camera
from shjax.render.camera import camera_rays as camera_rays
from shjax.render.gbuffer import GBuffer as GBuffer
from shjax.render.gbuffer import footprints as footprints
from shjax.render.gbuffer import make_gbuffer as make_gbuffer
from shjax.render.gbuffer import sphere as sphere
from shjax.render.meshes import Trace as Trace
from shjax.render.meshes import mesh as mesh
from shjax.render.meshes import trace_mesh as trace_mesh
from shjax.render.meshes import visibility as visibility
from shjax.render.shading import background as background
from shjax.render.shading import glossy as glossy
from shjax.render.shading import lambertian as lambertian
from shjax.render.shading import lambertian_reference as lambertian_reference
from shjax.render.shading import metallic_roughness as metallic_roughness
from shjax.render.shading import mirrored as mirrored
from shjax.render.shading import panorama_at as panorama_at
from shjax.render.shading import reference as reference
from shjax.render.shading import shade as shade
