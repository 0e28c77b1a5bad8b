"""Whether 24 quadrilaterals in a photo look like a ColorChecker Classic, and in which order.

First up to the gain of each band, the contrast of the file, and light that changes evenly across
the chart: this finds the order of the patches. Then up to any mixture of the reference's three
bands, which takes up the camera and the light: what is left is a few per cent for a chart (0.03, at
most 0.14, over 40 measured cameras under 2300 to 9000 K and lamps with lines; up to 0.35 in JPEGs)
and more than 1 for other colours.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spectrabox.capture.chart.patches import pixels_inside
from spectrabox.radiometry.records import LinearImage

PATCH_MM, PITCH_MM = 40.0, 43.5  # printed size and distance of the patches
COLUMNS_MM, ROWS_MM = (PITCH_MM * np.arange(count) + PATCH_MM / 2 for count in (6, 4))
CENTRES_MM = np.stack(np.meshgrid(COLUMNS_MM, ROWS_MM), axis=-1).reshape(24, 2)

ACCEPTED_RESIDUAL = 0.45         # relative rms; charts reach 0.35, other colours begin at 1.1
WORST_PATCH = 0.65               # in a raw: 0.37 in 99 of 100 charts, 0.72 in half of the covered
WORST_ENCODED_PATCH = 1.3        # in a file that may have a tone curve and a colour matrix in it
DARKEST_SHARE = 0.03             # of the brightest patch, in the denominator of relative misfits
MIN_RANK_CORRELATION = 0.8       # of the six neutral patches
NEUTRALS = slice(18, 24)
LEFT_OUT = 0.1                   # of the log residuals, the worst
HOPELESS_RESIDUAL = 1.0          # rms of the log residual above which no mixture of bands is tried
MIN_CONTRAST = 0.2
WORST_LEFT_OUT = 2               # patches
MIXTURE_STEPS = 6
MIXED_BANDS = 3                  # more would fit 24 patches whatever their colours

_GRID = np.arange(24).reshape(4, 6)
# as proposed, turned by 180 degrees, two mirrors
ORDERS = (_GRID, _GRID[::-1, ::-1], _GRID[:, ::-1], _GRID[::-1])


class Agreement(NamedTuple):
    """How well 24 signals fit a chart, in the order that fits best."""

    residual: float      # relative rms of the patches, the two worst left out
    contrast: float      # power of the light: 1 in a linear photo
    order: np.ndarray    # (24,) index of the proposed quadrilateral of dark skin, light skin, ...
    misfit: np.ndarray   # (24,) relative misfit of each patch, in chart order
    light: np.ndarray    # (24,) on each patch as far as it changes evenly, geometric mean 1


def chart_agreement(image: LinearImage, quads_px: np.ndarray, reference: np.ndarray) -> Agreement:
    """Agreement of the signals of 24 patches with a reference, in the order that fits best.

    Parameters
    ----------
    image : LinearImage
    quads_px : (24, 4, 2) array
        Quadrilaterals in sensor pixels.
    reference : (24, K) array
        Signals that an ordinary camera would read, dark skin first.
    """
    medians = _patch_medians(image, quads_px)
    if medians is None:
        return Agreement(np.inf, np.nan, _GRID.ravel(), np.full(24, np.inf), np.ones(24))
    fits = [(*_log_fit(medians[order.ravel()], reference), order.ravel()) for order in ORDERS]
    residual, contrast, order = min(fits, key=lambda fit: fit[0])
    if not residual < HOPELESS_RESIDUAL:
        return Agreement(residual, contrast, order, np.full(24, np.inf), np.ones(24))
    misfit, light = _mixture_fit(medians[order], reference, contrast)
    residual = float(np.sqrt(np.mean(np.sort(misfit)[:-WORST_LEFT_OUT] ** 2)))
    return Agreement(residual, contrast, order, misfit, light)


def _patch_medians(image: LinearImage, quads_px: np.ndarray) -> np.ndarray | None:
    """Median signals (24, K), or None where a patch holds no pixel of the photo."""
    height, width = image.signal.shape[:2]
    if not np.all(np.isfinite(quads_px)):
        return None
    medians = []
    for quad in quads_px:
        y, x = pixels_inside(quad, image.sensor_step, height, width)
        if y.size == 0:
            return None
        medians.append(np.median(image.signal[y, x], axis=0))
    return np.array(medians)


def _log_fit(signals: np.ndarray, reference: np.ndarray) -> tuple[float, float]:
    """Rms residual and contrast of log signals (24, K) = contrast x log reference + gain of the
    band + plane in x, y.

    The residual is in log reference, that is, divided by the contrast. The tenth that fits worst is
    left out, so that a covered or glossy patch does not decide. Infinite where the neutral row is
    out of order or nothing is bright.
    """
    brightness = signals.sum(axis=1)
    if brightness.max() <= 0:
        return np.inf, np.nan
    if _rank_correlation(brightness[NEUTRALS],
                         reference[NEUTRALS].sum(axis=1)) < MIN_RANK_CORRELATION:
        return np.inf, np.nan
    bands = signals.shape[1]
    # dark patches may read 0 or less
    floor = 1e-3 * np.maximum(signals.max(axis=0), np.finfo(np.float32).tiny)
    logs = np.log(np.maximum(signals, floor)).ravel()
    position = np.repeat(CENTRES_MM / CENTRES_MM.max(), bands, axis=0)
    terms = np.column_stack([np.log(reference).ravel(), np.tile(np.eye(bands), (24, 1)), position])
    solution = np.linalg.lstsq(terms, logs, rcond=None)[0]
    contrast = float(solution[0])
    if contrast <= MIN_CONTRAST:
        return np.inf, contrast
    fitting = np.sort(np.abs(logs - terms @ solution))[:int((1 - LEFT_OUT) * logs.size)]
    return float(np.sqrt(np.mean(fitting**2))) / contrast, contrast


def _mixture_fit(signals: np.ndarray, reference: np.ndarray,
                 contrast: float) -> tuple[np.ndarray, np.ndarray]:
    """Relative misfit (24,) of each patch and the light (24,) on it, bands mixing the reference's.

    Alternates between the mixture, by least squares of relative errors in which misfits count less
    (Huber's weights at twice the median), and a light that changes exponentially across the chart.
    """
    floor = 1e-3 * np.maximum(signals.max(axis=0), 1e-6 * signals.max())   # a band may be dark
    linear = np.maximum(signals, floor) ** (1 / contrast)
    darkest = DARKEST_SHARE * linear.max(axis=0)
    light, weights = np.ones(24), np.ones_like(linear)
    plane = np.column_stack([np.ones(24), (CENTRES_MM - CENTRES_MM.mean(axis=0))
                             / CENTRES_MM.max()])
    mixed = reference.shape[1] == linear.shape[1] == MIXED_BANDS
    predicted = np.empty_like(linear)
    error = np.zeros_like(linear)
    for _ in range(MIXTURE_STEPS):
        for band in range(linear.shape[1]):
            lit = light[:, None] * (reference if mixed else reference[:, band:band + 1])
            weight = weights[:, band] / (linear[:, band] + darkest[band])
            mixture = np.linalg.lstsq(lit * weight[:, None], linear[:, band] * weight,
                                      rcond=None)[0]
            predicted[:, band] = lit @ mixture
        error = (linear - predicted) / (np.abs(predicted) + darkest)
        weights = 1 / np.maximum(1,
                                 np.abs(error) / (2 * np.median(np.abs(error))
                                                  + np.finfo(float).tiny))
        ratio = np.log(linear.sum(axis=1) / np.maximum(predicted.sum(axis=1), darkest.sum() / 100))
        near = np.abs(ratio) <= np.quantile(np.abs(ratio), 1 - LEFT_OUT)
        slope = np.linalg.lstsq(plane[near], ratio[near], rcond=None)[0]
        light = light * np.exp(plane[:, 1:] @ slope[1:])
    return np.sqrt(np.mean(error**2, axis=1)), light


def _rank_correlation(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.corrcoef(np.argsort(np.argsort(a)), np.argsort(np.argsort(b)))[0, 1])


def white_excess(signals: np.ndarray, reference: np.ndarray, light: np.ndarray) -> np.ndarray:
    """White light (24,) added to each patch, as a share of the white patch's signal: glare.

    The least of the bands counts: a reflection of the lamp adds to all of them. Where the whole
    chart is veiled the mixture takes up part of it, so that veiling glare is underestimated.

    Parameters
    ----------
    signals : (24, K) array
        Linear, dark skin first.
    reference : (24, K) array
        Signals that an ordinary camera would read.
    light : (24,) array
        On each patch, as ``Agreement.light``.
    """
    misfit = _signed_misfit(signals, reference, light)
    return np.maximum(misfit.min(axis=1), 0.0)


def _signed_misfit(signals: np.ndarray, reference: np.ndarray, light: np.ndarray) -> np.ndarray:
    """(signal - prediction) / signal of the white patch (24, K), predicted by mixing the bands."""
    lit = light[:, None] * reference
    white = signals[NEUTRALS.start]
    weights = np.ones_like(signals)
    misfit = np.zeros_like(signals)
    for _ in range(MIXTURE_STEPS):
        for band in range(signals.shape[1]):
            columns = lit if lit.shape[1] == MIXED_BANDS else lit[:, band:band + 1]
            weight = weights[:, band] / (signals[:, band] + DARKEST_SHARE * white[band])
            mixture = np.linalg.lstsq(columns * weight[:, None], signals[:, band] * weight,
                                      rcond=None)[0]
            misfit[:, band] = (signals[:, band] - columns @ mixture) / white[band]
        relative = np.abs(misfit) * white / (np.abs(signals) + DARKEST_SHARE * white)
        weights = 1 / np.maximum(1, relative / (2 * np.median(relative) + np.finfo(float).tiny))
    return misfit
