"""What the photos say of every surface: the record in which flat samples and scenes end."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from spectrabox.measure.surfaces.colour_comparison import independent_bands
from spectrabox.radiometry import error_model, gloss
from spectrabox.radiometry.covariance import symmetric, symmetric_root
from spectrabox.radiometry.records import calibration, scenes, spectra
from spectrabox.sampling import spectral_measurement

FEW_BANDS = 12      # whose signals draws reach one by one
# correlation of the light scales of photos between which a lamp was moved: chart and card are the
# same, how they are lit is not
SHARED_SCALE = 0.5


def scene_signals(joint: scenes.JointReconstruction,
                  calibrations: Sequence[calibration.Calibration]) -> spectra.SurfaceSignals:
    """The signals of all materials of a scene, with their errors.

    Parameters
    ----------
    joint : JointReconstruction
    calibrations : sequence of Calibration
        Of every view, in the order of ``joint.views``.
    """
    signals = spectra.SurfaceSignals(joint.materials, joint.known, joint.grid, joint.spectra,
                                     joint.bands, joint.view_of_band, joint.response, joint.signal,
                                     {}, _gloss_of(joint))
    views = np.unique(joint.view_of_band)
    scales = [error_model.scale_covariances(calibrations[view], joint.views[view].light_scale)
              for view in views]
    bands = len(calibrations[0].sensitivity.curves)
    none = np.zeros((bands, bands))
    # lamps of one spectrum are one lamp that was moved
    responses = [joint.response[joint.view_of_band == view] for view in views]
    shared = np.kron([[1.0 if one is other else SHARED_SCALE * np.array_equal(one, other)
                       for other in responses] for one in responses], np.ones((bands, bands)))
    causes = {error_model.RENDERING_NOISE: joint.signal_covariance,
              error_model.SENSITIVITIES: error_model.sensitivity_covariance(calibrations, signals),
              error_model.LIGHT_SPECTRUM: error_model.light_covariance(calibrations, signals)}
    for cause in dict.fromkeys(cause for parts in scales for cause in parts):
        roots = np.vstack([symmetric_root(parts.get(cause, none)) for parts in scales])
        relative = (1.0 if error_model.CAUSES[cause].photos else shared) * (roots @ roots.T)
        causes[cause] = error_model.proportional_covariance(joint.signal, relative)
    for cause, relative in joint.stray_light.items():
        causes[cause] = error_model.added_covariance(relative * joint.signal, joint.view_of_band)
    causes[error_model.DISAGREEMENT] = error_model.proportional_covariance(
        joint.signal, joint.model_covariance)
    return replace(signals, errors=causes)


def _gloss_of(joint: scenes.JointReconstruction) -> tuple[spectra.CaptureStates, ...]:
    """What each material may mirror under each lamp in its place; none where the scene says it of
    all.
    """
    if not joint.gloss:
        return ()
    lamps = [joint.lamps[view] if joint.lamps else str(view) for view in joint.view_of_band]
    glosses = [gloss.gloss_states(joint.gloss.get(name), lamps) for name in joint.materials]
    return tuple(gloss if name in joint.gloss else gloss.through(np.zeros((len(lamps),) * 2))
                 for name, gloss in zip(joint.materials, glosses, strict=True))


def alone(signals: spectra.SurfaceSignals, index: int) -> spectra.SurfaceSignals:
    """The signals of one surface.

    Parameters
    ----------
    signals : SurfaceSignals
    index : int
        Of the surface.
    """
    own = slice(index, index + 1)
    return replace(signals, names=signals.names[own], known=signals.known[own],
                   spectra=signals.spectra[own], signal=signals.signal[own],
                   errors={cause: covariance[own]
                           for cause, covariance in signals.errors.items()},
                   states=signals.states[own])


def errors_by_cause(signals: spectra.SurfaceSignals, index: int) -> dict[str, np.ndarray]:
    """Covariance by cause of the signal of ``measurement``; they add up to its noise, which is
    without what the states of the capture add.

    Parameters
    ----------
    index : int
        Of the surface.
    """
    _, _, gain = _independent(signals, index)
    return {cause: gain @ covariance @ gain.T
            for cause, covariance in _errors_in_bands(signals, index).items()}


def measurement(signals: spectra.SurfaceSignals, index: int) -> spectra.SpectralMeasurement:
    """What the photos said of one surface, in bands that show it and do not depend on each other.

    Parameters
    ----------
    index : int
        Of the surface.
    """
    seen, chosen, gain = _independent(signals, index)
    causes, states = _errors_in_bands(signals, index), _states_in_bands(signals, index)
    signal, total = signals.signal[index][seen], np.sum(list(causes.values()), axis=0)
    errors = error_model.split_errors(signal, causes)
    different, repeated = spectral_measurement.different_bands(signals.response[seen])
    reduced, noise, multiplies = spectral_measurement.reduced_errors(
        gain, repeated, signal, total, errors.relative) \
        if np.array_equal(chosen, different) else (
            gain @ signal, symmetric(gain @ total @ gain.T), errors.of_sums(gain, signal).relative)
    return spectra.SpectralMeasurement(
        signals.grid, signals.response[seen][chosen], reduced, noise,
        None if states is None else states.through(gain),
        multiplies if multiplies is not None and multiplies.any() else None)


def _independent(signals: spectra.SurfaceSignals,
                 index: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Indices of the bands that show a surface, among them of those that do not depend on each
    other, and the gain that estimates their signals from all; of few bands all that are different,
    and with states of the capture all.
    """
    seen = np.flatnonzero(np.isfinite(signals.signal[index]))
    different, repeated = spectral_measurement.different_bands(signals.response[seen])
    if seen.size <= FEW_BANDS and (signals.states or different.size == seen.size):
        return seen, np.arange(seen.size), np.eye(seen.size)
    causes, signal = _errors_in_bands(signals, index), signals.signal[index][seen]
    errors = error_model.split_errors(signal, causes)
    # Errors in proportion to what is expected: in proportion to what was read, a reading that is
    # too dark would count for more, and sums come out dark.
    expected = np.maximum(signals.response[seen] @ signals.spectra[index], 0)
    total = np.sum(list(with_added(causes, _states_in_bands(signals, index)).values()), axis=0) \
        + errors.total(expected) - errors.total(signal)
    if seen.size <= FEW_BANDS:
        return seen, different, spectral_measurement.gain_of_different(total, repeated)
    return seen, *independent_bands(signals.response[seen], symmetric(total))


