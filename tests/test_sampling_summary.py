"""Mean, spread, band and bounds of draws against their definitions, and where the next reading
helps most.
"""
from dataclasses import replace

import numpy as np
import pytest
from sampling_cameras import seen, surface
from scipy import stats

from spectrabox.radiometry.errors import ConvergenceError, InputError
from spectrabox.radiometry.grid import basis_matrix, visible_grid
from spectrabox.radiometry.records.spectra import Outcome, SpectralMeasurement, SpectrumSamples
from spectrabox.sampling.further.more_measurements import Reading, condition
from spectrabox.sampling.summary import next_measurement_nm, summarise
from spectrabox.sampling.uniform import sample_uniform

GRID = visible_grid(5)
COEFFICIENTS = 7
BASIS = basis_matrix(GRID.nm, COEFFICIENTS)


def paint(error=0.01):
    return seen(surface(GRID.nm, 8), error)


@pytest.fixture(scope="module")
def samples():
    return sample_uniform(paint(), 2_000, 1, COEFFICIENTS)


@pytest.mark.parametrize("level", [0.5, 0.95])
def test_the_band_leaves_equal_tails(samples, level):
    summary = summarise(samples, paint(), level)
    spectra = samples.spectra
    # Quantiles interpolate between neighbours: the count is off by at most one of 2000.
    np.testing.assert_allclose((spectra < summary.lower).mean(axis=0), (1 - level) / 2, atol=1e-3)
    np.testing.assert_allclose((spectra > summary.upper).mean(axis=0), (1 - level) / 2, atol=1e-3)
    assert summary.level == level


def test_the_next_reading_goes_where_conditioning_on_it_helps_most(samples):
    covariance = np.cov(samples.spectra, rowvar=False, ddof=0)
    best = next_measurement_nm(GRID, covariance)
    candidates = np.arange(0, 61, 2)
    left = []
    for index in candidates:
        gain = covariance[:, index] / (covariance[index, index] + 0.005**2)
        left.append(GRID.weights_nm @ np.diag(covariance - np.outer(gain, covariance[index])))
    assert abs(best - GRID.nm[candidates[np.argmin(left)]]) <= 10


def test_the_reading_it_asks_for_narrows_real_draws(samples):
    summary = summarise(samples, paint())
    value = np.interp(summary.next_measurement_nm, GRID.nm, summary.mean)
    more = condition(paint(), [Reading.at_wavelength(summary.next_measurement_nm, float(value))])
    after = summarise(sample_uniform(more, 2_000, 2, COEFFICIENTS), more)
    # One-sided at 1e-4: variances of 2000 draws are good to about 3 %, so a fall of 20 % cannot be
    # chance.
    allowed = 0.8 + stats.norm.isf(1e-4) * 0.03
    assert GRID.weights_nm @ after.standard_deviation**2 \
        < allowed * (GRID.weights_nm @ summary.standard_deviation**2)


def test_the_conditions_are_named(samples):
    on, ended = summarise(samples, paint()).conditional_on
    assert (on.code, on.values["method"]) == ("band.prior-and-sampler",
                                              "uniform (tilted rejection)")
    assert ended == Outcome.EXACT.finding()
    own = summarise(samples, paint(), conditional_on=(ended,))
    assert own.conditional_on == (ended,)


@pytest.mark.parametrize("level, needed", [(0.95, 1000), (0.9, 500), (0.5, 100), (0.99, 5000)])
def test_too_few_draws_for_a_band_are_an_error(samples, level, needed):
    few = replace(samples, effective_samples=needed - 1.0)
    match = (f"a {100 * level:g} % band needs {needed} effective draws and there are "
             f"{needed - 1}; draw more")
    with pytest.raises(ConvergenceError, match=match):
        summarise(few, paint(), level)
    enough = replace(samples, effective_samples=float(needed))
    assert summarise(enough, paint(), level).level == level


def test_a_level_that_is_no_probability_is_an_error(samples):
    with pytest.raises(InputError, match=r"a level of 1\.5 was asked for"):
        summarise(samples, paint(), level=1.5)


def test_one_certain_spectrum_has_no_spread():
    coefficients = np.linspace(0.2, 0.8, COEFFICIENTS)
    rows = np.random.default_rng(5).dirichlet(np.ones(GRID.nm.size), COEFFICIENTS)
    certain = SpectralMeasurement(GRID, rows, rows @ BASIS @ coefficients, np.zeros((7, 7)))
    draws = np.tile(coefficients, (1000, 1))
    point = SpectrumSamples(GRID, draws @ BASIS.T, draws, "given", 1000.0, 0, Outcome.EXACT,
                            (Outcome.EXACT.finding(),))
    summary = summarise(point, certain)
    np.testing.assert_allclose(summary.standard_deviation, 0, atol=1e-12)   # a sum of 1000
    # the solver's tolerance, through seven bands of a condition number of some hundred
    np.testing.assert_allclose(summary.bound_upper - summary.bound_lower, 0, atol=1e-5)
