"""Real orthonormal spherical harmonics: grids, transforms, evaluation, rotation.

Convention: ``Y_lm = N_l|m| P_l|m|(cos t) (sqrt2 cos m p | 1 | sqrt2 sin |m| p)`` for
``m > 0 | m = 0 | m < 0``, without the Condon-Shortley phase [T4, Eqs. 4.3-4.5]; flat
index ``l (l + 1) + m`` on the axis before the last; ``l_max`` inclusive.

References:
    [T4] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 4.
"""

from shjax.harmonics.degrees import num_coefs, scale_degrees, spread
from shjax.harmonics.evaluation import basis, evaluate
from shjax.harmonics.rotation import rotate
from shjax.harmonics.spectrum import multiply, power_spectrum
from shjax.harmonics.transforms import analyze, project_samples, synthesize
from shjax.harmonics.wigner import wigner_d

__all__ = [
    "analyze",
    "basis",
    "evaluate",
    "multiply",
    "num_coefs",
    "power_spectrum",
    "project_samples",
    "rotate",
    "scale_degrees",
    "spread",
    "synthesize",
    "wigner_d",
]
