"""Photos of charts other than the Classic: found or by corners, read in order, calibrated."""
import json

import numpy as np
import pytest
from chart_photos import GRID, PRINTED, layout_named, noisy, photograph, true_reflectances, turned

from spectrabox.calibrate.chart_calibration import calibrate_chart
from spectrabox.calibrate.chart_photo import ChartPhoto
from spectrabox.capture.chart.detection import find_chart
from spectrabox.capture.chart.patches import sample_patches
from spectrabox.capture.chart.quality import judge_chart
from spectrabox.capture.photo.image_writers import write_linear_exr
from spectrabox.fixtures.chart_scene import chart_scene
from spectrabox.fixtures.paints import NM, random_paints
from spectrabox.radiometry.chart import table_orders, typical_camera_signals
from spectrabox.radiometry.charts.layouts import LAYOUTS
from spectrabox.radiometry.charts.references import published_signals
from spectrabox.radiometry.errors import ChartNotFoundError, CheckError
from spectrabox.radiometry.records.spectra import Quantity, Spectrum
from spectrabox.radiometry.spectra.named_spectra import light, sensitivities
from spectrabox.radiometry.spectra.spectrum_files import table_text

from tests.session_runs import call

CURVES, POWER = sensitivities("Nikon 5100 (NPL)", GRID), light("A", GRID)
SG = "ColorChecker Digital SG"


def camera_signals(reflectances):
    """What the camera reads under illuminant A, a perfect white at 0.8 in its brightest band."""
    response = CURVES * POWER * GRID.weights_nm
    return 0.8 * reflectances @ response.T / response.sum(axis=1).max()


@pytest.fixture(scope="module", params=PRINTED)
def shot(request, tmp_path_factory):
    """Chart, true reflectances, photo, corners and the reference's signals."""
    chart = layout_named(request.param, tmp_path_factory.mktemp("layout"))
    truth, printed = true_reflectances(chart), PRINTED[request.param]
    corners_px = printed.corners(10)
    photo = photograph(printed, camera_signals(truth), corners_px)
    return chart, truth, photo, corners_px, typical_camera_signals(truth, GRID, POWER)


def test_patches_are_sampled_where_they_are_printed(shot):
    chart, truth, photo, corners_px, reference = shot
    samples = sample_patches(photo, find_chart(photo, reference, corners_px, chart))
    ratio = samples.mean / camera_signals(truth)
    # The light changes by a quarter of a stop over the photo and by nothing else: patches that were
    # taken for each other differ by far more than these 19 %. Noise is 3 % in the darkest patch.
    assert np.ptp(np.log(ratio[truth.mean(axis=1) > 0.1])) < 0.19
    verdict = judge_chart(photo, find_chart(photo, reference, corners_px, chart), reference, chart)
    assert verdict.verdict == "good" and verdict.blur < 0.1


@pytest.mark.usefixtures("light_as_stated")
def test_a_camera_fitted_to_any_chart_predicts_other_paints(shot):
    chart, truth, photo, corners_px, reference = shot
    samples = sample_patches(photo, find_chart(photo, reference, corners_px, chart))
    lamp = Spectrum(GRID, POWER, Quantity.RELATIVE, "CIE A")
    fit = calibrate_chart([ChartPhoto(samples, truth, lamp, chart=chart)], GRID)
    fitted = fit.calibration.sensitivity
    assert fitted.residuals.shape == fitted.held_out_residuals.shape == samples.mean.shape
    unseen = random_paints(50, np.random.default_rng(9))[:, (NM >= 400) & (NM <= 700)]
    predicted = unseen @ (fitted.curves * POWER * GRID.weights_nm).T
    ratio = predicted / camera_signals(unseen)
    # Patches are known to 0.1 %; what they leave open of the curves is 1 % of unlike paints.
    assert np.std(np.log(ratio)) < 0.01
    # Errors are as stated: chi-square per signal of good data is 1, and 0.4 to 1.6 for 45 signals.
    assert 0.4 < fit.prior_fit.chi_square < 1.6


