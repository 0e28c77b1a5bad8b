"""Where a chart lies in a photo, how well it agrees, its patches and the verdict: recorded."""
import numpy as np
import pytest
from capture_pictures import changed, outcome, picture
from chart_photos import PRINTED, layout_named, photograph, true_reflectances

from spectrabox.capture.chart import agreement, detection, patches, quality
from spectrabox.capture.chart.reference import TYPICAL_SIGNALS, typical_signals
from spectrabox.capture.chart.reference_region import region_signals
from spectrabox.fixtures.chart_scene import card_scene, chart_scene
from spectrabox.radiometry.chart import CLASSIC
from spectrabox.radiometry.charts.layouts import chart_layout
from spectrabox.radiometry.records import ChartDetection, LinearImage, PatchSamples, PhotoKind

CORNERS = np.array([[52.0, 40.0], [331.0, 58.0], [322.0, 247.0], [44.0, 226.0]])
MIX = np.array([[0.62, 0.21, 0.03], [0.09, 0.71, 0.12], [0.02, 0.17, 0.66]])
SIGNALS = 0.8 * TYPICAL_SIGNALS @ MIX


def photo(signals=SIGNALS, corners=CORNERS, noise=0.002, seed=3, height=280, width=380, step=2.0,
          **options):
    """A linear photo of a Classic under another camera, its light brighter to the right."""
    facts = {key: options.pop(key) for key in ("kind", "source", "saturated_at") if key in options}
    linear = chart_scene(height, width, signals, corners, **{"gradient_stops": 0.3, **options})
    rng = np.random.default_rng(seed)
    variance = noise**2 * (0.5 + 2 * linear) * np.array([1.0, 0.8, 1.3])
    seen = (linear + np.sqrt(variance) * rng.standard_normal(linear.shape)).astype(np.float32)
    return LinearImage(seen, variance.astype(np.float32), seen > facts.get("saturated_at", 2.0),
                       step, 0.02, 250.0, 5.6, facts.get("kind", PhotoKind.RAW), "Maker Seven",
                       facts.get("source", "chart.dng"), "ab", np.eye(3))


def given(image, corners=CORNERS, chart=CLASSIC):
    """The quadrilaterals at corners in pixels of the picture, as an operator gives them."""
    corners_px = patches.sensor_from_image(np.asarray(corners), image.sensor_step)
    units = detection.homography(agreement.in_units(chart, chart.fiducials), corners_px)
    return detection._printed_quads(units, chart)


def detected(image, corners=CORNERS):
    return ChartDetection(given(image, corners), 0.7, False, "given")


def test_patches_of_a_photo(recorded):
    image = photo(saturated_at=0.72)
    sampled, excluded = patches.patches_and_excluded(image, detected(image))
    recorded({"samples": sampled, "excluded": excluded}, rtol=1e-5)
    # light that doubles 0.3 times over the picture
    light = 2.0 ** (0.3 * ((given(image).mean(axis=1)[:, 0] / 2 + 0.25) / 380 - 0.5))
    # noise of 700 pixels a patch, and the bend of the light over a patch
    np.testing.assert_allclose(sampled.mean, SIGNALS * light[:, None], rtol=5e-3, atol=4e-4)


def test_glints_saturation_and_size_of_patches(recorded):
    image, table = photo(), {}
    for size in (0, 2, 5, 9, 14):
        signal = image.signal.copy()
        signal[70:70 + size, 75:85] += 0.5
        sampled, excluded = patches.patches_and_excluded(changed(image, signal=signal),
                                                         detected(image))
        table[f"glint {size}"] = [sampled.mean[0], sampled.covariance_of_mean[0], excluded[0]]
    for share in (0.0099, 0.0101, 0.02):
        fraction = np.zeros((24, 3))
        fraction[7, 1] = fraction[18, 0] = share
        samples = PatchSamples(SIGNALS, np.zeros((24, 3, 3)), np.full(24, 100), fraction,
                               np.zeros((24, 3)))
        table[f"clipped {share}"] = outcome(lambda samples=samples: patches.require_unclipped(
            samples, CLASSIC.names, "chart.dng"))
    for scale in (0.07, 0.08, 0.09, 0.1, 0.12):
        small = CORNERS.mean(axis=0) + scale * (CORNERS - CORNERS.mean(axis=0))
        table[f"scale {scale}"] = outcome(lambda small=small: patches.sample_patches(
            image, detected(image, small)).pixels.min())
    for shift in (-46.0, -48.0, -50.0, 52.0, 57.0, 62.0):
        moved = CORNERS + np.array([shift, 0.0])
        table[f"shift {shift}"] = outcome(lambda moved=moved: patches.sample_patches(
            image, detected(image, moved)).pixels.min())
    quad = np.array([[20.0, 31.0], [64.0, 25.0], [70.0, 58.0], [18.0, 66.0]])
    table["inside"] = patches.pixels_inside(quad, 2.0, 40, 30)
    table["turned"] = [part.size for part in patches.pixels_inside(quad[::-1], 2.0, 40, 30)]
    table["to and fro"] = [patches.image_from_sensor(quad, 2.5),
                           patches.sensor_from_image(patches.image_from_sensor(quad, 2.5), 2.5)]
    recorded(table, rtol=1e-5)


