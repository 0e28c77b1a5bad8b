"""What capture refuses and puts back, and cameras of pixels that are not square."""
import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_views import TRUE

from spectrabox.calibrate.geometry.lens import pinhole
from spectrabox.calibrate.geometry.pose import _require_one, lens_of_focal_length, pose_from_points
from spectrabox.capture.chart import quality
from spectrabox.capture.chart.chart_agreement import (
    TYPICAL_SIGNALS,
    _log_fit,
    _mixture_fit,
    white_excess,
)
from spectrabox.capture.chart.patches import clipped_bands, require_unclipped, sample_patches
from spectrabox.capture.develop.bracket import merge_exposures
from spectrabox.capture.develop.dark import mean_dark
from spectrabox.capture.develop.developed import smooth_flat
from spectrabox.capture.meter.instruments.instrument_errors import (
    LineFaultError,
    UntrustedReadingError,
)
from spectrabox.capture.meter.instruments.interface import MeterSettings
from spectrabox.capture.meter.instruments.pr655 import Pr655
from spectrabox.capture.meter.measurement import READS, _trusted_result
from spectrabox.capture.meter.measurement_series import series_spectrum
from spectrabox.capture.photo.linear import linear_image
from spectrabox.radiometry.chart import CLASSIC
from spectrabox.radiometry.errors import CheckError, ClippedPhotoError
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.records.photos import (
    ChartDetection,
    LinearImage,
    PatchSamples,
    PhotoKind,
    RawFrame,
)
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.readings import ReadingSeries

from tests.test_calibrate_pose import CORNERS, SHIFT, TURN, seen


@pytest.mark.parametrize("band", [0, 1, 2])
def test_a_patch_that_is_clipped_in_one_band_is_refused_by_name(band):
    clipped = np.zeros((4, 3))
    clipped[2, band] = 0.3
    samples = PatchSamples(np.full((4, 3), 0.5), np.zeros((4, 3, 3)), np.full(4, 100), clipped,
                           np.zeros((4, 3)))
    with pytest.raises(ClippedPhotoError, match=r"1 of 4 patches are saturated \(c\)"):
        require_unclipped(samples, "abcd", "chart.dng")
    clipped[2, band] = 0.005        # a dead pixel or two
    require_unclipped(PatchSamples(samples.mean, samples.covariance_of_mean, samples.pixels,
                                   clipped, samples.gradient), "abcd", "chart.dng")


def test_bands_drop_out_where_too_many_patches_are_clipped_in_them():
    clipped = np.zeros((24, 6))
    clipped[:4, 4] = clipped[18:20, 2] = clipped[:3, 0] = 1.0
    samples = PatchSamples(np.full((24, 6), 0.5), np.zeros((24, 6, 6)), np.full(24, 100), clipped,
                           0 * clipped)
    neutrals = CLASSIC.neutrals
    assert clipped_bands(samples, neutrals).tolist() == [False, False, True, False, True, False]
    lost, = require_unclipped(samples, CLASSIC.names, "c.dng", neutrals, tuple("abcdef"),
                              bands_may_drop=True)
    assert (lost.code, lost.subject, lost.values["bands"]) == ("chart.bands-lost", "c.dng",
                                                               ["c", "e"])
    assert lost.values["clipped"] == len(lost.values["names"]) == 6
    assert lost.values["names"][0] == "dark skin"
    with pytest.raises(ClippedPhotoError, match=r"halve the exposure of c, e$"):
        require_unclipped(samples, CLASSIC.names, "c.dng", neutrals, tuple("abcdef"))


def image(signal, variance=1e-8, **more):
    """A linear image (H, W, 3) of a signal of one value a pixel."""
    signal = np.repeat(np.asarray(signal, np.float32)[..., None], 3, axis=2)
    facts = {"sensor_step": 1.0, "exposure_s": 0.01, "iso": 100.0, "f_number": 8.0,
             "kind": PhotoKind.RAW, "camera": "body", "source": "photo.dng", "sha256": ""} | more
    return LinearImage(signal=signal, variance=np.full(signal.shape, variance, np.float32),
                       saturated=np.zeros(signal.shape, bool), **facts)


