"""Other ways to a spectrum from the same signal, to compare with: single guesses, and a greedy
sampler.

The single guesses (colour-science) take tristimulus values. A camera's signal is turned into them
by the least-squares matrix over the test reflectances, which is what a raw converter does; for the
CIE observer itself nothing is lost.
"""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry.colour_science import METHODS, observer_response, upsampled
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import SpectralMeasurement
from spectrabox.radiometry.spectra.named_spectra import test_reflectances
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.sampling.spectral_measurement import MeasurementOperator, response_on

ATTEMPTS = 20_000


def baseline_spectra(measurement: SpectralMeasurement,
                     methods: tuple[str, ...] = METHODS) -> dict[str, np.ndarray]:
    """Spectrum (61,) of every method for one signal.

    Parameters
    ----------
    measurement : SpectralMeasurement
    methods : tuple of str
        Of `colour_science.METHODS`.

    Raises
    ------
    InputError
        If the signal has fewer than three bands.
    """
    xyz = to_tristimulus(response_on(measurement, PRIOR_GRID), measurement.signal[None])[0]
    return {method: upsampled(xyz, PRIOR_GRID, method) for method in methods}


def to_tristimulus(relative_response: np.ndarray, signals: np.ndarray) -> np.ndarray:
    """Tristimulus values (n, 3), white being 1, from signals (n, K) by a matrix that keeps white
    white.

    Parameters
    ----------
    relative_response : (K, 61) array
        Rows summing to 1.
    signals : (n, K) array
        Relative to white.

    Raises
    ------
    InputError
        If there are fewer than three bands.
    """
    if len(relative_response) < 3:
        raise InputError(f"{len(relative_response)} bands give no colour; the baselines need three "
                         "or more")
    known = np.concatenate([*test_reflectances(PRIOR_GRID).values(),
                            np.ones((1000, PRIOR_GRID.nm.size))])
    matrix = np.linalg.lstsq(known @ relative_response.T, known @ observer_response(PRIOR_GRID).T,
                             rcond=None)[0]
    return np.clip(signals @ matrix, 0, None)


def greedy_draws(operator: MeasurementOperator, draws: int, seed: int) -> tuple[np.ndarray, float]:
    """Draws (<= T, N) in the manner of Belcour et al. (2023) and the share of attempts that gave
    one.

    Our reading: coefficients are drawn one after the other, uniformly in the interval that the K
    last ones can still make up for one at a time; the K last are solved for, and the draw is
    dropped where they leave [0, 1]. It fails on some signals that can be reached and its draws are
    not uniform: kept to be compared with.

    Parameters
    ----------
    operator : MeasurementOperator
        ``A`` (K, N), signal ``y`` (K,) relative to white, and its noise covariance (K, K).
    draws : int
        T, at least 1.
    seed : int
        Of the random generator; the same seed gives the same draws bit for bit.
    """
    rng = np.random.default_rng(seed)
    bands, count = operator.A.shape
    # the K in the middle are solved for
    order = np.argsort(np.abs(np.arange(count) - (count - 1) / 2))
    solved, free = order[:bands], order[bands:]
    c = np.empty((ATTEMPTS, count))
    remaining = np.tile(operator.y, (ATTEMPTS, 1))
    for position, j in enumerate(free):
        later = np.r_[free[position + 1:], solved]
        most = operator.A[:, later].sum(axis=1)
        column = operator.A[:, j]
        seen = column > 1e-12
        with np.errstate(divide="ignore", invalid="ignore"):
            high = np.nanmin(np.where(seen, remaining / column, np.inf), axis=1)
            low = np.nanmax(np.where(seen, (remaining - most) / column, -np.inf), axis=1)
        low, high = np.clip(low, 0, 1), np.clip(high, 0, 1)
        c[:, j] = low + np.maximum(high - low, 0) * rng.random(ATTEMPTS)
        remaining -= c[:, j, None] * operator.A[:, j]
    c[:, solved] = np.linalg.solve(operator.A[:, solved], remaining.T).T
    kept = c[np.all((c >= 0) & (c <= 1), axis=1)]
    return kept[:draws], len(kept) / ATTEMPTS