def test_agreement_of_signals_with_a_chart(recorded):
    image = photo()
    quads = given(image)
    for case, order in (("as printed", np.arange(24)), ("turned", np.arange(24)[::-1]),
                        ("mirrored", np.arange(24).reshape(4, 6)[:, ::-1].ravel())):
        # least squares in rounds, on single-precision medians
        recorded(agreement.chart_agreement(image, quads[order], TYPICAL_SIGNALS), rtol=1e-4,
                 case=case)
    other = photo(np.random.default_rng(4).uniform(0.05, 0.8, (24, 3)))
    recorded({"other colours": agreement.chart_agreement(other, quads, TYPICAL_SIGNALS),
              "grey": agreement.chart_agreement(image, quads, typical_signals(5)[:, :3]),
              "outside": agreement.chart_agreement(image, quads + 5000, TYPICAL_SIGNALS),
              "units": [agreement.chart_units(CLASSIC), agreement.unit_scale(CLASSIC)],
              "typical": typical_signals(5)}, rtol=1e-4, case="others")
    tone = changed(image, signal=np.maximum(image.signal, 0) ** 0.6)
    found = agreement.chart_agreement(tone, quads, TYPICAL_SIGNALS)
    assert found.contrast == pytest.approx(0.6, rel=0.1)    # one power, up to the mixture of bands
    recorded(found, rtol=1e-4, case="tone curve")
    light = found.light
    recorded({"excess": agreement.white_excess(SIGNALS + 0.02, TYPICAL_SIGNALS, light),
              "excess of the red": agreement.white_excess(
                  SIGNALS + np.array([0.05, 0, 0.01]) * (np.arange(24) % 5 == 2)[:, None],
                  TYPICAL_SIGNALS, light, 19),
              "white": [agreement.white_patch(CLASSIC, TYPICAL_SIGNALS)]}, rtol=1e-4, case="glare")
    column = np.arange(24).reshape(6, 4).T.ravel()
    recorded([agreement.reading_of_reference(image, quads, TYPICAL_SIGNALS[order], CLASSIC, limit)
              for order in (np.arange(24), np.argsort(column), np.arange(24)[::-1],
                            np.roll(np.arange(24), 1)) for limit in (0.02, 0.45)], case="reading")


def test_charts_that_are_detected(recorded):
    for case, options in (("plain", {}), ("without a step", {"step": 1.0}),
                          ("encoded", {"kind": PhotoKind.LINEAR_FILE})):
        image = photo(height=560, width=760, corners=2 * CORNERS, **options)
        found = detection.find_chart(image, TYPICAL_SIGNALS)
        corners = patches.sensor_from_image(2 * CORNERS, image.sensor_step)
        by_hand = detection.find_chart(image, TYPICAL_SIGNALS, corners)
        # OpenCV's outlines are in whole pixels: a twentieth of a patch
        assert np.abs(found.corners_px - by_hand.corners_px).max() < 4 * image.sensor_step
        recorded(by_hand, rtol=1e-4, case=f"{case} by hand")
        recorded([found.mirrored, found.how_found, round(found.confidence, 2)], rtol=0.02,
                 case=case)
    recorded(detection.chart_overlay(image, by_hand).mean(axis=(0, 1)), rtol=0.01, case="drawn")


