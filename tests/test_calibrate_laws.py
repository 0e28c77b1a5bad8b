"""Laws of calibrations: probabilities that hold, exact small cases, scales that do not matter.

Statistical tests have a significance of 1e-4 each (3.9 sigma), at fixed seeds.
"""
import dataclasses

import numpy as np
import pytest
from calibrate_cameras import (
    GRID,
    cameras,
    coarse_prior,
    daylight,
    led,
    on_grid,
    photo,
    reflectances,
    samples,
    signals,
)
from scipy import optimize

from spectrabox.calibrate import chart_calibration
from spectrabox.calibrate.chart_calibration import (
    calibrate_chart,
    calibration_from_curves,
)
from spectrabox.calibrate.chart_equations import (
    COMMON_ERRORS,
    DARK_SHARE,
    FIELD_SD,
    GLARE_SD,
    OWN_DARK_SHARE,
    PatchError,
    field_terms,
    mean_error,
)
from spectrabox.calibrate.chart_photo import ChartPhoto, disagreement
from spectrabox.calibrate.light_field import _of_distance
from spectrabox.calibrate.prior.camera_prior import CameraPrior, prior_of_curves
from spectrabox.calibrate.prior.curve_posterior import nonnegative
from spectrabox.calibrate.prior.learnt_prior import KEPT_VARIANCE, _leading, within_families
from spectrabox.calibrate.prior.prior_fit import posterior_of_curves
from spectrabox.calibrate.products.lamps import draw_cameras
from spectrabox.calibrate.sensitivity import fit_with_prior, relative_prediction_covariance
from spectrabox.radiometry.chart import CLASSIC
from spectrabox.radiometry.records.spectra import Quantity, Spectrum

SIGMAS = 3.9
NM = np.arange(400.0, 701.0, 15.0)


def departing(*sds, floor=None, widening=1.0):
    """A prior of one camera that departs by these shares of each band, equally likely."""
    mean = np.maximum(cameras(1, 3)[0][:, ::3], 0.02).ravel()
    count, nothing = len(sds), np.zeros((mean.size, 0))
    departures = np.array([[0.0, 1.0, sd, 30.0, 0.0, 1.0] for sd in sds])
    state = mean if floor is None else np.log(mean + floor)
    return CameraPrior(NM, np.full(count, 1 / count), np.tile(state, (count, 1)),
                       np.arange(count), np.zeros((count, 2)), departures,
                       np.full(count, widening), nothing, nothing,
                       tuple(f"{sd}" for sd in sds), "test", "none", floor)


# ---- probabilities and errors of a chart fit -----------------------------------------------------

def test_families_are_as_probable_as_they_are_often_right():
    """Cameras drawn from two families that differ in how far they depart alone: of those held
    probable by p, a share p is of that family.
    """
    known, surfaces, rng = departing(0.05, 0.065), reflectances(), np.random.default_rng(71)
    roots = [np.linalg.cholesky(one) for one in known.covariances()]
    wide, probable = rng.integers(2, size=60), []
    for family in wide:
        curves = (known.means[family] + roots[family] @ rng.standard_normal(63)).reshape(3, -1)
        fine = np.array([np.interp(GRID.nm, NM, curve) for curve in curves])
        common = rng.choice(COMMON_ERRORS)
        signal = signals(fine, daylight(), surfaces)
        shown = photo(signal, daylight(), surfaces, 0.005)
        noisy = signal * (1 + 0.005 * rng.standard_normal(signal.shape)
                          + common * rng.standard_normal((24, 1)))
        posterior = posterior_of_curves([dataclasses.replace(shown, signal=noisy)], known, GRID,
                                        model_errors=(0.0003,))
        probable.append(posterior.families[1])
    error = np.sqrt(np.sum(np.array(probable) * (1 - np.array(probable))))
    assert abs(np.sum(wide - probable)) < SIGMAS * error
    # the test can tell: most photos leave the family open, and half the Occam term is 2 nats
    assert np.mean((np.array(probable) > 0.1) & (np.array(probable) < 0.9)) > 0.4


