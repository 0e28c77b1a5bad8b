"""Where bright pixels pile up: the clip point of each band, whatever the file states.

A sensor that is full, or a developer that cuts off, gives many pixels of different brightness one
value. Noise never does: about a value v, pixels scatter by s = sqrt(read + gain v) (noise.py), so
that of pixels of one brightness 13 % at most lie within a window of s / 3, and as many nearly in
the windows below. A pile is a window

    that holds at least ``TIMES_BELOW`` times what each of the three windows below it holds, and
    above which at most ``SHARE_ABOVE`` of its own number lie: hot pixels, overshoot of a filter,
    and of which at least ``SHARE_AT_ONE`` have one value, within s / 30: so that texture, which
    makes noise look larger than it is, does not make a pile of a plain part.

A developer that rolls highlights off piles them up at no one value, but presses their noise
together with them: where its curve has a slope d, the variance is d^2 of what the line of the noise
says. Where flat tiles have less than half of it from some level on to the brightest, less than a
quarter in the end, and all of it below that level, what lies above counts as clipped. A card that
is plainly bright scatters as it should; a curve that bends everywhere has no such level.

The noise is that of the darker part of the picture, where nothing is clipped, and its line is
drawn on to v. Where it is less than 1.5 steps of the file nothing can be told: a picture without
noise, as it is computed or smoothed, has plain parts of one value.
"""
from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from spectrabox.capture.photo.noise import LARGE_TILE, photon_transfer
from spectrabox.radiometry import errors, findings
from spectrabox.radiometry.records.spectra import default_band_names

SAMPLES = 1_000_000         # of a band, enough for a histogram
MIN_PILED = 50              # samples, of about a million; of fewer a part
MIN_PILED_SHARE = 2e-4      # of them
TIMES_BELOW = 4.0           # 1.3 about the peak of plain noise; 3.7 were its sigma taken 3 times
SHARE_ABOVE = 0.1
SHARE_AT_ONE, ONE_VALUE = 0.5, 1 / 30   # of the pile, and of sigma
MIN_WINDOW_STEPS = 4.0                  # of the file, about a value, that the share is taken of
WINDOWS_PER_SIGMA, WINDOWS_BELOW = 3, 3
MIN_SIGMA_STEPS = 1.5       # noise that would have spread the pile
DARKER = 0.7                # of the brightest: below it noise is measured
NOISE_TILES = 2000          # that tell it to 3 %; the whole picture where some rows have none dark
# of the variance by the line: in the end, from where on, and below, of a shoulder
QUIET, PRESSED, HOLDS = 0.25, 0.5, (0.7, 1.5)
LEVEL_STEP, LEVEL_TILES, MAX_LEVEL = 0.03, 8, 40    # of the brightest; flat tiles of a level
FLAT = 0.15                 # range of the pixels of a tile, of their mean, beyond 8 sigma
TOP_PERCENTILE = 99.9       # that the brightest is taken for
STEP_PERCENTILE = 5         # of the distances of neighbouring values: one step of the file
MIN_VALUES = 16             # that tell it


class Clip(NamedTuple):
    """Where a band clips: ``soft`` where highlights were rolled off from there on."""

    level: float
    soft: bool


