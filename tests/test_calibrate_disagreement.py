"""What is said of photos that a camera, measured curves or one another do not explain."""

import numpy as np
import pytest
from calibrate_cameras import GRID, daylight, led, on_grid, prior, reflectances, samples, signals
from calibrate_cameras import cameras_at_10_nm as cameras

from spectrabox.calibrate.chart_calibration import calibrate_chart
from spectrabox.calibrate.chart_photo import ChartPhoto
from spectrabox.radiometry.errors import CheckError
from spectrabox.radiometry.findings import faults
from spectrabox.radiometry.records.spectra import Quantity, Spectrum, UnknownLight

SURFACES = reflectances()
TRUTH = on_grid(cameras(1, 60)[0] / cameras(1, 60)[0].max())


def lamp(power):
    return Spectrum(GRID, power, Quantity.RELATIVE, "lamp")


def chart(curves=TRUTH, power=None, seed=3):
    signal = signals(curves, daylight() if power is None else power, SURFACES)
    return signal * (1 + 0.003 * np.random.default_rng(seed).standard_normal(signal.shape))


def calibrated(signal, *more, light=None, **options):
    first = (signal, daylight() if light is None else light)
    photos = [ChartPhoto(samples(taken, 0.003), SURFACES, lamp(power))
             for taken, power in (first, *more)]
    return calibrate_chart(photos, GRID, **options)


def mirrored(signal):
    return signal.reshape(4, 6, 3)[:, ::-1].reshape(24, 3)


def test_glare_beyond_belief_is_named_as_such():
    signal = chart()
    with pytest.raises(CheckError, match="read as a photo with much glare"):
        calibrated(signal + 0.5 * signal.max(axis=0), prior=prior())


def test_a_veil_is_estimated_where_the_evidence_is_for_it():
    signal = chart()
    veil = 0.15 * signal.max(axis=0)
    state = calibrated(signal + veil, prior=prior()).prior_fit.photos[0]
    # four standard errors, and what curves and exposure take up of the veil
    np.testing.assert_array_less(np.abs(state.white.glare - veil),
                                 4 * state.white.glare_error + 0.005 * signal.max())
    plain = calibrated(signal, prior=prior()).prior_fit
    assert plain.photos[0].white.glare_error.max() < 0.01 * signal.max()
    with pytest.raises(CheckError, match="no camera explains the chart photo"):
        calibrated(((signal + veil) / signal.max()) ** (1 / 2.2), prior=prior())


def test_of_a_wrong_chart_no_other_reading_is_named():
    # One of the readings always has the most evidence; here none is right.
    with pytest.raises(CheckError, match="check the chart reference"):
        calibrated(np.random.default_rng(1).uniform(0.02, 0.5, (24, 3)), prior=prior())


def test_the_one_photo_of_several_that_disagrees_is_named():
    with pytest.raises(CheckError, match=r"explains chart photo 2:.*mirrored left to right"):
        calibrated(chart(), (mirrored(chart(power=led(), seed=4)), led()), prior=prior())


def test_photos_of_two_cameras_are_refused_together():
    other = np.roll(TRUTH, 20, axis=1)
    with pytest.raises(CheckError, match="each of the 2 chart photos can be explained, but not all "
                       "by one camera"):
        calibrated(chart(), (chart(other, led(), 4), led()), prior=prior())


def test_a_camera_like_none_that_was_measured_is_said():
    # Lit by an LED, taken for daylight: curves that explain that are odd.
    doubted = faults(calibrated(chart(power=led()), prior=prior()).calibration.findings)
    assert {one.code for one in doubted} & {"calibration.unlike-cameras", "light.contradicted"}
    assert not faults(calibrated(chart(), prior=prior()).calibration.findings)