def test_how_bright_a_camera_was_measured_changes_nothing():
    """Two families that are one but for their unit: the exposure is unknown anyhow."""
    plain, signal = departing(0.0), signals(on_grid(cameras(1, 44)[0]), daylight(), reflectances())
    rng = np.random.default_rng(92)
    within = 0.1 * plain.means[0][:, None] * rng.standard_normal((63, 30)) / np.sqrt(30)
    known = dataclasses.replace(
        departing(0.0, 0.0), jitter_sd=1e-6, within=within, shares=np.array([[1.0, 0], [9.0, 0]]),
        means=plain.means * np.array([[1.0], [3.0]]))
    shown = photo(signal, daylight(), reflectances(), 0.01)
    posterior = posterior_of_curves([shown], known, GRID, model_errors=(0.01,))
    # the second is linearised where the first ended: a hundredth of a nat
    np.testing.assert_allclose(posterior.families, 0.5, atol=0.005)
    one, other = np.split(posterior.covariances, 2)
    np.testing.assert_allclose(one, other, rtol=0.02, atol=2e-3 * np.abs(one).max())


def test_an_error_of_a_patch_is_that_of_its_own_and_of_its_common_part():
    error = PatchError(0.03, 0.04)
    relative = error.among_bands(3)
    np.testing.assert_allclose(np.diag(relative), error.whole**2, rtol=1e-12)
    np.testing.assert_allclose(relative[~np.eye(3, dtype=bool)], 0.04**2, rtol=1e-12)
    # weights of any sum
    for scale in (1.0, 0.3):
        estimate = mean_error(scale * np.array([1.0, 3.0]), [PatchError(0.0, 0.02), error])
        assert estimate == pytest.approx((0.0225, 0.035))


@pytest.mark.parametrize("floor", [None, 0.05])
def test_what_is_added_to_a_curve_is_as_large_whatever_the_state(floor):
    """Departures of the curves, in the logarithm of which a prior may be: 3 % of the largest."""
    known = dataclasses.replace(departing(0.0, floor=floor), jitter_sd=0.0,
                                departures=np.array([[0.03, 30.0, 0.0, 30.0, 0.0, 120.0]]))
    sd = np.sqrt(np.diag(known.covariances()[0])) * known.slope(known.means[0])
    np.testing.assert_allclose(sd, 0.03 * known.curves(known.means[0]).max(), rtol=1e-12)


def test_measured_curves_are_as_uncertain_as_their_error_is_large():
    curves = on_grid(cameras(1, 4)[0])
    one, two = (prior_of_curves(GRID, curves, error).covariances()[0] for error in (0.1, 0.2))
    # but for what keeps the matrix invertible, a thousandth of the largest
    np.testing.assert_allclose(two, 4 * one, atol=1e-5)


def test_cameras_are_drawn_as_wide_as_a_prior_may_err():
    known = departing(0.02, widening=1.5)
    drawn = draw_cameras(known, 4000, np.random.default_rng(72)).reshape(4000, -1)
    expected = 1.5 * np.sqrt(np.diag(known.covariances()[0]))
    # 4000 draws know a deviation to 1.1 %
    np.testing.assert_allclose(drawn.std(axis=0) / expected, 1, atol=SIGMAS * 0.015)


def test_variation_within_families_is_pooled_without_bias():
    rng, sizes = np.random.default_rng(73), (2, 3, 2, 4)
    groups = np.split(np.arange(sum(sizes)), np.cumsum(sizes)[:-1])
    states = rng.standard_normal((sum(sizes), 8000))
    for group in groups:
        states[group] += 10 * rng.standard_normal()
    estimate = np.sum(within_families(states, groups) ** 2, axis=0)
    # chi-square of 7 degrees of freedom over 7, 8000 times
    assert estimate.mean() == pytest.approx(1, abs=SIGMAS * np.sqrt(2 / 7 / 8000))


