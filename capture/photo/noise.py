"""The noise of a photo from the photo itself: the photon-transfer line ``variance = read + gain x
signal``.

In a flat part of the picture, second differences of neighbouring pixels hold noise alone, and light
that changes linearly drops out. Variance and mean are taken tile by tile; among tiles of like
signal a low quantile is kept, because texture only ever adds, and the quantile's own bias is
removed (chi-square distribution of a flat tile's variance). Neighbouring pixels must have
independent noise: interpolated or denoised files look better than they are.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spectrabox.radiometry.errors import InputError

LARGE_TILE, SMALL_TILE = 16, 8  # pixels; the small one for pictures with few large ones
MANY_TILES, MIN_TILES = 200, 4
TILES_PER_LEVEL, MAX_LEVELS = 40, 100
MAX_TILES = 10_000  # of each band, spread over the picture: the line is then known to about 1 %
# of chi-square by Wilson and Hilferty: right to 1e-4 here, without scipy
QUANTILE, NORMAL_QUANTILE = 0.15, -1.0364334
# Second differences of white noise are correlated by -2/3 and 1/6 along the row; their mean square
# has fewer degrees of freedom than terms, by 1 + 2 (4/9 + 1/36).
TERMS_PER_FREEDOM = 1 + 2 * (4 / 9 + 1 / 36)


@dataclass(frozen=True, eq=False)
class PhotonTransfer:
    """Noise of each band: ``variance = read + gain x signal``, for signals as a fraction of full
    scale.
    """

    read: np.ndarray  # (K,) signal squared
    gain: np.ndarray  # (K,) signal per detected electron, as far as the noise tells

    def variance(self, signal: np.ndarray) -> np.ndarray:
        """Variance (H, W, K) float32 of a picture; below black the read noise alone remains."""
        # so that the reshape below is a view
        variance = np.maximum(signal, 0, dtype=np.float32, order="C")
        # one long row at a time is four times as fast as K numbers
        rows = variance.reshape(variance.shape[0], -1)
        rows *= np.tile(self.gain.astype(np.float32), variance.shape[1])
        rows += np.tile(self.read.astype(np.float32), variance.shape[1])
        return variance


def photon_transfer(signal: np.ndarray, saturated: np.ndarray, quantum: np.ndarray | float,
                    source: str = "") -> PhotonTransfer:
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
        If the picture is too small, or saturated nearly everywhere, so that nothing could be
        measured.
    """
    bands = signal.shape[2]
    floor = np.broadcast_to(np.square(quantum, dtype=float) / 12, bands)
    name = f"photo {source}" if source else "a photo"
    lines = [_fit_line(*_tile_statistics(signal[..., band], saturated[..., band], name),
                       floor[band]) for band in range(bands)]
    read, gain = np.array(lines).T
    return PhotonTransfer(read=read, gain=gain)


def transfer_from_pair(first: np.ndarray, second: np.ndarray, saturated: np.ndarray,
                       quantum: np.ndarray | float) -> PhotonTransfer:
    """The photon-transfer line of each band from two photos (H, W, K) of the same scene at the same
    settings.

    Texture drops out of their difference, so that every tile counts in full and interpolated pixels
    are no excuse; the light must not have changed and nothing have moved. A change of the light by
    a common factor is removed.

    Raises
    ------
    InputError
        If the photos differ in size, or show different scenes or too few unsaturated tiles.
    """
    if first.shape != second.shape:
        raise InputError(f"the photos of a pair are {first.shape} and {second.shape}; give two of "
                         "the same scene")
    lines = []
    for band in range(first.shape[2]):
        a, b = first[..., band], second[..., band]
        mean, difference = _pair_tiles(a, b, saturated[..., band])
        floor = float(np.broadcast_to(np.square(quantum, dtype=float) / 12, first.shape[2])[band])
        lines.append(_line_through(mean, difference, floor))
    read, gain = np.array(lines).T
    return PhotonTransfer(read=read, gain=gain)


