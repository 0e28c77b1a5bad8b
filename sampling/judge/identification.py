"""Which measured spectra could give a signal, which cannot be told apart, and whether none does.

A spectrum r of a library predicts the signal y ~ N(A r, V) with V = C + A D A': C is the signal's
own covariance, and D says how far another sample of the same material differs from the one that was
measured, D_ij = s_i s_j exp(-(nm_i - nm_j)^2 / (2 L^2)). Its evidence is that density at y, its
misfit the Mahalanobis distance of y. That it is none of them is the signal's evidence under the
learnt prior, which is the density that any other surface is expected to give.
"""
from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from spectrabox.radiometry.records import SpectralMeasurement
from spectrabox.radiometry.shaped import Record
from spectrabox.sampling.prior.mixture import PRIOR_GRID, LogitMixture
from spectrabox.sampling.prior.mixture_posterior import posterior, with_floor
from spectrabox.sampling.spline_measurement import response_on

VARIATION = 0.01        # of white: standard deviation between samples of one material
ALIKE_NM = 50.0         # L: wavelengths nearer than this vary together
REJECTED = 0.01         # a spectrum is rejected that gives so large a misfit less often
BY_CHANCE = 0.05        # the usual ratio: the one that a true spectrum exceeds less often


@dataclass(frozen=True, eq=False)
class Identification(Record):
    """How well each of n spectra of a library explains one signal, and the learnt prior's say."""

    log_evidence: Annotated[np.ndarray, "n"]        # nats
    misfit: Annotated[np.ndarray, "n"]              # Mahalanobis distance, in standard errors
    p_value: Annotated[np.ndarray, "n"]             # of a misfit at least as large, by chance
    indistinguishable: Annotated[np.ndarray, "n"]   # bool: not rejected, and near the best
    evidence_ratio: float                           # how near
    log_evidence_of_none: float                     # under the learnt prior
    probability_of_none: float                      # at even odds of the library and the prior


def identify(measurement: SpectralMeasurement, spectra: np.ndarray, prior: LogitMixture, *,
             standard_error: np.ndarray | None = None, variation: float = VARIATION,
             evidence_ratio: float | None = None) -> Identification:
    """Evidence of every spectrum of a library for one signal, and of none of them.

    Parameters
    ----------
    measurement : SpectralMeasurement
        0.1 % of white is added to its noise, as samplers do.
    spectra : (n, P) array
        On the measurement's wavelengths.
    prior : LogitMixture
        What else the surface may be.
    standard_error : (n, P) array, optional
        Of the spectra, 0 where nobody stated it.
    variation : float
        Standard deviation between samples of one material, of white.
    evidence_ratio : float, optional
        How much less evident than the best a spectrum may be and still not be told apart from it,
        above 1. By default the ratio that a true spectrum exceeds with a probability of 5 % at
        most: exp(q / 2) with the 95 % quantile q of chi-square.
    """
    from scipy.special import chdtrc, chdtri

    bands = len(measurement.signal)
    noise = with_floor(measurement.noise_covariance)
    # one row does for all where nobody stated errors
    stated = np.zeros_like(spectra[:1]) if standard_error is None or not standard_error.any() \
        else standard_error
    covariance = noise + _sample_covariance(measurement, np.sqrt(stated**2 + variation**2))
    covariance = np.broadcast_to(covariance, (len(spectra), bands, bands))
    residual = measurement.signal - spectra @ measurement.relative_response.T
    distance = np.einsum("nk,nk->n", residual,
                         np.linalg.solve(covariance, residual[..., None])[..., 0])
    evidence = -(distance + np.linalg.slogdet(covariance)[1] + bands * np.log(2 * np.pi)) / 2
    p_value = chdtrc(bands, distance)
    ratio = np.exp(chdtri(bands, BY_CHANCE) / 2) if evidence_ratio is None else evidence_ratio
    allowed = p_value >= REJECTED
    near = evidence >= np.max(evidence, where=allowed, initial=-np.inf) - np.log(ratio)
    none = float(posterior(prior, response_on(measurement, PRIOR_GRID), measurement.signal[None],
                           measurement.noise_covariance).log_evidence[0])
    of_library = evidence.max() + np.log(np.mean(np.exp(evidence - evidence.max())))
    return Identification(evidence, np.sqrt(distance), p_value, near & allowed,
                          float(ratio), none,
                          float(0.5 * (1 + np.tanh(0.5 * (none - of_library)))))


def _sample_covariance(measurement: SpectralMeasurement, deviation: np.ndarray) -> np.ndarray:
    """A D A' (n, K, K) for deviations s (n, P)."""
    nm = measurement.grid.nm
    alike = np.exp(-((nm[:, None] - nm) / ALIKE_NM)**2 / 2)
    weighted = measurement.relative_response * deviation[:, None, :]
    return (weighted.reshape(-1, nm.size) @ alike).reshape(weighted.shape) \
        @ weighted.transpose(0, 2, 1)
