"""Laws of the level of a surface: the prior does not pull it, whatever the level is.

A surface as light as any other is answered without bias, where the light is known to 3 %; a family
that is stated keeps the level that it has.
"""
import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import truncnorm

from spectrabox.radiometry.grid import interpolation_matrix, visible_grid
from spectrabox.radiometry.spectra.named_spectra import relative_response
from spectrabox.sampling.prior.level import GRID, levels_of, tilt
from spectrabox.sampling.prior.mixture import (
    PRIOR_GRID,
    drawn_reflectances,
    load_prior,
    logit,
    of_families,
    save_prior,
)
from spectrabox.sampling.prior.mixture_posterior import posterior
from spectrabox.sampling.prior.summaries import summaries

LIGHT_ERROR, OWN = 0.03, 0.005
SEEN = slice(6, None)           # from 430 nm on
SURFACES = 100


@pytest.fixture(scope="module")
def response():
    fine = visible_grid()
    return relative_response("Nikon 5100 (NPL)", "D65", fine) \
        @ interpolation_matrix(PRIOR_GRID.nm, fine.nm)


def nearly_grey(level, rng):
    """Greys, and greys that lean to either end of the spectrum by up to a tenth."""
    lean = rng.uniform(-1, 1, (SURFACES, 1)) * np.linspace(-0.05, 0.05, PRIOR_GRID.nm.size)
    lean[::2] = 0
    return np.minimum(level * (1 + lean), 0.99)


@pytest.mark.parametrize("level", [0.02, 0.05, 0.2, 0.6, 0.8, 0.9, 0.97])
def test_the_prior_does_not_pull_the_level_of_a_surface(response, level):
    rng = np.random.default_rng(1)
    truth = nearly_grey(level, rng)
    exact = truth @ response.T
    # errors of light in pairs of opposite sign: their mean is that of the answer alone
    light = LIGHT_ERROR * rng.standard_normal((SURFACES // 2, 1))
    seen = exact * (1 + np.concatenate([light, -light])) \
        + OWN * exact * rng.standard_normal(exact.shape)
    noise = LIGHT_ERROR**2 * seen[:, :, None] * seen[:, None, :] \
        + np.einsum("tk,kl->tkl", (OWN * seen)**2, np.eye(3))
    found = summaries(load_prior(), response, seen, {"errors": noise}, 0.95)
    bias = ((found.mean - truth) @ response.T).mean()
    # Nothing reflects more than all light: signals above white are answered by less.
    error = LIGHT_ERROR * level
    forced = np.mean(truncnorm.mean(-level / error, (0.996 - seen) / error, seen, error) - exact)
    # 1 L* is 0.9 % of white and more, above a level of 0.05
    assert abs(bias - forced) < error / 3
    held = (truth >= found.lower) & (truth <= found.upper)
    assert held[:, SEEN].mean() > 0.9


def test_levels_drawn_from_the_prior_are_uniform_and_those_of_a_stated_family_its_own():
    prior = load_prior()
    assert prior.uniform_level and not of_families(prior, ["skin"]).uniform_level
    drawn = 1 / (1 + np.exp(-logit(drawn_reflectances(prior, 20000)).mean(axis=1)))
    shares = np.histogram(drawn, np.linspace(0, 1, 6))[0] / 20000
    assert_allclose(shares, 0.2, atol=0.06)
    plain = dataclasses.replace(prior, uniform_level=False)
    kept = of_families(prior, ["paint"]), of_families(plain, ["paint"])
    for name in ("weights", "means", "covariances"):
        assert_allclose(getattr(kept[0], name), getattr(kept[1], name))


def test_a_tilted_component_is_the_component_times_the_weight():
    # a wide level among narrower ones: log w is all but a parabola near its own level
    prior = load_prior()
    component, level = int(np.argmin(np.abs(prior.means.mean(axis=1)))), 0.3
    shift, stretch, log_weight = tilt(prior, np.array([component]), np.array([level]))
    m, s = prior.level_mean[component], prior.level_variance[component]
    mean, variance = m + shift[0] * s, s + stretch[0] * s**2
    slope, bend = (np.interp(level, GRID, values) for values in prior.level_weight[1:])
    near = GRID[np.abs(GRID - level) < 0.5]
    wanted = -(near - m)**2 / s / 2 + slope * (near - level) + bend * (near - level)**2 / 2
    shape = -(near - mean)**2 / variance / 2
    assert_allclose(wanted - wanted[0], shape - shape[0], atol=1e-9)
    # and it weighs as much as the integral over all levels
    whole = -(GRID - m)**2 / s / 2 - np.log(s) / 2 + np.interp(level, GRID, prior.level_weight[0]) \
        + slope * (GRID - level) + bend * (GRID - level)**2 / 2
    integral = np.exp(whole).sum() * (GRID[1] - GRID[0]) / np.sqrt(2 * np.pi)
    assert np.exp(log_weight[0]) == pytest.approx(integral, rel=1e-3)


def test_families_keep_their_shares_of_a_level():
    prior = load_prior()
    joint = levels_of(prior)
    given = np.exp(-(GRID - prior.level_mean[:, None])**2 / prior.level_variance[:, None] / 2) \
        * (prior.weights / np.sqrt(prior.level_variance))[:, None]
    at = np.searchsorted(GRID, [-3.0, 0.0, 2.0])
    assert_allclose((joint / joint.sum(axis=0))[:, at], (given / given.sum(axis=0))[:, at],
                    rtol=1e-9)


def test_one_signal_has_the_posterior_that_it_has_among_others(response):
    prior = load_prior()
    signals = nearly_grey(0.8, np.random.default_rng(2))[:3] @ response.T
    noise = np.einsum("tk,tl->tkl", 0.03 * signals, 0.03 * signals) + 1e-6 * np.eye(3)
    together = posterior(prior, response, signals, noise)
    alone = posterior(prior, response, signals[1:2], noise[1])
    for name in ("weights", "shift", "stretch"):
        assert_allclose(getattr(alone, name)[0], getattr(together, name)[1], atol=1e-9)


def test_a_file_says_whether_the_level_is_uniform(tmp_path):
    prior = load_prior()
    for uniform in (True, False):
        save_prior(tmp_path / "prior.npz", dataclasses.replace(prior, uniform_level=uniform))
        assert load_prior(tmp_path / "prior.npz").uniform_level is uniform
