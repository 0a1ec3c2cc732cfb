"""View bases fitted to one BRDF: energies, reading, what is refused."""

import jax.numpy as jnp
import numpy as np
import pytest

import shjax
from shjax import brdf
from shjax.reference.random_orientations import draw_orientations, measured_error
from shjax.reflection.ranks import RANKS, within
from tests.helpers import relative_error

COLOURED = brdf.lafortune(
    [[-1.0, -0.9, -0.8]], [[0.9, 1.0, 1.0]], [[8.0, 12.0, 20.0]], np.full(3, 0.1)
)


@pytest.mark.x64
@pytest.mark.parametrize(
    "name",
    ["microfacet", pytest.param("coloured", marks=pytest.mark.slow), "fibre"],
)
def test_energies_are_those_of_the_expansion(name):
    """Of all of it, and of what is held: more maps hold more, uniform light is met."""
    model = {
        "microfacet": brdf.gaussian_microfacet(0.3),
        "coloured": COLOURED,
        "fibre": brdf.kajiya_kay(12.0),
    }[name]
    exact = shjax.brdf.expand(model, l_max=12, p_max=8)
    lost = []
    fits = {
        maps: shjax.reflection.fit_low_rank(model, maps=maps, l_max=12)
        for maps in RANKS
    }
    for maps, fit in fits.items():
        assert fit.kernels.shape == (13, maps, model.channels)
        assert relative_error(fit.energy, exact.degree_energy) < 2e-3
        # Three channels of three shapes need three functions with q = 0.
        if maps >= 9 or model.channels == 1:
            assert np.all(np.asarray(fit.lost[0]) < 1e-3 * np.asarray(fit.energy[0]))
        lost.append(float(jnp.sum(fit.lost)))
    assert lost == sorted(lost, reverse=True)
    most, few = fits[21], fits[4]
    assert relative_error(most.fewer(4).kernels, few.kernels) < 1e-6
    assert relative_error(most.fewer(4).views.table, few.views.table) < 1e-4
    assert relative_error(most.kernels[:, within(4)], few.kernels) < 1e-6


def test_maps_read_in_the_basis_are_the_reflected_light(rng, dtype):
    """Against the integral, by the error that the lost energies predict."""
    l = np.repeat(np.arange(9), 2 * np.arange(9) + 1)
    light = jnp.asarray(rng.normal(size=(81, 3)) / (1 + l[:, None]), dtype)
    fit = shjax.reflection.fit_low_rank(COLOURED, maps=9, l_max=8)
    maps = shjax.prefilter(light, fit)
    samples = draw_orientations(2048, seed=0)
    normals, views, towards = (
        jnp.asarray(a, dtype)
        for a in (samples.normals, samples.views, samples.reflected)
    )
    seen = maps.read(towards, views)
    panorama = shjax.synthesize(light, n_theta=64, n_phi=128)
    exact = shjax.reference_reflection(panorama, COLOURED, normals, views)
    found = measured_error(seen, exact, samples.weights)
    spectrum = np.asarray(shjax.power_spectrum(light)) / (2 * np.arange(9)[:, None] + 1)
    predicted = np.sqrt(np.sum(spectrum * fit.lost) / np.sum(spectrum * fit.energy))
    assert float(maps.predicted_rms_error) == pytest.approx(predicted, rel=1e-3)
    limit = 0.05 * predicted + 3 * found.standard_error + 1e-3
    assert abs(found.rms - predicted) < limit


def test_what_is_refused():
    with pytest.raises(ValueError, match="maps must be one of 4, 9, 16, 21; got 8"):
        shjax.reflection.fit_low_rank(COLOURED, maps=8)
    mixed = brdf.kajiya_kay(3.0) + brdf.lambertian(0.2)
    with pytest.raises(ValueError, match="must not mix parts about the tangent"):
        shjax.reflection.fit_low_rank(mixed)


def test_functions_of_the_view_stay_bounded_at_grazing(rng):
    # In float32 1 + z vanishes where the normal still has a direction; the q-th power of
    # what that was divided by reached 1e8 at n.v = 1e-4.
    from shjax.reflection.view_basis import LowRankViews, view_lines

    orders = (0, 1, -1, 3, -3, 4, -4)
    table = np.ones((len(orders), len(view_lines())))
    angle = np.pi - 10 ** rng.uniform(-7, -1, 200)
    phi = rng.uniform(0, 2 * np.pi, 200)
    views = np.stack(
        [np.sin(angle) * np.cos(phi), np.sin(angle) * np.sin(phi), np.cos(angle)],
        axis=-1,
    )
    found = LowRankViews(
        jnp.asarray(table, jnp.float32), tuple(range(len(orders))), orders
    ).values(jnp.asarray(views, jnp.float32))
    assert np.max(np.abs(np.asarray(found))) <= np.sqrt(2) * 1.001
    rise = np.sin(angle / 2)
    exact = np.stack(
        [
            np.ones(200)
            if q == 0
            else np.sqrt(2)
            * rise ** abs(q)
            * (np.cos(q * phi) if q > 0 else np.sin(-q * phi))
            for q in orders
        ],
        axis=-1,
    )
    np.testing.assert_allclose(found, exact, atol=2e-5)