def test_where_no_photo_had_light_the_curves_are_the_priors():
    power = np.where(GRID.nm > 520, 0.0, daylight())
    fit = calibrated(chart(power=power), light=power, prior=prior()).prior_fit
    assert np.all(fit.prior_share[:, GRID.nm > 520]
                  == 1) and np.median(fit.prior_share[2, GRID.nm < 500]) < 0.5
    both = calibrated(chart(power=power), (chart(seed=4), daylight()), light=power,
                      prior=prior()).prior_fit
    # Where a curve is dark beside the chart's noise the photo says nothing of it.
    seen = (GRID.nm > 520) & (both.sensitivity.curves > 0.02)
    assert both.prior_share[seen].max() < 1


def test_measured_curves_that_are_right_agree():
    # 6 % between laboratories, 20 % of fall-off and 1 % of glare are no disagreement.
    tilt = 1 + 0.1 * np.sin(GRID.nm / 60)
    signal = chart() * np.linspace(0.9, 1.1,
                                   24).reshape(4, 6).mean(axis=0)[np.arange(24) % 6][:, None]
    curves = TRUTH * tilt / (TRUTH * tilt).max()
    found = calibrated(signal + 0.01 * signal.max(axis=0), curves=curves).calibration.findings
    assert "calibration.curves-agree" in {one.code for one in found}


@pytest.mark.parametrize("wrong",
                         [np.roll(TRUTH, 20, axis=1), TRUTH * np.array([[0.5], [1.0], [1.0]])],
                         ids=["shifted by 20 nm", "red halved"])
def test_measured_curves_that_are_wrong_are_said(wrong):
    found = calibrated(chart(), curves=wrong / wrong.max()).calibration.findings
    assert [one.code for one in faults(found)] == ["calibration.curves-disagree"]


def test_measured_curves_in_another_order_are_refused():
    with pytest.raises(CheckError,
                       match=r"the measured curves do not explain.*bands in reverse order \(BGR\)"):
        calibrated(chart(), curves=TRUTH[::-1])


def test_the_record_says_how_well_the_chart_is_reproduced():
    fit = calibrated(chart(), prior=prior())
    colours, = [one for one in fit.calibration.findings if one.code == "calibration.chart-colours"]
    assert colours.values == {"mean": fit.delta_e.mean(), "left_out": fit.held_out_delta_e.mean()}
    # 0.3 % of noise in the signals is about 0.2 CIEDE2000.
    assert fit.delta_e.mean() < 0.5


def test_fall_off_is_said_of_each_photo_that_may_have_one():
    fall = np.linspace(1.1, 0.9, 6)[np.arange(24) % 6][:, None]
    found = calibrated(chart(), (chart(seed=4) * fall, daylight()),
                       prior=prior()).calibration.findings
    fields = {one.values["photo_number"]: one.values for one in found
              if one.code == "calibration.field"}
    assert fields[2]["low"] == pytest.approx(0.9, abs=0.03)
    lit = ChartPhoto(samples(chart()), SURFACES, lamp(daylight()), np.full(24, np.pi))
    known = calibrate_chart([lit], GRID, prior=prior())
    assert "calibration.field" not in {one.code for one in known.calibration.findings}


@pytest.mark.parametrize("light", [UnknownLight(), lamp(daylight())], ids=["unknown", "stated"])
def test_bands_of_which_no_camera_is_known_may_disagree_and_the_worst_is_named(light):
    # curves that any camera might have, in five bands, one of which errs by a third
    curves = np.exp(-0.5 * ((GRID.nm - np.arange(430, 671, 60)[:, None]) / 30) ** 2)
    rng = np.random.default_rng(2)
    signal = signals(curves, daylight(), SURFACES)
    signal *= np.exp(rng.standard_normal(signal.shape) * [0.05, 0.05, 0.05, 0.05, 0.3])
    fitted = calibrate_chart([ChartPhoto(samples(signal, 0.003), SURFACES, light,
                                         bands=tuple("abcde"))], GRID)
    doubt, = faults(fitted.calibration.findings)
    assert doubt.code == "calibration.bands-disagree" and next(iter(doubt.values["bands"])) == "e"
    with pytest.raises(CheckError, match="no camera explains the chart photo"):
        calibrate_chart([ChartPhoto(samples(rng.permutation(signal), 0.003), SURFACES,
                                    light)], GRID)
