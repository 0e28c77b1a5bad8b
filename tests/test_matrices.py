"""Matrices of one camera: by measured curves, by fitted ones, by the photographed chart."""
from dataclasses import replace

import numpy as np
import pytest

from spectrabox.calibrate.chart_calibration import calibrate_chart
from spectrabox.calibrate.chart_photo import ChartPhoto
from spectrabox.calibrate.colour_profile import fit_transform
from spectrabox.measure.plots import plot_matrices
from spectrabox.measure.profiles import camera_profile
from spectrabox.measure.profiles.camera_profile import (
    FITTED,
    MEASURED,
    PHOTOGRAPHED,
    compare_matrices,
    photographed_signals,
)
from spectrabox.radiometry.chart import chart_reflectances
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.profile_files import aces_from_d50
from spectrabox.radiometry.records.photos import PatchSamples
from spectrabox.radiometry.records.spectra import Quantity, Spectrum, UnknownLight
from spectrabox.radiometry.spectra.named_spectra import light, relative_response, sensitivities
from spectrabox.sampling.prior.mixture import PRIOR_GRID

SURFACES = chart_reflectances("BabelColor Average", FINE_GRID)
NIKON = sensitivities("Nikon D810", FINE_GRID)


def chart_photo(curves=NIKON, lamp="D55", exposure=1.0, noise=0.003):
    signal = SURFACES @ (curves * light(lamp, FINE_GRID) * FINE_GRID.weights_nm).T
    signal *= exposure / signal.max() * (
        1 + noise * np.random.default_rng(4).standard_normal(signal.shape))
    samples = PatchSamples(signal, np.zeros((24, 3, 3)), np.ones(24), 0 * signal, 0 * signal)
    return ChartPhoto(samples, SURFACES, Spectrum(FINE_GRID, light(lamp, FINE_GRID),
                                                  Quantity.RELATIVE, "measured"))


@pytest.fixture(scope="module")
def fitted():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("spectrabox.calibrate.chart_calibration.evidence_on_lights", lambda *_: ())
        photo = chart_photo()
        return photo, calibrate_chart([photo], FINE_GRID)


def test_three_matrices_of_one_camera_agree_within_what_each_is_sure_of(fitted):
    photo, calibration = fitted
    compared = compare_matrices(calibration, photo, NIKON)
    first, second, third = compared.facts()
    assert list(compared.matrices) == [MEASURED, FITTED, PHOTOGRAPHED]
    assert first["apart"] == 0 and second["apart"] < 0.5 and third["apart"] < 0.5
    for row in (second, third):
        # nine entries, of which the row sums are fixed: six within three standard deviations
        both = np.hypot(row["matrix"].standard_deviation, first["matrix"].standard_deviation)
        assert np.all(np.abs(row["matrix"].value - first["matrix"].value) < 3 * both)
    for row in (first, second, third):
        np.testing.assert_allclose(row["aces"].value, aces_from_d50() @ row["matrix"].value,
                                   atol=1e-12)
        # white stays white
        np.testing.assert_allclose(row["aces"].value.sum(axis=1), 1, atol=1e-9)
        assert row["fresh"]["percentile_90"].value > row["fresh"]["mean"].value > 0


def test_the_matrix_by_measured_curves_is_that_of_a_colour_profile(fitted):
    photo, calibration = fitted
    matrix, *_ = compare_matrices(calibration, photo, NIKON).matrices[MEASURED]
    response = relative_response("Nikon D810", "D55", PRIOR_GRID)
    patches = SURFACES[:, np.searchsorted(FINE_GRID.nm, PRIOR_GRID.nm)]
    # curves are read every 5 nm there, and every nm here
    np.testing.assert_allclose(matrix, fit_transform(
        response, patches, PRIOR_GRID, 1).coefficients, atol=2e-3)


def test_without_measured_curves_the_fitted_ones_judge(fitted):
    photo, calibration = fitted
    compared = compare_matrices(calibration, photo)
    assert list(compared.matrices) == [FITTED, PHOTOGRAPHED]
    assert compared.judge == FITTED and "as the fitted curves see them" in str(compared)


def test_a_photographed_chart_is_balanced_whatever_its_exposure(fitted):
    photo, calibration = fitted
    brighter = replace(photo, samples=replace(photo.samples, mean=3 * photo.samples.mean))
    (one, error), (three, _) = (photographed_signals(calibration, each)
                                for each in (photo, brighter))
    # but for the glare, which is that of the first photo
    np.testing.assert_allclose(one, three, rtol=0.02, atol=2e-3)
    assert 0 < error < 0.03
    # a neutral patch reads its reflectance: noise, and neutrals that are not quite
    np.testing.assert_allclose(one[18:], SURFACES[18:].mean(axis=1)[:, None] * np.ones(3),
                               rtol=0.06, atol=2e-3)


def test_measured_curves_need_a_light_and_matrices_three_bands(fitted):
    photo, calibration = fitted
    with pytest.raises(InputError, match="an unknown light, under which measured curves give no"):
        compare_matrices(calibration, replace(photo, light=UnknownLight()), NIKON)
    four = PatchSamples(np.ones((24, 4)), np.zeros((24, 4, 4)), np.ones(24), np.zeros((24, 4)),
                        np.zeros((24, 4)))
    with pytest.raises(InputError, match="the camera has 4 bands; matrices are of three"):
        compare_matrices(calibration, replace(photo, samples=four))


def test_the_plot_shows_every_entry_and_every_error(fitted):
    import matplotlib.pyplot as plt
    photo, calibration = fitted
    compared = compare_matrices(calibration, photo, NIKON)
    entries, errors = plt.subplots(1, 2)[1]
    plot_matrices(entries, errors, compared)
    drawn = [line for line in entries.get_lines() if len(line.get_xdata()) == 9]
    np.testing.assert_allclose(np.array([line.get_ydata() for line in drawn], float),
                               [np.ravel(each[0]) for each in compared.matrices.values()])
    shown = [line.get_ydata() for line in errors.get_lines() if len(line.get_xdata()) == 2]
    expected = [[compared.chart[source][0, figure], compared.fresh[source][0, figure]]
                for source in compared.matrices for figure in range(2)]
    np.testing.assert_allclose(np.array(shown, float), expected)
    plt.close(entries.figure)


def test_photographed_signals_differ_by_patch_and_all_alike_by_the_balance():
    """Logarithms of draws: what bands share of a patch, and patches of a band, is as stated."""
    calibration, rng = calibrate_chart([chart_photo()], FINE_GRID), np.random.default_rng(3)
    error = calibration.prior_fit.patch_error
    common, balance = np.hypot(error.common, 0.02), 0.01
    log = np.log(np.concatenate([camera_profile._as_they_may_be(
        np.ones((6, 3)), calibration, 0.02, balance, rng) for _ in range(40)]))
    covariance = np.cov(log.reshape(len(log), -1), rowvar=False).reshape(6, 3, 6, 3)
    bands, patches = np.eye(3), np.eye(6)
    stated = np.einsum("ij,kl->ikjl", patches, error.own**2 * bands + common**2) \
        + np.einsum("ij,kl->ikjl", np.ones((6, 6)), balance**2 * bands)
    # as many draws know a covariance to 2 % of the variances
    np.testing.assert_allclose(covariance, stated, atol=0.1 * stated.max())
