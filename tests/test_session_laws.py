"""Sessions of several photos: whose chart, whose drift, and what a drift of colour adds."""
import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from test_error_budget import calibration, curves_and_covariance, joint

from spectrabox.measure.scene import photo_errors as scene_errors
from spectrabox.measure.surfaces.surface_signals import errors_by_cause, scene_signals
from spectrabox.measure.surfaces.surface_spectra import resample_summary
from spectrabox.radiometry.chart import CLASSIC
from spectrabox.radiometry.error_model import drift_covariance
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.records import LightDrift, LightScale, SpectrumSummary, StrayLight
from spectrabox.session.stages import calibrate_stage, reconstruct_stage

COEFFICIENTS, COVARIANCE = curves_and_covariance()
COLOUR = np.array([0.02, 0.0, -0.03])


def drift(changed):
    return LightDrift(1.1 * (1 + COLOUR), np.full(3, 1e-3), 1.1, 1e-3, COLOUR, changed, "warmer")


def views(*names):
    return [SimpleNamespace(name=name, title=name, light="lamp", scene="box.xml", lights_by_id={},
                            turn_deg=0.0, spectrum_stated=True, same_light=lambda other: True)
            for name in names]


@pytest.mark.parametrize("with_chart", [(0, 1, 2), (0, 2), (0, 1, 3), (0, 2, 3)])
def test_every_photo_has_the_light_scale_of_its_own_chart(monkeypatch, with_chart):
    camera = calibration(np.ones(61), COEFFICIENTS, COVARIANCE)
    every = views("", "second", "third", "fourth")
    scales = {number: 10.0 + number for number in with_chart}
    charts = {}
    for number, view in enumerate(every):
        view.chart = number in with_chart
        if view.chart:
            charts[view.name] = SimpleNamespace(samples=number, thumbnail=None)

    def calibrated(photos, *_):
        # charts in the order of the photos that were given, each by what it shows
        states = [SimpleNamespace(light_scale=LightScale(scales[photo.samples], 0.1, None,
                                                         "chart photo"), white=None)
                  for photo in photos]
        return SimpleNamespace(calibration=dataclasses.replace(
            camera, light_scale=states[0].light_scale),
            prior_fit=SimpleNamespace(photos=states, sensitivity=camera.sensitivity))

    for name, replacement in (
            ("read_light_of", lambda *_: camera.light), ("calibrate_chart", calibrated),
            ("_irradiance", lambda *_: np.ones(24)), ("_chart_fit", lambda *_: None),
            ("held_out_patches", lambda *_: None), ("chart_level_notes", lambda *_: ()),
            ("session_chart", lambda _: CLASSIC), ("require_curves_of_bands", lambda _: None),
            ("_with_lamp_error", lambda _, calibrations: calibrations),
            ("_uneven_notes", lambda *_: ()), ("band_names", lambda *_: ()),
            ("_chart_photo", lambda _, view, chart, irradiance, *rest: SimpleNamespace(
                samples=chart.samples, irradiance=irradiance, reflectances=None))):
        monkeypatch.setattr(calibrate_stage, name, replacement)
    config = SimpleNamespace(
        all_views=every, views_with_chart=[view for view in every if view.chart], flat=False,
        sensitivity=SimpleNamespace(from_chart=True, method=None, prior=None, coefficients=None))
    records = calibrate_stage.calibrate_views(SimpleNamespace(
        config=config, records=SimpleNamespace(chart=SimpleNamespace(charts=charts),
                                               photo=SimpleNamespace(bands=())), device="cpu",
        progress=lambda *_: None))
    for number, view in enumerate(every):
        found = records.calibrations[view.name].light_scale.value
        # without a chart of its own, under the first photo's light: that of the first
        assert found == scales.get(number, scales[0]), view.name


def test_patches_left_out_are_left_out_of_the_chart_of_every_photo(monkeypatch):
    camera = calibration(np.ones(61), COEFFICIENTS, COVARIANCE)
    soiled, excluded = np.arange(24) == 3, []
    first, second = views("", "second")
    for view in (first, second):
        view.chart = True

    def calibrated(photos, *_):
        excluded.extend(photo.excluded for photo in photos)
        return SimpleNamespace(calibration=camera, prior_fit=None, scale=camera.light_scale)

    for name, replacement in (
            ("read_light_of", lambda *_: camera.light), ("calibrate_chart", calibrated),
            ("_irradiance", lambda *_: np.ones(24)), ("_chart_fit", lambda *_: None),
            ("held_out_patches", lambda *_: None), ("chart_level_notes", lambda *_: ()),
            ("session_chart", lambda _: CLASSIC), ("require_curves_of_bands", lambda _: None),
            ("_with_lamp_error", lambda _, calibrations: calibrations),
            ("_uneven_notes", lambda *_: ()), ("band_names", lambda *_: ()),
            ("excluded_patches", lambda _: soiled),
            ("read_chart_reference", lambda _: None),
            ("ChartPhoto", lambda _, reference, light, irradiance, excluded, *rest:
             SimpleNamespace(irradiance=irradiance, excluded=excluded, reflectances=None))):
        monkeypatch.setattr(calibrate_stage, name, replacement)
    chart = SimpleNamespace(samples=None, thumbnail=None)
    records = SimpleNamespace(chart=SimpleNamespace(charts={"": chart, "second": chart}),
                              photo=SimpleNamespace(bands=()))
    config = SimpleNamespace(
        all_views=[first, second], views_with_chart=[first, second], flat=False,
        sensitivity=SimpleNamespace(from_chart=True, method="smooth", prior=None, coefficients=10))
    calibrate_stage.calibrate_views(SimpleNamespace(
        config=config, records=records, device="cpu", progress=lambda *_: None))
    assert len(excluded) == 2 and all(each is soiled for each in excluded)


