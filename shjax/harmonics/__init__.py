"""Real orthonormal spherical harmonics: grids, transforms, evaluation, rotation.

Convention: ``Y_lm = N_l|m| P_l|m|(cos t) (sqrt2 cos m p | 1 | sqrt2 sin |m| p)`` for
``m > 0 | m = 0 | m < 0``, without the Condon-Shortley phase [T4, Eqs. 4.3-4.5]; flat
index ``l (l + 1) + m`` on the axis before the last; ``l_max`` inclusive.

References:
    [T4] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 4.
"""

from shjax.harmonics.degrees import num_coefs as num_coefs
from shjax.harmonics.degrees import scale_degrees as scale_degrees
from shjax.harmonics.degrees import spread as spread
from shjax.harmonics.evaluation import basis as basis
from shjax.harmonics.evaluation import evaluate as evaluate
from shjax.harmonics.rotation import rotate as rotate
from shjax.harmonics.spectrum import multiply as multiply
from shjax.harmonics.spectrum import power_spectrum as power_spectrum
from shjax.harmonics.transforms import analyze as analyze
from shjax.harmonics.transforms import project_samples as project_samples
from shjax.harmonics.transforms import sum_pixels as sum_pixels
from shjax.harmonics.transforms import synthesize as synthesize
from shjax.harmonics.wigner import wigner_d as wigner_d