def test_photos_in_which_no_chart_is_accepted(recorded):
    table, fits = {}, patches.sensor_from_image(CORNERS, 2.0)

    def found(image, corners=fits, reference=TYPICAL_SIGNALS, chart=CLASSIC):
        return outcome(lambda: detection.find_chart(image, reference, corners, chart).confidence)
    for power in (0.57, 0.62, 0.64, 0.66, 0.68, 1.95, 2.05, 2.1, 2.15, 2.2, 2.3):
        table[f"power {power}"] = found(photo(SIGNALS ** power))
    table["mirrored"] = found(photo(corners=CORNERS[[1, 0, 3, 2]]))
    table["turned"] = found(photo(corners=CORNERS[[2, 3, 0, 1]]))
    for colours in (0.2, 0.4, 0.6, 0.8, 1.0, 1.4):
        rng = np.random.default_rng(5)
        other = SIGNALS * np.exp(colours * rng.standard_normal(SIGNALS.shape))
        table[f"colours {colours}"] = found(photo(np.minimum(other, 1.5)))
    for covered in (0.3, 0.6, 0.9, 1.3, 2.0):
        paint = SIGNALS.copy()
        paint[9] *= np.array([1.0, 1 + covered, 1.0]) ** 2
        table[f"patch {covered}"] = found(photo(paint))
        table[f"encoded patch {covered}"] = found(photo(paint, kind=PhotoKind.LINEAR_FILE))
    for side in (40.0, 40.9, 41.2, 41.4, 41.7, 42.6):
        table[f"patches of {side}"] = found(photo(patch_mm=side, subsamples=4, noise=0.0005))
    for blue in (0.05, 0.023, 0.019, 0.01):
        dark = SIGNALS * np.array([1.0, 0.9, blue])
        table[f"blue {blue}"] = found(photo(dark @ np.diag([1, 1, 1]), background=[0.3, 0.3, 0.3 *
                                                                                   blue]))
    table["line"] = found(photo(), np.array([[0.0, 0], [10, 10], [20, 20], [30, 30]]))
    table["nothing"] = found(photo(), None, np.random.default_rng(2).random((24, 3)))
    table["bands"] = found(photo(), fits, typical_signals(4))
    flat = np.full((200, 300, 3), 0.4, np.float32)
    table["no chart"] = found(changed(photo(), signal=flat, variance=flat * 0 + 1e-6,
                                      saturated=flat > 1), None)
    recorded(table, rtol=1e-3)      # residuals of single-precision photos


@pytest.mark.parametrize("name", PRINTED)
def test_other_charts_at_given_corners(recorded, tmp_path, name):
    chart, printed = layout_named(name, tmp_path), PRINTED[name]
    spectra = true_reflectances(chart)
    nm = np.linspace(0, 1, spectra.shape[1])
    curves = np.stack([np.exp(-((nm - at) / 0.16) ** 2) for at in (0.78, 0.47, 0.2)])
    signals = 0.7 * spectra @ curves.T / curves.sum(axis=1)
    image = photograph(printed, signals, printed.corners(3.0))
    units = detection.homography(agreement.in_units(chart, chart.fiducials), printed.corners(3.0))
    quads = detection._printed_quads(units, chart)
    recorded({"quads": quads, "agreement": agreement.chart_agreement(image, quads, signals, chart),
              "verdict": quality.judge_chart(image, ChartDetection(quads, 0.5, False, "given"),
                                             signals, chart), "edges": quality._half_edge(chart)},
             rtol=2e-3)     # misfits and glare of nearly 0, out of single precision


CASES = {"good": {}, "dark": {"signals": 0.05 * SIGNALS}, "noisy": {"noise": 0.03},
         "uneven": {"gradient_stops": 1.4}, "saturated": {"saturated_at": 0.55},
         "small": {"corners": CORNERS.mean(axis=0) + 0.4 * (CORNERS - CORNERS.mean(axis=0))},
         "tilted": {"corners": np.array([[150.0, 40.0], [250.0, 45.0], [245.0, 240.0],
                                         [152.0, 236.0]])},
         "glare": {"signals": SIGNALS + 0.06 * (np.arange(24) % 7 == 3)[:, None]},
         "of a file": {"kind": PhotoKind.LINEAR_FILE}}


@pytest.mark.parametrize("case", CASES)
def test_verdicts(recorded, case):
    image = photo(**CASES[case])
    corners = CASES[case].get("corners", CORNERS)
    for explained in (False, True):
        recorded(quality.judge_chart(image, detected(image, corners), TYPICAL_SIGNALS,
                                     light_explained=explained), rtol=1e-4, case=f"{explained}")


