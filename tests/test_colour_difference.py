"""CIEDE2000 against the published pairs that reach every branch of the formula."""
import numpy as np
import pytest

from spectrabox.radiometry.appearance import ciede2000, lab_from_xyz

# Sharma, Wu & Dalal 2005, Table 1: pairs 1, 4, 7, 9, 13, 17, 20, 24.
PUBLISHED = [((50.0, 2.6772, -79.7751), (50.0, 0.0, -82.7485), 2.0425),
             ((50.0, -1.3802, -84.2814), (50.0, 0.0, -82.7485), 1.0000),
             ((50.0, 0.0, 0.0), (50.0, -1.0, 2.0), 2.3669),
             ((50.0, 2.4900, -0.0010), (50.0, -2.4900, 0.0009), 7.1792),
             ((50.0, -0.0010, 2.4900), (50.0, 0.0009, -2.4900), 4.8045),
             ((50.0, 2.5, 0.0), (73.0, 25.0, -18.0), 27.1492),
             ((50.0, 2.5, 0.0), (58.0, 24.0, 15.0), 19.4535),
             ((50.0, 2.5, 0.0), (50.0, 3.2592, 0.3350), 1.0000)]


@pytest.mark.parametrize("first, second, expected", PUBLISHED)
def test_published_pairs_are_reproduced_in_both_orders(first, second, expected):
    # Four decimals are published.
    assert ciede2000(np.array(first), np.array(second)) == pytest.approx(expected, abs=5e-5)
    assert ciede2000(np.array(second), np.array(first)) == pytest.approx(expected, abs=5e-5)


def test_white_is_100_and_neutral():
    white = np.array([0.9505, 1.0, 1.089])
    np.testing.assert_allclose(lab_from_xyz(white, white), [100, 0, 0], atol=1e-12)
    np.testing.assert_allclose(lab_from_xyz(0 * white, white), [0, 0, 0], atol=1e-12)