def _pair_tiles(a: np.ndarray, b: np.ndarray, clipped: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean of each unsaturated tile of both photos, and half the variance of their difference."""
    rows, columns = (side // SMALL_TILE for side in a.shape)
    tiles = [plane[:rows * SMALL_TILE, :columns * SMALL_TILE].reshape(rows, SMALL_TILE, columns,
                                                                      SMALL_TILE)
             for plane in (a, b, clipped)]
    usable = ~tiles[2].any(axis=(1, 3))
    if np.count_nonzero(usable) < MIN_TILES:
        raise InputError("the pair of photos is saturated nearly everywhere; give a pair with a "
                         "shorter exposure")
    means = [tile.mean(axis=(1, 3), dtype=float) for tile in tiles[:2]]
    change = means[1][usable].sum() / means[0][usable].sum()
    difference = tiles[1] - np.float32(change) * tiles[0]
    half = difference.var(axis=(1, 3), dtype=float, ddof=1) / (1 + change**2)
    largest = np.abs(means[1] - change * means[0])[usable].max()
    spread = np.sqrt(2 * np.median(half[usable]) / SMALL_TILE**2)
    if largest > max(20 * spread, 0.1 * means[0][usable].max()):
        raise InputError("the photos of the pair differ by more than noise; give two of the same "
                         "scene and light, with the camera on a tripod")
    return means[0][usable], half[usable]


def _line_through(mean: np.ndarray, variance: np.ndarray, floor: float) -> tuple[float, float]:
    """Weighted least squares of variance = read + gain x mean, both at least 0, weights from the
    line itself.
    """
    model = np.full(mean.size, max(float(variance.mean()), floor))
    read, gain = floor, 0.0
    for _ in range(4):
        above_floor, gain = _nonnegative_line(mean, variance - floor, model)
        read = floor + above_floor
        model = read + gain * np.maximum(mean, 0)
    return read, gain


def _tile_statistics(signal: np.ndarray, saturated: np.ndarray,
                     name: str) -> tuple[np.ndarray, np.ndarray, int]:
    """Mean and variance of each unsaturated tile, and the terms in each variance."""
    height, width = signal.shape
    size = LARGE_TILE if height * width >= MANY_TILES * LARGE_TILE**2 else SMALL_TILE
    rows, columns = height // size, width // size
    stride = max(1, rows * columns // MAX_TILES)
    tiles, clipped = (
        plane[:rows * size, :columns * size].reshape(rows, size, columns, size)[::stride]
        for plane in (signal, saturated))
    tiles, clipped = tiles.swapaxes(1, 2), np.any(clipped, axis=(1, 3))
    second = tiles[..., :-2] - 2 * tiles[..., 1:-1] + tiles[..., 2:]
    # 1 + 4 + 1 times that of one pixel
    variance = np.mean(np.square(second), axis=(2, 3), dtype=float) / 6
    mean = tiles.mean(axis=(2, 3), dtype=float)
    if np.count_nonzero(~clipped) < MIN_TILES:
        raise InputError(f"the noise of {name} of {width} x {height} pixels with "
                         f"{np.mean(saturated):.0%} saturated cannot be measured; at least "
                         f"{MIN_TILES} unsaturated tiles of {size} x {size} are needed")
    return mean[~clipped], variance[~clipped], size * (size - 2)


def _fit_line(mean: np.ndarray, variance: np.ndarray, terms: int,
              floor: float) -> tuple[float, float]:
    """Read noise and gain, both at least 0, from the tiles of one band."""
    freedom = terms / TERMS_PER_FREEDOM
    flat_quantile = (1 - 2 / (9 * freedom) + NORMAL_QUANTILE * np.sqrt(2 / (9 * freedom))) ** 3
    levels = int(np.clip(mean.size // TILES_PER_LEVEL, 1, MAX_LEVELS))
    in_level = mean.size // levels
    # the brightest few may be left over
    order = np.argsort(mean)[:levels * in_level].reshape(levels, in_level)
    signal = mean[order].mean(axis=1)
    model = np.full(mean.size, max(float(np.median(variance)), floor))
    read, gain = floor, 0.0
    # the quantile is taken of variance / line, so that a level may span a range of signals
    for _ in range(4):
        ratio = np.quantile(variance[order] / model[order], QUANTILE, axis=1) / flat_quantile
        at_level = np.maximum(ratio * model[order].mean(axis=1), floor)
        above_floor, gain = _nonnegative_line(signal, at_level - floor, at_level)
        read = floor + above_floor
        model = read + gain * np.maximum(mean, 0)
    return read, gain


def _nonnegative_line(x: np.ndarray, y: np.ndarray, sigma: np.ndarray) -> tuple[float, float]:
    """Least squares of y = read + gain x with errors sigma, read and gain at least 0."""
    design = np.column_stack([np.ones(x.size), np.maximum(x, 0)]) / sigma[:, None]
    target = y / sigma
    read, gain = np.linalg.lstsq(design, target, rcond=None)[0]
    if read >= 0 and gain >= 0:
        return float(read), float(gain)
    squares, products = np.square(design).sum(axis=0), design.T @ target
    # of two edges of the quadrant, the better one
    alone = np.maximum(products, 0) / (squares + np.finfo(float).tiny)
    if products[0] * alone[0] >= products[1] * alone[1]:
        return float(alone[0]), 0.0
    return 0.0, float(alone[1])
