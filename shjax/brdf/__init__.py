"""Reflectance models: analytic, microfacet, measured; isotropic, or about a tangent.

A BRDF is a pytree; ``a + b`` and ``0.3 * b`` combine them. What a model defines is its
*transfer function*: the BRDF times the clamped cosine, or what its paper puts there.
"""

from shjax.brdf.checks import Check as Check
from shjax.brdf.checks import check as check
from shjax.brdf.core import Brdf as Brdf
from shjax.brdf.core import select as select
from shjax.brdf.core import transfer as transfer
from shjax.brdf.files import read_cornell as read_cornell
from shjax.brdf.files import read_curet as read_curet
from shjax.brdf.files import read_merl as read_merl
from shjax.brdf.ggx import ggx as ggx
from shjax.brdf.ggx import metallic_roughness as metallic_roughness
from shjax.brdf.measured import from_samples as from_samples
from shjax.brdf.measured import from_table as from_table
from shjax.brdf.models import gaussian_microfacet as gaussian_microfacet
from shjax.brdf.models import kajiya_kay as kajiya_kay
from shjax.brdf.models import lafortune as lafortune
from shjax.brdf.models import lambertian as lambertian
from shjax.brdf.models import phong as phong
from shjax.brdf.models import phong_cosine as phong_cosine
from shjax.brdf.parse import parse as parse
from shjax.brdf.quadrature import Resolution as Resolution