@pytest.mark.parametrize("rise", [0.02, 0.2])
def test_the_gradient_of_a_patch_is_what_its_light_changes_by_over_it(rise):
    y, x = np.mgrid[:40, :60]
    plane = 0.4 * (1 + rise * (x - 29.5) / 59 + 0 * y)
    quad = np.array([[-0.5, -0.5], [59.5, -0.5], [59.5, 39.5], [-0.5, 39.5]])
    patches = sample_patches(image(plane), ChartDetection(quad[None], 1.0, False, ""))
    # single precision
    np.testing.assert_allclose(patches.gradient, rise, rtol=1e-4)


def test_black_levels_that_are_off_do_not_change_the_ratio_of_two_exposures():
    """Half of the picture is too dark to tell in the shorter exposure, where the black level is a
    tenth of it; in the longer one it is bright enough.
    """
    light = np.where(np.arange(60) < 30, 0.005, 0.1) * np.ones((40, 1))
    short, long = image(light + 5e-4), image(8 * light, exposure_s=0.08, source="long.dng")
    _, (pair,) = merge_exposures([short, long])
    assert pair.code == "bracket.ratio"
    assert pair.values["measured"] == pytest.approx(0.8 / 0.1005, rel=1e-4)


@pytest.mark.parametrize("added, expected", [((0.05, 0.05, 0.05), 0.05), ((0.05, 0.0, 0.0), 0.0),
                                             ((0.08, 0.03, 0.05), 0.03)])
def test_glare_is_what_all_bands_read_more(added, expected):
    """A lamp's reflection is white: of light on one patch that is coloured its least band counts.
    """
    signals = np.array([0.4, 0.7, 0.5]) * TYPICAL_SIGNALS
    white = CLASSIC.neutrals[0]
    signals[7] += np.array(added) * signals[white]
    estimate = white_excess(signals, TYPICAL_SIGNALS, np.ones(24), white)
    # one patch of 24 hardly moves the mixture
    assert estimate[7] == pytest.approx(expected, abs=0.004)
    assert np.delete(estimate, 7).max() < 0.004


@pytest.mark.parametrize("power", [0.45, 1.4])
def test_a_tone_curve_that_is_a_power_changes_nothing_of_how_well_a_chart_is_explained(power):
    rng = np.random.default_rng(94)
    noise = 1 + 0.03 * rng.standard_normal((24, 3))
    signals = np.array([0.4, 0.7, 0.5]) * TYPICAL_SIGNALS * noise
    kept = np.ones(24, bool)
    ours, theirs = (_log_fit(each, TYPICAL_SIGNALS, CLASSIC, kept)
                    for each in (signals, signals**power))
    # logarithms of a power are a multiple: round-off
    assert theirs == pytest.approx((ours[0], power * ours[1]), rel=1e-9)
    for one, other in zip(_mixture_fit(signals, TYPICAL_SIGNALS, 1.0, CLASSIC, kept),
                          _mixture_fit(signals**power, TYPICAL_SIGNALS, power, CLASSIC, kept),
                          strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-7)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_flat_field_does_not_know_left_from_right_nor_up_from_down(axis):
    y, x = np.mgrid[:50, :66] / 66
    card = image(0.7 * np.exp(-0.9 * (x - 0.2) ** 2 - 0.5 * (y - 0.6) ** 2 + 0.3 * x * y**2))
    turned = dataclasses.replace(card, signal=np.flip(card.signal, axis),
                                 saturated=np.flip(card.saturated, axis))
    ours, theirs = smooth_flat(card), smooth_flat(turned)
    # blocks of one and two pixels lie otherwise from the other side: of the bend over them
    np.testing.assert_allclose(np.flip(theirs, axis), ours, rtol=5e-4)
    # what is not a polynomial of fourth order in a card of this shape
    np.testing.assert_allclose(ours / ours.max(), card.signal / card.signal.max(), rtol=2e-3)


