"""Arrays in Python whose shape contradicts their wavelengths, and names that are not there."""
import numpy as np
import pytest

import spectrabox as sb

NM = np.arange(400, 701, 10.0)


CAMERA = {"camera": "Nikon 5100 (NPL)", "light": "D65"}
SIGNAL = [0.3, 0.2, 0.1]


@pytest.mark.parametrize(("asked", "sentence"), [
    ({"signals": "0.3,0.2,0.1"}, "signals: '0.3,0.2,0.1' is no array of numbers"),
    ({"signals": np.empty((0, 3))}, "signals has no row"),
    ({"noise": "small"}, "noise: 'small' is no array"),
    ({"white": [1, 1]}, r"white of shape \(2,\) was given for 3 bands"),
    ({"camera": 3}, "int is no camera"),
    ({"camera": (NM, np.ones((NM.size, 3)))}, r"shape \(31,\) and values of shape \(31, 3\)"),
    ({"camera": (NM, -np.ones((3, NM.size)))}, "sees nothing"),
    ({"light": (NM, -np.ones(NM.size))}, "falls below zero"),
    ({"signals": np.array([0.3, 0.2, 0.1j])}, "ndarray is no array of numbers"),
    ({"seed": -1}, "the seed -1 cannot be"), ({"level": "95"}, "a level of 95"),
    ({"light_error": "x"}, "light_error: 'x' is no array"),
    ({"sensitivity_error": [0.1, 0.1, 0.1]}, r"sensitivity_error: \[0.1, 0.1, 0.1\] is no number"),
    ({"families": 3}, "3 are no names of families"), ({"prior": 3}, "int is no prior"),
    ({"draws": 1000.5}, "samples 1000.5 is no whole number")])
def test_what_is_no_signal_camera_or_light_is_refused_in_a_sentence(asked, sentence):
    with pytest.raises(sb.InputError, match=sentence):
        sb.sample(**{"signals": SIGNAL, **CAMERA, **asked})


def test_a_colour_that_is_no_three_numbers_is_refused():
    with pytest.raises(sb.InputError, match="lab: '45,-27,30' is no array of numbers"):
        sb.sample(lab="45,-27,30")


@pytest.mark.parametrize(("library", "sentence"), [
    ({}, "the library is empty"), ([], "the library is empty"),
    ({"grey": np.full(61, 0.3)}, r"wavelengths of shape \(31,\) and values of shape \(61,\)"),
    ({"grey": np.full(31, 30.0)}, "looks like percent"),
    ({"grey": np.full(31, np.nan)}, "not a finite number"), (3, "the library is empty, or none")])
def test_a_library_that_holds_no_reflectance_is_refused(library, sentence):
    with pytest.raises(sb.InputError, match=sentence):
        sb.match(SIGNAL, library, nm=NM, noise=0.003, **CAMERA)


@pytest.mark.parametrize(("image", "asked", "sentence"), [
    ([["a"]], {}, "image: list is no array of numbers"),
    (np.full((2, 2, 3), np.nan), {}, "not finite"),
    (np.full((2, 2, 3), 0.3), {"white": [1, 1]}, r"white of shape \(2,\) was given for 3 bands"),
    (np.full((2, 2, 3), 0.3), {"noise": "x"}, "noise: 'x' is no array")])
def test_what_is_no_image_is_refused(image, asked, sentence):
    with pytest.raises(sb.InputError, match=sentence):
        sb.uplift(image, **CAMERA, **asked)


def test_what_an_estimate_is_asked_is_checked():
    wall = sb.sample(SIGNAL, noise=0.003, **CAMERA)
    for ask, sentence in ((lambda: wall.lab(3), "3 is no light"),
                          (lambda: wall.draws(2.5), "a whole number"),
                          (lambda: wall.draws(10, -3), "the seed -3 cannot be"),
                          (lambda: wall.delta_e(np.full(61, np.nan)), "not a finite number"),
                          (lambda: sb.match([SIGNAL], {"a": 0.3}, **CAMERA), "one signal")):
        with pytest.raises(sb.InputError, match=sentence):
            ask()


def test_a_light_is_found_whatever_its_capitals_and_else_the_nearest_are_named():
    wall = sb.sample(SIGNAL, noise=0.003, **CAMERA)
    np.testing.assert_array_equal(wall.lab("d50").value, wall.lab("D50").value)
    assert wall.delta_e(wall, "d65").value == 0
    for ask in (lambda: wall.lab("D66"), lambda: wall.delta_e(wall, "D66"),
                lambda: sb.sample(lab=[50, 0, 0], light="D66")):
        with pytest.raises(sb.InputError, match=r"nearest are .*D65"):
            ask()
    np.testing.assert_array_equal(sb.sample(lab=[50, 10, 0], light="d50").mean,
                                  sb.sample(lab=[50, 10, 0], light="D50").mean)
