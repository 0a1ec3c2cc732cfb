"""View bases fitted to what they serve: few maps, small errors at grazing views too.

The thesis expands the view in harmonics ``Y_pq`` [T5, Eq. 5.10], which are smooth where
Fresnel's term and ``1 / n.v`` pile up. Here, in each azimuthal order q, the kernel
``G_lq(theta_o)`` (the BRDF about R, a function of the view) is approximated by a few
products ``c_lk b_k(theta_o)``: profiles over the light's degree, which make the maps, and
functions of the view, which read them. Everything else of the theory stays, the exact
error included. :func:`adapt` fits one BRDF; :func:`family` holds a fit of all of GGX.

References:
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
"""

from shjax.adapted.ggx import Family as Family
from shjax.adapted.ggx import family as family
from shjax.adapted.ranks import RANKS as RANKS
from shjax.adapted.ranks import check_maps as check_maps
from shjax.adapted.ranks import signed_functions as signed_functions
from shjax.adapted.single import Adapted as Adapted
from shjax.adapted.single import adapt as adapt
from shjax.adapted.single import project as project
