"""Surfaces of known spectrum in a scene: level and colour of its light, beside the chart's."""
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from spectrabox.measure.rules import LIGHT_DOUBTED, light_of_known
from spectrabox.radiometry.error_model import (
    KNOWN_SURFACES,
    REPEATABILITY,
    scale_covariances,
    with_common_error,
)
from spectrabox.radiometry.findings import Severity
from spectrabox.radiometry.records.calibration import LightScale
from spectrabox.reconstruct import transport_engine
from spectrabox.reconstruct.agreement import scene_errors, surface_agreement
from spectrabox.reconstruct.inverse_rendering import reconstruct_views
from spectrabox.reconstruct.known_light import (
    KNOWN_LEVEL_ERROR,
    LAMP_COLOUR_ERROR,
    in_chart_light,
    tie_to_known,
)

from tests.cornell_problem import SCALE_ONE, photo_of, plain_settings, specs
from tests.session_runs import silent
from tests.test_reconstruct_views import FALLING, photographed, view

pytestmark = pytest.mark.usefixtures("mitsuba")

CHART = with_common_error(LightScale(1.0, 0.01, None, "chart photo"), REPEATABILITY, 0.03)
DIMMED = 0.95 * np.array([1.013, 1.0, 0.985])       # of a filament: redder as it dims
SETTINGS = plain_settings(9)


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    monkeypatch.setattr(transport_engine, "MAX_SPP", 128)
    monkeypatch.setattr(transport_engine, "IMAGE_SPP", 128)


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    return photographed(view(tmp_path_factory.mktemp("known"), "rising", scale=CHART), 81)


def in_light(seen, factor, known=("white",)):
    """The view as a lamp of other strength and colour lights it."""
    photo = replace(seen.photo, signal=(seen.photo.signal * factor).astype(np.float32),
                    variance=(seen.photo.variance * factor**2).astype(np.float32))
    return replace(seen, photo=photo, materials=specs(known))


def signals_of(seen):
    joint = reconstruct_views([seen], SETTINGS, silent)
    chosen = [joint.materials.index(name) for name in ("green", "red")]
    return joint.signal[chosen], joint.views[0]


def test_a_dimmer_and_redder_lamp_is_corrected_by_a_known_surface(sound):
    right, made = signals_of(in_light(sound, np.ones(3)))
    assert made.known_light.level == pytest.approx(1, abs=0.01)
    without, other = signals_of(in_light(sound, DIMMED, known=()))
    # nothing tells it of the lamp: all is that much darker, from 5 % in red to 6 % in blue
    np.testing.assert_allclose(without / right, np.broadcast_to(DIMMED, (2, 3)), rtol=0.03)
    assert other.known_light is None
    found, tied = signals_of(in_light(sound, DIMMED))
    light = tied.known_light
    # by their errors, a quarter of the chart's level is left at most
    np.testing.assert_allclose(found, right, rtol=light.level_error)
    assert np.abs(found / right - 1).max() < 0.25 * np.abs(without / right - 1).max()
    assert light.materials == ("white",)
    assert light.level == pytest.approx(0.95, abs=0.01)
    np.testing.assert_allclose(light.colour / light.colour[1], DIMMED / DIMMED[1], atol=0.003)
    assert light.level_error < light.expected_error / 1.5
    assert light.contradiction < LIGHT_DOUBTED


def test_what_known_surfaces_tell_takes_the_place_of_what_was_assumed(sound):
    _, made = signals_of(in_light(sound, DIMMED))
    errors = made.light_scale.common_errors
    assert errors == {KNOWN_SURFACES: made.known_light.level_error}
    covariance = sum(scale_covariances(sound.calibration, made.light_scale).values())
    assert np.sqrt(covariance[0, 0]) < 0.02


@pytest.mark.parametrize("chart_error", [0.001, 0.03, None])
def test_chart_and_known_surface_are_weighed_by_their_errors(sound, chart_error):
    scale = None if chart_error is None else with_common_error(
        LightScale(1.0, 0.0, None, "chart photo"), REPEATABILITY, chart_error)
    white = photo_of(np.full((*sound.measured.shape[:2], 3), 0.9))
    seen = replace(sound, photo=white, light_scale=scale, materials=specs(("white",)))
    tied, light = tie_to_known(seen, np.ones_like(sound.measured), None)
    surfaces = len(np.unique(seen.known_surface[seen.known_surface >= 0]))
    error = KNOWN_LEVEL_ERROR / np.sqrt(surfaces)
    share = 1.0 if chart_error is None else 1 / (1 + (error / chart_error) ** 2)
    assert np.log(tied.light_scale.value) == pytest.approx(share * np.log(0.9), rel=1e-6)
    assert light.level_error == pytest.approx(np.sqrt(share) * error, rel=1e-6)
    np.testing.assert_allclose(light.colour, 1, atol=1e-6)
    assert light.level is None if chart_error is None else light.level == pytest.approx(0.9)


