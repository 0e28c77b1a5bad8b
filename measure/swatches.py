"""Swatches of the samples' material: their correction, learnt on measurements and put on draws."""
from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from spectrabox.radiometry.bspline import basis_matrix
from spectrabox.radiometry.records import SpectralMeasurement, SpectrumSamples
from spectrabox.sampling.further.swatches import (
    SwatchCorrection,
    Swatches,
    correct,
    corrected_draws,
    learn_correction,
)
from spectrabox.sampling.prior.mixture import LogitMixture
from spectrabox.sampling.prior.signal_posterior import solve_posterior
from spectrabox.sampling.spline_measurement import nearest_splines

CORRECTED = " with swatches"        # after the method of corrected draws
LIKE = 0.95             # likeness that is called so
TELLING_BANDS = 6       # with three, samples of other materials look like the swatches


def correction_by_swatches(measurements: Sequence[SpectralMeasurement],
                           reflectances: np.ndarray,
                           priors: Sequence[LogitMixture]) -> SwatchCorrection:
    """The correction that measured swatches teach of the learnt prior.

    Parameters
    ----------
    measurements : sequence of n SpectralMeasurement
        What the camera says of each swatch, by a calibration that did not use them.
    reflectances : (n, 61) array
        Measured, on the prior's wavelengths.
    priors : sequence of n LogitMixture
        Of all families, or of those stated of a swatch.

    Raises
    ------
    InputError
        As ``learn_correction`` and ``solve_posterior``.
    """
    posteriors = [solve_posterior(prior, one)
                  for prior, one in zip(priors, measurements, strict=True)]
    return learn_correction(Swatches(
        np.array([one.signal for one in measurements]), reflectances,
        np.array([one.mean for one in posteriors]),
        np.array([one.standard_deviation for one in posteriors])))


def corrected_samples(correction: SwatchCorrection, signal: np.ndarray,
                      samples: SpectrumSamples) -> SpectrumSamples:
    """Draws by the learnt prior of one sample, corrected; their sentence says how like the
    swatches it is.

    Parameters
    ----------
    correction : SwatchCorrection
    signal : (K,) array
        Relative to white.
    samples : SpectrumSamples
        On the prior's wavelengths.
    """
    draws = samples.spectra
    found = correct(correction, signal[None], draws.mean(axis=0)[None], draws.std(axis=0)[None])
    spectra = corrected_draws(draws, found.mean[0], found.deviation[0])
    basis = basis_matrix(samples.grid.nm, samples.coefficients.shape[1])
    like = _likeness_sentence(found.likeness[0], signal.size) if correction.helps else ""
    return dataclasses.replace(samples, spectra=spectra,
                               coefficients=nearest_splines(spectra, basis),
                               method=samples.method + CORRECTED,
                               sentence=f"{samples.sentence} {correction.sentence}{like}")


def _likeness_sentence(likeness: float, bands: int) -> str:
    sentence = " Its signal is like theirs." if likeness >= LIKE else (
        f" Its signal is unlike theirs: the correction counts for {likeness:.0%}.")
    return sentence if bands >= TELLING_BANDS else (
        f"{sentence} {bands} bands do not show whether its material is theirs.")
