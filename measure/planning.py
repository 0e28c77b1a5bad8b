"""What to measure next of a surface: readings and photos, the best first, from draws of its
reflectance.
"""
from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from spectrabox.measure.second_photo import LampsAtHand, lamp_candidates
from spectrabox.radiometry.records import SpectralMeasurement, WavelengthGrid
from spectrabox.sampling.further.planner import (
    READING_ERROR,
    Candidate,
    PlannedStep,
    photo_candidate,
    plan,
    ranked,
    wavelength_candidates,
)
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.sampling.prior.signal_posterior import sample_prior

PLAN_DRAWS = 2000


def next_reading_candidates(other_photos: Mapping[str, np.ndarray], *, reading_minutes: float,
                            photo_minutes: float, spot_minutes: float | None) -> list[Candidate]:
    """Readings every 10 nm, other photos, and a spectrometer's whole spectrum.

    Parameters
    ----------
    other_photos : mapping of (K, 61) arrays
        Relative responses by name.
    reading_minutes, photo_minutes : float
        That one reading and one photo take.
    spot_minutes : float, optional
        That a spectrometer takes; None where there is none.
    """
    candidates = wavelength_candidates(PRIOR_GRID, minutes=reading_minutes)
    if spot_minutes is not None:
        rows = np.concatenate([reading.rows for reading in candidates])
        candidates.append(Candidate("spectrometer spot, 400-700 nm", rows, READING_ERROR,
                                    spot_minutes))
    return candidates + [photo_candidate(name, response, photo_minutes)
                         for name, response in other_photos.items()]


def plan_signal(measurement: SpectralMeasurement, candidates: list[Candidate],
                second: list[Candidate], steps: int, seed: int
                ) -> tuple[list[PlannedStep], list[PlannedStep], str]:
    """The best measurements of a signal's surface in order, and second photos ranked.

    Parameters
    ----------
    measurement : SpectralMeasurement
        The signal with all that has been measured so far.
    candidates, second : list of Candidate
    steps : int
        Measurements to choose.
    seed : int

    Returns
    -------
    chosen, photos : list of PlannedStep
    outcome : str
        How the draws ended.

    Raises
    ------
    InputError, ConvergenceError
    """
    draws = sample_prior(measurement, PLAN_DRAWS, seed)
    return (plan(draws.spectra, candidates, steps),
            ranked(np.cov(draws.spectra, rowvar=False), second), draws.sentence)


def rank_second_photos(spectra: np.ndarray, grid: WavelengthGrid,
                       measurement: SpectralMeasurement, curves: np.ndarray, present: np.ndarray,
                       second: LampsAtHand) -> list[PlannedStep]:
    """Second photos of one surface, the best first.

    Parameters
    ----------
    spectra : (T, P) array
        Draws of its reflectance.
    grid : WavelengthGrid
        Of the draws.
    measurement : SpectralMeasurement
        Whose noise a second photo has too.
    curves, present, second
        As in `lamp_candidates`.
    """
    error = float(np.sqrt(np.mean(np.diag(measurement.noise_covariance))))
    return ranked(np.cov(spectra, rowvar=False), lamp_candidates(
        curves, present, grid, second, standard_error=error))


def mean_over_surfaces(rankings: list[list[PlannedStep]]) -> list[PlannedStep]:
    """Width and RMSE with each second photo, averaged over surfaces, the best first.

    Parameters
    ----------
    rankings : list of lists of PlannedStep
        One a surface, from `rank_second_photos`.
    """
    by_name = {step.name: [each for ranking in rankings for each in ranking
                           if each.name == step.name] for step in rankings[0]}
    averages = [PlannedStep(name, *(float(np.mean([getattr(step, key) for step in steps]))
                                    for key in ("width_before", "width_after", "rmse_before",
                                                "rmse_after", "minutes")))
                for name, steps in by_name.items()]
    return sorted(averages, key=lambda step: step.rmse_after)
