"""Where nothing states the level of the light, it is estimated with the spectra, once for all
photos.
"""
from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from spectrabox.measure import rules
from spectrabox.measure.scene import photo_errors
from spectrabox.measure.steps import inversion
from spectrabox.measure.surfaces.surface_signals import scene_signals
from spectrabox.radiometry.error_model import LEVEL_BY_PRIOR
from spectrabox.radiometry.findings import Severity
from spectrabox.radiometry.records.calibration import LightScale
from spectrabox.reconstruct.inverse_rendering import reconstruct, reconstruct_views
from spectrabox.reconstruct.rendering.renderer import load_scene, render
from spectrabox.reconstruct.view import MaterialSpec

from tests.cornell_problem import GRID, SCALE_ONE, TRUTH, photo_of, plain_settings, scene, view_of
from tests.session_runs import silent

pytestmark = pytest.mark.usefixtures("mitsuba")

SETTINGS = plain_settings(9)
GUESS, LEVEL_ERROR = 0.75, 0.3
FALLING = 1.5 - (GRID.nm - 400) / 300


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("level")


def photographed(folder, light=None, brightness=1.0):
    """A view with stock Mitsuba's picture of the true paints, ``brightness`` times as bright."""
    view = view_of(scene(folder, max_depth=4), light=light)
    picture, _ = render(load_scene(view.xml(TRUTH, integrator="path")), 256, 5)
    return replace(view, photo=photo_of(brightness * picture))


def guessed(view):
    return replace(view, light_scale=LightScale(GUESS, GUESS * LEVEL_ERROR, None, "a guess"),
                   level_error=LEVEL_ERROR)


def median_surface(found):
    return np.median(np.abs(found.agreement.ratio - 1).max(axis=1))


def test_a_guess_of_the_level_is_no_fault_of_the_photo(folder):
    view = guessed(photographed(folder))
    free = reconstruct(view, SETTINGS, silent)
    held = reconstruct(replace(view, level_error=0.0), SETTINGS, silent)
    # white paint of 0.85 under a level that is 25 % too low would have to reflect more than all
    assert median_surface(free) < 0.02 < median_surface(held)
    assert not free.misfits and held.misfits
    # light between the surfaces tells the level, with 256 paths a pixel
    assert free.light_scale.value == pytest.approx(1.0, rel=0.03)
    assert free.light_scale.common_errors == {LEVEL_BY_PRIOR: LEVEL_ERROR}


def test_one_level_is_common_to_photos_under_unlike_lamps(folder):
    first = guessed(photographed(folder))
    second = replace(photographed(folder, FALLING, brightness=0.4), name="second",
                     light_scale=None, level_error=LEVEL_ERROR)
    joint = reconstruct_views([first, second], SETTINGS, silent)
    scales = [one.light_scale for one in joint.views]
    # the surfaces tell the ratio of both levels, but for what their spectra leave open
    assert scales[1].value / scales[0].value == pytest.approx(0.4, rel=0.05)
    signals = scene_signals(joint, [first.calibration, second.calibration])
    covariance = signals.errors[LEVEL_BY_PRIOR]
    relative = covariance[0] / np.outer(signals.signal[0], signals.signal[0])
    # every band of both photos is off by the same factor
    np.testing.assert_allclose(relative, LEVEL_ERROR**2, rtol=1e-6)


def test_photos_of_the_same_surfaces_share_one_expected_level(folder, monkeypatch):
    asked = []

    def expected(view, *_):
        asked.append(view.name)
        return LightScale(2.0, 0.2, None, "expected")

    monkeypatch.setattr(photo_errors, "scale_from_prior", expected)
    first = view_of(scene(folder, max_depth=4), scale=None)
    views = [first, replace(first, name="again")]
    other = replace(first.scene_file, surfaces=dict.fromkeys(first.scene_file.surfaces, "blue"))
    views.append(replace(first, name="other", scene_file=other,
                         materials=(MaterialSpec("blue", "blue"),)))
    unknown = SimpleNamespace(materials={"white": SimpleNamespace(known=None)}, families={})
    scaled = inversion.with_estimated_scale(unknown, views, SETTINGS, silent)
    assert asked == ["photo", "other"]
    assert [view.light_scale is None for view in scaled] == [False, True, False]
    assert [view.level_error for view in scaled] == pytest.approx([0.1] * 3)
    known = SimpleNamespace(materials={"white": SimpleNamespace(known=TRUTH["white"])}, families={})
    assert inversion.with_estimated_scale(known, views, SETTINGS, silent) == views


@pytest.mark.parametrize("level_error, known, scale_from_chart, expected", [
    (0.2, False, True, {"scene.level-by-prior": Severity.WARN}),
    (0.05, False, False, {"scene.level-by-prior": Severity.INFO}),
    (None, True, False, {"scene.scale-of-known": Severity.NOTE}),
    (None, False, True, {})])
def test_a_result_says_what_tells_the_level_of_its_light(level_error, known, scale_from_chart,
                                                         expected):
    calibration = SimpleNamespace(light_scale=SCALE_ONE if scale_from_chart else None,
                                  sensitivity=SimpleNamespace(basis=np.eye(2), residuals=None))
    stated = SimpleNamespace(flat_fields={"": "white.dng"}, scale_from_chart=scale_from_chart)
    result = SimpleNamespace(level_error=level_error, calibration=calibration, stated=stated,
                             surfaces=(SimpleNamespace(known=known),))
    found = {one.code: one.severity for one in rules.not_corrected(result)}
    assert found == expected