@pytest.mark.parametrize("words", list(table_orders(6, 4))[1:])
def test_a_reference_in_another_order_is_named_and_not_fitted(words):
    chart, printed = LAYOUTS["SpyderCheckr 24"], PRINTED["SpyderCheckr 24"]
    truth, corners_px = true_reflectances(chart), printed.corners()
    photo = photograph(printed, camera_signals(truth), corners_px)
    table = np.empty_like(truth)
    table[table_orders(chart.rows, chart.columns)[words]] = truth
    with pytest.raises(CheckError, match=rf"chart.exr: the patches agree with the reference of the "
                                         rf"SpyderCheckr 24 only if one of the two is read {words};"
                                         rf" list the reference row by row, E1 first, .* at E1, H1,"
                                         rf" H6 and E6"):
        find_chart(photo, typical_camera_signals(table, GRID, POWER), corners_px, chart)


def test_another_chart_at_the_corners_is_refused():
    chart, printed = LAYOUTS["SpyderCheckr 24"], PRINTED["SpyderCheckr 24"]
    photo = photograph(printed, camera_signals(true_reflectances(chart, seed=5)), printed.corners())
    reference = typical_camera_signals(true_reflectances(chart), GRID, POWER)
    with pytest.raises(ChartNotFoundError, match=r"--corners .* as the outer corners of the patch "
                                                 "grid at E1, H1, H6 and E6"):
        find_chart(photo, reference, printed.corners(), chart)
    with pytest.raises(ChartNotFoundError, match="a SpyderCheckr 24 cannot be found in photo "
                                                 r"chart\.exr by itself; give --corners X,Y"):
        find_chart(photo, reference, None, chart)


def test_a_mirrored_photo_of_a_chart_by_corners_is_refused():
    chart, printed = LAYOUTS["SpyderCheckr 24"], PRINTED["SpyderCheckr 24"]
    truth, corners_px = true_reflectances(chart), printed.corners()
    photo = turned(photograph(printed, camera_signals(truth), corners_px))
    mirrored = corners_px * [-1, 1] + [photo.signal.shape[1] - 1, 0]
    with pytest.raises(CheckError, match="shows the chart mirrored"):
        find_chart(photo, typical_camera_signals(truth, GRID, POWER), mirrored, chart)


@pytest.mark.parametrize("degrees", [0, 20])
def test_a_digital_sg_is_found_and_read_from_its_first_patch(degrees):
    chart, printed = LAYOUTS[SG], PRINTED[SG]
    signals = published_signals(chart, GRID) * [0.5, 0.8, 0.6]
    corners_px = printed.corners(degrees, height=460)
    photo = photograph(printed, signals, corners_px)
    detection = find_chart(photo, published_signals(chart, GRID), None, chart)
    by_hand = find_chart(photo, published_signals(chart, GRID), corners_px, chart)
    side = np.linalg.norm(corners_px[1] - corners_px[0]) / printed.extent[0] * printed.side[0]
    # Quadrilaterals reach 0.3 of a side from their centre: 0.1 keeps them inside the patch.
    np.testing.assert_allclose(detection.corners_px.mean(axis=1), by_hand.corners_px.mean(axis=1),
                               atol=0.1 * side)
    assert detection.how_found.code.startswith("chart.found-in") and not detection.mirrored


def test_a_passport_is_found_with_its_own_proportions():
    chart, patch_mm, pitch_mm = LAYOUTS["ColorChecker Passport"], 12.4, 15.0
    reference = published_signals(chart, GRID)
    unit = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    outer = np.array([5, 3]) * pitch_mm + patch_mm
    corners_px = (unit - 0.5) * outer * 6 + [420, 300]
    # The renderer of the Classic, its pitch being 43.5: corners are of 40 mm squares there.
    drawn = (unit - 0.5) * (np.array([5, 3]) * pitch_mm + 40 * pitch_mm / 43.5) * 6 + [420, 300]
    scene = chart_scene(600, 840, reference * [0.4, 0.7, 0.5], drawn,
                        patch_mm=patch_mm * 43.5 / pitch_mm)
    photo = noisy(scene)
    chart_at, by_hand = (find_chart(photo, reference, given, chart) for given in (None, corners_px))
    # A twentieth of a patch of 74 pixels.
    np.testing.assert_allclose(chart_at.corners_px, by_hand.corners_px, atol=3.7)
    # The sampled part is 0.6 of the patch's own side.
    side = np.linalg.norm(by_hand.corners_px[0, 1] - by_hand.corners_px[0, 0])
    assert side == pytest.approx(0.6 * patch_mm * 6, rel=1e-6)