def pile_of(values: np.ndarray, sigma: Callable[[np.ndarray], np.ndarray]) -> float | None:
    """The value at which the brightest of some samples pile up; None where they do not.

    Parameters
    ----------
    values : (n,) array
        Of one band.
    sigma : function
        Standard deviation of the noise of single samples about values.
    """
    levels, counts = np.unique(values, return_counts=True)
    least = max(MIN_PILED_SHARE * values.size, MIN_PILED * min(1.0, values.size / SAMPLES), 12.0)
    if levels.size < 2 or levels[-1] <= 0:
        return None
    below = np.concatenate([[0], np.cumsum(counts)])        # samples below levels[i]
    top = levels[levels > levels[-1] / 100]
    width = sigma(top) / WINDOWS_PER_SIGMA
    step = _step(levels)

    def number(lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
        return below[np.searchsorted(levels, upper)] - below[np.searchsorted(levels, lower)]

    piled = number(top - width / 2, top + width / 2)
    beside = number(top - (0.5 + WINDOWS_BELOW) * width, top - width / 2) / WINDOWS_BELOW
    above = values.size - below[np.searchsorted(levels, top + width / 2)]
    found = ((piled >= least) & (piled >= TIMES_BELOW * beside) & (above <= SHARE_ABOVE * piled)
             & (width * WINDOWS_PER_SIGMA >= MIN_SIGMA_STEPS * step))
    if not found.any():
        return None
    most = np.argmax(piled[found])
    middle, window = float(top[found][most]), float(width[found][most])
    near = np.abs(levels - middle) <= window / 2
    clip = float(levels[near][np.argmax(counts[near])])
    off = np.abs(levels - clip)
    at_one = counts[off <= max(step / 2, ONE_VALUE * WINDOWS_PER_SIGMA * window)].sum()
    about = counts[off <= max(window, MIN_WINDOW_STEPS * step) / 2].sum()
    return clip if at_one >= SHARE_AT_ONE * about else None


def clip_levels(signal: np.ndarray, quantum: np.ndarray | float, source: str = "",
                known: np.ndarray | None = None) -> list[Clip | None]:
    """Where each of K bands of a picture clips; None where none piles up.

    Parameters
    ----------
    signal : (H, W, K) array
        Linear.
    quantum : float or (K,) array
        Signal of one step of the file.
    source : str
        Of the photo, for errors.
    known : (H, W, K) bool array, optional
        Pixels that are saturated for sure.
    """
    stride = max(1, int(np.sqrt(signal[..., 0].size / SAMPLES)))
    steps = np.broadcast_to(quantum, signal.shape[2])
    clips: list[Clip | None] = []
    for band, step in enumerate(steps):
        plane = signal[..., band]
        line = dark_noise(plane, float(step), source, None if known is None else known[..., band])
        soft = None if line is None else shoulder_of(plane, line, float(step))
        pile = None if line is None else pile_of(
            np.ascontiguousarray(plane[::stride, ::stride]).ravel(), partial(_sigma_at, line))
        if soft is not None and (pile is None or soft < (1 - 2 * LEVEL_STEP) * pile):
            clips.append(Clip(soft, True))
        else:
            clips.append(None if pile is None else Clip(pile, False))
    return clips


def rolled_off(clips: Sequence[Clip | None]) -> tuple[findings.Finding, ...]:
    """That highlights were rolled off, with the level in each band that was.

    Parameters
    ----------
    clips : sequence of K Clip or None
    """
    names = default_band_names(len(clips))
    soft = {name: clip.level for name, clip in zip(names, clips, strict=True)
            if clip is not None and clip.soft}
    return (findings.Finding("file.rolled-off", findings.Severity.NOTE, values={
        "bands": list(soft), "levels": list(soft.values())}),) if soft else ()


def shoulder_of(plane: np.ndarray, line: tuple[float, float], step: float) -> float | None:
    """The value (H, W) above which noise is pressed together up to the brightest; None where it is
    not.

    Parameters
    ----------
    plane : (H, W) array
        Of one band.
    line : tuple of float
        As of ``dark_noise``.
    step : float
        Of the file.
    """
    some = _rows_of_tiles(plane, max(1, plane.size // (NOISE_TILES * LARGE_TILE**2)))
    rows, columns = (side // LARGE_TILE for side in some.shape)
    tiles = some[:rows * LARGE_TILE, :columns * LARGE_TILE].reshape(
        rows, LARGE_TILE, columns, LARGE_TILE).swapaxes(1, 2).astype(np.float32)
    mean = tiles.mean(axis=(2, 3), dtype=float)
    sigma = _sigma_at(line, mean)
    flat = np.ptp(tiles, axis=(2, 3)) <= FLAT * np.maximum(mean, 0) + 8 * sigma
    second = tiles[..., :-2] - 2 * tiles[..., 1:-1] + tiles[..., 2:]
    share = (np.mean(np.square(second), axis=(2, 3), dtype=float) / 6 / sigma**2)[flat]
    mean = mean[flat]
    if not mean.size or mean.max() <= 0 or _sigma_at(line, mean.max()) < MIN_SIGMA_STEPS * step:
        return None
    width = LEVEL_STEP * float(mean.max())
    level = np.minimum((mean / width).astype(int), MAX_LEVEL)
    shares = {int(one): float(np.median(share[level == one])) for one in np.unique(level)
              if np.count_nonzero(level == one) >= LEVEL_TILES}
    pressed = list(itertools.takewhile(lambda one: shares[one] < PRESSED, sorted(shares)[::-1]))
    if not pressed or min(shares[one] for one in pressed) > QUIET:
        return None
    onset = pressed[-1]
    below = [one for one in shares if onset / 2 <= one < onset]
    if sum(HOLDS[0] <= shares[one] <= HOLDS[1] for one in below) < max(2, len(below) / 2):
        return None
    return onset * width


def _sigma_at(line: tuple[float, float], level: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt(line[0] + line[1] * np.maximum(level, 0)))


def dark_noise(signal: np.ndarray, quantum: float, source: str = "",
               known: np.ndarray | None = None, samples: int = 1) -> tuple[float, float] | None:
    """Read noise and gain of the darker part of one band, and None where it shows none.

    Parameters
    ----------
    signal : (H, W) array
    quantum, source, known, samples
        As of ``clip_levels`` and ``photon_transfer``.
    """
    stride = max(1, int(np.sqrt(signal.size / 250_000)))
    brightest = float(np.percentile(signal[::stride, ::stride], TOP_PERCENTILE))
    for every in dict.fromkeys((max(1, signal.size // (NOISE_TILES * LARGE_TILE**2)), 1)):
        some = _rows_of_tiles(signal, every)
        bright = some > DARKER * brightest
        if known is not None:
            bright |= _rows_of_tiles(known, every)
        try:
            read, gain = photon_transfer(some[..., None], bright[..., None], quantum, source,
                                         samples)
        except errors.InputError:  # no dark tile
            continue
        return float(read[0]), float(gain[0])
    return None


def _rows_of_tiles(plane: np.ndarray, every: int) -> np.ndarray:
    """One in so many rows of the tiles that noise is measured in, all of a plane (H, W) for 1."""
    if every == 1:
        return plane
    rows, width = plane.shape[0] // LARGE_TILE, plane.shape[1]
    return plane[:rows * LARGE_TILE].reshape(rows, LARGE_TILE, width)[::every].reshape(-1, width)


def _step(levels: np.ndarray) -> float:
    """Distance of neighbouring values in the upper half of their range, of all where few lie there:
    that of a few nearest, since few samples leave gaps.
    """
    upper = levels[levels >= levels[-1] / 2]
    chosen = upper if upper.size >= MIN_VALUES else levels
    return float(np.percentile(np.diff(chosen), STEP_PERCENTILE))
