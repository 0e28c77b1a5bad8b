"""What light that was reflected twice off a surface tells of it, as in a concave corner: response
times rho squared.

The paper ranks draws by it (Eq. 10). Here draws are weighted by its likelihood and drawn again,
which is exact as the number of draws grows; the effective sample size says whether there were
enough.
"""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from spectrabox.radiometry.records import SpectralMeasurement, SpectrumSamples
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.sampling.prior.mixture_posterior import with_floor
from spectrabox.sampling.spline_measurement import response_on

PROPOSALS_PER_DRAW, MAX_PROPOSALS = 20, 200_000


def proposals_for(draws: int) -> int:
    """How many draws to weight where so many are wanted."""
    return min(PROPOSALS_PER_DRAW * draws, max(MAX_PROPOSALS, draws))


def given_reflected_twice(samples: SpectrumSamples, twice: SpectralMeasurement,
                          draws: int) -> SpectrumSamples:
    """Draws (T, 61) conditioned on the signal (K,) of light reflected twice, relative to white.

    Parameters
    ----------
    samples : SpectrumSamples
        Many, not conditioned on it.
    twice : SpectralMeasurement
        Its response, and the signal with its covariance; 0.1 % of white is always added.
    draws : int

    Returns
    -------
    SpectrumSamples
        ``effective_samples`` is that of the weights, at most ``draws``.
    """
    away = samples.spectra**2 @ response_on(twice, PRIOR_GRID).T - twice.signal
    weights = np.einsum("tk,kl,tl->t", away, np.linalg.inv(with_floor(twice.noise_covariance)),
                        away)
    weights = np.exp(-0.5 * (weights - weights.min()))
    weights /= weights.sum()
    effective = min(1 / np.sum(weights**2), float(draws))
    # Systematic: the least noise that drawing again can add.
    at = (np.arange(draws) + np.random.default_rng(samples.seed).random()) / draws
    chosen = np.minimum(np.searchsorted(np.cumsum(weights), at), len(weights) - 1)
    return replace(samples, spectra=samples.spectra[chosen],
                   coefficients=samples.coefficients[chosen], effective_samples=float(effective),
                   method=f"{samples.method}, weighted by light reflected twice")
