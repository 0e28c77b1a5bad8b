"""Several photos of one camera in one fit - lights, exposures, charts - and cameras of any number
of bands.
"""
import json

import numpy as np
import pytest
from calibrate_cameras import (
    GRID,
    daylight,
    led,
    on_grid,
    photo,
    prior,
    reflectances,
    samples,
    signals,
)
from calibrate_cameras import cameras_at_10_nm as cameras
from typer.testing import CliRunner

from spectrabox.calibrate.chart_calibration import calibrate_chart
from spectrabox.calibrate.chart_equations import field_terms
from spectrabox.calibrate.chart_photo import ChartPhoto
from spectrabox.calibrate.prior.curve_posterior import draw_curves, sensitivity_draws
from spectrabox.calibrate.sensitivity import default_prior, fit_with_prior
from spectrabox.radiometry.chart import CLASSIC, chart_reflectances
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import Quantity, Spectrum
from spectrabox.session.camera.camera_files import read_patches
from spectrabox.session.cli import app

SURFACES = reflectances()


def noisy(signal, noise, seed):
    return signal * (1 + noise * np.random.default_rng(seed).standard_normal(signal.shape))


def relative_error(found, truth):
    return np.sqrt(np.sum((found / found.max() - truth / truth.max()) ** 2)
                   / np.sum((truth / truth.max()) ** 2))


def spectrum(values):
    return Spectrum(GRID, values, Quantity.RELATIVE, "lamp")


def test_the_exposures_of_two_photos_are_found_and_a_known_ratio_is_kept():
    truth = on_grid(cameras(1, 71)[0])
    bright = noisy(signals(truth, daylight(), SURFACES), 0.005, 1)
    dark = noisy(0.125 * signals(truth, daylight(), SURFACES), 0.005, 2)
    shots = [photo(bright, daylight(), SURFACES, 0.005), photo(dark, daylight(), SURFACES, 0.005)]
    free = fit_with_prior(shots, prior(), GRID)
    # 0.5 % of noise over 24 patches and three bands in each photo, and the model error that the fit
    # allows.
    assert free.photos[1].scale / free.photos[0].scale == pytest.approx(0.125, rel=0.005)
    tied = fit_with_prior([shots[0], photo(8 * dark, daylight(), SURFACES, 0.005,
                                           relative_exposure_sd=1e-6)], prior(), GRID)
    # 1e-6 against data of 1e-3
    assert tied.photos[1].scale / tied.photos[0].scale == pytest.approx(1.0, rel=1e-4)


def test_two_charts_say_more_than_one_and_do_not_depend_on_their_order():
    truth = on_grid(cameras(1, 72)[0])
    other = reflectances(48, 21)
    shots = [photo(noisy(signals(truth, led(), SURFACES), 0.01, 3), led(), SURFACES, 0.01),
             photo(noisy(0.3 * signals(truth, led(), other), 0.01, 4), led(), other, 0.01)]
    alone, both, turned = (fit_with_prior(given, prior(), GRID)
                           for given in (shots[:1], shots, shots[::-1]))
    assert np.sum(both.sensitivity.standard_error**2) < np.sum(alone.sensitivity.standard_error**2)
    assert [held.shape for held in both.held_out] == [(24, 3), (48, 3)]
    # The curves' scale is fixed by the first chart: the same Gaussian in other coordinates, to
    # second order.
    np.testing.assert_allclose(turned.sensitivity.curves, both.sensitivity.curves, atol=2e-3)


def test_fall_off_and_glare_belong_to_each_photo():
    truth, terms = on_grid(cameras(1, 73)[0]), field_terms(CLASSIC.centres_uv)
    across = CLASSIC.centres_uv[:, 0]
    clean = [signals(truth, light(), SURFACES) for light in (led, daylight)]
    fallen = clean[1] * (1 - 0.2 * across)[:, None]
    shots = [photo(noisy(signal, 0.003, seed), light(), SURFACES, 0.003, terms, True)
             for seed, (signal, light) in enumerate(((clean[0], led), (fallen, daylight)))]
    first, second = fit_with_prior(shots, prior(), GRID).photos
    # 0.3 % of noise and as much model error on 24 patches leave the field uncertain by less than 2
    # %.
    np.testing.assert_allclose(first.field / first.field.mean(), 1, atol=0.02)
    np.testing.assert_allclose(second.field / second.field.mean(),
                               (1 - 0.2 * across) / np.mean(1 - 0.2 * across), atol=0.02)


def write_patches(path, signal, header="R,G,B"):
    path.write_text(header + "\n" + "\n".join(",".join(f"{value:.9g}" for value in row)
                                              for row in signal), encoding="utf-8")


