"""What ``spectrabox uplift`` answers: a picture in, the spectra behind its pixels out.

What is in memory does not grow with the picture's height.
"""
from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.capture.photo.image_rows import open_rows
from spectrabox.radiometry.errors import InputError
from spectrabox.sampling.prior.mixture import GRID, load_prior, of_families
from spectrabox.session.progress_display import StageProgress
from spectrabox.session.signals.low_rank_files import low_rank_path, write_low_rank
from spectrabox.session.signals.signal_options import numbers, response_of_names
from spectrabox.session.signals.spectra_rows import (
    GRID_STEP_NM,
    Canvas,
    Format,
    KeptWavelengths,
    row_blocks,
    write_spectra,
)
from spectrabox.session.signals.uplift_plan import (
    Job,
    Look,
    Plan,
    look,
    planned,
    require_sides,
    together,
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
    coefficients: int | None = None     # of a pixel, in place of its spectra


def uplift_answer(request: UpliftRequest, progress: StageProgress) -> tuple[dict[str, Any], str]:
    """JSON object and text of ``spectrabox uplift``, which writes its files.

    Parameters
    ----------
    request : UpliftRequest
    progress : function of (stage, share of it that is done, message)

    Raises
    ------
    InputError
    """
    job = job_of(request)
    found = together(_looks(job, progress))
    plan = planned(job, found, lambda share: progress("table", share, ""))
    paths = _written(job, plan, request.out, progress)
    return told(job, plan, paths, found.outside)


def _looks(job: Job, progress: StageProgress) -> Iterator[Look]:
    picture = job.picture
    for first, last in row_blocks(picture.height, picture.width):
        yield look(job, first, last)
        progress("signals", last / picture.height, "")


def _written(job: Job, plan: Plan, out: Path, progress: StageProgress) -> dict[str, Path]:
    canvas = Canvas(job.picture.height, job.picture.width, job.signals,
                    lambda signals: plan.made(job, signals))

    def so_far(share: float) -> None:
        progress("spectra", share, "")

    if plan.low_rank is None:
        return write_spectra(canvas, out, job.kept, so_far)
    return {"low_rank": write_low_rank(canvas, out, job.kept, plan.low_rank, plan.errors or {},
                                       so_far)}


def told(job: Job, plan: Plan, paths: dict[str, Path],
         beyond: int) -> tuple[dict[str, Any], str]:
    """JSON object and text of a picture that is written.

    Parameters
    ----------
    paths : dict
        Names to files.
    beyond : int
        Pixels outside 0 to 1.
    """
    pixels = job.picture.height * job.picture.width
    mean_nm, spread_nm = job.kept.nm
    facts = {**{name: str(path) for name, path in paths.items()},
             "pixels": pixels, "outside_0_to_1": beyond / pixels,
             "wavelengths_nm": mean_nm.tolist(), "standard_deviation_nm": spread_nm.tolist(),
             "pixel_type": "float" if job.kept.full or job.kept.form == "envi" else "half"}
    text = f"wrote {' and '.join(str(path) for path in paths.values())}; "
    if plan.low_rank is not None and plan.errors is not None:
        facts |= {"coefficients": len(plan.low_rank.basis) - 1, "errors": plan.errors}
        text += _words_of(plan.errors)
    return facts, text + (f"{100 * beyond / pixels:.1f} % of pixels lie outside what a reflectance "
                          "between 0 and 1 can give and were taken at the edge")


def _words_of(errors: dict[str, Any]) -> str:
    mean, spread = errors["mean"], errors["standard_deviation"]
    return (f"the low rank costs {mean['rms']} rms of the mean, {mean['largest']} at most, and "
            f"{spread['rms']} and {spread['largest']} of the standard deviation "
            f"(over {errors['pixels']} pixels); ")


def job_of(request: UpliftRequest) -> Job:
    """The picture of a request, open, and all that its pixels depend on.

    Raises
    ------
    InputError
    """
    span = round(GRID.nm[-1] - GRID.nm[0])
    if request.step_nm < 1 or request.step_nm % GRID_STEP_NM or span % request.step_nm:
        raise InputError(f"--step {request.step_nm} does not divide 400-700 nm into steps of "
                         f"{GRID_STEP_NM} nm; take 5, 10, 15, 20, 25, 30, 50 or 60")
    require_sides(request.side)
    kept = KeptWavelengths(request.step_nm, request.full, request.form)
    if request.coefficients is not None:
        low_rank_path(request.out, kept)
    relative_response = response_of_names(request.sensitivity, request.light)
    picture = open_rows(request.image)
    if picture.bands != len(relative_response):
        raise InputError(f"the image has {picture.bands} bands and the sensitivities "
                         f"{len(relative_response)}")
    white = np.ones(picture.bands) if request.white is None \
        else numbers(request.white, picture.bands, "white")
    return Job(picture, white.astype(np.float32), relative_response,
               of_families(load_prior(), request.families), request.noise, request.side, kept,
               request.coefficients)
