"""What to measure next of a surface: readings and photos, the best first, from draws of its
reflectance.
"""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from spectrabox.measure.more_bands.further_photos import FurtherPhoto
from spectrabox.measure.more_bands.second_photo import KnownSurface, SecondPhoto, forecasts
from spectrabox.radiometry.records.spectra import SpectralMeasurement
from spectrabox.sampling.further.planner import (
    READING_ERROR,
    Candidate,
    PlannedStep,
    photo_candidate,
    plan,
    wavelength_candidates,
)
from spectrabox.sampling.prior.mixture import PRIOR_GRID, load_prior
from spectrabox.sampling.prior.signal_posterior import sample_prior

PLAN_DRAWS = 2000
PAIRED = 4              # best filters, of which every pair is tried


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
                photos: Sequence[FurtherPhoto], white: np.ndarray, steps: int, seed: int
                ) -> tuple[list[PlannedStep], list[SecondPhoto], str]:
    """The best measurements of a signal's surface in order, and further photos ranked.

    Parameters
    ----------
    measurement : SpectralMeasurement
        The signal with all that has been measured so far.
    candidates : list of Candidate
    photos : sequence of FurtherPhoto
    white : (K,) array
        Signal of white in the photo of the signal, that of the brightest band being 1.
    steps : int
        Measurements to choose.
    seed : int

    Returns
    -------
    chosen : list of PlannedStep
    photos : list of SecondPhoto
    outcome : str
        How the draws ended.

    Raises
    ------
    InputError, ConvergenceError
    """
    draws = sample_prior(measurement, PLAN_DRAWS, seed)
    known = KnownSurface(load_prior(), measurement, draws.spectra)
    return (plan(draws.spectra, candidates, steps),
            rank_photos({"": known}, photos, white)[1], draws.sentence)


def rank_photos(surfaces: Mapping[str, KnownSurface], photos: Sequence[FurtherPhoto],
                white: np.ndarray) -> tuple[dict[str, list[SecondPhoto]], list[SecondPhoto]]:
    """Further photos and pairs of the best filters, the best first: for each surface, and on
    average over them.

    Parameters
    ----------
    surfaces : mapping
        By name.
    photos : sequence of FurtherPhoto
    white : (K,) array
        Signal of white in the first photo, that of the brightest band being 1.
    """
    each = {name: forecasts(surface, [[photo] for photo in photos], white)
            for name, surface in surfaces.items()}
    filters = {photo.name: photo for photo in photos if photo.filter is not None}
    best = [filters[step.name] for step in _averages(each) if step.name in filters][:PAIRED]
    pairs = [[first, second] for number, first in enumerate(best) for second in best[number + 1:]]
    if pairs:
        for name, surface in surfaces.items():
            each[name] += forecasts(surface, pairs, white)
    return ({name: sorted(steps, key=lambda step: step.rmse_after)
             for name, steps in each.items()}, _averages(each))


def _averages(rankings: Mapping[str, Sequence[SecondPhoto]]) -> list[SecondPhoto]:
    """Width and RMSE averaged over surfaces, the best first."""
    columns = zip(*rankings.values(), strict=True)
    means = [replace(steps[0], **{key: float(np.mean([getattr(step, key) for step in steps]))
                                  for key in ("width_before", "width_after", "rmse_before",
                                              "rmse_after")}) for steps in columns]
    return sorted(means, key=lambda step: step.rmse_after)
