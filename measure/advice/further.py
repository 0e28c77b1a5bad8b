"""A surface with one measurement more: a photo through a filter, under another lamp, a reading."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from spectrabox.measure.advice.forecast import Unknown, total_covariance
from spectrabox.measure.more_bands.filter_fit import FurtherPhoto
from spectrabox.measure.more_bands.joined_errors import ChartFitted, joined_errors
from spectrabox.measure.regions.moved_lamp import LEVEL
from spectrabox.measure.surfaces.surface_signals import FEW_BANDS, measurement
from spectrabox.radiometry import error_model, gloss, grid
from spectrabox.radiometry.covariance import block_diagonal
from spectrabox.radiometry.records import spectra
from spectrabox.sampling.further.more_measurements import Reading
from spectrabox.sampling.prior.mixture import PRIOR_GRID
from spectrabox.sampling.summary import READING_ERROR


def with_reading(unknown: Unknown, nm: float) -> spectra.SurfaceSignals:
    """A surface whose reflectance is read at one wavelength.

    Parameters
    ----------
    unknown : Unknown
    nm : float
    """
    now = unknown.signals
    row = Reading.at_wavelength(nm, 0.0).row(now.grid)
    causes = {cause: block_diagonal(covariance[0], np.zeros((1, 1)))
              for cause, covariance in now.errors.items()}
    causes[error_model.PHOTO_NOISE] = causes.get(error_model.PHOTO_NOISE, 0.0) + block_diagonal(
        np.zeros_like(total_covariance(now)), np.array([[READING_ERROR**2]]))
    return _with_bands(now, row[None], causes, tuple(_pad(states, 1) for states in now.states),
                       np.zeros(1))


def may_add_photos(unknown: Unknown, bands: int, fitted: ChartFitted | None) -> bool:
    """Whether what further photos err by is known of a surface: there is one photo, which shows it
    in all its bands, and they are few; of signals whose errors are noise alone always.

    Parameters
    ----------
    unknown : Unknown
    bands : int
        Of a photo.
    fitted : ChartFitted or None
        As of `with_photos`.
    """
    return fitted is None or (bool(np.isfinite(unknown.signals.signal).all())
                              and unknown.signals.signal.size == bands <= FEW_BANDS)


def with_photos(unknown: Unknown, photos: Sequence[FurtherPhoto], white: np.ndarray,
                fitted: ChartFitted | None) -> spectra.SurfaceSignals | None:
    """A surface in further photos through filters or under other lamps; None where what it mirrors
    under another lamp is not known.

    Parameters
    ----------
    unknown : Unknown
        Whose first bands are those of the photo that filters are used under.
    photos : sequence of FurtherPhoto
    white : (K,) array
        Signal of white in the first photo, that of the brightest band being 1.
    fitted : ChartFitted or None
        None: photos err by noise alone.
    """
    now = replace(unknown.signals, states=())
    measured = measurement(now, 0)
    spectrum = grid.interpolation_matrix(PRIOR_GRID.nm, now.grid.nm) @ unknown.spectrum
    response, signal, errors = joined_errors(now, spectrum, photos, white, fitted)
    further = response[measured.signal.size:]
    seen = [photo.same_lamp for photo in photos for dark in np.isin(
        np.arange(len(white)), photo.dark) if not dark]
    states = _states_with(unknown.signals.states, further @ spectrum, now.signal[0], seen,
                          unknown.stated)
    causes = {
        error_model.PHOTO_NOISE: errors.absolute, error_model.LIGHT_SCALE:
        error_model.proportional_covariance(signal, errors.relative)
    }
    return None if states is None else _with_bands(unknown.signals, further, causes, states,
                                                   signal[measured.signal.size:])


def _states_with(states: tuple[spectra.CaptureStates, ...], further: np.ndarray, signal: np.ndarray,
                 same_lamp: Sequence[bool],
                 stated: str | None) -> tuple[spectra.CaptureStates, ...] | None:
    """What the capture may add to the bands of further photos too, by their signals (n,)."""
    if not states:
        return ()
    own = states[0]
    if all(same_lamp):
        scale = np.where([name.startswith(LEVEL) for name in own.names],
                         further[:, None] / signal[0], 1.0)
        return (replace(own, pattern=np.vstack([own.pattern, scale * own.pattern[0]])),)
    if any(name.startswith(LEVEL) for name in own.names) or not own.pattern.any():
        return None
    lamps = [own.names[int(row.argmax())] for row in own.pattern]
    return (gloss.gloss_states(stated,
                               lamps + [lamps[0] if same else "another" for same in same_lamp]),)


def _with_bands(now: spectra.SurfaceSignals, response: np.ndarray, causes: Mapping[str, np.ndarray],
                states: tuple[spectra.CaptureStates,
                              ...], signals: np.ndarray) -> spectra.SurfaceSignals:
    """The surface with bands of these responses (n, P) added, with the covariances (J, J) of all
    errors by cause about its signals and some (n,) of these bands, which are not there yet.
    """
    count = len(response)
    return replace(
        now, bands=now.bands + tuple(f"further {number + 1}" for number in range(count)),
        view_of_band=np.r_[now.view_of_band, np.full(count, now.view_of_band.max() + 1)],
        response=np.vstack([now.response, response]),
        signal=np.hstack([now.signal, signals[None]]),
        errors={cause: covariance[None] for cause, covariance in causes.items()}, states=states)


def _pad(states: spectra.CaptureStates, bands: int) -> spectra.CaptureStates:
    """The same, of bands more to which nothing is added."""
    return states.through(np.eye(len(states.pattern) + bands, len(states.pattern)))
