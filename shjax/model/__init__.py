"""The least model that a scene needs: chosen by its predicted error, checked by measuring.

Four kinds, from few numbers to many: coefficients of the irradiance about the normal; a
radial map about R (P = 0); a map without azimuth (q = 0); the SHRM. A diffuse part stays
about the normal, where it needs a handful of numbers, and is no part of the map. Each
candidate's error is predicted from the light's spectrum [MATH, section 5], the cross terms
of diffuse and specular included, and the one that is read in the least time is chosen.
"""

from shjax.model.choice import choose_model as choose_model
from shjax.model.known import Energies as Energies
from shjax.model.known import Light as Light
from shjax.model.known import brdf_energies as brdf_energies
from shjax.model.known import light_coefs as light_coefs
from shjax.model.known import prepare_light as prepare_light
from shjax.model.representation import KINDS as KINDS
from shjax.model.representation import Model as Model
