"""The light: its scale in closed form, several lights, and spectra that cannot be right."""
import numpy as np
import pytest
from calibrate_cameras import GRID, daylight

from spectrabox.calibrate.chart_photo import light_power, unlit, wavelength_ranges
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.light_scale import scale_from_signals
from spectrabox.radiometry.records.spectra import Quantity, Spectrum

PREDICTED = np.random.default_rng(1).uniform(0.1, 1, (24, 3))


def test_the_light_scale_is_linear_in_the_light():
    scale = scale_from_signals(2.5 * PREDICTED, PREDICTED, 0.01, "chart")
    # One quotient of sums: a few eps.
    assert scale.value == pytest.approx(2.5, rel=1e-13)
    assert scale_from_signals(5.0 * PREDICTED, PREDICTED, 0.01,
                              "chart").value == pytest.approx(5.0, rel=1e-13)


@pytest.mark.parametrize("regions", [3, 24])
def test_bands_of_a_region_that_err_together_count_as_one(regions):
    rng = np.random.default_rng(8)
    fits = [scale_from_signals(2.5 * PREDICTED[:regions]
                               * (1 + 0.03 * rng.standard_normal((regions, 1))),
                               PREDICTED[:regions], 0.01, "chart") for _ in range(600)]
    stated = np.sqrt(np.mean([fit.standard_error**2 for fit in fits]))
    # The standard deviation of 600 draws is known to 3 %, a mean of 600 variances of 2 degrees of
    # freedom to 4 %.
    assert stated == pytest.approx(np.std([fit.value for fit in fits]), rel=0.12)


def test_the_closed_form_is_the_minimum_that_a_gradient_method_finds():
    from scipy.optimize import minimize_scalar
    measured = 1.7 * PREDICTED * (1
                                  + 0.05 * np.random.default_rng(3).standard_normal(
                                      PREDICTED.shape))
    loss = minimize_scalar(lambda scale: np.sum(((measured - scale * PREDICTED) / measured) ** 2),
                           (1, 2), options={"xtol": 1e-10})
    # The minimum of a parabola is found to the square root of eps.
    assert scale_from_signals(measured, PREDICTED, 0.01,
                              "chart").value == pytest.approx(loss.x, rel=1e-7)


def test_a_truncated_light_is_refused_with_what_is_missing():
    short = grid_from_nm(np.arange(420.0, 781.0))
    with pytest.raises(InputError, match="covers 420-780 nm; 400-700 nm is needed"):
        light_power(Spectrum(short, np.ones(361), Quantity.RELATIVE, "lamp.csv"), GRID)


def test_a_light_in_the_wrong_unit_is_refused():
    with pytest.raises(InputError, match="more than any lamp gives; state the unit"):
        light_power(Spectrum(GRID, 1e4 * daylight(), Quantity.IRRADIANCE, "lamp.csv"), GRID)


def test_a_negative_light_is_refused():
    with pytest.raises(InputError, match="a light spectrum must be positive"):
        light_power(Spectrum(GRID, daylight() - 1, Quantity.RELATIVE, "lamp.csv"), GRID)


def test_dark_ranges_are_found_at_both_ends():
    power = np.where((GRID.nm < 410) | (GRID.nm > 690), 0.0, 1.0)
    assert wavelength_ranges(unlit(power), GRID) == [(400.0, 409.0), (691.0, 700.0)]