# ---- the command line ----------------------------------------------------------------------------

@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A folder with photo, layout and reference of a chart of one's own, and its corners."""
    folder = tmp_path_factory.mktemp("own")
    chart, printed = layout_named("three rows of five", folder), PRINTED["three rows of five"]
    truth = true_reflectances(chart)
    columns = dict(zip(chart.names, truth, strict=True))
    (folder / "spectra.csv").write_text(table_text(GRID.nm, columns, source="ours",
                                                   quantity=Quantity.REFLECTANCE), encoding="utf-8")
    write_linear_exr(folder / "photo.exr",
                    photograph(printed, camera_signals(truth), printed.corners()))
    words = " ".join(f"{x:.1f},{y:.1f}" for x, y in printed.corners())
    return folder, words, camera_signals(truth)


def test_chart_takes_a_layout_of_ones_own(written):
    folder, corners, truth = written
    ran = call("chart", folder / "photo.exr", "--chart-layout", folder / "chart.toml", "--corners",
               corners, "--overlay", folder / "overlay.png", "--json")
    facts = json.loads(ran.stdout)
    assert ran.exit_code == 0, ran.stdout
    assert facts["verdict"] == "good" and np.shape(facts["mean"]) == (15, 3)
    assert np.shape(facts["corners_px"]) == (15, 4, 2) and (folder / "overlay.png").is_file()
    # A quarter of a stop of fall-off, half of it over the chart.
    np.testing.assert_allclose(facts["mean"], truth, rtol=0.1, atol=0.003)


def test_camera_fit_takes_a_layout_of_ones_own(written):
    folder, corners, _ = written
    ran = call("camera", "fit", "--chart", folder / "photo.exr", "--light", "A", "--chart-layout",
               folder / "chart.toml", "--corners", corners, "--json")
    assert ran.exit_code == 0, ran.stdout
    facts = json.loads(ran.stdout)
    assert len(facts["chart_delta_e00_patches"]) == 15 and facts["held_out_delta_e00"] < 0.5


def test_camera_fit_takes_a_table_of_as_many_patches(written):
    folder, _, truth = written
    rows = "\n".join(",".join(f"{value:.6f}" for value in row) for row in truth)
    (folder / "patches.csv").write_text(f"R,G,B\n{rows}\n", encoding="utf-8")
    words = ("camera", "fit", "--patches", folder / "patches.csv", "--light", "A", "--json")
    assert call(*words, "--chart-layout", folder / "chart.toml").exit_code == 0
    refused = call(*words)
    assert refused.exit_code == 3
    assert "holds 15 rows of signals; 24 are needed, one per patch, dark skin first" in \
        json.loads(refused.stdout)["error"]


def test_a_chart_that_needs_a_reference_asks_for_it(written):
    folder, corners, _ = written
    ran = call("chart", folder / "photo.exr", "--chart-layout", "SpyderCheckr 24", "--corners",
               corners, "--json")
    assert ran.exit_code == 3 and "measure its 24 patches" in json.loads(ran.stdout)["error"]


@pytest.mark.usefixtures("no_advice")
def test_flat_takes_a_layout_of_ones_own(written):
    folder, _, truth = written
    printed = PRINTED["three rows of five"]
    corners_px = printed.corners(height=360)
    grey = 0.4 * camera_signals(np.ones((1, GRID.nm.size)))[0]
    write_linear_exr(folder / "flat.exr", photograph(printed, truth, corners_px, background=grey))
    ran = call("flat", folder / "flat.exr", "--region", "table=10,100,60,150", "--light", "A",
               "--chart-layout", folder / "chart.toml", "--corners",
               ",".join(f"{value:.1f}" for value in corners_px.ravel()),
               "--session", folder / "session", "--json")
    assert ran.exit_code == 0, ran.stdout
    # The table reflects 0.4; its light, 8 % weaker than on the chart, is told to a few per cent.
    signal = json.loads(ran.stdout)["regions"][0]["signal"]
    np.testing.assert_allclose(signal, 0.4, rtol=0.03)
    assert {path.name for path in (folder / "session" / "spectra").iterdir()} == {"chart.toml",
                                                                                 "spectra.csv"}
