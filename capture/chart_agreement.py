"""Do 24 places in a photo look like a ColorChecker Classic, and in which order?

Up to the gain of each band, the contrast of the file, and light that changes evenly across the chart.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from capture.patches import pixels_inside
from radiometry.records import LinearImage

PATCH_MM, PITCH_MM = 40.0, 43.5  # printed size and distance of the patches
COLUMNS_MM, ROWS_MM = (PITCH_MM * np.arange(count) + PATCH_MM / 2 for count in (6, 4))
CENTRES_MM = np.stack(np.meshgrid(COLUMNS_MM, ROWS_MM), axis=-1).reshape(24, 2)

ACCEPTED_RESIDUAL = 0.45         # rms of log signal; wrong finds exceed 0.7, photos of charts reach 0.4
LEAST_RANK_CORRELATION = 0.8     # of the six neutral patches
NEUTRALS = slice(18, 24)
LEFT_OUT = 0.1                   # of the residuals, the worst

_GRID = np.arange(24).reshape(4, 6)
ORDERS = (_GRID, _GRID[::-1, ::-1], _GRID[:, ::-1], _GRID[::-1])  # as proposed, turned by 180 degrees, two mirrors


class Agreement(NamedTuple):
    """How well 24 signals fit a chart: rms of the log residual, power of the light, and the order that fits best."""

    residual: float
    contrast: float
    order: np.ndarray


def chart_agreement(image: LinearImage, quads_px: np.ndarray, reference: np.ndarray) -> Agreement:
    """Agreement of the signals in the quadrilaterals (24, 4, 2) with ``reference`` (24, K), in the best order."""
    medians = _patch_medians(image, quads_px)
    if medians is None:
        return Agreement(np.inf, np.nan, _GRID.ravel())
    candidates = [Agreement(*_log_fit(medians[order.ravel()], reference), order.ravel()) for order in ORDERS]
    return min(candidates, key=lambda candidate: candidate.residual)


def _patch_medians(image: LinearImage, quads_px: np.ndarray) -> np.ndarray | None:
    """Median signals (24, K), or None where a patch holds no pixel of the photo."""
    height, width = image.signal.shape[:2]
    medians = []
    for quad in quads_px:
        y, x = pixels_inside(quad, image.sensor_step, height, width)
        if y.size == 0:
            return None
        medians.append(np.median(image.signal[y, x], axis=0))
    return np.array(medians)


def _log_fit(signals: np.ndarray, reference: np.ndarray) -> tuple[float, float]:
    """Rms residual and contrast of log signals (24, K) = contrast x log reference + gain of the band + plane in x, y.

    The residual is in log reference, that is, divided by the contrast. The tenth that fits worst is left out, so that a
    covered or glossy patch does not decide. Infinite where the neutral row is out of order or nothing is bright.
    """
    brightness = signals.sum(axis=1)
    if brightness.max() <= 0:
        return np.inf, np.nan
    if _rank_correlation(brightness[NEUTRALS], reference[NEUTRALS].sum(axis=1)) < LEAST_RANK_CORRELATION:
        return np.inf, np.nan
    bands = signals.shape[1]
    floor = 1e-3 * np.maximum(signals.max(axis=0), np.finfo(np.float32).tiny)  # dark patches may read 0 or less
    logs = np.log(np.maximum(signals, floor)).ravel()
    place = np.repeat(CENTRES_MM / CENTRES_MM.max(), bands, axis=0)
    terms = np.column_stack([np.log(reference).ravel(), np.tile(np.eye(bands), (24, 1)), place])
    solution = np.linalg.lstsq(terms, logs, rcond=None)[0]
    contrast = float(solution[0])
    if contrast <= 0:
        return np.inf, contrast
    fitting = np.sort(np.abs(logs - terms @ solution))[:int((1 - LEFT_OUT) * logs.size)]
    return float(np.sqrt(np.mean(fitting**2))) / contrast, contrast


def _rank_correlation(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.corrcoef(np.argsort(np.argsort(a)), np.argsort(np.argsort(b)))[0, 1])