def test_two_photos_through_the_command_line_give_what_python_gives(tmp_path):
    surfaces = chart_reflectances("BabelColor Average", GRID)
    truth = on_grid(cameras(1, 74)[0])
    files, lights = [tmp_path / "led.csv", tmp_path / "day.csv"], [led(), daylight()]
    for seed, (path, light) in enumerate(zip(files, lights, strict=True)):
        write_patches(path, noisy(signals(truth, light, surfaces), 0.005, seed))
        rows = "\n".join(f"{nm:g},{value:.17g}" for nm, value in zip(GRID.nm, light, strict=True))
        (tmp_path / f"light_{path.name}").write_text(f"wavelength_nm,value\n{rows}\n",
                                                     encoding="utf-8")
    words = [word for path in files
             for word in ("--patches", str(path), "--light",
                          str(path.parent / f"light_{path.name}"))]
    result = CliRunner().invoke(app, ["camera", "fit", *words, "--reference",
                                      "BabelColor Average", "--json"])
    assert result.exit_code == 0, result.output
    facts = json.loads(result.stdout)
    first, second = (read_patches(path).samples for path in files)
    expected = calibrate_chart([ChartPhoto(first, surfaces, spectrum(lights[0])),
                                ChartPhoto(second, surfaces, spectrum(lights[1]))], GRID)
    # the same code on the same numbers
    np.testing.assert_array_equal(facts["sensitivities"], expected.calibration.sensitivity.curves)
    assert facts["photos"] == 2
    result = CliRunner().invoke(app, ["camera", "fit", *words, "--method", "paper"])
    assert result.exit_code == 3
    assert "method paper takes one photo; 2 photos need method prior" in result.stderr
    result = CliRunner().invoke(app, ["camera", "fit", *words, "--patches", str(files[0])])
    assert result.exit_code == 2 and "2 times --light for 3 photos" in result.stderr
    write_patches(files[1], np.ones((24, 3)), "B,G,R")
    result = CliRunner().invoke(app, ["camera", "fit", *words])
    assert result.exit_code == 3
    assert "day.csv has the bands B, G, R, led.csv has R, G, B" in result.stderr


def many_bands(count, seed=1):
    """Lopsided bumps (K, P) over a low pedestal, largest value 1."""
    rng = np.random.default_rng(seed)
    apart = GRID.nm - (np.linspace(425, 675, count) + rng.normal(0, 4, count))[:, None]
    width, skew = (max(12, 110 / count) * rng.uniform(0.7, 1.3, (count, 1)),
                   rng.uniform(0.7, 1.5, (count, 1)))
    estimate = np.exp(-0.5 * (apart / np.where(apart > 0, width * skew, width / skew)) ** 2)
    estimate = rng.uniform(0.5, 1, (count, 1)) * (estimate + rng.uniform(0, 0.03, (count, 1)))
    return estimate / estimate.max()


@pytest.mark.parametrize("bands, light", [(4, led), (7, daylight), (16, daylight)])
def test_any_number_of_bands_takes_the_same_joint_estimate(bands, light):
    truth, terms, across = (many_bands(bands), field_terms(CLASSIC.centres_uv),
                            CLASSIC.centres_uv[:, 0])
    spoiled = signals(truth, light(), SURFACES) * (1 - 0.2 * across)[:, None]
    spoiled = noisy(spoiled + 0.005 * spoiled.max(axis=0), 0.005, 3)
    shown = [photo(spoiled, light(), SURFACES, 0.005, terms, True)]
    fit = fit_with_prior(shown, default_prior(shown, GRID), GRID)
    field = fit.photos[0].field
    # 0.5 % of noise on 24 patches; bands add up.
    np.testing.assert_allclose(field / field.mean(), (1 - 0.2 * across) / np.mean(1 - 0.2 * across),
                               atol=0.02)
    lower, upper = np.quantile(draw_curves(fit.posterior, bands, 300, 0), [0.05, 0.95],
                               axis=0)
    # One camera: neighbouring wavelengths move together, so the share scatters by about 0.06 about
    # 0.9.
    assert np.mean((truth >= lower) & (truth <= upper)) > 0.7
    assert fit.model_error < 0.02 and not fit.disagrees


def test_a_band_of_any_brightness_is_fitted_alike():
    truth = many_bands(5)
    signal = noisy(signals(truth, daylight(), SURFACES), 0.003, 6)
    gains = np.array([1.0, 20.0, 0.05, 1.0, 3.0])
    shots = [[photo(values, daylight(), SURFACES, 0.003)] for values in (signal, signal * gains)]
    given, gained = (fit_with_prior(shown, default_prior(shown, GRID), GRID).sensitivity.curves
                     for shown in shots)
    for band in range(5):
        # The prior takes each band's level from the photo; what is left is which near-zero values
        # are held at zero.
        assert relative_error(gained[band], given[band]) < 0.03


def test_draws_follow_the_calibrations_covariance():
    signal = noisy(signals(on_grid(cameras(1, 75)[0]), daylight(), SURFACES), 0.005, 7)
    result = calibrate_chart([ChartPhoto(samples(signal, 0.005), SURFACES, spectrum(daylight()))],
                             GRID, prior=prior())
    fit = result.calibration.sensitivity
    draws = sensitivity_draws(result.calibration, 2000, 3)
    assert draws.shape == (2000, 3, 301) and draws.min() >= 0
    np.testing.assert_allclose(draws.max(axis=(1, 2)), 1, rtol=1e-12)
    far = fit.curves > 5 * fit.standard_error  # where clipping at zero plays no part
    # 2000 draws give standard deviations to 1.6 %; dividing each draw by its own maximum changes
    # them to first order only near the maximum.
    ratio = draws.std(axis=0)[far] / np.maximum(fit.standard_error[far], 1e-4)
    assert np.median(ratio) == pytest.approx(1, abs=0.15)
    np.testing.assert_array_equal(draws, sensitivity_draws(result.calibration, 2000, 3))


def test_measured_curves_have_no_draws():
    curves = on_grid(cameras(1, 76)[0])
    signal = signals(curves, daylight(), SURFACES)
    fit = calibrate_chart([ChartPhoto(samples(signal), SURFACES, spectrum(daylight()))], GRID,
                          curves=curves)
    level, error, _ = fit.without.deviations(SURFACES)     # nothing uncertain, nothing off
    assert np.abs(level).max() < 1e-4 and np.isfinite(error).all()
    with pytest.raises(InputError, match=r"measured curves from a file.*carry no covariance"):
        sensitivity_draws(fit.calibration, 10, 0)
