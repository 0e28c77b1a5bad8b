"""Chi-square quantiles, against SciPy's."""
import pytest
from scipy.special import chdtri

from spectrabox.radiometry.covariance import chi_square_beyond


@pytest.mark.parametrize("degrees", [1, 2, 3, 4, 7, 31])
@pytest.mark.parametrize("probability", [1e-9, 0.05, 0.5, 0.999])
def test_a_value_is_exceeded_with_its_probability(probability, degrees):
    # Sums of up to 16 terms round to some eps; where the tail is flat that grows by 1000.
    assert chi_square_beyond(probability, degrees) == pytest.approx(chdtri(degrees, probability),
                                                                    rel=1e-11)
