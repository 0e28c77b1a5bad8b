import dataclasses
from fractions import Fraction

import numpy as np
import pytest
from scipy.stats import chi2

from spectrabox.capture.chart.detection import chart_overlay, find_chart, locate_chart
from spectrabox.capture.chart.patches import require_unclipped, sample_patches
from spectrabox.capture.photo.linear import open_photo
from spectrabox.fixtures.chart_scene import GRID_MM, PITCH_MM, chart_scene, homography, mosaic
from spectrabox.fixtures.dng import write_dng
from spectrabox.radiometry.chart import (
    CLASSIC,
    PATCH_NAMES,
    chart_reflectances,
    typical_camera_signals,
)
from spectrabox.radiometry.errors import ChartNotFoundError, CheckError, ClippedPhotoError
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records.photos import LinearImage, PhotoKind

HEIGHT, WIDTH = 720, 1000
BLACK, WHITE, ELECTRONS, READ_DN = np.array([512, 510, 514, 516]), 16383, 20000, 4.0
CAMERA_GAIN = np.array([0.4, 0.7, 0.5])  # a camera sees more green than red or blue
UNIT = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


@pytest.fixture(scope="module")
def reference():
    grid = visible_grid(10.0)
    return typical_camera_signals(chart_reflectances("BabelColor Average", grid), grid)


def corners(degrees=0.0, width=560, mirrored=False, tilt=0.0):
    centred = (UNIT - 0.5) * GRID_MM * width / GRID_MM[0] * ([-1, 1] if mirrored else [1, 1])
    angle = np.deg2rad(degrees)
    turned = centred @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    turned *= 1 - tilt * turned[:, :1] / width  # the far side is smaller
    return turned + np.array([WIDTH, HEIGHT]) / 2


def photograph(folder, scene, seed=1):
    counts = mosaic(scene, "RGGB", BLACK, WHITE, ELECTRONS, READ_DN, np.random.default_rng(seed))
    write_dng(folder / "chart.dng", counts, black=BLACK, exposure_s=Fraction(1, 60))
    return open_photo(folder / "chart.dng")


def true_centres(corners_xy):
    row, column = np.divmod(np.arange(24), 6)
    centres_mm = np.column_stack([column, row]) * PITCH_MM + 20
    projected = (np.column_stack([centres_mm, np.ones(24)])
                 @ homography(UNIT * GRID_MM, corners_xy).T)
    return projected[:, :2] / projected[:, 2:]


@pytest.mark.parametrize("pose", [
    {"degrees": 0}, {"degrees": 30}, {"degrees": 90, "width": 500}, {"degrees": 180}, {"tilt": 0.3},
    {"degrees": 20, "tilt": 0.2}, {"width": 250},
])
def test_every_patch_is_found_in_its_place(tmp_path, reference, pose):
    place = corners(**pose)
    image = photograph(tmp_path, chart_scene(HEIGHT, WIDTH, CAMERA_GAIN * reference, place,
                                             gradient_stops=0.5))
    detection = find_chart(image, reference)
    side = 40 * np.linalg.norm(place[1] - place[0]) / GRID_MM[0]
    # Quadrilaterals reach 0.3 of a side from their centre: 0.05 keeps them well inside the patch.
    np.testing.assert_allclose(detection.corners_px.mean(axis=1), true_centres(place),
                               atol=0.05 * side)
    assert detection.confidence > 0.9 and not detection.mirrored


@pytest.mark.parametrize("degrees", [0, 30])
def test_a_mirrored_chart_is_refused(tmp_path, reference, degrees):
    place = corners(degrees, mirrored=True)
    image = photograph(tmp_path, chart_scene(HEIGHT, WIDTH, CAMERA_GAIN * reference, place))
    assert locate_chart(image, reference).mirrored
    with pytest.raises(CheckError, match=r"chart.dng shows the chart mirrored"):
        find_chart(image, reference)


