"""The light over a chart, from the chart photo itself: a smooth field fitted together with the gain
of each band.

``signal = gain x field(x, y) x predicted``, the logarithm of the field being a polynomial in the
picture's coordinates. 24 patches in K bands see it well where the prediction is good: to about the
prediction's error / sqrt(24 K / terms).
"""
from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from spectrabox.radiometry.errors import CalibrationError, InputError
from spectrabox.radiometry.records import LinearImage

# of the largest prediction: 3 % of each patch and 1 % of the white one (glare) weigh alike
DARKEST_SHARE = 0.3
STEPS = 20
TOLERANCE = 1e-10            # of the largest change of the field's logarithm


@dataclass(frozen=True, eq=False)
class LightField:
    """A smooth multiplicative field over a photo, its geometric mean over the patches being 1."""

    coefficients: np.ndarray     # (Q,) of the logarithm, powers of x and y from the first order on
    order: int
    origin_px: np.ndarray        # (2,) sensor pixels: centre of the patches
    scale_px: float
    offset: float                # of the logarithm: its mean over the patches without it
    gain: np.ndarray             # (K,) signal / prediction in each band
    residuals: np.ndarray        # (24, K) (signal - fit) / largest signal of the band
    standard_error: np.ndarray   # (24,) of the logarithm of the field at the patches

    def at(self, xy_px: np.ndarray) -> np.ndarray:
        """The field (...) at points (..., 2) in sensor pixels."""
        return np.exp(_terms((xy_px - self.origin_px) / self.scale_px, self.order)
                      @ self.coefficients - self.offset)


def fit_light_field(signals: np.ndarray, predicted: np.ndarray, centres_px: np.ndarray,
                    order: int = 2) -> LightField:
    """Fit field and gains to patch signals.

    Parameters
    ----------
    signals : (24, K)          patch means
    predicted : (24, K)        what each patch should read under even light, up to one gain per band
    centres_px : (24, 2)       centres of the patches in sensor pixels
    order :                    of the polynomial: 1 for a lamp far away, 2 for one near by or for vignetting

    Raises
    ------
    InputError
        If the shapes do not fit together, or a prediction is not positive.
    CalibrationError
        If the fit does not settle.
    """
    if signals.shape != predicted.shape or centres_px.shape != (signals.shape[0], 2):
        raise InputError(f"patch signals {signals.shape}, predictions {predicted.shape} and "
                         f"centres {centres_px.shape} do not fit together")
    if not np.all(predicted > 0):
        raise InputError("a predicted patch signal is not positive; check reflectances, light and "
                         "sensitivities")
    origin = centres_px.mean(axis=0)
    scale = float(np.linalg.norm(centres_px - origin, axis=1).max())
    powers = _terms((centres_px - origin) / scale, order)
    terms = powers - powers.mean(axis=0)
    bands = signals.shape[1]
    weights = (predicted / (predicted + DARKEST_SHARE * predicted.max(axis=0))).ravel()
    design = np.column_stack([np.tile(np.eye(bands), (signals.shape[0], 1)),
                              np.repeat(terms, bands, axis=0)])
    parameters = np.zeros(design.shape[1])
    gain = signals.sum(axis=0) / predicted.sum(axis=0)
    parameters[:bands] = np.log(np.maximum(gain, np.finfo(float).tiny))
    # Gauss-Newton on relative errors: signals of dark patches may be 0 or less
    for _ in range(STEPS):
        fitted = np.exp(design @ parameters) * predicted.ravel()
        error = (signals.ravel() - fitted) / fitted
        step = np.linalg.lstsq(design * weights[:, None], error * weights, rcond=None)[0]
        parameters += step
        if np.abs(step).max() < TOLERANCE:
            break
    else:
        raise CalibrationError("the light over the chart could not be fitted; check that the "
                               "patches are in the order of the reference and that no patch is "
                               "covered or glossy")
    fitted = (np.exp(design @ parameters) * predicted.ravel()).reshape(signals.shape)
    weighted = design * weights[:, None]
    variance = float(np.sum((error * weights) ** 2)) / max(error.size - design.shape[1], 1)
    covariance = variance * np.linalg.pinv(weighted.T @ weighted)[bands:, bands:]
    return LightField(
        coefficients=parameters[bands:], order=order, origin_px=origin, scale_px=scale,
        offset=float(powers.mean(axis=0) @ parameters[bands:]), gain=np.exp(parameters[:bands]),
        residuals=(signals - fitted) / signals.max(axis=0),
        standard_error=np.sqrt(np.einsum("ij,jk,ik->i", terms, covariance, terms)))


def divide_by_field(image: LinearImage, field: LightField) -> LinearImage:
    """The photo under the light that the middle of the chart had; trustworthy over the chart, a
    guess elsewhere.
    """
    height, width = image.signal.shape[:2]
    y, x = np.mgrid[:height, :width]
    xy_px = (np.stack([x, y], axis=-1) + 0.5) * image.sensor_step - 0.5
    light = field.at(xy_px).astype(np.float32)[..., None]
    return dataclasses.replace(image, signal=image.signal / light,
                               variance=image.variance / np.square(light),
                               source=f"{image.source} / field of the chart")


def _terms(xy: np.ndarray, order: int) -> np.ndarray:
    x, y = xy[..., 0], xy[..., 1]
    return np.stack([x**(total - power) * y**power for total in range(1, order + 1)
                     for power in range(total + 1)], -1)
