"""Whether to trust a fit: colour differences, what the light leaves open, what is the prior's."""
from __future__ import annotations

from dataclasses import replace

import numpy as np

from spectrabox.calibrate import chart_equations, sensitivity
from spectrabox.calibrate.chart_photo import refuse_disagreement, wavelength_ranges
from spectrabox.calibrate.prior import camera_prior, prior_fit
from spectrabox.radiometry import appearance
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records import photos, spectra

FROM_PRIOR = 0.5             # share of the prior's uncertainty left, above which the prior decides
MUCH_GLARE = 0.02            # of the brightest patch
PROBABLE = 0.05              # families below are not named
CLEAR_GAIN = 20.0            # of log evidence, for another reading of the photo
# Of the largest direction of the patches' signals: many bands have smaller ones, which hold errors
# of the patches and no colour.
COLOURS, PATCH_NOISE = 3, 0.01
DOUBTFUL = 1.5  # chi-square per signal, 72 of them: chance gives as much once in 200 photos
# What a measurement of curves may be off by: two laboratories that measure one camera differ by
# about 8 %. Added to each band (of the largest value, nm), multiplied with each band, with all
# bands alike.
LABORATORY = (0.01, 20.0, 0.06, 60.0, 0.06, 120.0)


def chart_colour_differences(measured: np.ndarray, predicted: np.ndarray, reflectances: np.ndarray,
                             grid: spectra.WavelengthGrid) -> np.ndarray:
    """CIEDE2000 (I,) between what the photo shows and what the fit predicts, under D65.

    Parameters
    ----------
    measured, predicted, reflectances, grid
        As of ``chart_colours``.
    """
    white = appearance.tristimulus(grid.nm, np.ones(grid.nm.size))
    return appearance.ciede2000(*(appearance.lab_from_xyz(xyz, white) for xyz in chart_colours(
        measured, predicted, reflectances, grid)))


def chart_colours(measured: np.ndarray, predicted: np.ndarray, reflectances: np.ndarray,
                  grid: spectra.WavelengthGrid) -> tuple[np.ndarray, np.ndarray]:
    """X, Y, Z (I, 3) under D65 of what the photo shows, and of what the fit predicts.

    Signals are turned into colours by the linear map that best takes the predicted signals to the
    tristimulus values of the reference reflectances.

    Parameters
    ----------
    measured, predicted : (I, K) arrays
        Signals of the patches; NaN where one was not measured.
    reflectances : (I, P) array
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    """
    true = np.array([appearance.tristimulus(grid.nm, reflectance) for reflectance in reflectances])
    usable = np.isfinite(predicted).all(axis=1) & np.isfinite(measured).all(axis=1)
    size = np.linalg.norm(predicted[usable], axis=0)
    few = predicted.shape[1] <= COLOURS
    to_xyz, *_ = np.linalg.lstsq(predicted[usable] / size, true[usable],
                                 rcond=None if few else PATCH_NOISE)
    to_xyz = to_xyz / size[:, None]
    return measured @ to_xyz, predicted @ to_xyz


def other_reading(photo: chart_equations.ChartEquations, prior: camera_prior.CameraPrior,
                  grid: spectra.WavelengthGrid) -> str | None:
    """Another reading of a photo under which some camera would explain it; None if there is none.

    Mirrored, turned, with bands reversed, decoded, or with glare taken off. The reading that gains
    most evidence is named only if the fit then agrees: of a wrong chart one reading is always the
    best, and none is right.

    Parameters
    ----------
    photo : ChartEquations
        No reading is tried where patches were left out, or bands of some are clipped.
    prior : CameraPrior
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    """
    if photo.rows is None or photo.clipped is not None:
        return None
    order = np.arange(len(photo.signal)).reshape(photo.rows, -1)
    readings = {
        "mirrored left to right": photo.signal[order[:, ::-1].ravel()],
        "mirrored top to bottom": photo.signal[order[::-1].ravel()],
        "turned by 180 degrees": photo.signal[order[::-1, ::-1].ravel()],
        "bands in reverse order (BGR)": photo.signal[:, ::-1],
        # white is taken to read 0.95 of full scale
        "an encoded (sRGB) picture instead of a linear one": appearance.decode_srgb(
            0.95 * photo.signal / photo.signal.max())}
    if (shaded := _without_glare(photo)) is not None:
        readings["a photo with much glare, or with a wrong black level,"] = shaded
    evidence = {name: _evidence(photo, signal, prior, grid) for name, signal in readings.items()}
    best = max(evidence, key=lambda name: evidence[name])
    if evidence[best] - _evidence(photo, photo.signal, prior, grid) < CLEAR_GAIN:
        return None
    fit = sensitivity.fit_with_prior([replace(photo, signal=readings[best])], prior, grid)
    return None if fit.disagrees else best


