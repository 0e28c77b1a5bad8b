"""Laws of the spline fits: exact recovery, invariance to exposure and patch order, honest standard
errors.
"""
import numpy as np
import pytest
from calibrate_cameras import GRID, daylight, led, reflectances, samples, signals
from scipy.stats import chi2
from uneven_charts import UNEVEN, patch_samples, uneven_photo

from spectrabox.calibrate.sensitivity import fit_sensitivities
from spectrabox.calibrate.spline_fit import SPLINE_METHODS, _solve_nonnegative, _solve_smooth
from spectrabox.radiometry.errors import CalibrationError, InputError
from spectrabox.radiometry.grid import basis_matrix, visible_grid

EVEN = np.full(24, np.pi)
BASIS = basis_matrix(GRID.nm, 10)
SIGMAS = 3.9        # of a test of significance 1e-4


def spline_camera(seed=2):
    coefficients = np.zeros((3, 10))
    rng = np.random.default_rng(seed)
    coefficients[:, 1:-1] = np.array([[0.1, 0.1, 0.1, 0.1, 0.3, 0.9, 0.6, 0.2],
                                      [0.1, 0.2, 0.4, 1.0, 0.7, 0.3, 0.1, 0.1],
                                      [0.3, 0.9, 0.8, 0.3, 0.1, 0.1, 0.1, 0.1]]) + rng.uniform(
        0, 0.05, (3, 8))
    return coefficients / (coefficients @ BASIS.T).max()


def fit(method, signal, light=None, surfaces=None, error=0.0):
    return fit_sensitivities(samples(signal, error), reflectances() if surfaces is None
                             else surfaces,
                             daylight() if light is None else light, EVEN, GRID, method=method)[:2]


@pytest.mark.parametrize("light", [daylight, led])
@pytest.mark.parametrize("method", ["paper", "nonnegative"])
def test_a_camera_of_the_spline_class_is_recovered_exactly(method, light):
    truth = spline_camera()
    signal = 0.3 * signals(truth @ BASIS.T, light(), reflectances())
    result, scale = fit(method, signal, light())
    # Round-off is about condition number x eps = 1e3 x 2e-16; 1e-8 is what is promised.
    np.testing.assert_allclose(result.coefficients, truth, atol=1e-8)
    assert scale.value == pytest.approx(0.3, rel=1e-8)
    np.testing.assert_allclose(result.residuals, 0, atol=1e-8)


@pytest.mark.parametrize("method", SPLINE_METHODS)
def test_exposure_changes_the_scale_and_nothing_else(method):
    rng = np.random.default_rng(3)
    signal = signals(spline_camera() @ BASIS.T, daylight(), reflectances())
    signal = signal * (1 + 0.01 * rng.standard_normal(signal.shape))
    first, scale = fit(method, signal)
    second, other = fit(method, 4.0 * signal)
    # A power of two scales every number exactly; only the active set's tolerance could differ.
    np.testing.assert_allclose(second.curves, first.curves, atol=1e-9)
    assert other.value == pytest.approx(4.0 * scale.value, rel=1e-9)


def test_the_papers_standard_errors_are_those_of_repeated_photos():
    truth = spline_camera() @ BASIS.T
    clean = signals(truth, daylight(), reflectances())
    sigma = 0.005 * clean.mean()
    rng = np.random.default_rng(6)
    fits = [fit("paper", clean + sigma * rng.standard_normal(clean.shape)) for _ in range(60)]
    # Compared before normalisation, where the estimate is linear: scale x curve at one wavelength
    # of the green band.
    place = 130
    values = np.array([scale.value * each.curves[1, place] for each, scale in fits])
    stated = np.mean([(scale.value * each.standard_error[1, place]) ** 2 for each, scale in fits])
    statistic = np.sum((values - values.mean()) ** 2) / stated
    # Two-sided at 1e-3: one false alarm in a thousand seeds; the seed is fixed.
    assert chi2.ppf(5e-4, 59) < statistic < chi2.ppf(1 - 5e-4, 59)


def test_non_negative_curves_stay_non_negative_under_noise():
    rng = np.random.default_rng(7)
    signal = signals(spline_camera() @ BASIS.T, led(), reflectances())
    signal = signal * (1 + 0.02 * rng.standard_normal(signal.shape))
    for method in ("nonnegative", "smooth"):
        assert fit(method, signal, led())[0].curves.min() >= 0
    assert fit("paper", signal, led())[0].curves.min() < 0


def test_a_smooth_fit_beats_the_papers_under_an_led():
    rng = np.random.default_rng(8)
    truth = spline_camera() @ BASIS.T
    signal = signals(truth, led(), reflectances())
    signal = signal * (1 + 0.02 * rng.standard_normal(signal.shape))
    error = {method: np.linalg.norm(fit(method, signal, led())[0].curves - truth)
             for method in ("paper", "smooth")}
    assert error["smooth"] < error["paper"]


def test_a_light_that_is_dark_over_a_third_of_the_range_is_refused():
    light = np.where(GRID.nm < 600, 1.0, 0.0)
    signal = signals(spline_camera() @ BASIS.T, light, reflectances())
    with pytest.raises(CalibrationError, match=r"cannot determine 10 coefficients.*400-700 nm"):
        fit("paper", signal, light)


