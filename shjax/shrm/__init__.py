"""The spherical harmonic reflection map: reflected light of every direction and view.

A map holds coefficients over the view for each reflected direction R (the tangent, for
fibres): ``(..., n_theta, n_phi, Q, C)`` on a lat-long grid, ``(..., 6, size, size, Q, C)``
on a cube. *Local* coefficients are over the view in R's own frame (e_theta, e_phi, R),
*global* ones over the view in the world [T5, section 5.4].

References:
    [T5] R. Ramamoorthi, A Signal-Processing Framework for Forward and Inverse
    Rendering, PhD thesis, Stanford, 2002, chapter 5.
"""

from shjax.shrm.explicit import azimuthal_texture as azimuthal_texture
from shjax.shrm.explicit import dynamic_map as dynamic_map
from shjax.shrm.explicit import fit_views as fit_views
from shjax.shrm.explicit import icosahedral_maps as icosahedral_maps
from shjax.shrm.explicit import view_grid as view_grid
from shjax.shrm.explicit import view_maps as view_maps
from shjax.shrm.prefiltering import FRAMES as FRAMES
from shjax.shrm.prefiltering import default_size as default_size
from shjax.shrm.prefiltering import prefilter as prefilter
from shjax.shrm.prefiltering import prefilter_cube as prefilter_cube
from shjax.shrm.prefiltering import prefilter_in as prefilter_in
from shjax.shrm.prefiltering import prefilter_kernels as prefilter_kernels
from shjax.shrm.reading import in_spherical_frame as in_spherical_frame
from shjax.shrm.reading import radiance as radiance
from shjax.shrm.reading import read_in as read_in
