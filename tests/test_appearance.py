"""Colours of reflectances under D65."""
from __future__ import annotations

import numpy as np
import pytest

from spectrabox.radiometry.appearance import (
    adapted_tristimulus,
    delta_e00,
    reflectance_to_lab,
    reflectance_to_srgb,
    signal_of_colour,
    tristimulus,
    tristimulus_weights,
)
from spectrabox.radiometry.errors import InputError

NM = np.arange(400.0, 701.0, 5.0)


@pytest.mark.parametrize("step_nm", [1.0, 5.0, 20.0])
def test_a_perfect_white_is_the_d65_white_on_any_grid(step_nm):
    nm = np.arange(400.0, 701.0, step_nm)
    # White of D65 as published for the 2 degree observer (CIE 15), four digits.
    np.testing.assert_allclose(tristimulus(nm, np.ones(nm.size)), [0.9504, 1.0, 1.0888], atol=2e-4)
    # One step of 8 bit.
    np.testing.assert_allclose(reflectance_to_srgb(nm, np.ones(nm.size)), 1, atol=1 / 255)


def test_a_grey_surface_has_equal_channels_and_black_has_none():
    grey = reflectance_to_srgb(NM, np.full(NM.size, 0.18))
    # The rounded matrix of the sRGB standard moves a grey by less than half a step of 8 bit.
    assert np.ptp(grey) < 0.5 / 255
    np.testing.assert_array_equal(reflectance_to_srgb(NM, np.zeros(NM.size)), 0)


def test_two_greys_differ_by_their_weighted_lightness():
    # For neutral colours CIEDE2000 is |dL| / S_L with S_L = 1 + 0.015 (L - 50)^2 / sqrt(20 + (L -
    # 50)^2), L the mean.
    a, b = 0.2, 0.25
    lightness = [116 * y ** (1 / 3) - 16 for y in (a, b)]
    offset = np.mean(lightness) - 50
    expected = (lightness[1] - lightness[0]) / (1 + 0.015 * offset ** 2 / np.sqrt(20 + offset ** 2))
    grey = np.ones(NM.size)
    # White in chromaticity coordinates is rounded nowhere; 1e-3 leaves room for a residual chroma
    # of round-off size.
    assert delta_e00(NM, a * grey, b * grey) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("light", ["A", "D50", "LED-B3"])
def test_white_stays_white_to_an_eye_that_has_adapted(light):
    white = np.ones(NM.size)
    # Bradford's matrix and its inverse: round-off.
    np.testing.assert_allclose(adapted_tristimulus(NM, light) @ white, tristimulus(NM, white),
                               rtol=1e-9)


@pytest.mark.parametrize("light", ["D65", "A", "FL11"])
def test_a_colour_is_the_signal_that_the_observer_has_of_a_surface(light):
    surfaces = np.array([np.full(NM.size, 0.6), 0.05 + 0.7 / (1 + np.exp((590 - NM) / 15)),
                         np.full(NM.size, 0.004)])
    weights = tristimulus_weights(NM, light)
    seen = surfaces @ weights.T / weights.sum(axis=1)
    np.testing.assert_allclose(signal_of_colour(light, lab=reflectance_to_lab(NM, surfaces, light)),
                               seen, rtol=1e-9)
    np.testing.assert_allclose(signal_of_colour(light, xyz=100 * surfaces @ weights.T), seen,
                               rtol=1e-6)


def test_colour_science_has_the_same_white_and_lab():
    import colour
    observer = "CIE 1931 2 Degree Standard Observer"
    white = colour.xyY_to_XYZ([*colour.CCS_ILLUMINANTS[observer]["D65"], 1])
    lab = [45.0, -27.0, 30.0]
    xyz = colour.Lab_to_XYZ(lab, colour.XYZ_to_xy(white))
    np.testing.assert_allclose(signal_of_colour("D65", lab=lab), xyz / white, rtol=1e-6)
    np.testing.assert_allclose(signal_of_colour("D65", xyz=100 * xyz), xyz / white, rtol=1e-3)


@pytest.mark.parametrize("colour", [{}, {"lab": [150, 0, 0]}, {"xyz": [20, 30]},
                                    {"lab": [50, 0, 0], "xyz": [18, 18, 18]}])
def test_what_is_no_colour_of_a_surface_is_refused(colour):
    with pytest.raises(InputError):
        signal_of_colour("D65", **colour)
