"""Where the variance of a recovered spectrum comes from: metamerism, photo noise, light ...

Linear-Gaussian at the posterior: with gain G = S J' Q^-1, Q = J S J' + R, R = sum of R_i,

    posterior covariance = (I - G J) S (I - G J)' + sum_i G R_i G'   (Joseph's form, exact)

The first term is what would remain with this estimator if every signal were perfect: metamerism.
The others add up to the rest without remainder, one term per cause.
"""
from __future__ import annotations

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records import SpectralMeasurement
from spectrabox.sampling.measurement import response_on
from spectrabox.sampling.prior.mixture import GRID, LogitMixture, reflectance
from spectrabox.sampling.prior.posterior import SIGNAL_FLOOR, posterior

METAMERISM, FLOOR = "metamerism", "model floor"


def error_budget(prior: LogitMixture, measurement: SpectralMeasurement,
                 causes: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Variance (P,) of the reflectance by cause, at the most probable component of the prior.

    Parameters
    ----------
    causes : dict of (K, K) arrays
        Covariances whose sum is the measurement's noise covariance, by name.

    Raises
    ------
    InputError
        If they do not add up.
    """
    total = sum(causes.values(), np.zeros_like(measurement.noise_covariance))
    if np.abs(total - measurement.noise_covariance).max() > 1e-9 + 1e-6 * np.abs(total).max():
        raise InputError("the covariances by cause do not add up to the noise covariance of the "
                         "measurement")
    relative_response = response_on(measurement, GRID)
    mixture = posterior(prior, relative_response, measurement.signal[None],
                        measurement.noise_covariance)
    index = int(np.argmax(mixture.weights[0]))
    p = reflectance(mixture.logits[index, 0])
    slope = p * (1 - p)
    jacobian = relative_response * slope
    base = prior.covariances[index] @ jacobian.T
    parts = {**causes, FLOOR: SIGNAL_FLOOR**2 * np.eye(len(total))}
    gain = base @ np.linalg.inv(jacobian @ base + total + parts[FLOOR])
    rest = np.eye(p.size) - gain @ jacobian
    budget = {METAMERISM: slope**2 * np.einsum("ij,jk,ik->i", rest, prior.covariances[index], rest,
                                               optimize=True)}
    budget |= {name: slope**2 * np.einsum("pk,kl,pl->p", gain, covariance, gain)
               for name, covariance in parts.items()}
    return budget


def sensitivity_covariance(light: np.ndarray, weights_nm: np.ndarray, spectrum: np.ndarray,
                           curve_covariance: np.ndarray) -> np.ndarray:
    """Covariance (K, K) of the signals of a spectrum (P,) from the posterior of the sensitivities,
    band after band.

    Parameters
    ----------
    light, weights_nm, spectrum : (P,)
    curve_covariance : (K P, K P)
        Of sensitivities in the unit in which white reads 1 under this light. What white reads is
        held fixed: an error common to a whole curve counts. Leave such errors out where white was
        measured with the same camera.
    """
    bands = len(curve_covariance) // len(spectrum)
    weighted = light * weights_nm
    rows = np.zeros((bands, len(curve_covariance)))
    for band in range(bands):
        rows[band, band * len(spectrum):(band + 1) * len(spectrum)] = weighted * spectrum
    return rows @ curve_covariance @ rows.T