@pytest.mark.parametrize("sizes", [np.ones(20), np.r_[1.0, 0.02, 0.001], np.geomspace(1, 1e-4, 9)])
def test_the_leading_directions_hold_what_is_kept_and_none_more(sizes):
    rows = np.diag(sizes)
    factors = _leading(rows)
    kept = np.sum(factors**2) / np.sum(sizes**2)
    assert kept >= KEPT_VARIANCE
    least = np.sort(np.sum(factors**2, axis=0))[0]
    assert kept - least / np.sum(sizes**2) < KEPT_VARIANCE


@pytest.mark.parametrize("seed", range(6))
def test_curves_held_above_zero_are_the_most_likely_that_are(seed):
    """Against non-negative least squares in whitened coordinates."""
    rng = np.random.default_rng(seed)
    root = rng.standard_normal((5, 5))
    covariance = root @ root.T + 0.2 * np.eye(5)
    mean = rng.uniform(0.5, 1.5, 5)
    mean[rng.integers(5)] = -0.4
    lower = np.linalg.inv(np.linalg.cholesky(covariance))
    best, _ = optimize.nnls(lower, lower @ mean)
    estimate = nonnegative(mean, covariance)
    # a ridge of 1e-10 of the variance
    np.testing.assert_allclose(estimate, best, atol=1e-8)
    assert not np.allclose(estimate, np.maximum(mean, 0))


def test_only_what_no_photos_light_reaches_is_the_priors_alone():
    """Two photos, of which one lamp leaves the blue dark: the other shows it."""
    curves, surfaces = on_grid(cameras(1, 44)[0]), reflectances()
    yellow = np.where(GRID.nm < 470, 0.0, daylight())
    shots = [photo(signals(curves, light, surfaces), light, surfaces, 0.01)
             for light in (yellow, led())]
    dark = GRID.nm < 465
    alone = fit_with_prior(shots[:1], coarse_prior(), GRID).prior_share
    both = fit_with_prior(shots, coarse_prior(), GRID).prior_share
    assert np.all(alone[:, dark] == 1) and both[2, GRID.nm == 450] < 0.5


# ---- everything that a fit says of itself, of photos drawn from its own model --------------------

PHOTOS = 40
LIGHT_ENOUGH = np.maximum(reflectances(), 0.1)  # that no glare leaves a patch below 0


def mahalanobis(off, covariance):
    """Chi-square per number of errors (n,) that are known to a covariance (n, n)."""
    return off @ np.linalg.solve(covariance, off) / off.size


@pytest.fixture(scope="module")
def drawn_photos():
    """Cameras, exposures, fields, glare and errors of patches drawn from what the fit expects of
    them, and the fits.
    """
    known, rng = departing(0.05), np.random.default_rng(90)
    surfaces = LIGHT_ENOUGH
    root, power = np.linalg.cholesky(known.covariances()[0]), daylight()
    terms, estimates = field_terms(CLASSIC.centres_uv), []
    for _ in range(PHOTOS):
        curves = (known.means[0] + root @ rng.standard_normal(63)).reshape(3, -1)
        fine = np.array([np.interp(GRID.nm, NM, curve) for curve in curves])
        exposure, field = rng.normal(0, 1), FIELD_SD * rng.standard_normal(5)
        lit = np.exp(exposure + terms @ field)[:, None] * signals(fine, power, surfaces)
        glare = GLARE_SD * lit.max(axis=0) * rng.standard_normal(3)
        clean = lit + glare
        own, level = (np.maximum(clean, share * clean.max(axis=0))
                      for share in (OWN_DARK_SHARE, DARK_SHARE))
        shown = photo(clean, power, surfaces, 0.002, terms, True)
        off = (0.004 * own * rng.standard_normal((24, 3))
               + rng.choice(COMMON_ERRORS) * level * rng.standard_normal((24, 1)))
        noisy = clean + off + 0.002 * clean * rng.standard_normal((24, 3))
        fit = fit_with_prior([dataclasses.replace(shown, signal=noisy)], known, GRID,
                             model_errors=(0.004,))
        white = np.exp(exposure) * fine @ (power * GRID.weights_nm)
        estimates.append((fit, fine / fine.max(), np.r_[np.log(white), field, glare], noisy))
    return estimates


