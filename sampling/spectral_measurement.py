"""A measurement of one surface: in spline coefficients, with the draws that polytope samplers make
of it; and what it must be before anything is drawn.
"""
from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from spectrabox.radiometry import error_model, errors, shaped
from spectrabox.radiometry.covariance import is_covariance, symmetric, with_rank
from spectrabox.radiometry.grid import basis_matrix, interpolation_matrix
from spectrabox.radiometry.records.spectra import SpectralMeasurement, WavelengthGrid

RANK = 1e-10            # relative: directions of a noise of less variance have none
SAME = 1e-9             # of white: responses closer than this are one
PROJECTION_STEPS = 300      # of the accelerated projected gradient; 1e-7 of the optimum at N = 31


@dataclass(frozen=True, eq=False)
class MeasurementOperator(shaped.Record):
    """A measurement of spline coefficients: ``y = A c + noise``, c of 1 giving y of 1."""

    A: Annotated[np.ndarray, "K N"]
    y: Annotated[np.ndarray, "K"]
    noise_covariance: Annotated[np.ndarray, "K K"]


def spline_operator(measurement: SpectralMeasurement, coefficients: int) -> MeasurementOperator:
    """The measurement in a B-spline basis of N = ``coefficients`` functions, every different band
    once.

    Parameters
    ----------
    measurement : SpectralMeasurement
    coefficients : int
        N, of the spline class.
    """
    whole = without_states(measurement)
    different, repeated = different_bands(whole.relative_response)
    gain = gain_of_different(whole.noise_covariance, repeated)
    A = whole.relative_response[different] @ basis_matrix(whole.grid.nm, coefficients)
    return MeasurementOperator(A, gain @ whole.signal, gain @ whole.noise_covariance @ gain.T)


def without_states(measurement: SpectralMeasurement) -> SpectralMeasurement:
    """The measurement with what the states of its capture add as one Gaussian error, for what knows
    no states: the signal less its mean, the noise with its covariance, all of which adds; bands
    that several photos repeat are estimated as one.

    Parameters
    ----------
    measurement : SpectralMeasurement
    """
    states = measurement.states
    if states is None:
        return measurement
    signal = measurement.signal - states.pattern @ states.mean
    noise = measurement.noise_covariance + states.pattern @ states.covariance @ states.pattern.T
    different, repeated = different_bands(measurement.relative_response)
    if different.size < signal.size:
        gain = gain_of_different(noise, repeated)
        signal, noise = gain @ signal, symmetric(gain @ noise @ gain.T)
    return replace(measurement, relative_response=measurement.relative_response[different],
                   signal=signal, noise_covariance=noise, states=None, relative_covariance=None)


