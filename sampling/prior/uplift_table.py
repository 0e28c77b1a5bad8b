"""Mean and spread of the spectrum behind every pixel of an image, by a table in signal space.

The posterior of three-band signals is computed on a lattice, at the points that the picture needs,
and interpolated trilinearly for every pixel. One axis is the middle band, evenly in its cube root,
as dark colours change fastest; the others are the logarithms of the two ratios to it, densest at
grey, where most surfaces are and the spread changes fastest. Within a cell the shares are such that
the signals of its corners make up the pixel's own, and so the colours, as far as the corners are no
brighter than white. `table_error` says what the interpolation costs. Of more bands see
`local_posteriors`.
"""
from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import product
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from spectrabox.radiometry.error_model import Errors
from spectrabox.radiometry.errors import InputError
from spectrabox.sampling.prior import calibrated_marginals, mixture, mixture_posterior

SIDE = 21                   # odd, so that grey is on the lattice
MIN_ROOT = 0.12  # cube root of the darkest middle band; darker signals are taken for as dark
BEND, MAX_LOG_RATIO = 0.6, 2.6   # log ratio at which the lattice widens, and the largest one
BATCH = 400                 # signals computed at a time
MAX_SIGNAL = 1.0
TABLE_TOLERANCE = 1e-4          # logits: what a mean is then off by is lost in half floats
TINY = np.float32(1e-9)       # keeps cells beyond white solvable
CORNERS = np.array(list(product((0, 1), repeat=3)))

Progress = Callable[[float], None]      # share that is done
MapParts = Callable[[Callable[[int], Any], Iterable[int]], Iterable[Any]]      # as `map`


# what n signals say by themselves: mean and standard deviation (n, 61), and novelty (n,): beyond 1
# the prior was learnt from none like it
Uplifted = tuple[np.ndarray, np.ndarray, np.ndarray]


def build_tables(prior: mixture.LogitMixture, relative_response: np.ndarray,
                 errors: Callable[[np.ndarray], list[Errors]], wanted: np.ndarray,
                 progress: Progress = lambda share: None,
                 map_parts: MapParts = map) -> tuple[list[Uplifted], np.ndarray]:
    """The posterior of three-band signals at L points of a lattice, 1000 to 2000 points a second,
    in single precision for several errors, and the row (side, side, side) of each point in these
    tables, -1 where it was left out; each table after the first takes half the time.

    Parameters
    ----------
    prior : LogitMixture
    relative_response : (3, 61) array
        Rows summing to 1.
    errors : function from signals (n, 3) to a list of their errors
        One for each table.
    wanted : (side, side, side) bool array
        Points that are needed, from `points_around`.
    progress : function of the share that is done
    map_parts : function of (function, iterable), optional
        Calls the function on each item, as ``map`` does; of a pool of threads, on several cores.

    Raises
    ------
    InputError
        For other than three bands.
    """
    if len(relative_response) != 3:
        raise InputError("a table is made for three bands; there are "
                         f"{len(relative_response)}: use `uplift_signals`")
    # Where a band is brighter than white, neighbours have the same signal.
    signals, same = np.unique(lattice(len(wanted))[wanted], axis=0, return_inverse=True)
    row = np.full(wanted.shape, -1, dtype=np.int32)
    row[wanted] = same.ravel()
    tables = _uplifted(prior, relative_response, signals, errors(signals), progress,
                       TABLE_TOLERANCE, map_parts)
    return [(mean.astype(np.float32), deviation.astype(np.float32), novelty.astype(np.float32))
            for mean, deviation, novelty in tables], row


def lattice(side: int) -> np.ndarray:
    """Signals (side, side, side, 3) of the table; bands brighter than white are those of white.

    Parameters
    ----------
    side : int
        Points along each axis.
    """
    middle, ratio = _knots(side)
    level, first, third = np.meshgrid(middle, ratio, ratio, indexing="ij")
    return np.minimum(np.stack([level * first, level, level * third], axis=-1), MAX_SIGNAL)


def _knots(side: int) -> tuple[np.ndarray, np.ndarray]:
    """Levels (side,) of the middle band, and ratios (side,) of the others to it."""
    return np.linspace(MIN_ROOT, 1, side)**3, np.exp(
        BEND * np.sinh(np.linspace(-1, 1, side) * np.arcsinh(MAX_LOG_RATIO / BEND)))


def relative_errors(signals: np.ndarray, noise: float) -> Errors:
    """Errors of signals (n, K) of which every band errs for itself, by a share.

    Parameters
    ----------
    signals : (n, K) array
        Relative to white.
    noise : float
        Relative standard error of every band.
    """
    alike = np.zeros((*signals.shape, signals.shape[1]))
    return Errors(alike + noise**2 * np.eye(signals.shape[1]), alike)


def uplift_signals(prior: mixture.LogitMixture, relative_response: np.ndarray, signals: np.ndarray,
                   errors: Errors, *, tolerance: float = mixture_posterior.TOLERANCE) -> Uplifted:
    """Mean and standard deviation (n, 61) behind signals with errors of their own, each by itself,
    and their novelty (n,).

    They are those of calibrated draws: as wide as the 95 % band, not as the bare mixture.

    Parameters
    ----------
    prior : LogitMixture
    relative_response : (K, 61) array
        Rows summing to 1.
    signals : (n, K) array
        Relative to white.
    errors : Errors
        Of the n signals.
    tolerance : float
        Change of a logit that ends the way to a mode.
    """
    return _uplifted(prior, relative_response, signals, [errors], lambda share: None,
                     tolerance)[0]


