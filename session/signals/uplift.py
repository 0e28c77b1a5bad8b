"""What ``spectrabox uplift`` answers: a picture in, the spectra behind its pixels out.

The picture is read twice, some rows at a time: once for which points of the table it needs, once
for its spectra. What is in memory does not grow with it.
"""
from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.capture.photo.image_rows import ROWS_PER_BLOCK, PictureRows, exr_rows, open_rows
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import writable
from spectrabox.sampling.prior.mixture import GRID, LogitMixture, load_prior, of_families
from spectrabox.sampling.prior.tables import (
    UpliftTable,
    build_table,
    interpolation,
    outside,
    points_around,
    uplift_directly,
)
from spectrabox.session.progress_display import StageProgress
from spectrabox.session.signals.signal_options import numbers, response_of_names

PIXELS_AT_ONCE = 65_536
GRID_STEP_NM = 5
SPREAD_STEPS = 2        # the standard deviation changes slowly: every second wavelength is kept

Spectra = tuple[np.ndarray, np.ndarray]         # mean (n, P), standard deviation (n, Q)


@dataclass(frozen=True)
class UpliftRequest:
    """The options of ``spectrabox uplift`` as given."""

    image: Path
    out: Path
    sensitivity: str
    light: str
    white: str | None
    noise: float
    side: int
    step_nm: int            # between wavelengths of the mean
    full: bool              # all wavelengths of both, in single floats
    families: tuple[str, ...] = ()      # that the surfaces are said to be of


@dataclass(frozen=True)
class _Job:
    """A picture's signals, relative to white, and what to make of them."""

    picture: PictureRows
    white: np.ndarray               # (K,)
    relative_response: np.ndarray   # (K, 61)
    prior: LogitMixture
    noise: float
    mean_bands: slice               # of the 61 wavelengths
    spread_bands: slice

    def signals(self, first: int, last: int) -> np.ndarray:
        """Signals (n, K) of some rows."""
        return (self.picture.read(first, last) / self.white).reshape(-1, self.picture.bands)


def uplift_answer(request: UpliftRequest, progress: StageProgress) -> tuple[dict[str, Any], str]:
    """JSON object and text of ``spectrabox uplift``, which writes two files.

    Parameters
    ----------
    request : UpliftRequest
    progress : function of (stage, share of it that is done, message)

    Raises
    ------
    InputError
    """
    job = _job(request)
    picture = job.picture
    nm = {"mean": GRID.nm[job.mean_bands], "standard_deviation": GRID.nm[job.spread_bands]}
    paths = {name: request.out / f"{name}.exr" for name in nm}
    wanted, beyond = _wanted(job, request.side, progress)
    spectra_of = _spectra(job, wanted, request.side, progress)
    half = not request.full
    with writable(request.out), \
            exr_rows(paths["mean"], picture.height, picture.width, _names(nm["mean"]),
                     half) as write_mean, \
            exr_rows(paths["standard_deviation"], picture.height, picture.width,
                     _names(nm["standard_deviation"]), half) as write_spread:
        for first, last, (mean, spread) in _in_order(job, spectra_of):
            write_mean(first, mean.reshape(last - first, picture.width, -1))
            write_spread(first, spread.reshape(last - first, picture.width, -1))
            progress("spectra", last / picture.height, "")
    facts = {**{name: str(path) for name, path in paths.items()},
             "pixels": picture.height * picture.width, "outside_0_to_1": beyond,
             "wavelengths_nm": nm["mean"].tolist(),
             "standard_deviation_nm": nm["standard_deviation"].tolist(),
             "pixel_type": "half" if half else "float"}
    return facts, (f"wrote {paths['mean']} and {paths['standard_deviation']}; "
                   f"{100 * beyond:.1f} % of pixels lie outside what a reflectance between 0 and 1 "
                   "can give and were taken at the edge")


