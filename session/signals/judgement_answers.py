"""What plan, certify, prior train and uplift answer: names and folders in, numbers and text out."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import interpolation_matrix, visible_grid
from spectrabox.radiometry.spectra import named_spectra
from spectrabox.sampling.further.more_measurements import joined
from spectrabox.sampling.further.planner import (
    READING_ERROR,
    Candidate,
    photo_candidate,
    plan,
    wavelength_candidates,
)
from spectrabox.sampling.judge.certificate import LEVELS, Certificate, certificate_page, certify
from spectrabox.sampling.prior.draws import sample_prior
from spectrabox.sampling.prior.libraries import read_library
from spectrabox.sampling.prior.mixture import GRID, LogitMixture, load_prior
from spectrabox.sampling.prior.tables import build_table, outside, uplift_directly, uplift_pixels
from spectrabox.sampling.prior.training import LeftOut, train
from spectrabox.session.signals.measurement_file import further_measurements
from spectrabox.session.signals.signal_options import (
    measurement_of_signal,
    numbers,
    optional_numbers,
)

PLAN_DRAWS = 2000


def response_of_names(sensitivity: str, light: str) -> np.ndarray:
    """Relative response (K, 61) of named curves and light, integrated at 1 nm."""
    fine = visible_grid(1)
    return named_spectra.relative_response(sensitivity, light, fine) \
        @ interpolation_matrix(GRID.nm, fine.nm)


@dataclass(frozen=True)
class PlanRequest:
    """The options of ``spectrabox plan`` as given."""

    sensitivity: str
    light: str
    signal: str
    white: str | None
    noise: str | None
    steps: int
    lights: tuple[str, ...]             # of another photo by the same camera
    cameras: tuple[str, ...]            # of another photo under the same light
    readings: tuple[str, ...]           # taken already, as are the next three
    photos: tuple[str, ...]
    same: tuple[str, ...]
    more: Path | None
    reading_minutes: float
    photo_minutes: float
    spot_minutes: float | None          # of a whole spectrum by a spectrometer; None: there is none
    seed: int


def plan_answer(request: PlanRequest) -> tuple[dict[str, Any], str]:
    """JSON object and text of ``spectrabox plan``.

    Raises
    ------
    InputError
    """
    minutes = (request.reading_minutes, request.photo_minutes, request.spot_minutes or 1.0)
    if min(minutes) <= 0:
        raise InputError("the minutes of a measurement must be positive")
    relative_response = named_spectra.relative_response(request.sensitivity, request.light,
                                                        visible_grid(1))
    bands = len(relative_response)
    white = optional_numbers(request.white, bands, "white")
    measurement = measurement_of_signal(relative_response,
                                        numbers(request.signal, bands, "signal"), white,
                                        optional_numbers(request.noise, bands, "noise"))
    taken = further_measurements(request.readings, request.photos, request.same, request.more,
                                 request.sensitivity, relative_response, white)
    draws = sample_prior(joined(measurement, taken), PLAN_DRAWS, request.seed)
    chosen = plan(draws.spectra, candidates_of(request), request.steps)
    facts = {"steps": [{"measurement": step.name, "width_before": step.width_before,
                        "width_after": step.width_after, "minutes": step.minutes,
                        "fall_per_minute": step.fall_per_minute} for step in chosen],
             "taken": [measured.name for measured in taken], "outcome": draws.sentence}
    lines = [f"{step.name}: mean width of the 95 % band {step.width_before:.3f} -> "
             f"{step.width_after:.3f} in {step.minutes:g} min" for step in chosen]
    return facts, "\n".join([*lines, draws.sentence])


def candidates_of(request: PlanRequest) -> list[Candidate]:
    """Readings every 10 nm, photos under other lights or by other cameras, and a spectrometer's
    whole spectrum.
    """
    candidates = wavelength_candidates(GRID, minutes=request.reading_minutes)
    if request.spot_minutes is not None:
        rows = np.concatenate([reading.rows for reading in candidates])
        candidates.append(Candidate("spectrometer spot, 400-700 nm", rows, READING_ERROR,
                                    request.spot_minutes))
    photos = [(f"photo under {light}", request.sensitivity, light) for light in request.lights]
    photos += [(f"photo by {camera}", camera, request.light) for camera in request.cameras]
    return candidates + [photo_candidate(name, response_of_names(camera, light),
                                         request.photo_minutes)
                         for name, camera, light in photos]


def certify_answer(folders: list[Path], sensitivity: str, light: str, noise: float,
                   prior_file: Path | None,
                   lights: tuple[str, ...]) -> tuple[dict[str, Any], str]:
    """JSON object and page of ``spectrabox certify``."""
    if not 0 <= noise < 0.5:
        raise InputError(f"a relative noise of {noise:g} was given; 0 to 0.5 is needed")
    prior, relative_response = load_prior(prior_file), response_of_names(sensitivity, light)
    certificates = [certify(prior, read_library(folder), relative_response, noise, lights=lights)
                    for folder in folders]
    return ({"libraries": [_certificate_facts(certificate) for certificate in certificates],
             "prior": prior.source, "noise": noise},
            certificate_page(certificates, prior, f"{sensitivity} under {light}"))


def _certificate_facts(certificate: Certificate) -> dict[str, Any]:
    same = ("name", "curves", "left_out", "rmse", "spectral_angle", "curve_coverage", "width",
            "sharpness", "winkler", "delta_e00", "unfamiliar", "trained_on", "verdict")
    return {**{name: getattr(certificate, name) for name in same},
            "coverage": {f"{level:g}": certificate.coverage[level] for level in LEVELS},
            "coverage_standard_error": certificate.coverage_error}


def train_answer(folders: list[Path], sensitivity: str, light: str, components: int,
                 seed: int) -> tuple[dict[str, Any], str, LogitMixture]:
    """JSON object, text and prior of ``spectrabox prior train``."""
    if not 1 <= components <= 64:
        raise InputError(f"{components} components were asked for; 1 to 64 are possible")
    libraries = [read_library(folder) for folder in folders]
    prior, judged = train(libraries, response_of_names(sensitivity, light), components, seed)
    rows = [left_out_facts(prior, library) for library in judged]
    lines = [f"{'left out':<20} {'curves':>6} {'RMSE':>7} {'95 % band holds':>16} {'width':>6} "
             f"{'whole curves':>13}"]
    lines += [f"{row['name']:<20} {row['curves']:6d} {row['rmse']:7.4f} {row['coverage']:16.3f} "
              f"{row['width']:6.3f} {row['curve_coverage']:13.3f}" for row in rows]
    lines += [f"{library.name}: left out {count} curves, {reason}" for library in libraries
              for reason, count in library.left_out.items()]
    facts = {"left_out_in_turn": rows,
             "band_factors": dict(zip(map(str, prior.levels.tolist()), prior.band_factors.tolist(),
                                      strict=True)), "curve_factor": prior.curve_factor,
             "source": prior.source}
    return facts, "\n".join(lines), prior


def left_out_facts(prior: LogitMixture, library: LeftOut) -> dict[str, Any]:
    """What the calibrated prior did on a library left out, at its calibrated 95 % band."""
    at_95 = int(np.argmin(np.abs(prior.levels - 0.95)))
    factor, scores = prior.band_factors[at_95], library.scores[at_95]
    return {"name": library.name, "curves": library.curves, "rmse": library.rmse,
            "coverage": float(np.mean(scores <= factor)),
            "width": float(library.width[at_95] * factor),
            "curve_coverage": float(np.mean(scores.max(axis=1) <= prior.curve_factor))}


def uplift_answer(signals: np.ndarray, sensitivity: str, light: str, noise: float,
                  side: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Mean and standard deviation (H, W, 61) of an image's signals (H, W, K) and the share outside
    0 to 1.
    """
    relative_response = response_of_names(sensitivity, light)
    if signals.shape[2] != len(relative_response):
        raise InputError(f"the image has {signals.shape[2]} bands and the sensitivities "
                         f"{len(relative_response)}")
    flat = np.nan_to_num(signals.reshape(-1, len(relative_response)).astype(float))
    prior = load_prior()
    small = len(flat) < side**3 or len(relative_response) != 3
    mean, spread = (uplift_directly(prior, relative_response, np.clip(flat, 0, 1), noise) if small
                    else uplift_pixels(build_table(prior, relative_response, noise, side), flat))
    shape = (*signals.shape[:2], GRID.nm.size)
    return mean.reshape(shape), spread.reshape(shape), float(outside(flat).mean())
