"""Synthetic inputs obey the laws that they are said to."""
import numpy as np
import pytest

from spectrabox.fixtures import lamp
from spectrabox.fixtures.flat_sample import lamplight


@pytest.mark.parametrize("side, width", [(-1, 19.0), (1, 25.0)])
def test_the_blue_peak_is_half_as_high_at_half_of_its_width(monkeypatch, side, width):
    monkeypatch.setattr(lamp, "PEAK_RADIANCE", 1.0)
    nm = np.array([450.0, 450.0 + side * width / 2])
    phosphor = (0.40 * np.exp(-0.5 * ((nm - 543) / 31) ** 2)
                + 0.47 * np.exp(-0.5 * ((nm - 600) / 45) ** 2)
                + 0.006 * np.exp(-0.5 * ((nm - 480) / 160) ** 2))
    top, flank = lamp.radiance(nm) - phosphor
    assert flank == pytest.approx(top / 2, rel=1e-9)


def test_a_small_lamp_lights_a_plane_by_the_square_of_its_distance_and_the_cosine():
    height, rows, columns = 0.8, 40, 60
    found = lamplight((rows, columns), [(0.3, 0.2, height, 1.7)])
    y, x = ((np.arange(count) + 0.5) / columns for count in (rows, columns))
    squared = (x - 0.3) ** 2 + (y[:, None] - 0.2) ** 2 + height**2
    expected = height / np.sqrt(squared) / squared
    # single precision
    np.testing.assert_allclose(found / found[7, 9], expected / expected[7, 9], rtol=1e-5)
    # light from all sides is the same everywhere
    mixed = lamplight((rows, columns), [(0.3, 0.2, height, 1.7)], ambient=0.25)
    np.testing.assert_allclose(mixed, 0.25 + 0.75 * found, rtol=1e-5)
