"""Tristimulus values are those of the standard observer."""
import warnings

import numpy as np
import pytest

from spectrabox.radiometry.appearance import (
    LUMENS_PER_WATT,
    colour_matching,
    luminance_of,
    tristimulus_of,
)


def test_the_curves_are_the_cie_1931_observers():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour
        observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    nm = np.arange(380.0, 781.0)
    inside = (observer.wavelengths >= 380) & (observer.wavelengths <= 780)
    # a published table of ten digits, which another version of colour-science may interpolate
    np.testing.assert_allclose(colour_matching(nm), np.asarray(observer.values)[inside].T,
                               rtol=1e-10)


def test_one_watt_at_the_peak_is_683_lumens():
    nm = np.arange(554.0, 557.0)
    # A line of area 1 at 555 nm, where V is 1.
    assert luminance_of(nm, np.array([0.0, 1.0, 0.0])) == pytest.approx(LUMENS_PER_WATT, rel=1e-6)


@pytest.mark.parametrize("step", [1.0, 2.0, 4.0])
def test_equal_energy_is_white_on_every_instruments_grid(step):
    nm = np.arange(380.0, 781.0, step)
    x, y, z = tristimulus_of(nm, np.ones(nm.size))
    # CIE 15: the three curves have equal areas, from the table's ends and rounding to 1e-4.
    assert x / (x + y + z) == pytest.approx(1 / 3, abs=1e-4)
    assert y / (x + y + z) == pytest.approx(1 / 3, abs=1e-4)


def test_light_outside_the_visible_has_no_luminance():
    assert luminance_of(np.array([800.0, 900.0]), np.ones(2)) == 0
