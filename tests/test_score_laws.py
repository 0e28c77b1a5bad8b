"""What a run says of itself: shares inside bands of the stated level, and the worst of its bands.
"""
from types import SimpleNamespace

import numpy as np
import pytest

from spectrabox.calibrate.chart_findings import root_mean_square
from spectrabox.measure.rules import median_surface_error, worst_entry
from spectrabox.measure.rules import rehearsed as rule_on_rehearsal
from spectrabox.measure.scene.rehearsal import Rehearsed
from spectrabox.measure.surfaces.surface_spectra import score
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.findings import Severity
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.records.scenes import SurfaceAgreement
from spectrabox.radiometry.records.spectra import Outcome, SpectrumSamples
from spectrabox.sampling.evaluation.metrics import coverage_error
from spectrabox.sampling.further.more_measurements import Reading, condition


@pytest.mark.parametrize("inside", [0.905, 0.945, 0.955])
def test_the_95_per_cent_score_counts_truths_in_the_central_95_per_cent(inside):
    grid = grid_from_nm(np.arange(400.0, 701.0, 5.0))
    ladder = np.linspace(0.2, 0.6, 2001)
    samples = SpectrumSamples(grid, np.repeat(ladder[:, None], 61, axis=1),
                              np.full((2001, 5), 0.4), "test", 2001.0, 0, Outcome.CONVERGED, ())
    truth = np.full(61, 0.4 + 0.2 * inside)         # as far out as that share of the draws
    truth[:20] = 0.4
    summary = SimpleNamespace(grid=grid, mean=np.full(61, 0.4), lower=truth - 1, upper=truth + 1,
                              bound_lower=np.zeros(61), bound_upper=np.ones(61))
    found = score(truth, None, summary, samples)
    assert found.coverage_95 == pytest.approx(1.0 if inside < 0.95 else 20 / 61)


def test_a_surface_is_judged_by_its_worst_band():
    ratio = np.array([[1.0, 1.0, 0.8], [1.0, 1.1, 1.0], [1.02, 1.0, 1.0]])
    seen = SurfaceAgreement(("a", "b", "c"), ("a", "b", "c"), np.full(3, 100), ratio,
                            np.zeros((3, 3)))
    assert median_surface_error(seen) == pytest.approx(0.1)
    assert worst_entry(seen) == (0, 2)


@pytest.mark.parametrize("wavelengths", [1, 61])
def test_a_coverage_is_known_as_well_as_its_curves_are_many(wavelengths):
    """Curves that lie inside or outside as a whole: a binomial number of them, not of values."""
    rng = np.random.default_rng(41)
    errors, found = [], []
    for _ in range(400):
        inside = np.repeat(rng.uniform(size=(50, 1)) < 0.8, wavelengths, axis=1)
        errors.append(coverage_error(inside))
        found.append(inside.mean())
    # 400 numbers know a deviation to 3.5 %
    assert np.mean(errors) == pytest.approx(np.std(found, ddof=1), rel=0.14)
    assert np.mean(errors) == pytest.approx(np.sqrt(0.16 / 50), rel=0.03)


def test_a_residual_is_the_root_of_the_mean_square_of_what_was_measured():
    assert root_mean_square(np.array([[3.0, -4.0], [np.nan, 0.0]])) == pytest.approx(
        np.sqrt(25 / 3))
    assert root_mean_square(np.array([np.nan])) is None and root_mean_square(None) is None


@pytest.mark.parametrize("apart, said", [(0.06, "are the same measurement twice"),
                                         (0.08, "contradict each other beyond their errors")])
def test_two_readings_contradict_each_other_by_the_error_of_their_difference(apart, said):
    """0.014 of readings known to 0.01: 4.9 of it, which one pair in a million exceeds, are 0.069.
    """
    readings = [Reading.at_wavelength(550.0, value, 0.01) for value in (0.4, 0.4 + apart)]
    with pytest.raises(InputError, match=said):
        condition(SimpleNamespace(grid=grid_from_nm(np.arange(400.0, 701.0, 5.0))), readings)


def test_a_rehearsal_is_judged_by_the_material_whose_bands_hold_least():
    rehearsed = Rehearsed(0.95, 1, 40, ("good", "poor", "fair"), np.array([0.97, 0.88, 0.94]),
                          np.full(3, 0.005), np.full(3, 0.05), np.full(3, 0.2),
                          np.full((3, 10), 4))
    found, = rule_on_rehearsal(rehearsed)
    assert found.values["value"] == 0.88 and found.severity is Severity.WARN
    assert found.subject == "poor"