def _errors_in_bands(signals: spectra.SurfaceSignals, index: int) -> dict[str, np.ndarray]:
    """Covariance of one surface's signal by cause, in the bands that show it."""
    seen = np.flatnonzero(np.isfinite(signals.signal[index]))
    return {cause: covariance[index][np.ix_(seen, seen)]
            for cause, covariance in signals.errors.items()}


def _states_in_bands(signals: spectra.SurfaceSignals, index: int) -> spectra.CaptureStates | None:
    """What one surface's capture may have added to its signal, in the bands that show it."""
    seen = np.isfinite(signals.signal[index])
    return signals.states[index].through(np.eye(seen.size)[seen]) if signals.states else None


def with_added(causes: Mapping[str, np.ndarray],
               states: spectra.CaptureStates | None) -> dict[str, np.ndarray]:
    """Covariances (K, K) by cause, with those of what the states of the capture add.

    Parameters
    ----------
    causes : mapping of (K, K) arrays
    states : CaptureStates or None
        Of the same bands.
    """
    together = dict(causes)
    for cause, covariance in ({} if states is None else spectra.added_by_cause(states)).items():
        together[cause] = together.get(cause, 0.0) + covariance
    return together


def relative_errors(signals: spectra.SurfaceSignals, index: int) -> dict[str, np.ndarray]:
    """Relative standard error of one surface's signal by cause, in the bands that show it.

    Parameters
    ----------
    index : int
        Of the surface.
    """
    value = signals.signal[index][np.isfinite(signals.signal[index])]
    causes = with_added(_errors_in_bands(signals, index), _states_in_bands(signals, index))
    return {cause: np.sqrt(np.diag(covariance)) / value for cause, covariance in causes.items()}


def noise_and_disagreement(signals: spectra.SurfaceSignals,
                           index: int) -> tuple[np.ndarray, np.ndarray]:
    """Covariance (J, J) of one surface's signal by noise, and relative by the disagreement of photo
    and model; NaN in bands that do not show it.

    Parameters
    ----------
    signals : SurfaceSignals
    index : int
        Of the surface.
    """
    signal = signals.signal[index]
    errors = signals.errors
    noise = errors[error_model.PHOTO_NOISE if error_model.PHOTO_NOISE in
                   errors else error_model.RENDERING_NOISE]
    with np.errstate(invalid="ignore"):
        return noise[index], errors[error_model.DISAGREEMENT][index] / np.outer(signal, signal)
