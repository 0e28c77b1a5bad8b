"""The shape-preserving cubic is SciPy's."""
import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from spectrabox.radiometry.grid import pchip


@pytest.mark.parametrize("knots", [2, 3, 4, 11, 40])
@pytest.mark.parametrize("levels", [None, (0.0, 1.0, 2.0)], ids=["smooth", "flat pieces"])
def test_it_is_the_curve_of_scipy(knots, levels):
    rng = np.random.default_rng(knots)
    x = np.cumsum(rng.uniform(0.2, 20, knots))
    y = rng.normal(size=(3, knots)) if levels is None else rng.choice(levels, (3, knots))
    at = np.concatenate([x, rng.uniform(x[0], x[-1], 100)])
    # Round-off of a cubic of values of order 1: a few dozen eps, and steps differ by 100 to 1.
    np.testing.assert_allclose(pchip(x, y, at), PchipInterpolator(x, y, axis=-1)(at), rtol=0,
                               atol=1e-12)