def _job(request: UpliftRequest) -> _Job:
    span = round(GRID.nm[-1] - GRID.nm[0])
    if request.step_nm < 1 or request.step_nm % GRID_STEP_NM or span % request.step_nm:
        raise InputError(f"--step {request.step_nm} does not divide 400-700 nm into steps of "
                         f"{GRID_STEP_NM} nm; take 5, 10, 15, 20, 25, 30, 50 or 60")
    if request.side < 3 or request.side % 2 == 0:
        raise InputError(f"--side {request.side} is not odd and at least 3")
    relative_response = response_of_names(request.sensitivity, request.light)
    picture = open_rows(request.image)
    if picture.bands != len(relative_response):
        raise InputError(f"the image has {picture.bands} bands and the sensitivities "
                         f"{len(relative_response)}")
    white = np.ones(picture.bands) if request.white is None \
        else numbers(request.white, picture.bands, "white")
    step = 1 if request.full else request.step_nm // GRID_STEP_NM
    wide = 1 if request.full else SPREAD_STEPS * step
    return _Job(picture, white.astype(np.float32), relative_response,
                of_families(load_prior(), request.families), request.noise,
                slice(None, None, step), slice(None, None, wide))


def _wanted(job: _Job, side: int, progress: StageProgress) -> tuple[np.ndarray | None, float]:
    """Points of the table that the picture needs, None where pixels are computed one by one, and
    the share of pixels outside 0 to 1.
    """
    wanted, beyond = np.zeros((side,) * 3, dtype=bool), 0
    for first, last in _blocks(job.picture):
        signals = job.signals(first, last)
        beyond += int(outside(signals).sum())
        if job.picture.bands == 3:
            wanted |= points_around(signals, side)
        progress("signals", last / job.picture.height, "")
    pixels = job.picture.height * job.picture.width
    directly = job.picture.bands != 3 or pixels < wanted.sum()
    return None if directly else wanted, beyond / pixels


def _spectra(job: _Job, wanted: np.ndarray | None, side: int,
             progress: StageProgress) -> Callable[[np.ndarray], Spectra]:
    """The function from signals (n, K) to spectra."""
    def directly(signals: np.ndarray) -> Spectra:
        mean, spread = uplift_directly(job.prior, job.relative_response,
                                       np.clip(signals, 0, 1).astype(float), job.noise)
        return mean[:, job.mean_bands], spread[:, job.spread_bands]

    if wanted is None:
        return directly
    table = build_table(job.prior, job.relative_response, job.noise, side, wanted,
                        lambda share: progress("table", share, ""))
    both = np.hstack([table.mean[:, job.mean_bands],
                      table.standard_deviation[:, job.spread_bands]])
    return lambda signals: _looked_up(table, both, GRID.nm[job.mean_bands].size, signals)


def _looked_up(table: UpliftTable, both: np.ndarray, bands: int, signals: np.ndarray) -> Spectra:
    spectra = interpolation(table, signals) @ both
    return spectra[:, :bands], spectra[:, bands:]


def _blocks(picture: PictureRows) -> Iterable[tuple[int, int]]:
    """First and last row of parts of the picture."""
    blocks = max(1, PIXELS_AT_ONCE // (picture.width * ROWS_PER_BLOCK))
    rows = blocks * ROWS_PER_BLOCK
    return [(first, min(first + rows, picture.height)) for first in range(0, picture.height, rows)]


def _in_order(job: _Job,
              spectra_of: Callable[[np.ndarray], Spectra]) -> Iterator[tuple[int, int, Spectra]]:
    """The spectra of parts of the picture in their order, as many at a time as there are cores."""
    cores = os.cpu_count() or 1
    waiting: deque[tuple[int, int, Future[Spectra]]] = deque()
    with ThreadPoolExecutor(cores) as pool:
        for first, last in _blocks(job.picture):
            waiting.append((first, last, pool.submit(spectra_of, job.signals(first, last))))
            if len(waiting) > cores:
                first, last, spectra = waiting.popleft()
                yield first, last, spectra.result()
        for first, last, spectra in waiting:
            yield first, last, spectra.result()


def _names(nm: np.ndarray) -> list[str]:
    return [f"{wavelength:g}nm" for wavelength in nm]
