"""What the transport's Monte Carlo noise adds to a fit is taken off, and a scale errs as stated.

Statistical tests have a significance of 1e-4 (3.9 sigma), at fixed seeds.
"""
import numpy as np
import pytest
from test_reconstruct_fit import BASIS, COUNT, GROUP, REGIONS, case, fit_spectra, model, transport

from spectrabox.reconstruct.fit.band_system import compress
from spectrabox.reconstruct.fit.view_terms import Nuisances, ViewTerms
from spectrabox.reconstruct.tracer.transport import TracedTransport

SIGMAS = 3.9
PASSES, NOISE = 4, 0.3


def test_noise_of_the_transport_is_taken_off_cost_pull_and_information():
    """Errors in the variables: rows that err by e have sums of squares larger by those of e."""
    rng = np.random.default_rng(31)
    rows, truth = transport(rng), rng.uniform(0.2, 0.7, (2, COUNT))
    measured = 1.05 * rows @ model().signals(truth)
    weight = np.full_like(measured, 1e4)
    nuisances = Nuisances(scale=1.0, surface_error=0.05)
    state = np.append(truth.ravel(), np.zeros(6))   # spectra, and gains of two surfaces

    def expanded(mean, deviations):
        system = compress(mean, measured, weight, GROUP, deviations)
        cost, pull, information = ViewTerms(system, model(), nuisances).expand(state)
        return np.concatenate([[cost], pull, information.ravel()])

    clean, plain, found = expanded(rows, None), [], []
    for _ in range(300):
        passes = rows * (1 + NOISE * rng.standard_normal((PASSES, REGIONS, 1)))
        mean = passes.mean(axis=0)
        plain.append(expanded(mean, None))
        found.append(expanded(mean, (passes - mean) / np.sqrt(PASSES * (PASSES - 1))))
    error = np.std(found, axis=0, ddof=1) / np.sqrt(len(found))
    added = np.mean(plain, axis=0) - clean
    # a hundredth of a surface's noise may be left on
    allowed = SIGMAS * error + 0.02 * np.abs(added)
    off = np.abs(np.mean(found, axis=0) - clean)
    assert np.all(off <= allowed + 1e-9 * np.abs(clean).max())
    # the test can tell: what is taken off is far more than what is allowed
    information = slice(1 + state.size, None)
    told = added[information] > 4 * allowed[information]
    assert np.count_nonzero(told) >= 40 and added[0] > 4 * allowed[0]


@pytest.mark.parametrize("scale", [0.2, 3.7])
def test_the_stated_error_of_a_scale_is_that_of_repeated_photos(scale):
    rng = np.random.default_rng(32)
    rows, clean, _, truth = case(seed=7)
    clean = scale * clean
    known = model({0: truth[0] @ BASIS.T})
    fits = []
    for _ in range(60):
        measured = clean * (1 + 0.02 * rng.standard_normal(clean.shape))
        system = compress(rows, measured, 1 / (0.02 * clean) ** 2, GROUP)
        fits.append(fit_spectra(system, known).views[0])
    found, stated = (np.array([getattr(fit, name) for fit in fits])
                     for name in ("scale", "scale_error"))
    # 59 degrees of freedom know a deviation to 9 %
    assert found.std(ddof=1) / stated.mean() == pytest.approx(1, abs=SIGMAS * 0.092)


def test_deviations_of_passes_are_those_of_their_mean():
    """Four traces that err by 0.1 each have a mean that errs by 0.05."""
    rng = np.random.default_rng(34)
    passes = 1 + 0.1 * rng.standard_normal((PASSES, 20_000, 1, 1))
    traced = TracedTransport(np.zeros((1, 1), int), passes, 16, 0.0)
    variance = np.sum(traced.deviations**2, axis=0).mean()
    # 60 000 degrees of freedom know a variance to 0.6 %
    assert variance == pytest.approx(0.1**2 / PASSES, rel=0.025)
    assert np.var(traced.coefficients) == pytest.approx(0.1**2 / PASSES, rel=0.04)
