"""A signal that no reflectance gives has no narrow band: it errs by its distance to those that one
gives.
"""
import json

import numpy as np
import pytest
from scipy.optimize import nnls
from typer.testing import CliRunner

import spectrabox as sb
from spectrabox.radiometry.records.spectra import Outcome
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.sampling.prior.signal_posterior import UNREACHED
from spectrabox.sampling.spectral_measurement import response_on
from spectrabox.session.cli import app

CAMERA = {"camera": "Nikon 5100 (NPL)", "light": "D65", "draws": 1000}
IMPOSSIBLE = [[0.9, 0.01, 0.9], [0.0, 0.9, 0.0], [0.5, 0.0, 0.0], [1.0, 1.0, 0.0]]


def nearest(response, signal):
    """Least squares with 0 <= r <= 1 as non-negative least squares: r and what is left of 1."""
    bands, count = response.shape
    weight = 1e4            # of r + rest = 1, in place of an equality
    matrix = np.vstack([np.hstack([response, np.zeros((bands, count))]),
                        weight * np.hstack([np.eye(count), np.eye(count)])])
    solution, _ = nnls(matrix, np.r_[signal, np.full(count, weight)], maxiter=20_000)
    return response @ solution[:count]


@pytest.mark.parametrize("signal", IMPOSSIBLE)
def test_the_nearest_is_told_and_the_band_covers_the_distance(signal):
    estimate = sb.sample(signal, **CAMERA)
    assert estimate.ending is Outcome.OUT_OF_REACH and not estimate.as_intended
    finding = next(each for each in estimate.findings if each.code == "draws.out-of-reach")
    response = response_on(estimate.measurement, PRIOR_GRID)
    expected = nearest(response, np.array(signal))
    # both solvers to 1e-4 of white: the penalty of the equality, and their tolerances
    np.testing.assert_allclose(finding.values["nearest"], expected, atol=1e-4)
    distance = np.abs(expected - signal).max()
    assert finding.values["distance"] == pytest.approx(distance, abs=1e-4)
    lower, upper = estimate.band()
    lowest, highest = estimate.bounds()
    # bounds are of splines and the mean of straight lines: a few thousandths apart at most
    assert np.all(estimate.mean > lowest - 5e-3) and np.all(estimate.mean < highest + 5e-3)
    # the signals of the band's ends lie apart by the distance at least
    assert np.all(response @ (upper - lower) > distance)
    assert estimate.causes[UNREACHED] > 0.5
    assert sum(estimate.causes.values()) == pytest.approx(1, abs=1e-9)


def test_the_band_grows_with_the_distance_and_vanishes_with_none():
    """From a colour that a surface has, step by step out of reach."""
    inside, outside = np.array([0.5, 0.3, 0.4]), np.array([0.9, 0.01, 0.9])
    widths = []
    for share in (0.0, 0.6, 0.8, 1.0):
        estimate = sb.sample((1 - share) * inside + share * outside, **CAMERA)
        widths.append(estimate.band_width)
        assert (estimate.ending is Outcome.OUT_OF_REACH) == (share >= 0.6)
    assert np.all(np.diff(widths[1:]) > 0)


def test_many_signals_say_so_too():
    estimates = sb.sample([[0.5, 0.3, 0.4], IMPOSSIBLE[0]], **CAMERA)
    known, impossible = estimates.values()
    assert known.ending is not Outcome.OUT_OF_REACH
    assert impossible.ending is Outcome.OUT_OF_REACH and impossible.band_width > 0.3


def test_a_colour_outside_the_spectral_locus_is_told_on_the_command_line():
    result = CliRunner().invoke(app, ["sample", "--xyz", "0,29.33989,29.33989", "--samples",
                                      "1000", "--json"])
    facts = json.loads(result.stdout)
    assert result.exit_code == 0 and facts["ended"] == "out-of-reach"
    values = next(each["values"] for each in facts["findings"]
                  if each["code"] == "draws.out-of-reach")
    # relative to D65: X 5.1, Y 28.0, Z 28.3, computed by linear programming elsewhere
    np.testing.assert_allclose(values["nearest"], [5.1 / 95.05, 0.28, 28.3 / 108.9], atol=2e-3)
    lower, upper, mean = (np.array(facts[name]) for name in ("lower", "upper", "mean"))
    assert (upper - lower).mean() > values["distance"]
    assert np.all((mean >= facts["bound_lower"]) & (mean <= facts["bound_upper"]))