def test_the_drift_between_the_first_chart_and_photo_is_that_of_no_other_photo(monkeypatch):
    drifts = {}
    camera = calibration(np.ones(61), COEFFICIENTS, COVARIANCE)

    def scale(config, view, photo, calibrated, stored, drift):
        drifts[view.name] = drift
    photo = SimpleNamespace(signal=np.ones((4, 5, 3)))
    for name, replacement in (
            ("scale_of_view", scale), ("View", lambda *_: None), ("read_materials", lambda *_: ()),
            ("band_names", lambda *_: ("R", "G", "B")), ("read_session_scene", lambda *_: None)):
        monkeypatch.setattr(reconstruct_stage, name, replacement)
    measured, names = drift(True), ("", "second", "third")
    records = SimpleNamespace(photo=SimpleNamespace(photos=dict.fromkeys(names, photo), bands=()),
                              calibrations=lambda _: [camera] * 3)
    reconstruct_stage.views_of(SimpleNamespace(all_views=views(*names)), records, measured)
    assert drifts == {"": measured, "second": None, "third": None}


@pytest.mark.parametrize("changed", [True, False])
def test_a_drift_of_colour_is_an_error_of_the_first_photo_alone(monkeypatch, changed):
    """The light was 2 % redder: what the first photo's bands differ by is no property of paint."""
    monkeypatch.setattr(scene_errors, "with_stray_light", lambda found, *_: found)
    before = 1e-4 * (np.eye(6) + 0.5)[None]
    two = joint(COEFFICIENTS, model=before)
    said = [dataclasses.make_dataclass("Noted", ["light_scale", ("notes", tuple, ())], frozen=True)(
        view.light_scale) for view in two.views]
    two = dataclasses.replace(two, views=tuple(said))
    measured = drift(changed)
    after = scene_errors.with_photo_errors(
        two, scene_errors.StatedErrors(measured, np.zeros(3), 0.0, {}))
    expected = before.copy()
    if changed:
        expected[0, :3, :3] += np.outer(COLOUR, COLOUR)
    # a sum of two numbers
    np.testing.assert_allclose(after.model_covariance, expected, rtol=1e-12)
    np.testing.assert_array_equal(two.model_covariance, before)
    assert [view.notes for view in after.views] == [("warmer",), ()]
    assert drift_covariance(measured).any() == changed


def test_stray_light_of_one_photo_is_that_of_no_other():
    """What glare adds in a photo all its bands share; another photo has a glare of its own."""
    pattern = np.array([[0.01, 0.02, 0.03, 0.04, 0.05, 0.06]])
    two = dataclasses.replace(joint(COEFFICIENTS), stray_light=(StrayLight("glare", pattern),))
    both = [calibration(np.ones(61), COEFFICIENTS, COVARIANCE)] * 2
    found = errors_by_cause(scene_signals(two, both), 0)["glare"]
    error = pattern[0] * two.signal[0]
    one = np.outer(error, error)
    np.testing.assert_allclose(found[:3, :3], one[:3, :3])
    np.testing.assert_allclose(found[3:, 3:], one[3:, 3:])
    assert not found[:3, 3:].any() and not found[3:, :3].any()


@pytest.mark.parametrize("step", [1.0, 10.0])
def test_a_summary_on_another_grid_is_the_same_curves(step):
    nm, curves = np.arange(400.0, 701.0, 5.0), {}
    for number, name in enumerate(("mean", "standard_deviation", "lower", "upper", "bound_lower",
                                   "bound_upper")):
        curves[name] = 0.1 * number + nm / 1e4 * (1 + number)       # straight: exact on any grid
    summary = SpectrumSummary(grid_from_nm(nm), **curves, level=0.95, conditional_on="",
                              next_measurement_nm=450.0)
    other = np.arange(400.0, 701.0, step)
    found = resample_summary(summary, grid_from_nm(other))
    np.testing.assert_array_equal(found.grid.nm, other)
    for number, name in enumerate(curves):
        # round-off of sums near 1
        np.testing.assert_allclose(getattr(found, name), 0.1 * number + other / 1e4 * (1 + number),
                                   rtol=1e-13)
