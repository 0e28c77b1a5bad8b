"""The noise of a photo from the photo itself: the photon-transfer line [Janesick 2007, ch. 5].

    variance = read + gain x signal

In a flat part of the picture, second differences d = x(i-1) - 2 x(i) + x(i+1) hold noise alone, of
variance 6 sigma^2, and light that changes linearly drops out. Mean signal and mean d^2 / 6 are
taken tile by tile. Texture only ever adds to it: among tiles of like signal the q-quantile is kept,
q = 0.15, and divided by that of a flat tile, whose variance is sigma^2 chi^2_f / f with f degrees
of freedom. By Wilson and Hilferty (1931) that quantile is

    chi^2_f(q) / f = (1 - 2 / (9 f) + z(q) sqrt(2 / (9 f)))^3,    z(q) the normal quantile,

right to 1e-4 for the f of these tiles. Neighbouring pixels must have independent noise:
interpolated or denoised files look better than they are. A gain that comes out negative is 0, read
noise is at least that of rounding to steps of the file, step^2 / 12, and negative signals count as
black.

Some cameras cut off what lies below black. A tile whose share f of samples is at the lowest value
of the file then holds a censored normal distribution, of the mean m = c + b s, c half a step above
that value, b = -z(f), and with h = b (1 - f) + phi(b) of the variance

    v s^2 + 2 c f h s + c^2 f (1 - f) + (1 - f) step^2 / 12,    v = b h + 1 - f - h^2,

which is solved for s; uncorrected, the noise of black would read as 0.58 of what it is. Tiles that
are at black nearly throughout tell nothing and are left out.
"""
from __future__ import annotations

import itertools
from statistics import NormalDist

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.photos import LinearImage

LARGE_TILE, SMALL_TILE = 16, 8  # pixels; the small one for pictures with few large ones
MANY_TILES, MIN_TILES = 200, 4
TILES_PER_LEVEL, MAX_LEVELS = 40, 100
MAX_TILES = 10_000  # of each band, spread over the picture: the line is then known to about 1 %
QUANTILE = 0.15                 # q
ROUNDS = 6                      # of weights from the line itself
MAX_AT_BLACK = 0.9              # of a tile's samples: beyond, their share tells too little
HALF_SCALE, NEAR = 0.5, 0.1     # signals at which noise is stated, and within how much of it
SMOOTH_ERROR = 0.03             # relative, of a level however many its tiles: texture
# Second differences of white noise are correlated by -2/3 and 1/6 along the row; their mean square
# has fewer degrees of freedom than terms, by 1 + 2 (4/9 + 1/36).
TERMS_PER_FREEDOM = 1 + 2 * (4 / 9 + 1 / 36)


def variance_of(signal: np.ndarray, read: np.ndarray, gain: np.ndarray) -> np.ndarray:
    """Variance (H, W, K) float32 of a picture; below black the read noise alone remains.

    Parameters
    ----------
    signal : (H, W, K) array
        Linear.
    read, gain : (K,) arrays
        Of ``photon_transfer``.
    """
    # so that the reshape below is a view
    variance = np.maximum(signal, 0, dtype=np.float32, order="C")
    # one long row at a time is four times as fast as K numbers
    rows = variance.reshape(variance.shape[0], -1)
    rows *= np.tile(gain.astype(np.float32), variance.shape[1])
    rows += np.tile(read.astype(np.float32), variance.shape[1])
    return variance