def level_told(seen, factor):
    """Logarithm of the level by known surfaces, and of each of them, where the photo is the
    rendering times a factor (H, W).
    """
    signal = np.where(seen.measured > 0, seen.measured, 1e-3)
    shown = replace(seen, photo=photo_of(signal * factor[..., None]), light_scale=None,
                    materials=specs(("white",)))
    tied, _ = tie_to_known(shown, signal, None)
    agreement = surface_agreement(tuple(shown.scene_file.surfaces), shown.surface_materials,
                                  tied.photo, signal[None] * tied.light_scale.value,
                                  shown.surface, shown.used)
    tied, light = tie_to_known(shown, signal,
                               scene_errors(agreement, frozenset({"white"}), 100))
    known = shown.known_surface
    of_surfaces = [np.log(np.mean((signal * factor[..., None])[known == index])
                          / np.mean(signal[known == index]))
                   for index in np.unique(known[known >= 0])]
    return np.log(tied.light_scale.value), light.level_error, np.array(of_surfaces)


@pytest.mark.parametrize("factor", [0.6, 0.8, 1.5])
def test_one_shaded_or_brighter_surface_of_several_does_not_tell_the_level(sound, factor):
    shapes = list(sound.scene_file.surfaces)
    for shape in ("floor", "ceiling", "back"):
        wrong = np.where(sound.surface == shapes.index(shape), factor, 1.0)
        level, error, of_surfaces = level_told(sound, wrong)
        assert abs(level) < 0.01 < abs(of_surfaces.mean())
        assert abs(level) < error


def test_where_all_surfaces_are_uneven_the_level_is_nearer_than_their_median(sound):
    """Each surface off by some 15 %, its parts by some 10 % besides."""
    rng, rows = np.random.default_rng(12), []
    row, column = np.mgrid[:sound.surface.shape[0], :sound.surface.shape[1]] / 2.5
    shapes = len(sound.scene_file.surfaces)
    for _ in range(100):
        of_surface = 0.15 * rng.standard_normal(shapes + 1)
        waves = rng.uniform(0, 2 * np.pi, (shapes + 1, 2))
        pattern = 0.2 * np.sin(row + waves[sound.surface, 0]) * np.sin(
            column + waves[sound.surface, 1])
        level, _, of_surfaces = level_told(sound, np.exp(of_surface[sound.surface] + pattern))
        rows.append((level, np.median(of_surfaces), of_surfaces.mean()))
    level, median, mean = np.sqrt(np.mean(np.square(rows), axis=0))
    # the median of five is 1.2 times as far off as their mean; the level is as near
    assert level < 0.93 * median
    assert level < 1.12 * mean


def test_the_photo_is_as_under_the_colour_of_the_chart_s_light(sound):
    seen = in_light(sound, DIMMED)
    tied, light = tie_to_known(seen, sound.measured, None)
    np.testing.assert_allclose(tied.measured * light.colour, seen.measured, rtol=1e-6)
    assert np.prod(light.colour) == pytest.approx(1)
    np.testing.assert_allclose(in_chart_light(seen.photo, light).variance * light.colour**2,
                               seen.photo.variance, rtol=1e-5)


def test_the_light_of_every_view_is_that_on_its_own_known_surfaces(sound, tmp_path):
    """A second lamp of unstated strength, and a first one that dimmed."""
    second = photographed(view(tmp_path, "falling", FALLING, scale=None), 82, brightness=1.7)
    both = [in_light(sound, DIMMED), replace(second, materials=specs(("white",)))]
    joint = reconstruct_views(both, SETTINGS, silent)
    assert joint.views[0].known_light.level == pytest.approx(0.95, abs=0.01)
    assert joint.views[1].known_light.level is None
    assert joint.views[1].light_scale.value == pytest.approx(1.7, rel=0.02)


def test_an_alarm_is_raised_where_the_light_is_beyond_what_can_have_changed(sound):
    def status(factor):
        made = signals_of(in_light(sound, factor))[1]
        return [one.severity for one in light_of_known(made, "")]

    assert status(DIMMED) == [Severity.INFO, Severity.INFO]
    assert status(0.8 * np.ones(3)) == [Severity.WARN, Severity.INFO]
    assert status(np.array([1.0, 1.0, 1 - 6 * LAMP_COLOUR_ERROR])) == [Severity.INFO, Severity.WARN]


def test_a_view_without_known_surfaces_keeps_the_chart_s_scale(sound):
    _, made = signals_of(replace(sound, light_scale=SCALE_ONE))
    assert made.known_light is None and made.light_scale is SCALE_ONE