def test_signals_may_be_in_any_unit():
    """Shares of full scale or digital numbers: an unknown field and glare make no difference."""
    surfaces, power, terms = LIGHT_ENOUGH, daylight(), field_terms(CLASSIC.centres_uv)
    signal = signals(on_grid(cameras(1, 44)[0]), power, surfaces)
    signal = signal / signal.max() * np.exp(terms @ [0.2, -0.1, 0.1, -0.15, 0.1])[:, None] + 0.02
    one, other = (fit_with_prior([photo(unit * signal, power, surfaces, 0.01, terms, True)],
                                 coarse_prior(), GRID) for unit in (1.0, 16383.0))
    ours, theirs = (fit.photos[0] for fit in (one, other))
    # round-off of some thousand terms
    np.testing.assert_allclose(other.sensitivity.curves, one.sensitivity.curves, atol=1e-6)
    np.testing.assert_allclose(theirs.field, ours.field, rtol=1e-6)
    np.testing.assert_allclose(theirs.white.glare, 16383 * ours.white.glare, rtol=1e-4)
    np.testing.assert_allclose(theirs.predicted, 16383 * ours.predicted, rtol=1e-6)
    assert np.abs(ours.white.glare).min() > 0.005


def test_curves_of_drawn_cameras_err_as_stated(drawn_photos):
    ratio = [np.mean((truth - fit.sensitivity.curves) ** 2)
             / np.mean(fit.sensitivity.standard_error ** 2)
             for fit, truth, _, _ in drawn_photos]
    # some 15 independent errors a camera, in 40 cameras: known to 6 %
    assert np.mean(ratio) == pytest.approx(1, abs=SIGMAS * 0.06)


def test_white_field_and_glare_of_drawn_photos_err_as_stated_together(drawn_photos):
    estimates = []
    for fit, _, truth, _ in drawn_photos:
        white = fit.photos[0].white
        fitted = np.r_[np.log(white.level), white.field, white.glare]
        estimates.append(mahalanobis(truth - fitted, white.covariance))
    # chi-square of 11 over 11, in 40 photos: 6.7 %, and 15 % of field bend the equations
    assert np.mean(estimates) == pytest.approx(1, abs=SIGMAS * 0.067 + 0.05)


def test_white_of_a_band_errs_as_the_light_scale_says(drawn_photos):
    estimates = []
    for fit, _, truth, _ in drawn_photos:
        state = fit.photos[0]
        relative = np.exp(np.log(state.white.level) - truth[:3]) - 1
        weight = state.white.level ** 2         # bands count by their signal
        estimates.append(np.sum(weight * relative**2) / weight.sum()
                         / (state.scale_error / state.scale) ** 2)
    # 40 photos of hardly more than one error each
    assert np.mean(estimates) == pytest.approx(1, abs=SIGMAS * np.sqrt(2 / 40))


def test_patches_of_drawn_photos_err_from_the_others_as_stated(drawn_photos):
    surfaces, estimates, prior_alone = LIGHT_ENOUGH, [], []
    for fit, _, _, signal in drawn_photos:
        off = signal - fit.without.predicted(surfaces)
        covariance = fit.without.error_covariance(surfaces)
        estimates += [mahalanobis(*each) for each in zip(off, covariance, strict=True)]
        prior_alone.append(fit.chi_square)
        np.testing.assert_allclose(fit.held_out[0], fit.without.predicted(surfaces),
                                   atol=0.02 * signal.max())
    # chi-squares of 3 over 3, 960 of them, and of 72 over 72, 40 of them
    assert np.mean(estimates) == pytest.approx(1, abs=SIGMAS * np.sqrt(2 / 3 / 960) + 0.05)
    assert np.mean(prior_alone) == pytest.approx(1, abs=SIGMAS * np.sqrt(2 / 72 / 40) + 0.03)


