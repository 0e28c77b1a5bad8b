"""Whether to trust a fit: colour differences, what the light leaves open, what is the prior's."""
from __future__ import annotations

import numpy as np

from spectrabox.calibrate.chart_equations import ChartEquations
from spectrabox.calibrate.prior.camera_prior import CameraPrior
from spectrabox.calibrate.prior.prior_fit import posterior_of_curves
from spectrabox.calibrate.sensitivity import PriorFit, fit_with_prior
from spectrabox.radiometry.appearance import ciede2000, decode_srgb, lab_from_xyz, tristimulus
from spectrabox.radiometry.records import LinearImage, WavelengthGrid

FROM_PRIOR = 0.5             # share of the prior's uncertainty left, above which the prior decides
MUCH_GLARE = 0.02            # of the brightest patch
GLARE_SIGMA = 3.0            # of a band: nearer to 0 none is claimed
PROBABLE = 0.05              # families below are not named
CLEAR_GAIN = 20.0            # of log evidence, for another reading of the photo


def chart_colour_differences(measured: np.ndarray, predicted: np.ndarray, reflectances: np.ndarray,
                             grid: WavelengthGrid) -> np.ndarray:
    """CIEDE2000 (I,) between what the photo shows and what the fit predicts, under D65.

    Signals are turned into colours by the linear map that best takes the predicted signals to the
    tristimulus values of the reference reflectances.

    Parameters
    ----------
    measured, predicted : (I, K) arrays
        Signals of the patches.
    reflectances : (I, P) array
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    """
    true = np.array([tristimulus(grid.nm, reflectance) for reflectance in reflectances])
    white = tristimulus(grid.nm, np.ones(grid.nm.size))
    to_xyz, *_ = np.linalg.lstsq(predicted, true, rcond=None)
    return ciede2000(lab_from_xyz(measured @ to_xyz, white),
                     lab_from_xyz(predicted @ to_xyz, white))


def other_reading(photo: ChartEquations, prior: CameraPrior, grid: WavelengthGrid) -> str | None:
    """Another reading of a photo under which some camera would explain it; None if there is none.

    Mirrored, turned, with bands reversed, decoded, or with glare taken off. The reading that gains
    most evidence is named only if the fit then agrees: of a wrong chart one reading is always the
    best, and none is right.

    Parameters
    ----------
    photo : ChartEquations
        No reading is tried where patches were left out.
    prior : CameraPrior
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    """
    if photo.rows is None:
        return None
    order = np.arange(len(photo.signal)).reshape(photo.rows, -1)
    readings = {
        "mirrored left to right": photo.signal[order[:, ::-1].ravel()],
        "mirrored top to bottom": photo.signal[order[::-1].ravel()],
        "turned by 180 degrees": photo.signal[order[::-1, ::-1].ravel()],
        "bands in reverse order (BGR)": photo.signal[:, ::-1],
        # white is taken to read 0.95 of full scale
        "an encoded (sRGB) picture instead of a linear one": decode_srgb(
            0.95 * photo.signal / photo.signal.max())}
    if (shaded := _without_glare(photo)) is not None:
        readings["a photo with much glare, or with a wrong black level,"] = shaded
    evidence = {name: _evidence(photo, signal, prior, grid) for name, signal in readings.items()}
    best = max(evidence, key=lambda name: evidence[name])
    if evidence[best] - _evidence(photo, photo.signal, prior, grid) < CLEAR_GAIN:
        return None
    return None if fit_with_prior([_read(photo, readings[best])], prior, grid).disagrees else best


def sentences(fit: PriorFit, grid: WavelengthGrid) -> tuple[str, ...]:
    """What the operator should know before trusting the curves, in sentences.

    Parameters
    ----------
    fit : PriorFit
    grid : WavelengthGrid
        Of its curves.
    """
    notes = [f"patches and model agree within {fit.model_error:.1%} (chi-square "
            f"{fit.chi_square:.2f} per signal)"]
    likely = [(members, share) for members, share in fit.families if share > PROBABLE][:3]
    if likely:
        notes.append("most like " + "; ".join(f"{members} ({share:.0%})"
                                             for members, share in likely))
    held = fit.prior_share > FROM_PRIOR
    for band in range(len(held)):
        if likely and held[band].any():     # products with a lamp's lines rest on it everywhere
            notes.append(f"band {band + 1} rests on the prior over {_ranges(held[band], grid)}")
    for number, state in enumerate(fit.photos, start=1):
        which = "" if len(fit.photos) == 1 else f"photo {number}: "
        if np.ptp(state.field) > 0:
            low, high = np.array([state.field.min(), state.field.max()]) / state.field.mean()
            notes.append(f"{which}illumination over the chart runs from {low:.2f} to "
                        f"{high:.2f} of its mean")
        certain = np.abs(state.glare) > GLARE_SIGMA * state.glare_error
        glare = float(np.max(np.abs(state.glare) / state.predicted.max(axis=0), where=certain,
                             initial=0.0))
        if glare > MUCH_GLARE:
            notes.append(f"{which}glare or a wrong black level of {glare:.0%} of the brightest "
                         "patch was estimated and subtracted: shade the lens and check the dark "
                         "frame")
    return tuple(notes)


def _ranges(chosen: np.ndarray, grid: WavelengthGrid) -> str:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(int))).reshape(
        -1, 2)
    return ", ".join(f"{grid.nm[start]:g}-{grid.nm[stop - 1]:g} nm" for start, stop in edges)


def _evidence(photo: ChartEquations, signal: np.ndarray, prior: CameraPrior,
              grid: WavelengthGrid) -> float:
    # of log signals, so that readings of any scale compare
    logarithms = np.log(np.maximum(signal, 1e-12)).sum()
    return posterior_of_curves([_read(photo, signal)], prior, grid).log_evidence + float(logarithms)


def _read(photo: ChartEquations, signal: np.ndarray) -> ChartEquations:
    return ChartEquations(signal, photo.covariance, photo.reflectances, photo.power,
                          photo.irradiance, photo.field_terms, photo.glare, rows=photo.rows)


def _without_glare(photo: ChartEquations) -> np.ndarray | None:
    """Signals less an offset in each band.

    It leaves the darkest patch what it reflects of the lightest patch's light. None where that
    patch does not read darker.
    """
    grey = photo.reflectances.mean(axis=1)
    darkest, lightest = int(np.argmin(grey)), int(np.argmax(grey))
    if np.any(photo.signal[darkest] >= photo.signal[lightest]):
        return None
    ratio = grey[darkest] / grey[lightest]
    offset = (photo.signal[darkest] - ratio * photo.signal[lightest]) / (1 - ratio)
    return np.maximum(photo.signal - offset, 1e-3 * photo.signal[lightest])


def certain_glare(fit: PriorFit | None, chart_photo: LinearImage) -> np.ndarray:
    """Glare (K,) of the first chart photo in the bands where it is beyond chance, of the picture's
    mean signal; 0 where no fit tells.
    """
    if fit is None:
        return np.zeros(1)
    state = fit.photos[0]
    certain = np.abs(state.glare) > GLARE_SIGMA * state.glare_error
    return np.where(certain, np.abs(state.glare) / chart_photo.signal.mean(axis=(0, 1)), 0.0)
