"""How well each material's signal is known, by cause: the likelihood of the samplers and the report's error budget."""
from __future__ import annotations

import numpy as np

from radiometry.records import Calibration, Reconstruction
from radiometry.response import response_matrix, white_signal
from radiometry.spectrum_files import spectrum_on_grid
from sampling.spectral_samples import SpectralMeasurement


def measurement_of(calibration: Calibration, reconstruction: Reconstruction, index: int) -> SpectralMeasurement:
    """What the camera said of one material, relative to white, with every error that is known."""
    response = response_matrix(reconstruction.grid, calibration.sensitivity.curves, _light(calibration, reconstruction))
    covariance = np.sum(list(signal_covariances(calibration, reconstruction, index).values()), axis=0)
    return SpectralMeasurement(reconstruction.grid, response / white_signal(response)[:, None],
                               reconstruction.signal[index], covariance)


def signal_covariances(calibration: Calibration, reconstruction: Reconstruction, index: int) -> dict[str, np.ndarray]:
    """Covariance (K, K) of one material's signal, relative to white, by cause."""
    signal = reconstruction.signal[index]
    both = np.outer(signal, signal)
    scale = reconstruction.light_scale
    relative_scale = 0.0 if scale.standard_error is None else scale.standard_error / scale.value
    return {"photo and rendering noise": reconstruction.signal_covariance[index],
            "sensitivities": sensitivity_covariance(calibration, reconstruction, index),
            "light scale": relative_scale**2 * both,
            "photo and model disagree": reconstruction.model_covariance[index] * both}


def relative_errors(calibration: Calibration, reconstruction: Reconstruction, index: int) -> dict[str, np.ndarray]:
    """Relative standard error (K,) of one material's signal, by cause."""
    return {cause: np.sqrt(np.diag(covariance)) / reconstruction.signal[index]
            for cause, covariance in signal_covariances(calibration, reconstruction, index).items()}


def sensitivity_covariance(calibration: Calibration, reconstruction: Reconstruction, index: int) -> np.ndarray:
    """Covariance (K, K) of a signal, relative to white, by the error of the camera's curves.

    With a covariance of the curves, to first order: an error dM of a band changes the signal by the integral of
    dM x light x (reflectance - signal), divided by the white signal, since white itself is calibrated. Without one,
    every band errs by the stated share of the brightest band: an error of a curve's tail admits light from there.
    """
    fit, signal = calibration.sensitivity, reconstruction.signal[index]
    if fit.covariance is None or fit.basis is None:
        return calibration.relative_covariance * signal.max() ** 2
    weight = _light(calibration, reconstruction) * reconstruction.grid.weights_nm
    contrast = (reconstruction.spectra[index] - signal[:, None]) * weight / reconstruction.white_signal[:, None]
    jacobian = contrast @ fit.basis
    bands, coefficients = jacobian.shape
    blocks = fit.covariance.reshape(bands, coefficients, bands, coefficients)
    return np.einsum("kn,knlm,lm->kl", jacobian, blocks, jacobian)


def _light(calibration: Calibration, reconstruction: Reconstruction) -> np.ndarray:
    return spectrum_on_grid(calibration.light, reconstruction.grid)
