"""The noise of a photo from the photo itself: the photon-transfer line ``variance = read + gain x signal``.

In a flat part of the picture, second differences of neighbouring pixels hold noise alone, and light that changes
linearly drops out. Variance and mean are taken tile by tile; among tiles of like signal a low quantile is kept, because
texture only ever adds, and the quantile's own bias is removed (chi-square distribution of a flat tile's variance).
Neighbouring pixels must have independent noise: interpolated or denoised files look better than they are.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls
from scipy.stats import chi2

from radiometry.errors import InputError

LARGE_TILE, SMALL_TILE = 16, 8  # pixels; the small one for pictures with few large ones
MANY_TILES, FEWEST_TILES = 200, 4
TILES_PER_LEVEL = 40
QUANTILE = 0.15
# Second differences of white noise are correlated by -2/3 and 1/6 along the row; their mean square has fewer degrees
# of freedom than terms, by 1 + 2 (4/9 + 1/36).
TERMS_PER_FREEDOM = 1 + 2 * (4 / 9 + 1 / 36)


@dataclass(frozen=True, eq=False)
class PhotonTransfer:
    """Noise of each band: ``variance = read + gain x signal``, for signals as a fraction of full scale."""

    read: np.ndarray  # (K,) signal squared
    gain: np.ndarray  # (K,) signal per detected electron, as far as the noise tells

    def variance(self, signal: np.ndarray) -> np.ndarray:
        """Variance (H, W, K) float32 of a picture; below black the read noise alone remains."""
        variance = np.maximum(signal, 0, dtype=np.float32)
        variance *= self.gain.astype(np.float32)
        variance += self.read.astype(np.float32)
        return variance


def photon_transfer(signal: np.ndarray, saturated: np.ndarray, quantum: np.ndarray | float) -> PhotonTransfer:
    """Estimate the photon-transfer line of each band.

    Parameters
    ----------
    signal : (H, W, K)         linear signal
    saturated : (H, W, K) bool pixels at the clip point, whose tiles are left out
    quantum :                  signal of one step of the file, per band or one for all; its rounding error is the least
                               read noise

    Raises
    ------
    InputError
        If the picture is too small, or saturated nearly everywhere, so that nothing could be measured.
    """
    bands = signal.shape[2]
    floor = np.broadcast_to(np.square(quantum, dtype=float) / 12, bands)
    lines = [_fit_line(*_tile_statistics(signal[..., band], saturated[..., band]), floor[band])
             for band in range(bands)]
    read, gain = np.array(lines).T
    return PhotonTransfer(read=read, gain=gain)


def _tile_statistics(signal: np.ndarray, saturated: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Mean and variance of each unsaturated tile, and the terms in each variance."""
    height, width = signal.shape
    size = LARGE_TILE if height * width >= MANY_TILES * LARGE_TILE**2 else SMALL_TILE
    rows, columns = height // size, width // size
    tiles = signal[:rows * size, :columns * size].reshape(rows, size, columns, size).swapaxes(1, 2)
    clipped = saturated[:rows * size, :columns * size].reshape(rows, size, columns, size).any(axis=(1, 3))
    second = tiles[..., :-2] - 2 * tiles[..., 1:-1] + tiles[..., 2:]
    variance = np.mean(np.square(second), axis=(2, 3), dtype=float) / 6  # 1 + 4 + 1 times that of one pixel
    mean = tiles.mean(axis=(2, 3), dtype=float)
    if np.count_nonzero(~clipped) < FEWEST_TILES:
        raise InputError(f"the noise of a photo of {width} x {height} pixels with {np.mean(saturated):.0%} saturated "
                         f"cannot be measured; at least {FEWEST_TILES} unsaturated tiles of {size} x {size} are needed")
    return mean[~clipped], variance[~clipped], size * (size - 2)


def _fit_line(mean: np.ndarray, variance: np.ndarray, terms: int, floor: float) -> tuple[float, float]:
    """Read noise and gain, both at least 0, from the tiles of one band."""
    freedom = terms / TERMS_PER_FREEDOM
    flat_quantile = chi2.ppf(QUANTILE, freedom) / freedom
    levels = np.array_split(np.argsort(mean), max(1, mean.size // TILES_PER_LEVEL))
    signal = np.array([mean[level].mean() for level in levels])
    model = np.full(mean.size, max(float(np.median(variance)), floor))
    read, gain = floor, 0.0
    for _ in range(4):  # the quantile is taken of variance / line, so that a level may span a range of signals
        ratio = np.array([np.quantile(variance[level] / model[level], QUANTILE) for level in levels]) / flat_quantile
        at_level = np.maximum(ratio * np.array([model[level].mean() for level in levels]), floor)
        design = np.column_stack([np.ones(signal.size), np.maximum(signal, 0)]) / at_level[:, None]
        scale = np.linalg.norm(design, axis=0) + np.finfo(float).tiny
        read, gain = nnls(design / scale, np.ones(signal.size))[0] / scale
        read = max(read, floor)
        model = read + gain * np.maximum(mean, 0)
    return read, gain