def photon_transfer(signal: np.ndarray, saturated: np.ndarray, quantum: np.ndarray | float,
                    source: str = "", samples: np.ndarray | int = 1
                    ) -> tuple[np.ndarray, np.ndarray]:
    """The photon-transfer line of each band, of signals of 0 to 1: read noise (K,), signal squared,
    and gain (K,), signal per detected electron as far as the noise tells.

    Parameters
    ----------
    signal : (H, W, K) array
        Linear, as a fraction of full scale.
    saturated : (H, W, K) bool array
        Pixels at the clip point, whose tiles are left out.
    quantum : float or (K,) array
        Signal of one step of the file; its rounding error is the least read noise.
    source : str
        Of the photo, for errors.
    samples : int or (K,) array
        Of the sensor, whose mean is one value of the picture.

    Raises
    ------
    InputError
        If the picture is too small, or saturated or cut off at black nearly everywhere, so that
        nothing could be measured.
    """
    bands = signal.shape[2]
    floor = np.broadcast_to(np.square(quantum, dtype=float) / 12, bands)
    name = f"photo {source}" if source else "a photo"
    averaged = np.broadcast_to(samples, bands)
    lines = [_fit_line(*_tile_statistics(signal[..., band], saturated[..., band], floor[band],
                                         int(averaged[band]), name), floor[band])
             for band in range(bands)]
    read, gain = np.array(lines).T
    return read, gain