def test_what_the_prior_leaves_is_the_error_after_over_that_before(drawn_photos):
    """Of cameras of which one family is known: the errors of curves divided by their largest."""
    known = departing(0.05)
    cameras_before = draw_cameras(known, 3000, np.random.default_rng(91))
    scaled = cameras_before / cameras_before.max(axis=(1, 2), keepdims=True)
    before = np.array([np.interp(GRID.nm, NM, one) for one in scaled.std(axis=0)])
    fit, truth, _, _ = drawn_photos[0]
    inside = (truth > 0.1) & (truth < 0.95) & np.isin(GRID.nm, NM)
    ratio = fit.sensitivity.standard_error[inside] / before[inside]
    # draws know a deviation to 1.3 %; this camera is some per cent brighter than the mean
    np.testing.assert_allclose(fit.prior_share[inside], ratio, rtol=0.15)
    assert np.ptp(ratio) > 0.1


def test_how_far_a_prior_may_err_is_no_part_of_what_a_photo_leaves_of_it():
    """Errors before and after are widened alike."""
    shown = photo(signals(on_grid(cameras(1, 44)[0]), led(), reflectances()), led(),
                  reflectances(), 0.01)
    one, other = (fit_with_prior([shown], departing(0.1, widening=factor), GRID,
                                 model_errors=(0.01,)) for factor in (1.0, 1.7))
    # sizes of the errors of patches are held possible, whose answers differ by little
    np.testing.assert_allclose(other.prior_share, one.prior_share, rtol=3e-3, atol=1e-9)
    np.testing.assert_allclose(other.sensitivity.standard_error,
                               1.7 * one.sensitivity.standard_error, rtol=3e-3, atol=1e-12)


# ---- scales that do not matter ------------------------------------------------------------------

@pytest.fixture(scope="module")
def calibrated():
    """Calibrations of one photo by each method, as shot and with three times the light."""
    surfaces, power = reflectances(), daylight()
    rng = np.random.default_rng(74)
    clean = signals(on_grid(cameras(1, 44)[0]), power, surfaces)
    clean *= 0.2 / clean.max()
    signal = clean * (1 + 0.01 * rng.standard_normal(clean.shape))
    curves = on_grid(cameras(1, 44)[0])
    pairs = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chart_calibration, "evidence_on_lights", lambda *_: ())
        for method in ("nonnegative", "smooth", "file", "prior"):
            pairs[method] = []
            for factor in (1.0, 3.0):
                shown = ChartPhoto(samples(factor * signal, 0.003), surfaces,
                                   Spectrum(GRID, power, Quantity.RELATIVE, "lamp"),
                                   factor * np.full(24, 2.0))
                pairs[method].append(calibrate_chart(
                    [shown], GRID, "prior" if method == "file" else method, coarse_prior(),
                    curves=curves if method == "file" else None))
    return pairs


@pytest.mark.parametrize("method", ["nonnegative", "smooth", "file", "prior"])
def test_more_light_changes_signals_and_their_errors_and_nothing_else(calibrated, method):
    one, three = calibrated[method]
    surfaces = reflectances()
    # a hundredth of a standard error: where a search stops
    exact = {"rtol": 1e-3, "atol": 1e-6} if method == "prior" else {"rtol": 1e-7, "atol": 1e-12}
    ours, theirs = (each.calibration.sensitivity for each in (one, three))
    np.testing.assert_allclose(theirs.curves, ours.curves, **exact)
    if method != "file":
        np.testing.assert_allclose(theirs.standard_error, ours.standard_error, **exact)
    assert three.scale.value == pytest.approx(one.scale.value, rel=exact["rtol"])
    assert three.scale.standard_error == pytest.approx(one.scale.standard_error, rel=1e-3)
    np.testing.assert_allclose(three.calibration.relative_covariance,
                               one.calibration.relative_covariance, rtol=1e-3, atol=1e-9)
    np.testing.assert_allclose(three.without.predicted(surfaces),
                               3 * one.without.predicted(surfaces), rtol=exact["rtol"])
    np.testing.assert_allclose(three.without.error_covariance(surfaces),
                               9 * one.without.error_covariance(surfaces), rtol=5e-3, atol=1e-9)


