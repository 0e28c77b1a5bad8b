"""Errors of many signals at once by the curves of camera and light, against those of one material.
"""
import dataclasses

import numpy as np
import pytest
from test_error_budget import GRID as COARSE
from test_error_budget import LIGHTS, calibration, curves_and_covariance

from spectrabox.radiometry.error_model import (
    curve_errors,
    light_covariance,
    light_errors,
    sensitivity_covariance,
)
from spectrabox.radiometry.grid import FINE_GRID, interpolation_matrix, visible_grid
from spectrabox.radiometry.interreflection import response_matrix, white_signal
from spectrabox.radiometry.records.spectra import SurfaceSignals

READINGS = visible_grid(20)


@pytest.mark.parametrize("fitted", [True, False])
@pytest.mark.parametrize("read", [True, False])
def test_errors_of_many_signals_by_the_curves_are_those_of_each_alone(fitted, read):
    rng = np.random.default_rng(11)
    coefficients, covariance = curves_and_covariance()
    made = calibration(LIGHTS[1], coefficients, covariance if fitted else None)
    to_fine = interpolation_matrix(COARSE.nm, FINE_GRID.nm)
    fit = dataclasses.replace(made.sensitivity, grid=FINE_GRID, curves=made.sensitivity.curves
                              @ to_fine.T, basis=to_fine @ made.sensitivity.basis)
    light = dataclasses.replace(
        made.light, grid=READINGS, values=np.interp(READINGS.nm, COARSE.nm, LIGHTS[1]),
        standard_error=np.full(READINGS.nm.size, 0.02) if read else None)
    made = dataclasses.replace(made, sensitivity=fit, light=light)
    response = response_matrix(FINE_GRID, fit.curves,
                               np.interp(FINE_GRID.nm, READINGS.nm, light.values))
    response /= white_signal(response)[:, None]
    spectra = np.clip(0.4 + 0.3 * np.cumsum(rng.standard_normal((5, 61)), axis=1) / 8, 0, 1)
    # not quite those of the spectra: signals are measured
    signals = spectra @ to_fine.T @ response.T + 0.01 * rng.standard_normal((5, 3))
    surfaces = SurfaceSignals(tuple("abcde"), (False,) * 5, FINE_GRID, spectra @ to_fine.T,
                              tuple("RGB"), np.zeros(3, int), response, signals, {})
    errors = curve_errors(made, FINE_GRID).together_with(light_errors(made, FINE_GRID, response))
    found = errors.at(COARSE.nm, FINE_GRID).covariance(signals, spectra)
    both = sensitivity_covariance([made], surfaces) + light_covariance([made], surfaces)
    for index, alone in enumerate(both):
        # sums of 301 products and the roots of a covariance: some 1e-13 of its largest entry
        np.testing.assert_allclose(found[index], alone, rtol=0, atol=1e-11 * alone.max())
        assert alone.max() > 0