def test_bands_that_read_alike_are_refused():
    signal = signals(spline_camera() @ BASIS.T, daylight(), reflectances())
    signal[:, 2] = 0.5 * signal[:, 1]
    with pytest.raises(CalibrationError, match="bands 2 and 3 read alike"):
        fit("nonnegative", signal)


def test_a_patch_without_signal_is_named():
    signal = signals(spline_camera() @ BASIS.T, daylight(), reflectances())
    signal[23, 2] = -0.001
    with pytest.raises(CalibrationError, match="patch 24 has no positive signal"):
        fit("nonnegative", signal)


def test_an_unknown_method_lists_the_known_ones():
    with pytest.raises(InputError, match="'spline' is not known; known are prior, paper, "
                       "nonnegative, smooth"):
        fit("spline", np.ones((24, 3)))


def test_what_noise_leaves_of_a_smooth_fit_is_a_straight_line_and_no_constant():
    """With nothing but noise beside it, a sensitivity that rises evenly is drawn as it rises."""
    rising = np.linspace(0.1, 1.0, 24) @ basis_matrix(GRID.nm, 24).T
    truth = np.array([rising, rising[::-1], np.full(rising.size, 0.6)])
    errors = []
    for seed in range(8):
        signal = signals(truth, daylight(), reflectances())
        signal = signal * (1 + 0.1 * np.random.default_rng(seed).standard_normal(signal.shape))
        result = fit("smooth", signal)[0].curves
        errors.append(result / result.max() - truth)
    off = np.mean(errors, axis=0)
    # The mean of eight fits of two numbers a band, at 10 % of noise in 24 patches.
    assert np.sqrt(np.mean(off**2)) < 0.04


@pytest.mark.parametrize("method", SPLINE_METHODS)
def test_the_scale_is_that_of_an_integral_over_nanometres_on_any_grid(method):
    """Wavelengths 5 nm apart stand for 5 nm each: the factor between signal and integral stays."""
    grid, every_fifth = visible_grid(5), np.arange(0, 301, 5)
    curves = spline_camera() @ basis_matrix(grid.nm, 10).T
    light, surfaces = daylight()[every_fifth], reflectances()[:, every_fifth]
    signal = 0.3 * surfaces @ (curves * light * grid.weights_nm).T
    estimate, scale, _ = fit_sensitivities(samples(signal, 1e-3), surfaces, light, EVEN, grid,
                                           method=method)
    # The two whose class holds the curves are exact to round-off; a smooth curve is near to them.
    atol = 0.3 * (0.15 if method == "smooth" else 1e-8)
    np.testing.assert_allclose(scale.value * estimate.curves, 0.3 * curves, atol=atol)


def test_a_light_that_leaves_open_which_coefficients_are_zero_is_refused():
    """Condition numbers below the limit, at which non-negative least squares may never end."""
    chart = uneven_photo(19, field=False, glare=False)
    with pytest.raises(CalibrationError, match=r"which coefficients are\s+zero; use method .prior"):
        for width_nm in np.arange(25.5, 29.0, 0.5):     # at most of them, as rounding has it
            light = np.exp(-0.5 * ((UNEVEN.nm - 520) / width_nm) ** 2)
            fit_sensitivities(patch_samples(chart), chart.reflectances, light, chart.irradiance,
                              UNEVEN, method="nonnegative")


# ---- errors of splines ---------------------------------------------------------------------------

def test_noise_three_times_as_large_as_stated_is_told_from_the_residuals():
    """The covariance of non-negative splines grows with the mean square of the residuals."""
    rng = np.random.default_rng(75)
    design, truth = rng.uniform(0, 1, (40, 5)), rng.uniform(1, 2, 5)
    estimates = []
    for _ in range(60):
        _, covariance = _solve_nonnegative(design, design @ truth + 0.03 * rng.standard_normal(40),
                                           np.full(40, 0.01))
        estimates.append(covariance)
    exact = 0.03**2 * np.linalg.inv(design.T @ design)
    # chi-squares of 35 degrees of freedom, 60 times
    assert np.mean(estimates, axis=0)[0, 0] / exact[0, 0] == pytest.approx(
        1, abs=SIGMAS * np.sqrt(2 / 35 / 60))


def test_smooth_curves_err_by_the_noise_of_their_patches():
    """Of 24 coefficients a penalty leaves few free: what is left of the residuals counts by those.
    """
    rng, size = np.random.default_rng(76), 24
    design = np.exp(-0.5 * ((np.arange(size) - np.linspace(0, 23, 24)[:, None]) / 3) ** 2)
    differences = np.diff(np.eye(size), 2, axis=0)
    rough = 1e7 * (differences.T @ differences + 1e-9 * np.eye(size))
    truth = np.full(size, 2.0)          # a straight line, which nothing bends
    unit = np.linalg.inv(design.T @ design / 0.01**2 + rough)
    estimates = []
    for _ in range(40):
        signal = design @ truth + 0.02 * rng.standard_normal(24)
        estimates.append(_solve_smooth(design, signal, np.full(24, 0.01), roughness=rough)[1])
    # errors of twice the stated ones; some 20 degrees of freedom, 40 times
    assert np.mean(estimates, axis=0)[3, 3] / unit[3, 3] == pytest.approx(
        4, rel=SIGMAS * np.sqrt(2 / 20 / 40) + 0.05)
