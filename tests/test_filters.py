"""Photos through filters: what a file says of one, what two charts say, and what surfaces gain."""
import dataclasses

import numpy as np
import pytest
from calibrate_cameras import GRID, reflectances
from calibrate_cameras import cameras as made_cameras
from calibrate_cameras import prior as simulated_prior
from test_calibrate_products import shot, simulated_lamps
from typer.testing import CliRunner

from spectrabox.calibrate.chart_equations import PatchError, noise_of_photos, rows_of_patch
from spectrabox.calibrate.chart_photo import ChartPhoto
from spectrabox.calibrate.sensitivity import fit_with_prior
from spectrabox.measure.advice.advise import TO_FINE, advice_on_signal
from spectrabox.measure.advice.forecast import WIDTH, outlook_of
from spectrabox.measure.more_bands.filter_fit import (
    filter_from_charts,
    photos_at_hand,
    white_of_bands,
)
from spectrabox.radiometry.chart import REFERENCES
from spectrabox.radiometry.error_model import curve_errors, filter_errors
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.calibration import Calibration
from spectrabox.radiometry.records.photos import PatchSamples
from spectrabox.radiometry.records.spectra import Quantity, SpectralMeasurement, Spectrum
from spectrabox.radiometry.spectra import named_spectra
from spectrabox.radiometry.spectra.filters import (
    filters_at_hand,
    read_filter,
    stated_filter,
    unknown_filter,
)
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior
from spectrabox.sampling.prior.signal_posterior import solve_posterior
from spectrabox.session.cli import app

CAMERA, LAMP = made_cameras(1, 8)[0], simulated_lamps(4, 9).spectra[3]
ORANGE = 0.02 + 0.88 / (1 + np.exp((560 - GRID.nm) / 12))


def bare(noise=0.01):
    """A chart photo without a filter under a stated lamp."""
    photo = shot(CAMERA, LAMP, 1, noise)
    return dataclasses.replace(photo, power=LAMP * GRID.weights_nm)


def through(transmittance, stated, noise=0.01):
    """One through a filter, of which ``stated`` is known."""
    photo = shot(CAMERA, LAMP, 2, noise, stated_filter("true", transmittance))
    power = LAMP * stated.transmittance * GRID.weights_nm
    return dataclasses.replace(photo, filter=stated, power=power)


def states(photos):
    return fit_with_prior(photos, simulated_prior(), GRID).photos


def shape(transmittance):
    return transmittance / transmittance.mean()


def test_a_filter_that_nobody_measured_is_known_from_two_charts():
    """Against what its prior leaves open: a factor of 4."""
    known = states([bare(), through(ORANGE, unknown_filter())])[1].filter
    seen = (GRID.nm > 430) & (GRID.nm < 670)        # beyond, the camera sees next to nothing
    off = np.log(shape(known.transmittance) / shape(ORANGE))[seen]
    spread = np.sqrt(np.einsum("pe,ef,pf->p", known.modes, known.covariance, known.modes))[seen]
    assert np.sqrt(np.mean(off**2)) < 0.5
    # 2.5 standard errors of rms, wavelengths being correlated
    assert np.sqrt(np.mean((off / spread) ** 2)) < 2.5


def test_a_stated_transmittance_that_errs_is_corrected_within_its_error():
    wrong = ORANGE * (1 + 0.04 * np.sin((GRID.nm - 400) / 70))
    known = states([bare(0.002), through(ORANGE, stated_filter("f", wrong), 0.002)])[1]
    lit = ORANGE > 0.2
    before, after = (np.std(np.log(each / ORANGE)[lit])
                     for each in (wrong, known.filter.transmittance))
    assert after < before


