"""How the pixels of a picture become spectra: found in a first reading, the same for all of it.

The picture is read twice, some rows at a time: once for which points of the table it needs, once
for its spectra. Every pixel's are a function of its own signal and of the plan alone, so that they
do not depend on how the picture is cut, nor on who computes them.
"""
from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from spectrabox.capture.photo.image_rows import PictureRows
from spectrabox.radiometry.errors import InputError
from spectrabox.sampling.prior.low_rank import LowRank, low_rank, stated_errors
from spectrabox.sampling.prior.mixture import LogitMixture
from spectrabox.sampling.prior.tables import (
    Progress,
    build_table,
    interpolation,
    outside,
    points_around,
    uplift_directly,
)
from spectrabox.session.signals.spectra_rows import KeptWavelengths, Spectra

SAMPLED = 65_536            # pixels, evenly over the picture, that tell what a low rank costs
SAMPLED_DIRECTLY = 2048     # where each takes a millisecond
PIECE = 16_384              # pixels looked up at a time: more do not stay in the cache
SUMS = 1e-5                 # of an interpolation in single precision, at most


@dataclass(frozen=True)
class Job:
    """A picture's signals, relative to white, and what to make of them."""

    picture: PictureRows
    white: np.ndarray               # (K,)
    relative_response: np.ndarray   # (K, 61)
    prior: LogitMixture
    noise: float
    side: int                       # points of the table along each axis
    kept: KeptWavelengths
    coefficients: int | None        # of a low rank

    def signals(self, first: int, last: int) -> np.ndarray:
        """Signals (n, K) of some rows."""
        return (self.picture.read(first, last) / self.white).reshape(-1, self.picture.bands)


@dataclass(frozen=True)
class Look:
    """What the first reading finds in some rows."""

    wanted: np.ndarray      # (side, side, side) points of the table that are needed
    outside: int            # pixels beyond 0 to 1
    sample: np.ndarray      # (n, K) signals of some pixels


def look(job: Job, first: int, last: int) -> Look:
    """The first reading of some rows."""
    signals = job.signals(first, last)
    wanted = np.zeros((job.side,) * 3, dtype=bool)
    for piece in _pieces(signals) if job.picture.bands == 3 else ():
        wanted |= points_around(piece, job.side)
    width = job.picture.width
    step = _sampling_step(job.picture.height, width)
    # copied: a view would hold all signals of these rows
    return Look(wanted, int(outside(signals).sum()), signals[-first * width % step::step].copy())


def together(looks: Iterable[Look]) -> Look:
    """What was found in all rows, from parts in their order."""
    wanted, beyond, samples = np.array(False), 0, []
    for each in looks:
        wanted = wanted | each.wanted
        beyond += each.outside
        samples.append(each.sample)
    return Look(wanted, beyond, np.concatenate(samples))


def _pieces(signals: np.ndarray) -> list[np.ndarray]:
    return [signals[start:start + PIECE] for start in range(0, len(signals), PIECE)]


def _sampling_step(height: int, width: int) -> int:
    """Pixels from one of the sample to the next, in reading order: no divisor of a row."""
    step = max(1, -(-height * width // SAMPLED))
    while math.gcd(step, width) > 1:
        step += 1
    return step


@dataclass(frozen=True)
class Plan:
    """What a pixel's signal becomes."""

    row: np.ndarray | None          # (side, side, side) in the table; none where it is computed
    columns: np.ndarray | None      # (L, C) spectra or coefficients at the table's points
    low_rank: LowRank | None
    errors: dict[str, object] | None    # of the low rank

    def made(self, job: Job, signals: np.ndarray) -> Spectra:
        """Mean and standard deviation of signals (n, K), or coefficients (n, N) of both."""
        if self.row is None or self.columns is None:
            found = directly(job, signals)
            found = found if self.low_rank is None else self.low_rank.coefficients(found)
        else:
            found = np.concatenate([interpolation(self.row, len(self.columns), piece) @ self.columns
                                    for piece in _pieces(signals)])
        bands = job.kept.nm[0].size
        return (found,) if self.low_rank else (found[:, :bands], found[:, bands:])


def directly(job: Job, signals: np.ndarray) -> np.ndarray:
    """Mean and standard deviation (n, P + Q) side by side, each signal by itself."""
    mean, spread = uplift_directly(job.prior, job.relative_response,
                                   np.clip(signals, 0, 1).astype(float), job.noise)
    return np.hstack([mean[:, job.kept.mean], spread[:, job.kept.spread]])


def planned(job: Job, found: Look, progress: Progress) -> Plan:
    """The plan of a picture whose every row has been looked at.

    Raises
    ------
    InputError
        For a number of coefficients that cannot be.
    """
    low = None if job.coefficients is None else low_rank(
        job.prior, job.relative_response, job.noise, job.coefficients, job.kept.mean,
        job.kept.spread)
    picture = job.picture
    if picture.bands != 3 or picture.height * picture.width < found.wanted.sum():
        return Plan(None, None, low, None if low is None else _errors_directly(job, low, found))
    table = build_table(job.prior, job.relative_response, job.noise, job.side, found.wanted,
                        progress)
    both = np.hstack([table.mean[:, job.kept.mean],
                      table.standard_deviation[:, job.kept.spread]])
    if low is None:
        return Plan(table.row, both, None, None)
    columns = low.coefficients(both)
    # A pixel's error is a mean of those at the table's points around it.
    bound = (np.abs(low.spectra(columns) - both)
             + low.rounded(columns, _rounding(job))).max(axis=0) + SUMS
    weights = interpolation(table.row, len(both), found.sample)
    return Plan(table.row, columns, low,
                stated_errors(low, weights @ both, _stored(job, weights @ columns),
                              job.kept.nm[0].size, bound))


def _errors_directly(job: Job, low: LowRank, found: Look) -> dict[str, object]:
    some = found.sample[::max(1, -(-len(found.sample) // SAMPLED_DIRECTLY))]
    spectra = directly(job, some)
    return stated_errors(low, spectra, _stored(job, low.coefficients(spectra)),
                         job.kept.nm[0].size, None)


def _stored(job: Job, coefficients: np.ndarray) -> np.ndarray:
    return coefficients.astype(np.float32 if job.kept.full else np.float16)


def _rounding(job: Job) -> float:
    return float(np.finfo(np.float32 if job.kept.full else np.float16).eps) / 2


def require_sides(side: int) -> None:
    """Refuse a table without a grey.

    Raises
    ------
    InputError
    """
    if side < 3 or side % 2 == 0:
        raise InputError(f"--side {side} is not odd and at least 3")