def _tile_statistics(signal: np.ndarray, saturated: np.ndarray, floor: float, samples: int,
                     name: str) -> tuple[np.ndarray, np.ndarray, int]:
    """Mean and variance of each tile that is neither saturated nor black throughout, and the terms
    in each variance.
    """
    height, width = signal.shape
    size = LARGE_TILE if height * width >= MANY_TILES * LARGE_TILE**2 else SMALL_TILE
    rows, columns = height // size, width // size
    stride = max(1, rows * columns // MAX_TILES)
    tiles, clipped = (
        plane[:rows * size, :columns * size].reshape(rows, size, columns, size)[::stride]
        for plane in (signal, saturated))
    tiles, clipped = tiles.swapaxes(1, 2), np.any(clipped, axis=(1, 3))
    second = tiles[..., :-2] - 2 * tiles[..., 1:-1] + tiles[..., 2:]
    # The weights 1, -2, 1 give 6 times the variance of a pixel.
    variance = np.mean(np.square(second), axis=(2, 3), dtype=float) / 6
    mean = tiles.mean(axis=(2, 3), dtype=float)
    lowest = float(signal.min())
    at_black = np.mean(tiles == lowest, axis=(2, 3)) if lowest <= 0 else np.zeros(mean.shape)
    usable = ~clipped & (at_black <= MAX_AT_BLACK)
    if np.count_nonzero(usable) < MIN_TILES:
        # of all pixels: a picture of a few pixels has no tile
        black = np.mean(signal == lowest) if lowest <= 0 else 0.0
        raise InputError(f"the noise of {name} of {width} x {height} pixels with "
                         f"{np.mean(saturated):.0%} saturated and {black:.0%} cut off "
                         f"at black cannot be measured; at least {MIN_TILES} tiles of {size} x "
                         f"{size} that are neither are needed")
    return (*_uncensored(mean[usable], variance[usable], at_black[usable], lowest, floor, samples),
            size * (size - 2))


def _uncensored(mean: np.ndarray, variance: np.ndarray, at_black: np.ndarray, lowest: float,
                floor: float, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean and variance of tiles as they were before samples below black were cut off."""
    cut = at_black > 0
    if not cut.any():
        return mean, variance
    from scipy.special import ndtri

    share = at_black[cut] ** (1 / samples)      # of single samples: all of a pixel's must be cut
    step = np.sqrt(12 * floor * samples)        # of a single sample
    b, c = -ndtri(share), step / 2
    density = np.exp(-b**2 / 2) / np.sqrt(2 * np.pi)
    h = b * (1 - share) + density
    v = b * h + 1 - share - h**2
    half = c * share * h
    rest = c**2 * share * (1 - share) + (1 - share) * step**2 / 12 - samples * variance[cut]
    s = (-half + np.sqrt(np.maximum(half**2 - v * rest, 0))) / v
    mean, variance = mean.copy(), variance.copy()
    mean[cut] = lowest + c + b * s
    variance[cut] = (np.maximum(s, 0)**2 + step**2 / 12) / samples
    return mean, variance


def _fit_line(mean: np.ndarray, variance: np.ndarray, terms: int,
              floor: float) -> tuple[float, float]:
    """Read noise and gain, both at least 0, from the tiles of one band.

    Levels are alike in signal, not in the number of their tiles: in one that held the few black
    tiles of a lit box together with brighter ones, the low quantile would be that of either.
    """
    freedom = terms / TERMS_PER_FREEDOM
    order = np.argsort(mean)
    mean, variance = mean[order], variance[order]
    starts = _level_starts(mean)
    count = np.diff(np.append(starts, mean.size))
    signal = np.add.reduceat(mean, starts) / count
    flat = np.array([_flat_quantile(int(tiles), freedom) for tiles in count])
    model = np.full(mean.size, max(float(np.median(variance)), floor))
    of_level = np.add.reduceat(model, starts) / count
    read, gain = floor, 0.0
    # The quantile is taken of variance / line, so that a level may span a range of signals.
    for _ in range(ROUNDS):
        ratio = _level_quantiles(variance / model, starts, count) / flat
        at_level = np.maximum(ratio * of_level, floor)
        # Not the line alone: texture, which lifts a level off it, would have the weight of noise.
        sigma = np.maximum(at_level, of_level) * np.sqrt(1 / count + SMOOTH_ERROR**2)
        above_floor, gain = _nonnegative_line(signal, at_level - floor, sigma)
        read = floor + above_floor
        model = read + gain * np.maximum(mean, 0)
        of_level = np.add.reduceat(model, starts) / count
    return read, gain


def _level_quantiles(values: np.ndarray, starts: np.ndarray, count: np.ndarray) -> np.ndarray:
    """The ``QUANTILE`` of the values of each level, as ``np.quantile`` has it."""
    level = np.repeat(np.arange(starts.size), count)
    ordered = values[np.lexsort((values, level))]
    position = QUANTILE * (count - 1)
    below = starts + position.astype(int)
    above = np.minimum(below + 1, starts + count - 1)
    return np.asarray(ordered[below] + (position % 1) * (ordered[above] - ordered[below]))


def _level_starts(mean: np.ndarray) -> np.ndarray:
    """Where each level begins among tiles sorted by their mean: equal steps of the root of the
    signal, which is as a photo's noise goes, cut again where a step holds very many.
    """
    step = np.sqrt(np.maximum(mean, 0)) * MAX_LEVELS / np.sqrt(max(mean[-1], 1e-12))
    steps = np.flatnonzero(np.diff(np.minimum(step.astype(int), MAX_LEVELS - 1))) + 1
    edges = np.concatenate([[0], steps, [mean.size]])
    share = max(TILES_PER_LEVEL, mean.size // MAX_LEVELS)
    return np.concatenate([np.linspace(start, stop, max((stop - start) // share, 1), False)
                           for start, stop in itertools.pairwise(edges)]).astype(int)


def noise_near(image: LinearImage, band: int, level: float) -> float | None:
    """Median standard deviation of the noise of pixels about a signal; None where there are none.

    Parameters
    ----------
    image : LinearImage
    band : int
    level : float
        Signal; pixels within ``NEAR`` of it count.
    """
    variance = image.variance[..., band][np.abs(image.signal[..., band] - level) < NEAR]
    return float(np.sqrt(np.median(variance))) if variance.size else None


def _flat_quantile(tiles: int, freedom: float) -> float:
    """What ``QUANTILE`` of so many flat tiles is of their variance, by Wilson and Hilferty; the
    probability of an order statistic by Blom.
    """
    normal = NormalDist().inv_cdf((1 + QUANTILE * (tiles - 1) - 0.375) / (tiles + 0.25))
    return float((1 - 2 / (9 * freedom) + normal * np.sqrt(2 / (9 * freedom))) ** 3)


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