def test_patches_of_a_photo_through_a_filter_err_as_those_without():
    photos = [bare(), through(ORANGE, stated_filter("f", ORANGE))]
    covariance = noise_of_photos(photos, PatchError(0.01, 0.01))
    error = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(error, error)
    assert np.linalg.eigvalsh(covariance).min() > 0
    assert 0.2 < correlation[0, 72] < 0.9 and not covariance[0, 75:].any()
    np.testing.assert_array_equal(rows_of_patch(photos, 3), [9, 10, 11, 81, 82, 83])
    # a photo without a filter that is taken again errs alike too, or errors would contradict
    again = noise_of_photos([*photos, bare()], PatchError(1e-4, 0.01))
    assert np.linalg.eigvalsh(again).min() > 0
    # what a chart's copy departs by is in all photos, beside what they repeat
    patterns = 0.02 * np.random.default_rng(3).standard_normal((24, 3, 40))
    copies = [dataclasses.replace(photo, copy_errors=patterns) for photo in photos]
    by_copy = noise_of_photos(copies, PatchError(0.01, 0.01)) - covariance
    both = np.tile(patterns.reshape(72, 40), (2, 1))
    np.testing.assert_allclose(by_copy, both @ both.T, atol=1e-12)
    # two photos without a filter are no photos of one light
    np.testing.assert_array_equal(rows_of_patch([bare(), bare()], 3), [9, 10, 11])


