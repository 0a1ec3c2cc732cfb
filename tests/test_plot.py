"""Each figure is made, holds its panels, and can be saved."""

import numpy as np
import pytest

import shjax
from shjax import brdf, plot, render
from shjax.envmap import make_envmap

pytest.importorskip("matplotlib")


@pytest.fixture
def envmap(rng):
    return make_envmap(rng.uniform(0.5, 2, (32, 64, 3)).astype(np.float32))


def save(figure, tmp_path):
    figure.savefig(tmp_path / "figure.png", dpi=40)
    assert (tmp_path / "figure.png").stat().st_size > 2000


@pytest.mark.slow
def test_figures(envmap, tmp_path):
    lighting = envmap.lighting(l_max=8)
    expansion = shjax.brdf.expand(brdf.ggx(0.4, 0.5), l_max=8, p_max=3)
    maps = shjax.prefilter(
        lighting, expansion.rho.astype(lighting.dtype), n_theta=16, n_phi=32
    )
    coefficients = plot.coefficients(lighting[:9], size=24)
    assert len(coefficients.axes) == 8  # four pictures, four scales
    save(coefficients, tmp_path)
    spectra = plot.spectra(lighting, expansion, chosen=(5, 2))
    assert [axis.get_xlabel() for axis in spectra.axes] == [
        "degree l",
        "degree p of the view",
    ]
    save(spectra, tmp_path)
    pictures = plot.reflection_maps(maps)
    assert sum(bool(axis.images) for axis in pictures.axes) == 16
    save(pictures, tmp_path)
    ball = render.sphere(24)
    exact = render.image(ball, maps)
    errors = plot.errors({"half": 0.5 * exact}, exact)
    assert "50.00% rms" in [axis.get_title() for axis in errors.axes]
    save(errors, tmp_path)
    balls = plot.three_balls(envmap, glossy=brdf.phong(20.0), size=32, rms_error=0.2)
    assert [axis.get_title() for axis in balls.axes] == ["mirror", "glossy", "diffuse"]
    save(balls, tmp_path)
