"""Numbers of a chart photo to follow from session to session: brightness, colour balance, fit."""
from __future__ import annotations

import numpy as np

from spectrabox.measure.comparison import Quantity
from spectrabox.radiometry.records import LightScale, LinearImage, PatchSamples

MIN_PATCH = 0.03        # of the brightest patch: darker ones are glare and noise
BRIGHTNESS, RESIDUAL, LEFT_OUT, SCALE = ("brightness of the chart", "chart residual",
                                         "patches left out, RMSE", "light scale")
MIN_RESIDUAL_SPREAD, LEFT_OUT_SPREAD = 0.002, 0.005


def chart_quantities(samples: PatchSamples, photo: LinearImage,
                     repeatability: float) -> dict[str, Quantity]:
    """Brightness and colour balance of a chart photo, as logarithms at one exposure.

    Parameters
    ----------
    samples : PatchSamples
    photo : LinearImage
        Its stated exposure counts.
    repeatability : float
        Relative standard deviation of lamp and shutter from session to session.
    """
    variance = (samples.standard_error / np.maximum(samples.mean, 1e-12)) ** 2
    bright = _bright(samples)
    by_band = (np.log(np.maximum(samples.mean, 1e-12))[bright].mean(axis=0)
               - np.log(relative_exposure(photo)))
    errors = np.sqrt(variance[bright].sum(axis=0)) / max(np.count_nonzero(bright), 1)
    balance = by_band - by_band.mean()
    return {BRIGHTNESS: Quantity(float(by_band.mean()),
                                 float(np.linalg.norm(errors) / errors.size), repeatability),
            **{f"band {band + 1} against the others":
               Quantity(float(value), float(error), repeatability / 3)
               for band, (value, error) in enumerate(zip(balance, errors, strict=True))}}


def fit_quantities(samples: PatchSamples, predicted: np.ndarray,
                   left_out_rmse: np.ndarray) -> dict[str, Quantity]:
    """How well a calibration explains its chart photo.

    Parameters
    ----------
    samples : PatchSamples
        Of I patches in K bands.
    predicted : (I, K) array
        Signals by the calibration.
    left_out_rmse : (I,) array
        Of the reflectance of each patch, by a calibration without it.
    """
    off = ((samples.mean - predicted) / samples.mean)[_bright(samples)]
    residual = float(np.sqrt(np.nanmean(off ** 2)))
    return {RESIDUAL: Quantity(residual, 0.0, max(residual / 3, MIN_RESIDUAL_SPREAD)),
            LEFT_OUT: Quantity(float(left_out_rmse.mean()), 0.0, LEFT_OUT_SPREAD)}


def scale_quantity(scale: LightScale, photo: LinearImage, repeatability: float) -> Quantity:
    """Logarithm of the brightness of the light that a scene was rendered with, at one exposure.

    Parameters
    ----------
    scale : LightScale
    photo : LinearImage
        Of the chart: its stated exposure counts.
    repeatability : float
        As of ``chart_quantities``.
    """
    return Quantity(float(np.log(scale.value / relative_exposure(photo))),
                    float((scale.standard_error or 0.0) / scale.value), repeatability)


def relative_exposure(photo: LinearImage) -> float:
    """Time (s) x ISO / 100 / f-number squared, as far as the file states them."""
    exposure = (photo.exposure_s or 1.0) * (photo.iso or 100.0) / 100.0
    return exposure / (photo.f_number or 1.0) ** 2


def _bright(samples: PatchSamples) -> np.ndarray:
    return np.asarray(samples.mean.min(axis=1) > MIN_PATCH * samples.mean.max())
