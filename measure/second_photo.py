"""What a second photo under another lamp or through a filter would add to the first.

Linear-Gaussian, as in planner.py: the photo's bands are new rows on the covariance of the draws. A
second photo is taken to be as noisy as the first and to err independently of it. Where the light of
a session is unknown, the camera's own curves are the products over the light's posterior mean.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID, interpolation_matrix
from spectrabox.radiometry.records import Calibration, WavelengthGrid
from spectrabox.radiometry.spectra.spectrum_files import on_grid, spectrum_on_grid
from spectrabox.sampling.further.planner import (
    PHOTO_ERROR,
    PHOTO_MINUTES,
    Candidate,
    photo_candidate,
)

DARK = 1e-3             # of the brightest: no curve is divided by a light below it


@dataclass(frozen=True)
class LampsAtHand:
    """Lamps, and filters for the present light, by name."""

    lamps: dict[str, np.ndarray]        # (301,) spectra at 400, 401 ... 700 nm, any unit
    filters: dict[str, np.ndarray]      # (301,) transmittances


def lamp_candidates(curves: np.ndarray, present: np.ndarray, grid: WavelengthGrid,
                    hand: LampsAtHand, *, standard_error: float = PHOTO_ERROR,
                    minutes: float = PHOTO_MINUTES) -> list[Candidate]:
    """A second photo under each lamp and through each filter.

    Parameters
    ----------
    curves : (K, 301) array
        Sensitivities at 400, 401 ... 700 nm.
    present : (301,) array
        The light that filters are used under.
    grid : WavelengthGrid
        Of the draws.
    hand : LampsAtHand
    standard_error : float
        Of a photo's signal, of white.
    minutes : float
        Of a photo.
    """
    to_draws = interpolation_matrix(grid.nm, FINE_GRID.nm)
    filtered = {name: present * passed for name, passed in hand.filters.items()}
    candidates = []
    for name, light in (hand.lamps | filtered).items():
        rows = curves * light * FINE_GRID.weights_nm
        total = rows.sum(axis=1, keepdims=True)
        if np.any(total <= 0):
            raise InputError(f"a band of the camera sees nothing with {name}; leave it out")
        candidates.append(photo_candidate(name, rows / total @ to_draws, minutes, standard_error))
    return candidates


def curves_and_light(calibration: Calibration) -> tuple[np.ndarray, np.ndarray]:
    """Sensitivities (K, 301) and the light (301,) of a calibration.

    Parameters
    ----------
    calibration : Calibration
    """
    fit = calibration.sensitivity
    curves = on_grid(fit.grid.nm, np.maximum(fit.curves, 0), FINE_GRID, "the camera's curves")
    if calibration.light_posterior is None:
        return curves, spectrum_on_grid(calibration.light, FINE_GRID)
    known = calibration.light_posterior
    light = on_grid(known.grid.nm, known.mean, FINE_GRID, "the light's posterior")
    light = np.maximum(light, DARK * light.max())
    return curves / light, light