def _uplifted(prior: mixture.LogitMixture, relative_response: np.ndarray, signals: np.ndarray,
              errors: Sequence[Errors], progress: Progress,
              tolerance: float, map_parts: MapParts = map) -> list[Uplifted]:
    """What signals say under each of several errors."""
    shape = len(signals), mixture.PRIOR_GRID.nm.size
    every = [(np.empty(shape), np.empty(shape), np.empty(len(signals))) for _ in errors]

    def compute(start: int) -> int:
        rows, mixture = slice(start, start + BATCH), None
        for (mean, deviation, novelty), own in zip(every, errors, strict=True):
            noise, relative = own.absolute[rows], mixture_posterior.multiplying(own.relative[rows])
            mixture = mixture_posterior.posterior(prior, relative_response, signals[rows], noise,
                                                  mixture, tolerance=tolerance, relative=relative)
            drawn, _ = calibrated_marginals.marginal_moments(prior, relative_response,
                                                             signals[rows], noise, mixture,
                                                             relative)
            mean[rows], deviation[rows] = mixture_posterior.mean_and_spread(drawn)
            novelty[rows] = np.maximum(
                mixture_posterior.novelty(prior, mixture, noise),
                mixture_posterior.unsaid(relative_response, mean[rows], signals[rows], noise,
                                         relative))
        return start

    for start in map_parts(compute, range(0, len(signals), BATCH)):
        progress(min(start + BATCH, len(signals)) / len(signals))
    return every


def points_around(signals: np.ndarray, side: int) -> np.ndarray:
    """Points (side, side, side) bool of the lattice that signals (n, 3) are interpolated from.

    Parameters
    ----------
    signals : (n, 3) array
    side : int
    """
    wanted = np.zeros((side + 1,) * 3, dtype=bool)
    cell, _ = _cell_and_share(signals, side)
    wanted[tuple(cell.T)] = True        # of each cell the corner nearest to the origin
    for axis in range(3):
        wanted |= np.roll(wanted, 1, axis)
    return wanted[:side, :side, :side]


def uplift_pixels(table: Uplifted, row: np.ndarray,
                  signals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation (n, 61), single precision, of signals (n, 3) from the table.

    Signals outside [0, 1] are taken at its edge; see `outside` for which they were.

    Parameters
    ----------
    table : Uplifted
        One of `build_tables`, with all `points_around` the signals.
    row : (side, side, side) array
        Of each point of the lattice in the table.
    signals : (n, 3) array
    """
    mean, deviation, _ = table
    weights = interpolation(row, len(mean), signals)
    return weights @ mean, weights @ deviation


def interpolation(row: np.ndarray, points: int, signals: np.ndarray) -> csr_array:
    """Weights (n, L), eight to a row, with which a table's points make up signals (n, 3).

    Parameters
    ----------
    row : (side, side, side) array
        Of each point of the lattice in the table.
    points : int
        L, of the table.
    signals : (n, 3) array
    """
    side = len(row)
    cell, share = _cell_and_share(signals, side)
    strides = np.array([side**2, side, 1], dtype=np.int32)
    rows = row.ravel()[(cell @ strides)[:, None] + (CORNERS @ strides).astype(np.int32)]
    both = np.stack([1 - share, share], axis=1, dtype=np.float32)       # of each axis
    first, second, third = (both[:, :, axis] for axis in range(3))
    weights = (first[:, :, None] * second[:, None])[..., None] * third[:, None, None]
    ends = np.arange(0, rows.size + 1, len(CORNERS), dtype=np.int32)
    return csr_array((weights.ravel(), rows.ravel(), ends), shape=(len(rows), points))


def _cell_and_share(signals: np.ndarray, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Cells of the lattice (n, 3), and how far across them (n, 3) the signals are, 0 to 1, so that
    the corners' signals make up the pixel's.
    """
    signals = np.asarray(signals, dtype=np.float32)
    middle = np.clip(signals[:, 1], MIN_ROOT**3, MAX_SIGNAL)
    ratio = np.log(np.maximum(signals[:, ::2], 1e-6) / middle[:, None])
    end = np.float32(np.arcsinh(MAX_LOG_RATIO / BEND))
    bent = np.arcsinh(np.clip(ratio, -MAX_LOG_RATIO, MAX_LOG_RATIO) / np.float32(BEND)) / end
    at = np.column_stack([(np.cbrt(middle) - MIN_ROOT) / (1 - MIN_ROOT), (bent + 1) / 2])
    at *= side - 1
    cell = np.clip(at.astype(np.int32), 0, side - 2)
    level, ratios = (knots.astype(np.float32) for knots in _knots(side))
    below, above = level[cell[:, 0]], level[cell[:, 0] + 1]
    share = np.empty_like(at)
    share[:, 0] = (middle - below) / (above - below)
    for axis, band in ((1, 0), (2, 2)):
        # what the corners give, those beyond white being those of white
        ends = [(1 - share[:, 0]) * np.minimum(below * ratio, MAX_SIGNAL)
                + share[:, 0] * np.minimum(above * ratio, MAX_SIGNAL)
                for ratio in (ratios[cell[:, axis]], ratios[cell[:, axis] + 1])]
        wanted = np.minimum(signals[:, band], MAX_SIGNAL) - ends[0]
        share[:, axis] = wanted / np.maximum(ends[1] - ends[0], TINY)
    return cell, np.clip(share, 0, 1)


def outside(signals: np.ndarray) -> np.ndarray:
    """Which signals (n, K) leave [0, 1] in some band and so cannot be those of a reflectance.

    Parameters
    ----------
    signals : (n, K) array
        Relative to white.
    """
    return np.any((signals < 0) | (signals > MAX_SIGNAL), axis=1)