def test_a_photo_without_chart_is_refused_with_advice(tmp_path, reference):
    tiles = np.random.default_rng(2).uniform(0.1, 0.6, (HEIGHT // 40, WIDTH // 40, 3))
    image = photograph(tmp_path, np.kron(tiles, np.ones((40, 40, 1))))
    with pytest.raises(ChartNotFoundError,
                       match=r"no ColorChecker was found in photo chart.dng.*corners_px"):
        find_chart(image, reference)


def test_a_chart_of_other_colours_is_not_accepted(tmp_path, reference):
    shuffled = CAMERA_GAIN * np.random.default_rng(3).permutation(reference)
    image = photograph(tmp_path, chart_scene(HEIGHT, WIDTH, shuffled, corners()))
    with pytest.raises(ChartNotFoundError):
        find_chart(image, reference)


def test_an_encoded_photo_is_not_taken_for_linear(tmp_path, reference):
    encoded = (CAMERA_GAIN * reference) ** (1 / 2.4)
    image = photograph(tmp_path, chart_scene(HEIGHT, WIDTH, encoded, corners(), frame=0.2))
    with pytest.raises(CheckError, match=r"its values go with the power 0\.4\d of the light"):
        find_chart(image, reference)


def test_corners_given_by_hand_are_taken_and_turned(tmp_path, reference):
    image = photograph(tmp_path, chart_scene(HEIGHT, WIDTH, CAMERA_GAIN * reference, corners()))
    for given in (corners(), corners(180)):
        detection = find_chart(image, reference, given)
        # The geometry is exact; least squares of the homography leaves round-off.
        np.testing.assert_allclose(detection.corners_px.mean(axis=1), true_centres(corners()),
                                   atol=1e-3)
        assert detection.how_found.code == "chart.corners-given"


def test_wrong_corners_are_refused(tmp_path, reference):
    image = photograph(tmp_path, chart_scene(HEIGHT, WIDTH, CAMERA_GAIN * reference, corners()))
    with pytest.raises(ChartNotFoundError,
                       match=r"patches at the given corners .* outer corners of the patch grid"):
        find_chart(image, reference, np.roll(corners(), 1, axis=0))


def test_patch_means_agree_with_the_truth_within_their_covariance(tmp_path, reference):
    signals = CAMERA_GAIN * reference
    image = photograph(tmp_path, chart_scene(HEIGHT, WIDTH, signals, corners(15)), seed=4)
    samples = sample_patches(image, find_chart(image, reference))
    distance = sum(error @ np.linalg.solve(covariance, error) for error, covariance
                   in zip(samples.mean - signals, samples.covariance_of_mean, strict=True))
    # 72 independent means with their stated covariance: two-sided chi-square test at 0.2 %.
    assert chi2.ppf(0.001, 72) < distance < chi2.ppf(0.999, 72)


def test_dust_does_not_move_a_mean(tmp_path, reference):
    image = photograph(tmp_path, chart_scene(HEIGHT, WIDTH, CAMERA_GAIN * reference, corners()))
    detection = find_chart(image, reference)
    clean = sample_patches(image, detection)
    signal = image.signal.copy()
    x, y = (true_centres(corners())[18] / 2).astype(int)
    signal[y:y + 3, x:x + 3] = 0.01
    dusty = sample_patches(dataclasses.replace(image, signal=signal), detection)
    assert dusty.pixels[18] <= clean.pixels[18] - 7
    # Nine of some hundred pixels left out shift the mean by less than its standard error.
    np.testing.assert_array_less(np.abs(dusty.mean[18] - clean.mean[18]),
                                 np.sqrt(np.diag(clean.covariance_of_mean[18])))


def test_uneven_light_shows_as_gradient_and_not_as_noise(tmp_path, reference):
    even, uneven = (sample_patches(image, find_chart(image, reference)) for image in (
                        photograph(tmp_path,
                                   chart_scene(HEIGHT, WIDTH, 0.7 * CAMERA_GAIN * reference,
                                               corners(), gradient_stops=stops))
                        for stops in (0.0, 2.0)))
    side = 0.6 * 40 / GRID_MM[0] * 560
    # The light doubles over half the picture; slope of the bright patches to 10 %.
    np.testing.assert_allclose(uneven.gradient[18:20], 2 * np.log(2) * side / WIDTH, rtol=0.1)
    # Shot noise grows with the light, at most by 2 ** 0.5; the variance of a variance of 300 pixels
    # is 8 %.
    ratio = uneven.covariance_of_mean[:, 1, 1] / even.covariance_of_mean[:, 1, 1]
    assert 0.5 < np.median(ratio) < 2


@pytest.mark.parametrize("gain, saturated", [(1.6, ["white 9.5"]), (2.6, None)])
def test_clipped_patches_are_named_and_few_are_only_left_out(tmp_path, reference, gain, saturated):
    signals = gain * CAMERA_GAIN * reference
    image = photograph(tmp_path, chart_scene(HEIGHT, WIDTH, signals, corners(), background=0.2))
    samples = sample_patches(image, find_chart(image, reference, corners()))
    if saturated is None:
        with pytest.raises(ClippedPhotoError, match=r"saturated \(.*white 9.5, neutral 8\); halve"):
            require_unclipped(samples, PATCH_NAMES, image.source, CLASSIC.neutrals)
    else:
        require_unclipped(samples, PATCH_NAMES, image.source, CLASSIC.neutrals)
        clipped = np.flatnonzero(samples.clipped.any(axis=1))
        assert [PATCH_NAMES[i] for i in clipped] == saturated and not samples.saturated.any()


def test_a_good_photo_passes_the_clipping_check(tmp_path, reference):
    image = photograph(tmp_path, chart_scene(HEIGHT, WIDTH, CAMERA_GAIN * reference, corners()))
    require_unclipped(sample_patches(image, find_chart(image, reference)), PATCH_NAMES,
                      image.source)


def test_a_chart_too_small_is_refused(tmp_path, reference):
    place = corners(width=60)
    image = photograph(tmp_path, chart_scene(HEIGHT, WIDTH, CAMERA_GAIN * reference, place))
    with pytest.raises(
            CheckError,
            match=r"chart is too small, patch 1 has \d+ pixels and at least 16 are needed"):
        sample_patches(image, find_chart(image, reference, place))


def test_a_chart_that_leaves_the_photo_is_refused(tmp_path, reference):
    place = corners() - [HEIGHT / 2 - 185, 0]
    image = photograph(tmp_path, chart_scene(HEIGHT, WIDTH, CAMERA_GAIN * reference, place))
    detection = find_chart(image, reference, place)
    moved = dataclasses.replace(detection, corners_px=detection.corners_px - [100.0, 0.0])
    with pytest.raises(CheckError, match="patch 1 of the chart lies partly outside the photo"):
        sample_patches(image, moved)


def test_the_overlay_marks_the_patches_and_nothing_else(tmp_path, reference):
    image = photograph(tmp_path, chart_scene(HEIGHT, WIDTH, CAMERA_GAIN * reference, corners()))
    picture = chart_overlay(image, find_chart(image, reference))
    assert picture.dtype == np.uint8 and picture.shape == (HEIGHT, WIDTH, 3)
    centre = np.rint(true_centres(corners())[0]).astype(int)
    patch = picture[centre[1] - 30:centre[1] + 30, centre[0] - 30:centre[0] + 30]
    assert (patch > 250).all(axis=2).any() and not (picture[:100] > 250).all(axis=2).any()


def test_a_chart_in_bands_of_which_most_are_red_is_recognised_and_an_inverted_one_is_not():
    grid = visible_grid(10.0)
    at = [int(np.argmin(np.abs(grid.nm - nm))) for nm in (450, 550, 620, 650, 670, 690, 700)]
    reflectances = chart_reflectances("BabelColor Average", grid)
    for signals, known in ((reflectances[:, at], True), (1 - reflectances[:, at], False)):
        scene = chart_scene(HEIGHT, WIDTH, signals, corners())
        image = LinearImage(scene, 1e-6 + 0 * scene, scene > 2, 1.0, None,
                            None, None, PhotoKind.RAW, "", "chart", "")
        if known:
            assert find_chart(image, typical_camera_signals(reflectances, grid)).confidence > 0.5
        else:
            with pytest.raises((ChartNotFoundError, CheckError)):
                find_chart(image, typical_camera_signals(reflectances, grid))
