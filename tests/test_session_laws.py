"""Sessions of several photos: whose chart, and whose stray light."""
import dataclasses

import numpy as np
import pytest
from calibrate_cameras import (
    GRID,
    cameras,
    daylight,
    on_grid,
    prior,
    reflectances,
    samples,
    signals,
)
from small_captures import (
    measured_chart,
    photo_records,
    records_of,
    scene_capture,
    scene_view,
    work,
)
from test_error_budget import calibration, curves_and_covariance, joint

from spectrabox.measure.captured import Sensitivity
from spectrabox.measure.steps import calibration as calibration_step
from spectrabox.measure.surfaces.surface_signals import errors_by_cause, scene_signals
from spectrabox.measure.surfaces.surface_spectra import resample_summary
from spectrabox.radiometry.grid import grid_from_nm
from spectrabox.radiometry.records.spectra import Quantity, Spectrum, SpectrumSummary

COEFFICIENTS, COVARIANCE = curves_and_covariance()
COLOUR = np.array([0.02, 0.0, -0.03])


@pytest.fixture
def even_light(monkeypatch):
    """Chart scenes that need not be rendered: one irradiance for all patches, exactly known."""
    monkeypatch.setattr(calibration_step, "_irradiance", lambda *_: np.full(24, np.pi))
    monkeypatch.setattr(calibration_step, "_with_lamp_error", lambda _, calibrations: calibrations)


def lit_charts(views, reflectances, strengths):
    """Records of charts that a camera saw under a lamp of these strengths."""
    camera = on_grid(cameras(1, 3)[0])
    return records_of(
        chart={view.name: measured_chart(samples(
            strengths[view.name] * 1e-3 * signals(camera, daylight(), reflectances), 1e-3))
            for view in views if view.chart},
        photo=photo_records(*(view.name for view in views)))


def views_of_charts(*with_chart):
    """Four photos under one lamp, those of these numbers with a chart."""
    lamp = Spectrum(GRID, daylight(), Quantity.RELATIVE, "lamp")
    return [scene_view(name, chart=f"chart-{name}.dng" if number in with_chart else None,
                       light=lamp)
            for number, name in enumerate(("", "second", "third", "fourth"))]


@pytest.mark.parametrize("with_chart", [(0, 1, 2), (0, 2), (0, 1, 3), (0, 2, 3)])
def test_every_photo_has_the_light_scale_of_its_own_chart(even_light, with_chart):
    views, surfaces = views_of_charts(*with_chart), reflectances()
    strengths = {view.name: 1.0 + 0.1 * number for number, view in enumerate(views)}
    records = calibration_step.calibrate_scene(
        scene_capture(*views, reflectances=surfaces, sensitivity=Sensitivity(prior=prior())),
        lit_charts(views, surfaces, strengths), work())
    scales = {name: each.light_scale.value for name, each in records.calibrations.items()}
    for number, view in enumerate(views):
        # without a chart of its own, under the first photo's light: that of the first
        own = strengths[view.name] if number in with_chart else 1.0
        # patches are known to a thousandth; scales differ by a tenth
        assert scales[view.name] / scales[""] == pytest.approx(own, rel=2e-3), view.name


def test_patches_left_out_are_left_out_of_the_chart_of_every_photo(even_light):
    views, surfaces, soiled = views_of_charts(0, 1)[:2], reflectances(), np.arange(24) == 3
    seen = np.where(soiled[:, None], 0.3, 1.0) * surfaces

    def scales(surfaces_seen, excluded):
        made = calibration_step.calibrate_scene(
            scene_capture(*views, reflectances=surfaces, excluded=excluded,
                          sensitivity=Sensitivity(method="smooth")),
            lit_charts(views, surfaces_seen, {"": 1.0, "second": 1.1}), work())
        return [made.calibrations[view.name].light_scale.value for view in views]

    clean, without = scales(surfaces, soiled), scales(seen, soiled)
    assert without == clean
    assert all(abs(one / other - 1) > 1e-3
               for one, other in zip(scales(seen, ~soiled & soiled), clean, strict=True))


def test_stray_light_of_one_photo_is_that_of_no_other():
    """What glare adds in a photo all its bands share; another photo has a glare of its own."""
    pattern = np.array([[0.01, 0.02, 0.03, 0.04, 0.05, 0.06]])
    two = dataclasses.replace(joint(COEFFICIENTS), stray_light={"glare": pattern})
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
    summary = SpectrumSummary(grid_from_nm(nm), **curves, level=0.95, conditional_on=(),
                              next_measurement_nm=450.0)
    other = np.arange(400.0, 701.0, step)
    found = resample_summary(summary, grid_from_nm(other))
    np.testing.assert_array_equal(found.grid.nm, other)
    for number, name in enumerate(curves):
        # round-off of sums near 1
        np.testing.assert_allclose(getattr(found, name), 0.1 * number + other / 1e4 * (1 + number),
                                   rtol=1e-13)
