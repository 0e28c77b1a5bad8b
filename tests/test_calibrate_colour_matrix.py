"""A file's colour matrix against curves: laws, and the mistaken light it names."""
import numpy as np
import pytest
from calibrate_cameras import cameras, on_grid

from spectrabox.calibrate import doubts
from spectrabox.calibrate.chart_calibration import calibrate_chart
from spectrabox.calibrate.chart_photo import ChartPhoto
from spectrabox.calibrate.doubts import (
    SPREAD,
    TYPICAL,
    colour_matrix,
    matrix_deviation,
    matrix_doubt,
)
from spectrabox.capture.chart.patches import sample_patches
from spectrabox.capture.photo.linear import open_photo
from spectrabox.fixtures.demos.demo_photos import NM, camera_sensitivities
from spectrabox.fixtures.dng import write_dng
from spectrabox.radiometry.appearance import tristimulus
from spectrabox.radiometry.chart import chart_reflectances
from spectrabox.radiometry.findings import Severity, worst
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records.photos import ChartDetection, PatchSamples
from spectrabox.radiometry.records.spectra import Quantity, Spectrum, UnknownLight
from spectrabox.radiometry.spectra.named_spectra import light

GRID = visible_grid()
CODES = {"calibration.matrix-contradicts", "calibration.matrix-agrees"}


def measured_curves():
    """The Nikon D5100 that colour-science ships, on the working grid."""
    return np.array([np.interp(GRID.nm, NM, curve) for curve in camera_sensitivities()])


def own_matrix(curves):
    surfaces = chart_reflectances("BabelColor Average", GRID)
    xyz = np.array([tristimulus(GRID.nm, surface) for surface in surfaces])
    signals = surfaces @ (curves * light("D65", GRID) * GRID.weights_nm).T
    return np.linalg.lstsq(xyz, signals, rcond=None)[0].T


@pytest.mark.parametrize("scale", [1.0, 1e-4])
def test_the_matrix_that_the_curves_predict_deviates_by_nothing(scale):
    curves = measured_curves()
    # Two least-squares solutions of condition 20: a hundred eps.
    np.testing.assert_allclose(matrix_deviation(scale * own_matrix(curves), curves, GRID), 0,
                               atol=1e-12)


def test_a_row_that_is_brighter_deviates_in_its_own_band():
    curves = measured_curves()
    matrix = own_matrix(curves) * np.array([[1.0], [1.0], [1.2]])
    deviation = matrix_deviation(matrix, curves, GRID)
    # The common scale takes a part of the 20 %, the same of every band.
    assert deviation[2, 0] - deviation[0, 0] == pytest.approx(deviation[2, 0] - deviation[1, 0])
    assert deviation[2, 0] > 0.1 and np.all(deviation[:2, 0] < 0)


def test_a_photo_without_a_matrix_or_of_other_bands_says_nothing():
    curves = measured_curves()
    assert not colour_matrix(None, curves, GRID)
    assert not colour_matrix(np.eye(3), np.vstack([curves, curves]), GRID)


def calibrated(light_name, taken_for):
    curves, surfaces = measured_curves(), chart_reflectances("BabelColor Average", GRID)
    signal = surfaces @ (curves * light(light_name, GRID) * GRID.weights_nm).T
    signal *= 1 + 0.005 * np.random.default_rng(1).standard_normal(signal.shape)
    zero = np.zeros((24, 3))
    matrix = own_matrix(curves)
    samples = PatchSamples(signal, np.zeros((24, 3, 3)), np.ones(24), zero, zero, matrix)
    spectrum = UnknownLight() if taken_for is None else Spectrum(
        GRID, light(taken_for, GRID), Quantity.RELATIVE, taken_for)
    return calibrate_chart([ChartPhoto(samples, surfaces, spectrum)], GRID).calibration


def test_products_with_an_unknown_light_are_held_against_no_matrix():
    fit = calibrated("LED-B3", None)
    # as curves they would contradict it by far: they hold the lamp
    held = colour_matrix(own_matrix(measured_curves()), fit.sensitivity.curves, GRID)
    assert [one.code for one in held] == ["calibration.matrix-contradicts"]
    assert worst(held) is Severity.WARN
    assert not {one.code for one in fit.findings} & CODES


def test_a_mistaken_light_is_named_and_the_right_one_is_not():
    def contradicts(calibration):
        code, = CODES & {one.code for one in calibration.findings}
        return code == "calibration.matrix-contradicts"
    assert contradicts(calibrated("LED-B3", "LED-B2"))
    assert not contradicts(calibrated("LED-B3", "LED-B3"))


def test_a_camera_that_libraw_knows_by_its_name_brings_its_matrix(tmp_path):
    grey = np.full((64, 64), 2000, np.uint16)
    write_dng(tmp_path / "known.dng", grey, make="NIKON CORPORATION", model="NIKON D5100",
              camera_from_xyz=None)
    write_dng(tmp_path / "unknown.dng", grey, camera_from_xyz=None)
    matrix = open_photo(tmp_path / "known.dng").camera_from_xyz
    # Entries depart from the typical by two to three spreads at most, an outlier among cameras.
    assert np.abs((matrix_deviation(matrix, measured_curves(), GRID) - TYPICAL) / SPREAD).max() < 4
    assert open_photo(tmp_path / "unknown.dng").camera_from_xyz is None


def test_the_matrix_that_a_dng_states_is_the_one_before_a_profile_and_no_doubt(tmp_path):
    bars = np.full((64, 64), 2000, np.uint16)
    write_dng(tmp_path / "own.dng", bars, matrix_light=21)
    image = open_photo(tmp_path / "own.dng")
    assert image.matrix_of_file and image.camera_from_xyz is not None
    quads = np.array([[[4, 4], [60, 4], [60, 60], [4, 60]]], float)
    assert sample_patches(image, ChartDetection(quads, 1.0, False, "")).camera_from_xyz is None


def test_a_camera_that_departs_by_one_spread_everywhere_is_doubted_by_one(monkeypatch):
    """A mean square over what is free: nine entries, of which a common scale takes up one."""
    monkeypatch.setattr(doubts, "matrix_deviation", lambda *_: TYPICAL - SPREAD)
    assert matrix_doubt(np.eye(3), np.ones((3, GRID.nm.size)), GRID) == pytest.approx(9 / 8)


def test_a_dark_band_deviates_by_shares_of_its_own_brightness():
    curves = on_grid(cameras(1, 4)[0])
    factors = np.array([[1.0], [1.0], [0.25]])
    matrix = own_matrix(curves)
    matrix[2] += np.array([0.0, 0.03, -0.03]) * matrix[2].max()
    bright = matrix_deviation(matrix, curves, GRID)
    dark = matrix_deviation(factors * matrix, factors * curves, GRID)
    # a common scale takes up a little of the third row, less where it is dark
    np.testing.assert_allclose(dark[2], bright[2], atol=0.25 * np.abs(bright[2]).max())
    assert np.abs(bright[2]).max() > 0.005