@pytest.mark.parametrize("method", ["nonnegative", "smooth", "prior"])
def test_a_patch_left_out_is_told_alike_wherever_it_is_told(calibrated, method):
    """As a signal, as a residual, and by the record that later stages predict it with."""
    fit = calibrated[method][0]
    predicted = fit.without.predicted(reflectances())
    np.testing.assert_allclose(fit.held_out, predicted, rtol=1e-9)
    residual = 1 - predicted / fit.without.signal
    np.testing.assert_allclose(fit.calibration.sensitivity.held_out_residuals, residual,
                               atol=1e-9)
    assert np.all(fit.held_out_delta_e >= 0) and np.abs(residual).max() > 0.01


@pytest.mark.parametrize("method", ["smooth", "file", "prior"])
def test_a_patch_errs_from_what_the_others_predict_by_as_much_as_is_stated(calibrated, method):
    fit, surfaces = calibrated[method][0].without, reflectances()
    off = fit.signal - fit.predicted(surfaces)
    stated = np.einsum("ikk->ik", fit.error_covariance(surfaces))
    # 72 numbers know a variance to 17 %; errors of chart and stray light that this photo lacks
    # make those that are stated by splines wider
    assert (0.1 if method == "smooth" else 0.4) < np.mean(off**2 / stated) < 1 + SIGMAS * 0.17


def test_residuals_that_are_alike_are_an_error_and_no_offset():
    """The covariance is about zero: a photo that reads all patches 3 % high errs by 3 %."""
    off = np.array([0.03, -0.01, 0.02])
    signal = np.full((24, 3), 0.4)
    signal[-1] = 0.001                  # too dark to have a relative error
    residuals = np.tile(off, (24, 1))
    residuals[-1] = 5.0
    covariance = relative_prediction_covariance(residuals, samples(signal))
    np.testing.assert_allclose(covariance, np.outer(off, off), rtol=1e-12)


def test_curves_taken_as_given_err_by_what_is_stated():
    lamp = Spectrum(GRID, daylight(), Quantity.RELATIVE, "lamp")
    fit = calibration_from_curves(GRID, on_grid(cameras(1, 4)[0]), lamp, 0.04)
    np.testing.assert_allclose(fit.relative_covariance, 0.04**2 * np.eye(3), rtol=1e-12)


def test_dark_patches_do_not_decide_how_far_a_photo_disagrees():
    signal = np.full((24, 3), 0.5)
    signal[-1] = 0.001
    held_out = signal.copy()
    held_out[-1] = 0.002                # twice as bright, and 6.7 % of 3 % of the brightest
    expected = 0.001 / (0.03 * 0.5) / np.sqrt(24)
    assert disagreement(signal, held_out) == pytest.approx(expected)


# ---- light beyond the chart, and a lamp's beam ---------------------------------------------------

def test_a_lens_darkens_the_corners_by_no_more_than_is_held_possible():
    """The fourth power of a cosine is the square of 1 + tan^2: between none and 60 % of the light
    is lost at the corner, of which 20 % in the mean.
    """
    plane = [1e-6 * np.random.default_rng(1).uniform(size=(24, 2)), np.zeros((1, 2))]
    picture = [np.zeros((24, 2)), np.array([[0.6, 0.8]])]
    (_, with_lens), (_, without) = (
        _of_distance(6.0, plane, picture, flat, np.random.default_rng(78))
        for flat in (False, True))
    left = np.exp(with_lens - without)[:, 0]
    assert left.min() >= 0.4 - 1e-4 and left.max() <= 1
    # 1 - 0.6 u^2 with u uniform: mean 0.8, deviation 0.18, of 400
    assert left.mean() == pytest.approx(0.8, abs=SIGMAS * 0.18 / 20)
