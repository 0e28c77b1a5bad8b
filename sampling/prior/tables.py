"""Mean and spread of the spectrum behind every pixel of an image, by a table in signal space.

The posterior of three-band signals is computed once on a lattice and interpolated trilinearly for
every pixel. One axis is the middle band, evenly in its cube root, as dark colours change fastest;
the others are the logarithms of the two ratios to it, densest at grey, where most surfaces are and
the spread changes fastest. `table_error` says what the interpolation costs. More than three bands
are computed pixel by pixel.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.sampling.prior.mixture import GRID, LogitMixture
from spectrabox.sampling.prior.posterior import mean_and_spread, posterior

SIDE = 25                   # odd, so that grey is on the lattice
MIN_ROOT = 0.12  # cube root of the darkest middle band; darker signals are taken for as dark
BEND, MAX_LOG_RATIO = 0.3, 2.6   # log ratio at which the lattice widens, and the largest one
BATCH = 500
MAX_SIGNAL = 1.0


@dataclass(frozen=True)
class UpliftTable:
    """Mean and standard deviation (side, side, side, 61) at the signals of `lattice`."""

    mean: np.ndarray
    standard_deviation: np.ndarray
    relative_response: np.ndarray


def build_table(prior: LogitMixture, relative_response: np.ndarray, noise: float = 0.01,
                side: int = SIDE) -> UpliftTable:
    """The posterior of three-band signals on a lattice; takes seconds.

    Parameters
    ----------
    prior : LogitMixture
    relative_response : (3, 61) array
        Rows summing to 1.
    noise : float
        Relative standard error of the signals.
    side : int
        Points of the lattice along each axis, odd.

    Raises
    ------
    InputError
        For other than three bands.
    """
    if len(relative_response) != 3:
        raise InputError("a table is made for three bands; there are "
                         f"{len(relative_response)}: use `uplift_directly`")
    mean, spread = uplift_directly(prior, relative_response, lattice(side).reshape(-1, 3), noise)
    shape = (side, side, side, GRID.nm.size)
    return UpliftTable(mean.reshape(shape).astype(np.float32),
                       spread.reshape(shape).astype(np.float32), relative_response)


def lattice(side: int) -> np.ndarray:
    """Signals (side, side, side, 3) of the table; bands brighter than white are those of white."""
    middle = np.linspace(MIN_ROOT, 1, side)**3
    ratio = np.exp(BEND * np.sinh(np.linspace(-1, 1, side) * np.arcsinh(MAX_LOG_RATIO / BEND)))
    level, first, third = np.meshgrid(middle, ratio, ratio, indexing="ij")
    return np.minimum(np.stack([level * first, level, level * third], axis=-1), MAX_SIGNAL)


def uplift_directly(prior: LogitMixture, relative_response: np.ndarray, signals: np.ndarray,
                    noise: float = 0.01) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation (n, 61) of signals (n, K), each by itself; about 2000 a second.

    Parameters
    ----------
    prior : LogitMixture
    relative_response : (K, 61) array
        Rows summing to 1.
    signals : (n, K) array
        Relative to white.
    noise : float
        Relative standard error of the signals.
    """
    means, spreads = np.empty((len(signals), GRID.nm.size)), np.empty((len(signals), GRID.nm.size))
    for start in range(0, len(signals), BATCH):
        part = signals[start:start + BATCH]
        covariance = np.einsum("tk,kl->tkl", (noise * part)**2, np.eye(len(relative_response)))
        means[start:start + BATCH], spreads[start:start + BATCH] = mean_and_spread(
            posterior(prior, relative_response, part, covariance))
    return means, spreads


def uplift_pixels(table: UpliftTable, signals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard deviation (n, 61), single precision, of signals (n, 3) from the table.

    Signals outside [0, 1] are taken at its edge; see `outside` for which they were.
    """
    from spectrabox.sampling.prior.table_kernel import look_up  # numba

    stacked = np.concatenate([table.mean, table.standard_deviation], axis=3)
    both = look_up(stacked, np.ascontiguousarray(signals, dtype=np.float32), MIN_ROOT, BEND,
                   MAX_LOG_RATIO)
    return both[:, :GRID.nm.size], both[:, GRID.nm.size:]


def outside(signals: np.ndarray) -> np.ndarray:
    """Which signals (n, K) leave [0, 1] in some band and so cannot be those of a reflectance."""
    return np.any((signals < 0) | (signals > MAX_SIGNAL), axis=1)


def table_error(table: UpliftTable, prior: LogitMixture, signals: np.ndarray,
                noise: float = 0.01) -> dict[str, float]:
    """Root-mean-square error of mean, and of the standard deviation relative to its mean, against
    the direct way.
    """
    mean, spread = uplift_directly(prior, table.relative_response, signals, noise)
    quick_mean, quick_spread = uplift_pixels(table, signals)
    return {"mean": float(np.sqrt(np.mean((quick_mean - mean)**2))),
            "standard_deviation": float(np.sqrt(np.mean((quick_spread - spread)**2))
                                        / spread.mean())}
