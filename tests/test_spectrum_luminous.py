"""The table of V(lambda) is the standard observer's."""
import warnings

import numpy as np
import pytest

from spectrabox.radiometry.spectra.luminous import (
    LUMENS_PER_WATT,
    luminance_of,
    luminous_efficiency,
)


def test_the_efficiency_is_the_cie_1931_observers():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import colour
        observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    nm = np.arange(380.0, 781.0)
    truth = np.interp(nm, observer.wavelengths, np.asarray(observer.values)[:, 1])
    # The table has every fifth value; between them the cubic differs by less than 0.001 of the
    # peak.
    np.testing.assert_allclose(luminous_efficiency(nm), truth, atol=1e-3)
    # An integral over it: the differences average out.
    assert luminous_efficiency(nm).sum() == pytest.approx(truth.sum(), rel=1e-4)


def test_one_watt_at_the_peak_is_683_lumens():
    nm = np.arange(554.0, 557.0)
    # A line of area 1 at 555 nm, where V is 1.
    assert luminance_of(nm, np.array([0.0, 1.0, 0.0])) == pytest.approx(LUMENS_PER_WATT, rel=1e-6)


def test_light_outside_the_visible_has_no_luminance():
    assert luminance_of(np.array([800.0, 900.0]), np.ones(2)) == 0