def check_measured_curves(photo: chart_equations.ChartEquations, curves: np.ndarray,
                          grid: spectra.WavelengthGrid) -> Finding:
    """How well measured curves (K, P) explain a chart photo.

    Exposure, illumination and glare of the photo are unknown.

    Parameters
    ----------
    photo : ChartEquations
    curves : (K, P) array
        Of any scale.
    grid : WavelengthGrid
        Working grid, of P wavelengths.

    Raises
    ------
    CheckError
        If they do not, but would if the photo were read in another way: mirrored, bands reversed,
        encoded.
    """
    # cameras that another laboratory would have measured so
    prior = camera_prior.prior_about(grid, curves, LABORATORY, "measured curves")
    fit = sensitivity.fit_with_prior([photo], prior, grid)
    if fit.chi_square < DOUBTFUL and not fit.disagrees:
        return Finding("calibration.curves-agree", Severity.INFO, values={
            "error": fit.model_error, "chi_square": fit.chi_square})
    reading = other_reading(photo, prior, grid) if fit.disagrees else None
    if reading is not None:
        refuse_disagreement("the measured curves do not explain the chart photo", photo.signal,
                            fit.held_out[0], fit.chi_square, reading)
    return Finding("calibration.curves-disagree", Severity.WARN,
                   values={"chi_square": fit.chi_square})


def fit_findings(fit: sensitivity.PriorFit, grid: spectra.WavelengthGrid) -> tuple[Finding, ...]:
    """How well a fit explains its photos, what of it is the prior's, and what it subtracted.

    Parameters
    ----------
    fit : PriorFit
    grid : WavelengthGrid
        Of its curves.
    """
    findings = [Finding("calibration.model-error", Severity.INFO, values={
        "error": fit.model_error, "chi_square": fit.chi_square})]
    likely = [[members, share] for members, share in fit.families if share > PROBABLE][:3]
    if likely:
        findings.append(Finding("calibration.nearest-cameras", Severity.INFO,
                                values={"cameras": likely}))
    held = fit.prior_share > FROM_PRIOR
    for band in range(len(held)):
        if likely and held[band].any():     # products with a lamp's lines rest on it everywhere
            findings.append(Finding("calibration.rests-on-prior", Severity.INFO, values={
                "band": band + 1,
                "ranges_nm": [list(ends) for ends in wavelength_ranges(held[band], grid)]}))
    for number, state in enumerate(fit.photos, start=1):
        photo_number = None if len(fit.photos) == 1 else number
        if np.ptp(state.field) > 0:
            low, high = np.array([state.field.min(), state.field.max()]) / state.field.mean()
            findings.append(Finding("calibration.field", Severity.INFO, values={
                "photo_number": photo_number, "low": float(low), "high": float(high)}))
        glare = float(np.max(state.certain_glare / state.predicted.max(axis=0)))
        if glare > MUCH_GLARE:
            findings.append(Finding("calibration.glare", Severity.NOTE, values={
                "photo_number": photo_number, "glare": glare}))
    return tuple(findings)


def _evidence(photo: chart_equations.ChartEquations, signal: np.ndarray,
              prior: camera_prior.CameraPrior, grid: spectra.WavelengthGrid) -> float:
    # of log signals, so that readings of any scale compare
    logarithms = np.log(np.maximum(signal, 1e-12)).sum()
    posterior = prior_fit.posterior_of_curves([replace(photo, signal=signal)], prior, grid)
    return posterior.log_evidence + float(logarithms)


def _without_glare(photo: chart_equations.ChartEquations) -> np.ndarray | None:
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


def certain_glare(fit: sensitivity.PriorFit | None, chart_photo: photos.LinearImage) -> np.ndarray:
    """Glare (K,) of the first chart photo in the bands where it is beyond chance, of the picture's
    mean signal; 0 (1,) where no fit says.

    Parameters
    ----------
    fit : PriorFit or None
    chart_photo : LinearImage
        The first that was fitted.
    """
    if fit is None:
        return np.zeros(1)
    return np.asarray(fit.photos[0].certain_glare / chart_photo.signal.mean(axis=(0, 1)))
