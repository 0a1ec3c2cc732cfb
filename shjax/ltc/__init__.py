"""Linearly transformed cosines (LTC): reflection of area lights in closed form.

A clamped cosine turned and sheared by a matrix is close to a BRDF's lobe, and its integral
over a polygon is the irradiance of the polygon transformed back. Fast, and no more exact
than the fit: the table keeps its error. For the exact integral and for harmonics see
:func:`shjax.lights.area_reflection` and :func:`shjax.lights.area_shade`.

References:
    [HDHN16] E. Heitz, J. Dupuy, S. Hill, D. Neubelt, Real-Time Polygonal-Light Shading
    with Linearly Transformed Cosines, ACM TOG 35 (4), 2016.
"""

from shjax.ltc.fitting import fit
from shjax.ltc.table import LtcTable

__all__ = ["LtcTable", "fit"]
