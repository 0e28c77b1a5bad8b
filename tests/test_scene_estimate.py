"""Pose, lamp and fall-off of the lens, estimated where a photo contradicts its scene.

Photos by a stock Mitsuba path tracer, which shares no code with what is estimated.
"""
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from spectrabox.fixtures.demos import box_render, demo_scenes
from spectrabox.radiometry.findings import Severity
from spectrabox.reconstruct import scene_estimate
from spectrabox.reconstruct.inverse_rendering import reconstruct
from spectrabox.reconstruct.scene.beam import Beam
from spectrabox.reconstruct.scene.scene_file import read_scene
from spectrabox.reconstruct.view import MaterialSpec

from benchmarks.bench_scene_estimate import CAMERA, falloff, point, replaced, turned
from benchmarks.bench_scene_faults import base_of_plastic, plastic
from tests.cornell_problem import GRID, camera, photo_of, plain_settings, view_of
from tests.session_runs import silent

SIZE = (64, 96)
PAINTS = {"white": 0.8, "green": 0.3, "red": 0.25, "cube": 0.5}
MOVED_CM, CORNER, TURN = np.array([-1.0, 1.2, 1.2]), 0.7, np.radians([0.1, 0.45, -0.2])
SETTINGS = plain_settings(7, errors_from_scene=True)
EGGSHELL = 0.5          # roughness of a plastic
SIGMAS = 4.0            # of each figure: one of 16,000 right ones is farther off


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("box")


def reflectance(name):
    """Reflectance (P,) of a paint."""
    return PAINTS[name] * (1 + 0.2 * np.sin(GRID.nm / 60 + PAINTS[name]))


@pytest.fixture(scope="module")
def view(mitsuba, folder):
    """A function that photographs the box, its true scene edited, a lens over it."""
    stated = folder / "box.xml"
    stated.write_text(demo_scenes.box_scene(SIZE), encoding="utf-8")
    calibration = camera()

    def photographed(edited=lambda xml: xml, lens=1.0, factor=1.0):
        seen = box_render.box_light(
            GRID.nm, {name: factor * reflectance(name) for name in PAINTS},
            calibration.light.values, calibration.sensitivity.curves, size=SIZE, spp=64, seed=3,
            edited=edited) * lens
        seen = seen / np.percentile(seen, 99)
        return view_of(read_scene(stated), photo_of(seen, (0.003 * seen) ** 2), scale=None,
                       materials=tuple(MaterialSpec(name, name, reflectance(name)
                                                    if name == "white" else None)
                                       for name in PAINTS))
    return photographed


def parts_of(made):
    """Parts of the scene that were estimated, by what they are."""
    return {part["what"]: part for one in made.findings if one.code == "scene.estimated"
            for part in one.values["parts"]}


def signal_error(made):
    """Root mean square error of the unknown paints' signals."""
    response = camera().sensitivity.curves * camera().light.values
    response = response / response.sum(axis=1, keepdims=True)
    return float(np.sqrt(np.mean([(made.signal[index] - response @ reflectance(name)) ** 2
                                  for index, name in enumerate(made.materials)
                                  if name != "white"])))


def test_a_scene_that_is_right_is_taken_as_it_is(view):
    assert parts_of(reconstruct(view(), SETTINGS, silent)) == {}


def test_a_lamp_and_a_lens_are_found_with_their_errors(view, monkeypatch):
    lamp = demo_scenes.BOX_LIGHT_CM
    seen = view(lambda xml: replaced(xml, point(lamp), point(lamp + MOVED_CM)),
                falloff(SIZE, CORNER)[..., None])
    made = reconstruct(seen, SETTINGS, silent)
    parts = parts_of(made)
    for what, size in (("lamp", np.linalg.norm(MOVED_CM)), ("vignetting", 1 - CORNER)):
        assert parts[what]["size"] == pytest.approx(size, abs=SIGMAS * parts[what]["error"])
    assert parts["vignetting"]["named"]
    assert not parts["beam"]["named"] and "camera" not in parts
    monkeypatch.setattr(scene_estimate, "DISAGREEMENT", np.inf)
    as_stated = reconstruct(seen, SETTINGS, silent)
    assert signal_error(made) < signal_error(as_stated) / 2


def test_a_camera_that_is_turned_is_found_by_the_edges(view):
    parts = parts_of(reconstruct(view(lambda xml: replaced(xml, CAMERA, turned(TURN))
                                      if CAMERA in xml else xml), SETTINGS, silent))
    assert parts["camera"]["size"] == pytest.approx(
        np.degrees(np.linalg.norm(TURN)), abs=SIGMAS * parts["camera"]["error"])


def test_paints_that_shine_are_no_camera_or_lamp_elsewhere(view):
    base = base_of_plastic(EGGSHELL)
    shining = view(plastic(EGGSHELL), factor=1 / base)
    made = reconstruct(shining, SETTINGS, silent)
    assert parts_of(made) == {}
    assert np.ptp(np.log(made.agreement.ratio.mean(axis=1))) > 0.05


def test_a_tone_curve_is_no_lamp_elsewhere(view):
    seen = view()
    curved = replace(seen, photo=replace(seen.photo, signal=seen.photo.signal ** 0.5))
    made = reconstruct(curved, SETTINGS, silent)
    assert [one.severity for one in made.findings if one.code == "scene.not-linear"] == [
        Severity.FAIL]
    assert parts_of(made) == {}


def test_a_beam_is_one_along_its_axis_and_even_without_coefficients():
    axis = np.array([0.0, 0.6, -0.8])
    directions = np.random.default_rng(1).standard_normal((3, 50))
    directions /= np.linalg.norm(directions, axis=0)
    bent = Beam(axis, np.array([0.3, -0.2, 0.5, 0.1, -0.4]))
    # round-off of a sum of five products
    assert bent.intensity(axis[:, None]) == pytest.approx(1, abs=1e-14)
    assert np.ptp(bent.intensity(directions)) > 0.1
    np.testing.assert_array_equal(Beam(axis, np.zeros(5)).intensity(directions), 1)
