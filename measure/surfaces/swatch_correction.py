"""Swatches of the samples' material: their correction, learnt on measurements and put on draws."""
from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.records.spectra import SpectralMeasurement, SpectrumSamples
from spectrabox.sampling.further.learnt_swatches import (
    TELLING_BANDS,
    SwatchCorrection,
    Swatches,
    correct,
    corrected_draws,
    learn_correction,
    odd_swatches,
)
from spectrabox.sampling.prior.mixture import LogitMixture
from spectrabox.sampling.prior.signal_posterior import solve_posterior
from spectrabox.sampling.spectral_measurement import nearest_splines

CORRECTED = " with swatches"        # after the method of corrected draws


def correction_by_swatches(measurements: Sequence[SpectralMeasurement],
                           reflectances: np.ndarray, priors: Sequence[LogitMixture],
                           names: Sequence[str], predicted: np.ndarray,
                           signals: np.ndarray | None = None) -> SwatchCorrection:
    """The correction that measured swatches teach of the learnt prior.

    Parameters
    ----------
    measurements : sequence of n SpectralMeasurement
        What the camera says of each swatch, by a calibration that did not use them.
    reflectances : (n, 61) array
        Measured, on the prior's wavelengths.
    priors : sequence of n LogitMixture
        Of all families, or of those stated of a swatch.
    names : sequence of n str
    predicted : (n, K) array
        Signals that the reflectances would give.
    signals : (n, K) array or None
        By which samples are compared with swatches; None: those of the measurements.

    Raises
    ------
    InputError
        As ``learn_correction`` and ``solve_posterior``.
    """
    posteriors = [solve_posterior(prior, one)
                  for prior, one in zip(priors, measurements, strict=True)]
    learnt = learn_correction(Swatches(
        np.array([one.signal for one in measurements]) if signals is None else signals,
        reflectances,
        np.array([one.mean for one in posteriors]),
        np.array([one.standard_deviation for one in posteriors])))
    shown = learnt.swatches.signals
    return dataclasses.replace(learnt, contradicted=tuple(
        name for name, odd in zip(names, odd_swatches(shown, predicted), strict=True) if odd))


def corrected_samples(correction: SwatchCorrection, signal: np.ndarray, log_evidence: float,
                      samples: SpectrumSamples) -> SpectrumSamples:
    """Draws by the learnt prior of one sample, corrected; their sentence says how probably it is of
    the swatches' material.

    Parameters
    ----------
    correction : SwatchCorrection
    signal : (K,) array
        Relative to white.
    log_evidence : float
        Log density of the signal under the learnt prior, in nats.
    samples : SpectrumSamples
        On the prior's wavelengths.
    """
    draws = samples.spectra
    after = correct(correction, signal[None], draws.mean(axis=0)[None], draws.std(axis=0)[None],
                    np.array([log_evidence]))
    spectra = corrected_draws(draws, after.mean[0], after.deviation[0])
    basis = basis_matrix(samples.grid.nm, samples.coefficients.shape[1])
    like = _material_sentence(after.probability[0], signal.size) if correction.helps else ""
    return dataclasses.replace(samples, spectra=spectra,
                               coefficients=nearest_splines(spectra, basis),
                               method=samples.method + CORRECTED,
                               sentence=f"{samples.sentence} {correction.sentence}{like} "
                                        f"{correction.doubt}".rstrip())


def _material_sentence(probability: float, bands: int) -> str:
    sentence = (f" By its signal it is of their material with a probability of {probability:.0%}, "
                "for which the correction counts.")
    return sentence if bands >= TELLING_BANDS else (
        f"{sentence} {bands} bands say little of a material.")
