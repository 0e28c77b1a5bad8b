"""What ``spectrabox uplift`` answers: a picture in, the spectra behind its pixels out.

The picture is read twice, some rows at a time: once for which points of the table it needs, once
for its spectra. What is in memory does not grow with it.
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.capture.photo.image_rows import PictureRows, open_rows
from spectrabox.radiometry.errors import InputError
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
from spectrabox.session.signals.spectra_rows import (
    GRID_STEP_NM,
    Canvas,
    Format,
    KeptWavelengths,
    Spectra,
    row_blocks,
    write_spectra,
)


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
    form: Format = "exr"


@dataclass(frozen=True)
class _Job:
    """A picture's signals, relative to white, and what to make of them."""

    picture: PictureRows
    white: np.ndarray               # (K,)
    relative_response: np.ndarray   # (K, 61)
    prior: LogitMixture
    noise: float
    kept: KeptWavelengths

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
    wanted, beyond = _wanted(job, request.side, progress)
    canvas = Canvas(picture.height, picture.width, job.signals,
                    _spectra(job, wanted, request.side, progress))
    paths = write_spectra(canvas, request.out, job.kept,
                          lambda share: progress("spectra", share, ""))
    mean_nm, spread_nm = job.kept.nm
    facts = {**{name: str(path) for name, path in paths.items()},
             "pixels": picture.height * picture.width, "outside_0_to_1": beyond,
             "wavelengths_nm": mean_nm.tolist(), "standard_deviation_nm": spread_nm.tolist(),
             "pixel_type": "float" if request.full or request.form == "envi" else "half"}
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
    return _Job(picture, white.astype(np.float32), relative_response,
                of_families(load_prior(), request.families), request.noise,
                KeptWavelengths(request.step_nm, request.full, request.form))


def _wanted(job: _Job, side: int, progress: StageProgress) -> tuple[np.ndarray | None, float]:
    """Points of the table that the picture needs, None where pixels are computed one by one, and
    the share of pixels outside 0 to 1.
    """
    wanted, beyond = np.zeros((side,) * 3, dtype=bool), 0
    for first, last in row_blocks(job.picture.height, job.picture.width):
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
        return mean[:, job.kept.mean], spread[:, job.kept.spread]

    if wanted is None:
        return directly
    table = build_table(job.prior, job.relative_response, job.noise, side, wanted,
                        lambda share: progress("table", share, ""))
    both = np.hstack([table.mean[:, job.kept.mean],
                      table.standard_deviation[:, job.kept.spread]])
    return lambda signals: _looked_up(table, both, GRID.nm[job.kept.mean].size, signals)


def _looked_up(table: UpliftTable, both: np.ndarray, bands: int, signals: np.ndarray) -> Spectra:
    spectra = interpolation(table, signals) @ both
    return spectra[:, :bands], spectra[:, bands:]
