"""What a measurement must be before anything is drawn from it."""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry.covariance import is_covariance
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import SpectralMeasurement

ALIKE = 1e-6    # smallest singular value of the bands' directions: below, two bands respond alike


def check_draw_count(draws: int) -> None:
    """Raise unless at least one draw is asked for.

    Parameters
    ----------
    draws : int
        T, at least 1.

    Raises
    ------
    InputError
    """
    if draws < 1:
        raise InputError(f"{draws} draws were asked for; ask for at least 1")


def check_measurement(measurement: SpectralMeasurement) -> None:
    """Raise unless a measurement can be sampled: finite numbers, a covariance, distinct bands.

    Raises
    ------
    InputError
        With what is wrong.
    """
    for name, values in (("response", measurement.relative_response),
                         ("signal", measurement.signal),
                         ("noise", measurement.noise_covariance)):
        if not np.all(np.isfinite(values)):
            raise InputError(f"the {name} of the measurement holds numbers that are not finite; "
                             "measure it again")
    check_noise(measurement.noise_covariance)
    check_bands(measurement.relative_response)


def check_bands(response: np.ndarray) -> None:
    """Raise unless bands see different things.

    Parameters
    ----------
    response : (K, P) array
        Sensitivity times light.

    Raises
    ------
    InputError
    """
    length = np.linalg.norm(response, axis=1, keepdims=True)
    if np.any(length == 0) or np.linalg.svd(response / length, compute_uv=False)[-1] < ALIKE:
        raise InputError("two bands respond alike, or one sees nothing of 400-700 nm under this "
                         "light; leave one out or measure the sensitivities again")


def check_noise(covariance: np.ndarray) -> None:
    """Raise unless a matrix (..., K, K), or every one of many, is a covariance.

    Parameters
    ----------
    covariance : (..., K, K) array
        Symmetric and positive semi-definite, or an error.

    Raises
    ------
    InputError
    """
    if not is_covariance(covariance):
        raise InputError("the noise covariance is not symmetric positive semi-definite; state "
                         "variances on the diagonal, or a covariance estimated from repeated "
                         "readings")