def test_verdicts_about_their_limits(recorded):
    table, even = {}, {"gradient_stops": 0.0}

    def verdict(corners=CORNERS, blur=0, **options):
        image = photo(**{**even, **options}, corners=corners)
        if blur:
            kernel = np.ones(blur) / blur
            soft = image.signal
            for axis in (0, 1):
                soft = np.apply_along_axis(np.convolve, axis, soft, kernel, "same")
            image = changed(image, signal=soft.astype(np.float32))
        result = quality.judge_chart(image, detected(image, corners), TYPICAL_SIGNALS)
        return [result.verdict, *result.reasons]
    for white in (0.047, 0.049, 0.051, 0.053):
        brightest = SIGNALS[18].max()
        table[f"white {white}"] = verdict(signals=SIGNALS * white / brightest, noise=0.0002,
                                          background=0.02)
    for noise in (0.03, 0.045, 0.05, 0.055, 0.06, 0.065, 0.07, 0.08):
        table[f"noise {noise}"] = verdict(noise=noise)
    for stops in (0.5, 0.55, 0.6, 0.65, 0.7):
        table[f"stops {stops}"] = verdict(gradient_stops=stops)
    for glare in (0.018, 0.022, 0.0235, 0.0245, 0.026):
        table[f"glare {glare}"] = verdict(signals=SIGNALS + glare * (np.arange(24) == 8)[:, None])
    for blur in (3, 7, 8, 9, 11):
        table[f"blur {blur}"] = verdict(blur=blur)
    for scale in (0.38, 0.385, 0.39, 0.395, 0.40):
        table[f"scale {scale}"] = verdict(CORNERS.mean(axis=0) + scale * (
            CORNERS - CORNERS.mean(axis=0)))
    for narrow in (0.70, 0.74, 0.76, 0.78, 0.8):
        squeezed = CORNERS.mean(axis=0) + (CORNERS - CORNERS.mean(axis=0)) * np.array([narrow, 1])
        table[f"narrow {narrow}"] = verdict(squeezed)
    recorded(table, rtol=1e-3)


def test_figures_of_verdicts(recorded):
    image = photo(gradient_stops=0.0)
    light = np.linspace(0.83, 1.17, 24)
    samples = patches.sample_patches(image, detected(image))
    centred = CORNERS - CORNERS.mean(axis=0)
    table = {"tilt": [quality.tilt_deg(given(image, 190 + centred * np.array([narrow, 1])))
                      for narrow in (0.5, 0.77, 1, 1.4)],
             "edges": quality.edge_width(image, given(image)),
             "outer": [[patch, *way] for patch, way in quality._outer_edges(CLASSIC)],
             "light": [quality.uneven_light_reasons(light ** power) for power in
                       (0.9, 0.97, 0.985, 1.0)],
             "explained": [quality.uneven_light_reasons(light ** 3, light ** power)
                           for power in (2, 2.03, 1.9)],
             "excluded": [quality._light_reasons(np.where(np.arange(24) == 5, share, 0.01),
                                                 CLASSIC.names, glare * np.linspace(1, 1.002, 24))
                          for share, glare in ((0.099, 0.0299), (0.101, 0.01), (0.02, 0.0301))],
             "camera": [quality._camera_reasons(*figures) for figures in (
                 (39.9, 0.199, 100), (40.1, 0.2, 99), (40.0, 0.201, 101))],
             "exposure": [quality._exposure_reasons(samples, CLASSIC.names, white, 23)
                          for white in (0.0499, 0.0501, 0.001, 0.7)],
             "rise": [quality._rise(profile) for profile in (
                 np.linspace(0, 1, 61), np.r_[np.full(25, 0.1), np.linspace(0.1, 0.9, 11),
                                              np.full(25, 0.9)],
                 np.r_[np.full(30, 0.45), np.full(31, 0.9)], np.r_[np.full(30, 0.44),
                                                                   np.full(31, 0.9)],
                 np.full(61, -1.0))],
             "values": quality._values_at(image.signal, np.array([[3.25, 7.5], [-4, 900],
                                                                  [379, 0]]))}
    recorded(table, rtol=1e-5)


