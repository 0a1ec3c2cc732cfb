"""From pictures back to lighting and reflectance, and what they could not determine."""

from shjax.inverse.joint import estimate_joint as estimate_joint
from shjax.inverse.lighting import estimate_lighting as estimate_lighting
from shjax.inverse.pictures import Decoded as Decoded
from shjax.inverse.pictures import decode as decode
from shjax.inverse.reflectance import estimate_brdf as estimate_brdf
from shjax.inverse.rows import visible_cosine as visible_cosine
