"""Whether a photo is linear, by one paint on both sides of an edge of its scene."""
from __future__ import annotations

import numpy as np
import pytest

from spectrabox.fixtures.demos import box_render, demo_scenes
from spectrabox.radiometry.findings import Severity
from spectrabox.reconstruct import linearity
from spectrabox.reconstruct.scene.scene_file import read_scene
from spectrabox.reconstruct.view import MaterialSpec

from tests.cornell_problem import photo_of, view_of

NM = np.arange(400.0, 701.0, 10.0)
SIZE = (104, 156)
PAINTS = {"white": 0.8, "green": 0.3, "red": 0.25, "cube": 0.5}
LAMP_MOVED_CM = np.array([-1.0, -1.2, 1.2])


def edges(power, lamp_off=(0.0, 0.0, 0.0)):
    """A ceiling, a floor and a side that meet a back wall, as a photo of that power shows them."""
    normals = np.array([[0, -1.0, 0], [0, 1.0, 0], [1.0, 0, 0]])
    to_lamp, back = np.array([5.0, 10.0, 70.0]), np.array([0, 0, 1.0])
    photo, rendered, by_lamp = [], [], []
    for normal, offset in zip(normals, ([0, -20.0, 0], [0, 20.0, 0], [30.0, 0, 0]), strict=True):
        towards = to_lamp + offset
        by_lamp.append(back / (back @ towards) - normal / (normal @ towards))
        rendered.append(np.log((back @ towards) / (normal @ towards)))
        photo.append(power * (rendered[-1] + by_lamp[-1] @ lamp_off))
    return np.array(photo), np.array(rendered), np.array(by_lamp), np.full(3, 0.05)


@pytest.mark.parametrize("power", [0.45, 0.7, 1.0])
def test_the_power_of_a_curve_is_that_of_the_ratios(power):
    value, error, departure, _ = linearity.exponent(*edges(power), 2.0)
    assert value == pytest.approx(power, abs=1e-9)
    assert departure == pytest.approx(abs(power - 1) / error, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("axis", range(3))
def test_a_lamp_that_stands_elsewhere_is_no_tone_curve(axis):
    _, _, departure, _ = linearity.exponent(*edges(1.0, 2.0 * np.eye(3)[axis]), 2.0)
    # One standard deviation of what is allowed for: less than two of the exponent's.
    assert departure < 2


@pytest.fixture(scope="module")
def box(mitsuba, tmp_path_factory):
    """The demo's box, its rendering by a stock path tracer, and one with its lamp elsewhere."""
    lamp = demo_scenes.BOX_LIGHT_CM

    def moved(xml):
        old, new = (", ".join(f"{value:g}" for value in place)
                    for place in (lamp, lamp + LAMP_MOVED_CM))
        assert old in xml
        return xml.replace(old, new)
    seen, elsewhere = (box_render.box_light(
        NM, {name: np.full(NM.size, value) for name, value in PAINTS.items()}, np.ones(NM.size),
        np.ones((1, NM.size)), size=SIZE, spp=16, seed=seed, edited=edited)
        for seed, edited in ((1, lambda xml: xml), (2, moved)))
    path = tmp_path_factory.mktemp("box") / "box.xml"
    path.write_text(demo_scenes.box_scene(SIZE), encoding="utf-8")
    return read_scene(path), seen, elsewhere


def found_in(box, photo):
    scene, seen, _ = box
    view = view_of(scene, photo_of(np.repeat(photo / photo.max(), 3, axis=2)),
                   materials=tuple(MaterialSpec(name, name, None) for name in PAINTS))
    return linearity.linearity(view, np.repeat(seen, 3, axis=2))


def test_a_tone_curve_is_found(box):
    found = found_in(box, box[1] ** 0.5)
    assert found.code == "scene.not-linear" and found.severity is Severity.FAIL
    assert found.values["value"] == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("number", [1, 2])
def test_a_linear_photo_passes_wherever_its_lamp_stands(box, number):
    assert found_in(box, box[number]).code == "scene.linear"