def test_signals_of_reference_regions(recorded):
    image = changed(picture(60, 90), saturated=np.zeros((60, 90, 3), bool))
    quads = np.array([[[20.0, 22.0], [70.0, 26.0], [66.0, 60.0], [18.0, 58.0]],
                      [[100.0, 30.0], [140.0, 30.0], [140.0, 90.0], [100.0, 90.0]]])
    y, x = np.mgrid[30 // 2:90 // 2, 50:70]
    inside = image.signal[y, x].astype(float).mean(axis=(0, 1))
    np.testing.assert_allclose(region_signals(image, quads)[1], inside, rtol=1e-6)
    table = {"signals": region_signals(image, quads)}
    for side in (5.4, 6.4, 7.4, 8.4):
        square = np.array([[50.0, 50], [50 + side, 50], [50 + side, 50 + side], [50, 50 + side]])
        table[f"side {side}"] = outcome(lambda square=square: region_signals(image, square[None]))
    for clipped in (5, 6, 7):       # of 600 pixels
        mask = np.zeros(image.saturated.shape, bool)
        mask[20, 52:52 + clipped, 2] = True
        table[f"clipped {clipped}"] = outcome(lambda mask=mask: region_signals(
            changed(image, saturated=mask), quads[1:]))
    for dark in (9.0, 9.9, 10.1, 11.0):         # sigmas of the mean of 600 pixels
        level = np.full(image.signal.shape, 0.01, np.float32)
        table[f"dark {dark}"] = outcome(lambda level=level, dark=dark: region_signals(
            changed(image, signal=level, variance=np.full_like(level, 600 * (0.01 / dark)**2)),
            quads[1:]))
    for left, right in ((-0.6, 60.0), (-0.5, 60.0), (0.0, 179.5), (0.0, 179.6)):
        table[f"{left} {right}"] = outcome(lambda left=left, right=right: region_signals(
            image, np.array([[[left, 20], [right, 20], [right, 60], [left, 60]]])))
    table["shape"] = outcome(lambda: region_signals(image, quads[0]))
    table["nan"] = outcome(lambda: region_signals(image, np.where(quads == 26.0, np.nan, quads)))
    recorded(table, rtol=1e-5)


def test_cards_of_straight_rows(recorded):
    # no sample lies on an edge, where rounding would decide
    corners = np.array([[12.137, 9.071], [80.313, 14.229], [77.183, 55.037], [10.291, 50.117]])
    signals = np.random.default_rng(3).random((12, 4))
    made = card_scene(64, 96, signals, corners, np.array([0.0, 11.0, 24.0, 40.0]),
                      np.array([0.0, 9.0, 21.0]), (8.0, 7.0), background=[0.1, 0.2, 0.3, 0.4],
                      frame=0.05, border=3.0, gradient_stops=-0.7, subsamples=3)
    recorded({"card": made, "plain": card_scene(32, 48, signals, corners / 2, np.array(
        [0.0, 11.0, 24.0, 40.0]), np.array([0.0, 9.0, 21.0]), (8.0, 7.0)),
        "classic": chart_scene(60, 80, SIGNALS, CORNERS / 5, [0.2, 0.3, 0.4], frame=0.01,
                               gradient_stops=1.1, subsamples=2, patch_mm=42.0),
        "default": chart_scene(60, 80, SIGNALS, CORNERS / 5)}, rtol=1e-5)
    assert chart_layout("SpyderCheckr 24").names


def test_charts_in_other_numbers_of_bands_and_without_neutrals(recorded):
    four = np.column_stack([SIGNALS, 0.5 * SIGNALS[:, 0] + 0.4 * SIGNALS[:, 2]])
    linear = chart_scene(280, 380, four, CORNERS, gradient_stops=0.3)
    noise = 0.002 * np.random.default_rng(6).standard_normal(linear.shape)
    image = changed(photo(), signal=(linear + noise).astype(np.float32),
                    variance=np.full_like(linear, 4e-6), saturated=linear > 2)
    found = agreement.chart_agreement(image, given(image), typical_signals(4))
    plain = changed(CLASSIC, neutrals=())
    recorded({"agreement": found, "excess": agreement.white_excess(
        four + 0.01, typical_signals(4), found.light), "verdict": quality.judge_chart(
            photo(), detected(photo()), TYPICAL_SIGNALS, plain).reasons,
        "noisy": quality.judge_chart(photo(noise=0.2), detected(photo()), TYPICAL_SIGNALS,
                                     plain).reasons,
        "white": agreement.white_patch(plain, TYPICAL_SIGNALS[::-1])}, rtol=1e-3)