def different_bands(relative_response: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices (r,) of bands that are not those of an earlier photo again, and which of them (K, r)
    each band is: 1, else 0.

    Parameters
    ----------
    relative_response : (K, P) array
    """
    first = np.array([next(other for other in range(band + 1)
                           if np.allclose(relative_response[other], own, rtol=0, atol=SAME))
                      for band, own in enumerate(relative_response)])
    different = np.unique(first)
    return different, (first[:, None] == different).astype(float)


def gain_of_different(noise: np.ndarray, repeated: np.ndarray) -> np.ndarray:
    """The gain (r, K) that estimates the signals of different bands from all by generalised least
    squares.

    Parameters
    ----------
    noise : (K, K) array
    repeated : (K, r) array
        From `different_bands`.
    """
    if repeated.shape[0] == repeated.shape[1]:
        return np.eye(len(repeated))
    weighted = np.linalg.solve(with_rank(noise, RANK), repeated)
    return np.asarray(np.linalg.solve(repeated.T @ weighted, weighted.T))


def reduced_errors(gain: np.ndarray, repeated: np.ndarray, signal: np.ndarray, noise: np.ndarray,
                   relative: np.ndarray | None
                   ) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """The signals (r,) of different bands, the covariance (r, r) of their errors, and that of what
    multiplies them.

    What multiplies bands that repeat each other is averaged as their signals are, as much of it as
    their covariance then holds; the rest adds.

    Parameters
    ----------
    gain : (r, K) array
    repeated : (K, r) array
    signal : (K,) array
    noise : (K, K) array
        Of all errors, about the signal.
    relative : (K, K) array or None
        Of those that multiply it.
    """
    own, whole = gain @ signal, symmetric(gain @ noise @ gain.T)
    if relative is None or not relative.any() or len(gain) == len(signal):
        return own, whole, relative
    shares = gain * repeated.T
    return own, whole, error_model.Errors.of_total(whole, own,
                                                   shares @ relative @ shares.T).relative


def nearest_coefficients(A: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Coefficients (N,) in [0, 1] whose signal A c is nearest to y, by bounded least squares.

    Parameters
    ----------
    A : (K, N) array
        From coefficients to signal.
    y : (K,) array
        Signal.
    """
    from scipy.optimize import lsq_linear  # 0.3 s to import, and few signals need it

    return np.clip(lsq_linear(A, y, bounds=(0, 1), tol=1e-12).x, 0, 1)


def response_on(measurement: SpectralMeasurement, grid: WavelengthGrid) -> np.ndarray:
    """Relative response (K, P') to reflectances that are straight lines between the P' wavelengths
    of a coarser grid; rows sum to 1.

    Parameters
    ----------
    measurement : SpectralMeasurement
    grid : WavelengthGrid
        Of P wavelengths, coarser.
    """
    return measurement.relative_response @ interpolation_matrix(grid.nm, measurement.grid.nm)


def nearest_splines(spectra: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Coefficients (T, N) in [0, 1] of the splines nearest to spectra (T, P), all at once.

    Accelerated projected gradient with restarts (O'Donoghue and Candes 2015) from the clipped
    least-squares fit.

    Parameters
    ----------
    spectra : (T, P) array
        Reflectances.
    basis : (P, N) array
        Basis functions at the same wavelengths.
    """
    gram, target = basis.T @ basis, spectra @ basis
    step = 1 / np.linalg.eigvalsh(gram)[-1]
    c = np.clip(np.linalg.solve(gram, target.T).T, 0, 1)
    ahead, momentum = c, 1.0
    for _ in range(PROJECTION_STEPS):
        new = np.clip(ahead - step * (ahead @ gram - target), 0, 1)
        if np.abs(new - c).max() < 1e-9:
            return new
        restart = np.sum((ahead - new) * (new - c)) > 0
        following = 1.0 if restart else (1 + np.sqrt(1 + 4 * momentum**2)) / 2
        ahead = new + (0.0 if restart else (momentum - 1) / following) * (new - c)
        c, momentum = new, following
    return c


# ---- what a measurement must be ------------------------------------------------------------------
# What a measurement must be before anything is drawn from it.

ALIKE = 1e-6    # smallest singular value of the bands' directions: below, two bands respond alike


def check_draw_count(draws: int) -> None:
    """Raise unless a whole number of draws, at least one, is asked for.

    Parameters
    ----------
    draws : int
        T, at least 1.

    Raises
    ------
    InputError
    """
    if not isinstance(draws, int | np.integer) or draws < 1:
        raise errors.InputError(
            f"{draws!r} draws were asked for; ask for at least 1, a whole number")


def check_seed(seed: int) -> None:
    """Raise unless a seed is a whole number from 0.

    Parameters
    ----------
    seed : int

    Raises
    ------
    InputError
    """
    if not isinstance(seed, int | np.integer) or seed < 0:
        raise errors.InputError(f"the seed {seed!r} cannot be; give 0, 1, 2 ...")


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
            raise errors.InputError(
                f"the {name} of the measurement holds numbers that are not finite; "
                "measure it again")
    check_noise(measurement.noise_covariance)
    if measurement.relative_covariance is not None:
        check_noise(measurement.relative_covariance)
    response = measurement.relative_response
    check_bands(response if measurement.states is None
                else response[different_bands(response)[0]])


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
        raise errors.InputError(
            "two bands respond alike, or one sees nothing of 400-700 nm under this "
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
        raise errors.InputError(
            "the noise covariance is not symmetric positive semi-definite; state "
            "variances on the diagonal, or a covariance estimated from repeated "
            "readings")
