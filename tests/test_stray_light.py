"""Causes of error that no photo tells: light the scene does not hold, and the lamp's position."""
import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from spectrabox.fixtures.demos.demo_scenes import CHART_LIGHT_CM, chart_scene_xml
from spectrabox.measure.scene.photo_errors import with_stray_light
from spectrabox.measure.surfaces.surface_signals import (
    _gloss_of,
    errors_by_cause,
    relative_errors,
    scene_signals,
)
from spectrabox.radiometry.chart import CLASSIC
from spectrabox.radiometry.error_model import (
    CAUSES,
    GLARE,
    LAMP_AT_CHART,
    SCENE_LEVEL,
    SCENE_LEVEL_ERROR,
    STRAY_LIGHT,
    SURFACE_REFLECTION,
)
from spectrabox.radiometry.gloss import KINDS
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records.scenes import JointReconstruction
from spectrabox.reconstruct.rendering.renderer import (
    lamp_position_error,
    patch_irradiance,
    start_mitsuba,
)
from spectrabox.reconstruct.scene.edit_scene import with_light_moved
from spectrabox.reconstruct.scene.scene_file import read_scene
from spectrabox.session.config.session_file import read_session
from spectrabox.session.kept_stages import load_finished

GRID = visible_grid(50)
SIGNAL = np.array([[0.8, 0.7, 0.6], [0.1, 0.05, 0.2]])     # a white and a dark paint
WHITE = np.array([2.0, 3.0, 1.0])


def joint(irradiance, surface):
    """One photo of surfaces of a white and a dark paint, (H, W) each."""
    measured = irradiance[..., None] * (SIGNAL * WHITE)[surface]
    view = SimpleNamespace(
        materials=("white", "dark"), measured=measured, used=np.ones(surface.shape, bool),
        surface=surface, agreement=SimpleNamespace(materials=("white", "dark")), signal=SIGNAL,
        white_signal=WHITE)
    zero = np.zeros((2, 3, 3))
    return JointReconstruction((view,), ("photo",), ("white", "dark"), (False, False), GRID,
                               np.ones((2, GRID.nm.size)), tuple("RGB"), np.zeros(3, int),
                               np.ones((3, GRID.nm.size)), SIGNAL, zero, zero)


def test_glare_and_ambient_light_are_what_a_photo_with_them_reads_more():
    rng = np.random.default_rng(3)
    surface = np.repeat([[0, 0, 1]], 40, axis=0).repeat(10, axis=1)
    irradiance = rng.uniform(0.2, 1.0, surface.shape)
    clean = joint(irradiance, surface)
    lit_otherwise = with_stray_light(clean, np.full(3, 0.01), 0.004, {"dark": "glossy"})
    estimate = lit_otherwise.stray_light
    photo = clean.views[0].measured
    hazy = photo + 0.01 * photo.mean(axis=(0, 1))
    lit = joint(irradiance + 0.004 * np.percentile(irradiance, 99), surface).views[0].measured
    for cause, spoilt in ((GLARE, hazy), (STRAY_LIGHT, lit)):
        more = [spoilt[surface == paint].mean(axis=0) / photo[surface == paint].mean(axis=0) - 1
                for paint in (0, 1)]
        # Round-off.
        np.testing.assert_allclose(estimate[cause], more, rtol=1e-9)
    # three hundredths of white upon the dark paint, nothing upon the white
    white, dark = _gloss_of(lit_otherwise)
    np.testing.assert_allclose(dark.pattern @ dark.mean, KINDS["glossy"].mean)
    np.testing.assert_array_equal(white.pattern, 0)


def test_dark_paint_owes_most_to_glare_and_shadow_to_ambient_light():
    surface = np.repeat([[0, 1]], 20, axis=0).repeat(20, axis=1)
    shaded = np.where(surface == 1, 0.1, 1.0)
    stray = with_stray_light(joint(shaded, surface), np.full(3, 0.005), 0.002, {}).stray_light
    glare, ambient = stray[GLARE], stray[STRAY_LIGHT]
    assert np.all(glare[1] > 10 * glare[0])
    # Round-off: the white paint's light is the brightest; the shadow has a tenth of it.
    np.testing.assert_allclose(ambient, np.array([[0.002] * 3, [0.02] * 3]), rtol=1e-9)


@pytest.mark.parametrize("share", [0.002, 0.01])
def test_the_lamps_position_moves_the_light_on_the_chart_as_a_moved_lamp_does(tmp_path, share):
    start_mitsuba("cpu")
    (tmp_path / "chart.xml").write_text(chart_scene_xml((208, 312)), encoding="utf-8")
    scene = read_scene(tmp_path / "chart.xml")
    places, size = CLASSIC.centres_uv, CLASSIC.sizes_uv[0]
    still = patch_irradiance(scene, places, size)
    distance = float(np.linalg.norm(CHART_LIGHT_CM))
    changes = [np.log(patch_irradiance(with_light_moved(scene, 0, share * distance * axis), places,
                                       size) / still).mean() for axis in np.eye(3)]
    stated = lamp_position_error(scene, places, size, share)
    # The middle of the chart is not straight below the lamp and one side of a difference bends it:
    # 3 % of the change at 1 %.
    assert stated == pytest.approx(np.linalg.norm(changes), rel=0.06)
    assert lamp_position_error(scene, places, size, 0.0) == 0.0


def test_a_session_names_each_cause_in_its_budget(finished):
    run = load_finished(read_session(finished))
    session = run.records.reconstruct.joint
    calibrations = run.records.calibrations(run.capture.views)
    parts = errors_by_cause(scene_signals(session, calibrations), 0)
    assert parts.keys() <= CAUSES.keys()
    assert {GLARE, STRAY_LIGHT, LAMP_AT_CHART} <= set(parts)
    # Inverse squares, 0.5 % along each axis: 1 %, less where the light falls at an angle.
    errors = session.views[0].light_scale.common_errors
    assert 0.005 < errors[LAMP_AT_CHART] < 0.012
    without = dataclasses.replace(session, stray_light={})
    total = sum(errors_by_cause(scene_signals(without, calibrations), 0).values())
    # Round-off.
    np.testing.assert_allclose(sum(parts.values()) - total, parts[GLARE] + parts[STRAY_LIGHT],
                               atol=1e-15)
    assert SURFACE_REFLECTION in relative_errors(scene_signals(session, calibrations), 0)
    # an error of the level widens the signals of every band by its share of them, and no more
    signal = session.signal[0]
    np.testing.assert_allclose(parts[SCENE_LEVEL], SCENE_LEVEL_ERROR**2 * np.outer(signal, signal))
