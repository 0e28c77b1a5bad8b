import numpy as np
import pytest

from spectrabox.radiometry.grid import grid_from_nm, trapezoid_weights_nm, visible_grid
from spectrabox.radiometry.records.spectra import Outcome, Quantity, Spectrum, SpectrumSamples


def test_arrays_of_a_record_cannot_be_changed():
    values = np.ones(301)
    spectrum = Spectrum(visible_grid(), values, Quantity.REFLECTANCE, "test")
    with pytest.raises(ValueError, match="read-only"):
        spectrum.values[0] = 2
    values[0] = 5  # the caller's own array stays the caller's
    assert spectrum.values[0] == 1


@pytest.mark.parametrize("shape", [(300,), (301, 1), ()])
def test_a_wrong_shape_names_record_field_and_need(shape):
    with pytest.raises(ValueError, match=r"Spectrum\.\w+ has shape"):
        Spectrum(visible_grid(), np.ones(shape), Quantity.REFLECTANCE, "test", np.ones(301))


def test_a_letter_is_the_same_size_wherever_it_stands():
    with pytest.raises(ValueError, match="with T = 3"):
        SpectrumSamples(visible_grid(5), np.ones((3, 61)), np.ones((4, 7)), "m", 3.0, 1,
                        Outcome.EXACT, (Outcome.EXACT.finding(),))


def test_grid_weights_integrate_a_line_exactly():
    nm = np.array([400.0, 401, 405, 450, 700])
    # The trapezoid rule is exact for lines: only round-off of a few numbers of size 1e5.
    assert trapezoid_weights_nm(nm) @ (2 * nm
                                       + 1) == pytest.approx(700**2 - 400**2 + 300, rel=1e-13)


def test_a_grid_must_ascend():
    with pytest.raises(ValueError, match="strictly ascending"):
        grid_from_nm(np.array([400.0, 500, 450]))
