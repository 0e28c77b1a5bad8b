"""What an operator may say of a light, and the records that follow."""
import numpy as np
import pytest
from calibrate_cameras import GRID

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.calibration import HeldOutPatches
from spectrabox.radiometry.records.spectra import Spectrum
from spectrabox.radiometry.spectra.named_spectra import light as named_light
from spectrabox.radiometry.spectra.named_spectra import stated_light


@pytest.mark.parametrize("word, kind, cct", [("unknown", None, None), ("led", "led", None),
                                             ("halogen", "halogen", None), ("3200K", None, 3200.0),
                                             ("tungsten", "halogen", None),
                                             ("3200", None, 3200.0), ("sun", "daylight", None),
                                             ("Daylight", "daylight", None)])
def test_a_word_narrows_the_lamps(word, kind, cct):
    light = stated_light(word, GRID)
    assert (light.kind, light.cct) == (kind, cct)


@pytest.mark.parametrize("word", ["tungsten", "3200", "unknown"])
def test_where_a_spectrum_is_needed_a_kind_of_light_is_asked_back_with_names_near_it(word):
    with pytest.raises(InputError, match=r"its spectrum is needed: .*A \(tungsten, 2856 K\)"):
        named_light(word, GRID)


def test_a_cie_name_states_a_spectrum():
    light = stated_light("FL3.15", GRID)
    assert isinstance(light, Spectrum) and light.source == "CIE FL3.15"
    np.testing.assert_array_equal(light.values, named_light("FL3.15", GRID))


@pytest.mark.parametrize("word, said", [("D66", "no light that is known.*daylight, halogen"),
                                        ("900K", "run from 1500 to 25000 K"),
                                        ("lamp.csv", "lamp.csv")])
def test_what_is_no_light_is_refused(word, said):
    with pytest.raises(InputError, match=said):
        stated_light(word, GRID)


def test_a_left_out_patch_is_scored_over_wavelengths():
    flat = np.full((24, 301), 0.5)
    lower = flat - 0.1
    reference = np.where(GRID.nm < 475, 0.7, 0.5) * np.ones((24, 1))
    found = HeldOutPatches(GRID, flat, lower, flat + 0.1, reference, np.zeros(24, bool),
                           np.ones(24), 0.95)
    # 75 of 301 wavelengths are 0.2 off and outside.
    np.testing.assert_allclose(found.inside, 226 / 301)
    np.testing.assert_allclose(found.rmse, 0.2 * np.sqrt(75 / 301))
