"""Which reading to take next: expected fall of the band's width per minute of the operator's time.

Linear-Gaussian, from draws of the posterior: with spectral covariance C, a reading m with variance
s^2 leaves C - C m m' C / (m' C m + s^2), whatever it will read. A second photo under another light
brings K rows at once. Readings are chosen greedily, each given those before it.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.records.spectra import WavelengthGrid

READING_MINUTES, PHOTO_MINUTES = 2.0, 5.0
READING_ERROR, PHOTO_ERROR = 0.005, 0.005
STEP_NM = 10.0              # between spot readings
NORMAL_95 = 1.959964


@dataclass(frozen=True)
class Candidate:
    """One possible measurement: rows (J, P) on the reflectance, error of each, minutes it takes."""

    name: str
    rows: np.ndarray
    standard_error: float
    minutes: float


@dataclass(frozen=True)
class PlannedStep:
    """One measurement of a plan: mean width of the 95 % band and expected RMSE of the mean, before
    and after, and minutes.
    """

    name: str
    width_before: float
    width_after: float
    rmse_before: float
    rmse_after: float
    minutes: float

    @property
    def fall_per_minute(self) -> float:
        """Fall of the mean band width per minute."""
        return (self.width_before - self.width_after) / self.minutes


def wavelength_candidates(grid: WavelengthGrid,
                          minutes: float = READING_MINUTES) -> list[Candidate]:
    """Spot readings every 10 nm.

    Parameters
    ----------
    grid : WavelengthGrid
        Of P wavelengths.
    minutes : float
        That a reading takes the operator.
    """
    wanted = np.arange(grid.nm[0], grid.nm[-1] + 1e-9, STEP_NM)
    return [Candidate(f"reading at {nm:.0f} nm",
                      np.eye(grid.nm.size)[[int(np.argmin(np.abs(grid.nm - nm)))]], READING_ERROR,
                      minutes) for nm in wanted]


def photo_candidate(name: str, relative_response: np.ndarray, minutes: float = PHOTO_MINUTES
                    ) -> Candidate:
    """Another photo, such as one under another light, by its relative response (K, P).

    Rows sum to 1.

    Parameters
    ----------
    name : str
    relative_response : (K, P) array
        Of camera and light; rows summing to 1.
    minutes : float
        That the photo takes the operator.
    """
    return Candidate(name, relative_response, PHOTO_ERROR, minutes)


def plan(spectra: np.ndarray, candidates: list[Candidate], steps: int = 3) -> list[PlannedStep]:
    """The best ``steps`` measurements in order, from draws (T, P) of the posterior.

    Parameters
    ----------
    spectra : (T, P) array
        At least 100 draws of the posterior.
    candidates : list of Candidate
    steps : int
        Number of measurements.

    Raises
    ------
    InputError
        For fewer than 100 draws, no candidates, or steps below 1.
    """
    if len(spectra) < 100:
        raise InputError(f"{len(spectra)} draws are too few to plan with; draw at least 100")
    if not candidates or steps < 1:
        raise InputError("nothing to plan: give at least one candidate and one step")
    covariance = np.cov(spectra, rowvar=False)
    chosen = []
    for _ in range(steps):
        options = ranked(covariance, candidates)
        chosen.append(options[0])
        best = next(candidate for candidate in candidates if candidate.name == options[0].name)
        covariance = after(covariance, best)
    return chosen


def ranked(covariance: np.ndarray, candidates: list[Candidate]) -> list[PlannedStep]:
    """All candidates, best fall per minute first.

    Parameters
    ----------
    covariance : (P, P) array
        Of the reflectance.
    candidates : list of Candidate
    """
    options = []
    for candidate in candidates:
        left = after(covariance, candidate)
        options.append(PlannedStep(candidate.name, mean_width(covariance), mean_width(left),
                                   expected_rmse(covariance), expected_rmse(left),
                                   candidate.minutes))
    return sorted(options, key=lambda option: -option.fall_per_minute)


def after(covariance: np.ndarray, candidate: Candidate) -> np.ndarray:
    """Covariance (P, P) once the candidate has been measured.

    Parameters
    ----------
    covariance : (P, P) array
        Of the reflectance before it.
    candidate : Candidate
    """
    base = covariance @ candidate.rows.T
    Q = candidate.rows @ base + candidate.standard_error**2 * np.eye(len(candidate.rows))
    return covariance - base @ np.linalg.solve(Q, base.T)


def mean_width(covariance: np.ndarray) -> float:
    """Mean width of the 95 % band of a Gaussian with this covariance.

    Parameters
    ----------
    covariance : (P, P) array
        Of the reflectance.
    """
    return float(2 * NORMAL_95 * np.sqrt(np.maximum(np.diag(covariance), 0)).mean())


def expected_rmse(covariance: np.ndarray) -> float:
    """Root of the mean square error, over wavelengths, of a mean with this covariance.

    Parameters
    ----------
    covariance : (P, P) array
        Of the reflectance.
    """
    return float(np.sqrt(np.maximum(np.diag(covariance), 0).mean()))