@pytest.mark.parametrize("errors, count", [((0.001, 0.2, 0.2), 0), ((0.2, 0.2, 0.2), 1)])
def test_a_photo_is_too_dark_where_no_band_knows_black(errors, count):
    """Of a lamp without blue, the blue band knows it least, however long the exposure."""
    mean, white = np.full((24, 3), 0.5), 0.5
    mean[-1] = 0.02
    covariance = np.zeros((24, 3, 3))
    covariance[-1] = np.diag((0.02 * np.array(errors)) ** 2)
    samples = PatchSamples(mean, covariance, np.full(24, 100), np.zeros((24, 3)), np.zeros((24, 3)))
    codes = [one.code for one in quality.black_noisy(samples, 23, white)]
    assert codes == ["chart.black-noisy"] * count


def raw(mosaic, cfa, name="photo.dng"):
    return RawFrame(mosaic=np.rint(mosaic).astype(np.uint16), cfa=cfa,
                    black_level=np.full(cfa.shape, 512.0), white_level=16383.0, exposure_s=1.0,
                    iso=100.0, f_number=8.0, camera="body", file=name, sha256="")


def test_black_that_is_cut_off_is_told_alike_however_often_the_tile_is_written():
    """Half of all samples below black, of a pattern of one tile and of four."""
    rng, rggb = np.random.default_rng(95), np.array([[0, 1], [1, 2]])
    mosaic = np.maximum(512 + 6 * rng.standard_normal((192, 288)), 512)
    one, four = (linear_image(raw(mosaic, np.tile(rggb, times))) for times in ((1, 1), (2, 2)))
    np.testing.assert_allclose(four.variance, one.variance, rtol=1e-6)
    # green of two samples; the share of black of some 10 000 samples tells to a few per cent
    expected = (6 / (16383 - 512)) ** 2 * np.array([1, 1 / 2, 1])
    np.testing.assert_allclose(one.variance[0, 0], expected, rtol=0.1)


def test_noise_is_that_of_rounding_at_least_however_often_the_tile_is_written():
    """An even picture: green is the mean of two samples, which err independently by rounding."""
    rggb, step = np.array([[0, 1], [1, 2]]), 1 / (16383 - 512)
    for times in ((1, 1), (2, 2), (1, 3)):
        image = linear_image(raw(np.full((96, 144), 5000), np.tile(rggb, times)))
        expected = step**2 / 12 * np.array([1, 1 / 2, 1])
        # the gain of what has no noise is 0
        np.testing.assert_allclose(image.variance[0, 0], expected, rtol=1e-4)


@pytest.mark.parametrize("frames", [2, 16])
def test_a_pixel_is_hot_by_the_noise_of_the_mean_of_dark_frames(frames):
    """Noise of 4 DN a frame: eleven and five standard errors of the mean, of a limit of eight."""
    rng, shape = np.random.default_rng(93), (60, 80)
    glow = np.zeros(shape)
    glow[20, 30], glow[40, 50] = np.array([11.0, 5.0]) * 4 / np.sqrt(frames)
    shots = [raw(512 + glow + 4 * rng.standard_normal(shape), np.zeros((1, 1), int),
                 f"dark {index}") for index in range(frames)]
    assert np.argwhere(mean_dark(shots).hot).tolist() == [[20, 30]]


@pytest.mark.parametrize("spread, shared", [(0.3, 0.0), (0.0, 0.04), (0.3, 0.04)])
def test_a_mean_errs_by_its_scatter_and_by_its_calibration_independently(spread, shared):
    grid = grid_from_nm(np.array([500.0, 510.0, 520.0]))
    ones = np.ones(3)
    series = ReadingSeries(grid, 5 * ones, spread * ones, 0.0, 0.1, 9,
                           Quantity.RADIANCE, (), shared * ones)
    estimate = series_spectrum(series, "lamp").standard_error
    np.testing.assert_allclose(estimate**2, spread**2 / 9 + shared**2, rtol=1e-12)