def test_errors_of_curves_and_filter_are_those_of_draws_of_both():
    """Significance 1e-4: variances of 20,000 draws are known to 1 %, 3.9 times that is allowed."""
    photos = [bare(), through(ORANGE, stated_filter("f", ORANGE))]
    fit = fit_with_prior(photos, simulated_prior(), GRID)
    fitted, sensitivity = fit.photos[1].filter, fit.sensitivity
    light = Spectrum(GRID, LAMP * fitted.transmittance, Quantity.RELATIVE, "light")
    calibration = Calibration(sensitivity, light, None, np.zeros((3, 3)), (), filter=fitted)
    spectrum = reflectances()[2]
    rows = sensitivity.curves * light.values * GRID.weights_nm
    signal = rows @ spectrum / rows.sum(axis=1)
    stated = sum(errors(calibration, GRID).covariance(signal[None], spectrum[None])[0]
                 for errors in (curve_errors, filter_errors))
    together = np.block([[sensitivity.covariance, fitted.with_curves.T],
                         [fitted.with_curves, fitted.covariance]])
    # small errors: what is not linear in them is no matter
    drawn = 0.1 * np.random.default_rng(1).multivariate_normal(np.zeros(len(together)), together,
                                                               20_000, method="eigh")
    size = len(sensitivity.covariance)
    curves = (sensitivity.coefficients + drawn[:, :size].reshape(-1, 3, size // 3)
              ) @ sensitivity.basis.T
    weight = light.values * (1 + drawn[:, size:] @ fitted.modes.T) * GRID.weights_nm
    seen = np.einsum("tkp,tp,p->tk", curves, weight, spectrum, optimize=True)
    seen = seen / np.einsum("tkp,tp->tk", curves, weight, optimize=True)
    np.testing.assert_allclose(100 * seen.var(axis=0), np.diag(stated), rtol=0.05)


@pytest.mark.parametrize("rows, words", [
    ("wavelength_nm,f\n720,0.1\n900,0.5\n", "none of it visible"),
    ("wavelength_nm,f\n450,0.1\n700,0.5\n", "covers 450-700 nm"),
    ("wavelength_nm,f\n400,-0.5\n700,0.5\n", "a transmittance between 0 and 1"),
    ("wavelength_nm,f,g\n400,0.1,0.2\n700,0.5,0.3\n", "holds 2 columns")])
def test_a_file_that_is_no_transmittance_is_refused(tmp_path, rows, words):
    (tmp_path / "f.csv").write_text(rows)
    with pytest.raises(InputError, match=words):
        read_filter(tmp_path / "f.csv")


def test_per_cent_and_stated_errors_are_understood(tmp_path):
    for name, factor in (("fraction", 1), ("percent", 100)):
        (tmp_path / f"{name}.csv").write_text("wavelength_nm,f,standard_error\n" + "".join(
            f"{nm},{factor * 0.5},{factor * 0.01}\n" for nm in range(380, 731, 10)))
    one, other = filters_at_hand(tmp_path).values()
    np.testing.assert_allclose(one.transmittance, other.transmittance)
    # a stated error of 0.01 of 0.5, and a little stray light; modes leave out 0.5 % of the variance
    errors = np.sqrt(np.sum(one.modes**2, axis=1))
    np.testing.assert_allclose(errors, np.hypot(0.02, 0.002), rtol=0.02)
    np.testing.assert_allclose(one.modes, other.modes, atol=1e-12)


def test_a_grey_filter_leaves_the_colour_of_white():
    known = states([bare(), through(np.full(GRID.nm.size, 0.3), stated_filter(
        "grey", np.full(GRID.nm.size, 0.3)))])
    colours = [each.white.level / each.white.level.sum() for each in known]
    # noise of 24 patches of 1 %
    np.testing.assert_allclose(colours[1], colours[0], rtol=0.01)


def test_forecasts_are_the_bands_that_further_photos_then_have():
    """With all but noise known, over test colours."""
    prior, rng = load_prior(), np.random.default_rng(3)
    truths = np.vstack([rows[::6] for name, rows in named_spectra.test_reflectances(
        PRIOR_GRID).items()
                        if name not in REFERENCES])[:60] @ TO_FINE.T
    bare = named_spectra.relative_response("Nikon 5100 (NPL)", "D65", FINE_GRID)
    hand = {"f": stated_filter("f", ORANGE)}
    photo = photos_at_hand(bare, np.ones(301), hand)
    white = white_of_bands(bare, np.ones(301))
    forecast, after = [], []
    for truth in truths:
        both = np.vstack([bare, photo[0].response])
        signal = both @ truth
        error = 0.01 * np.sqrt(np.maximum(signal, 0.02) / np.r_[white, photo[0].white])
        noisy = signal + error * rng.standard_normal(6)
        first = SpectralMeasurement(FINE_GRID, bare, noisy[:3], np.diag(error[:3]**2))
        gel = [one.width_after for one in advice_on_signal(first, prior, hand=hand)
               if one.action == "gel"]
        forecast += gel     # none where it would bring less than 2 %
        solved = solve_posterior(prior, SpectralMeasurement(FINE_GRID, both, noisy,
                                                            np.diag(error**2)))
        after += [outlook_of(solved, 0.95)[WIDTH]] * len(gel)
    assert len(forecast) == len(truths)
    assert np.mean(forecast) == pytest.approx(np.mean(after), rel=0.1)


def test_the_transmittance_of_a_gel_comes_from_two_readings(tmp_path):
    lamp = np.linspace(0.2, 1.4, 301)
    for name, values in (("lamp", lamp), ("gel", lamp * ORANGE)):
        (tmp_path / f"{name}.csv").write_text("wavelength_nm,value\n" + "".join(
            f"{nm:g},{value}\n" for nm, value in zip(GRID.nm, values, strict=True)))
    words = ["filter", "fit", *(str(tmp_path / f"{name}.csv") for name in ("lamp", "gel")),
             "--readings", "--out", str(tmp_path / "orange.csv")]
    outcome = CliRunner().invoke(app, words)
    assert outcome.exit_code == 0, outcome.output
    known = read_filter(tmp_path / "orange.csv", "transmittance")
    np.testing.assert_allclose(known.transmittance, ORANGE, rtol=1e-6)
    # two readings of 0.5 %, and the shift and stray light that every file may have
    assert 0.005 * np.sqrt(2) < np.sqrt(np.sum(known.modes[-1]**2)) < 0.012
    swapped = CliRunner().invoke(app, [*words[:2], words[3], words[2], *words[4:]])
    assert swapped.exit_code == 3 and "without the filter first" in swapped.output


def test_two_chart_photos_measure_a_filter_within_its_standard_error():
    grid = FINE_GRID.nm
    layouts = [ChartPhoto(PatchSamples(photo.signal, photo.covariance, np.ones(24),
                                       0 * photo.signal, 0 * photo.signal),
                          photo.reflectances, Spectrum(GRID, LAMP, Quantity.RELATIVE, "lamp"),
                          filter=through)
               for photo, through in ((bare(0.003), None), (through(ORANGE, stated_filter(
                   "true", ORANGE), 0.003), unknown_filter()))]
    known, _ = filter_from_charts(*layouts, None, prior=simulated_prior())
    seen = (grid > 430) & (grid < 660)
    off = np.log(known.values / ORANGE)
    off -= off[seen].mean()
    relative = known.standard_error / known.values
    assert np.sqrt(np.mean(off[seen] ** 2)) < 0.4
    assert np.sqrt(np.mean((off[seen] / relative[seen]) ** 2)) < 2.5