@pytest.mark.parametrize("worse, refused", [(2.0, True), (3.5, False)])
def test_a_second_pose_counts_up_to_three_standard_errors(worse, refused):
    """Of eight points whose residuals say a noise of 0.5 pixels; turned by a third of a turn."""
    noise, best, other = 0.5, np.zeros(6), np.array([0.0, 2.0, 0.0, 0.0, 0.0, 1.0])
    squares = noise**2 * (2 * 8 - 6)
    fits = [(best, 1.0, squares), (other, 1.0, squares + (worse * noise) ** 2)]
    if refused:
        with pytest.raises(CheckError, match="two poses of the camera explain"):
            _require_one(fits, 8)
    else:
        _require_one(fits, 8)


def replying(*replies):
    """An instrument whose held result reads so, one reply after the other."""
    left = iter(replies)

    def read():
        reply = next(left)
        if reply is None:
            raise LineFaultError("port: garbled")
        return SimpleNamespace(raw=(reply,))
    line = SimpleNamespace(name="port", drain=lambda _: None)
    return SimpleNamespace(read=read, checks_bytes=False, line=line)


def test_a_result_counts_once_two_readings_in_a_row_agree():
    assert _trusted_result(replying("a", "b", "b", "c")).raw == ("b",)
    # a fault between two readings parts them
    with pytest.raises(LineFaultError, match="garbled"):
        _trusted_result(replying("a", None, "a", "b"))
    with pytest.raises(UntrustedReadingError, match="readings of the same result all differ"):
        _trusted_result(replying(*map(str, range(READS))))


@pytest.mark.parametrize("exposure, back", [("Adaptive,0 msec", b"SE00000"),
                                            ("Manual,125 msec", b"SE00125")])
def test_a_pr655_gets_its_own_exposure_and_averages_back(monkeypatch, exposure, back):
    message = (f"MS-75,None,None,None,1 deg,SI,{exposure},Normal,3 cycles,2 deg,No Smart Dark,"
               "No Sync,Standard Sensitivity,60.00 Hertz")
    meter, put = Pr655(SimpleNamespace(name="port")), []
    monkeypatch.setattr(meter, "_ask", lambda command: message)
    monkeypatch.setattr(meter, "_set", lambda new, old: put.append(old.encode()))
    meter.settings(MeterSettings(integration_ms=250.0, averages=2))
    assert put == [back, b"SN03"]


def test_an_undistorted_photo_keeps_the_width_of_its_field():
    """Square pixels of the horizontal focal length: what fills the width fills it afterwards."""
    square = pinhole(TRUE)
    assert square[0, 0] == square[1, 1] == TRUE.matrix[0, 0] != TRUE.matrix[1, 1]
    np.testing.assert_array_equal(square[:, 2], TRUE.matrix[:, 2])


def test_the_errors_of_a_pose_are_those_of_repeated_clicks():
    """Eight points, six unknowns: an error by their number alone is a fifth too small."""
    rng, lens = np.random.default_rng(5), lens_of_focal_length(700.0, 640, 480)
    poses = [pose_from_points(CORNERS, seen(CORNERS, TURN, SHIFT, rng, 0.3, lens), lens)
             for _ in range(350)]
    estimate = np.array([pose.world_to_camera[:3, 3] for pose in poses])
    stated = np.mean([np.diag(pose.covariance)[3:] for pose in poses], axis=0)
    # 350 draws know a variance to 7.6 %: three of them, 3.9 sigma
    np.testing.assert_allclose(stated / estimate.var(axis=0, ddof=1), 1, atol=0.3)
