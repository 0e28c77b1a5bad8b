"""A whole calibration: curves, light and scale, from chart photos or from measured curves."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated

import numpy as np

from spectrabox.calibrate import (
    chart_copy,
    chart_findings,
    chart_photo,
    doubts,
    joint_estimate,
    sensitivity,
    trust,
)
from spectrabox.calibrate.chart_equations import ChartEquations
from spectrabox.calibrate.colour_drift import colour_drift
from spectrabox.calibrate.held_out_patches import PatchesWithout, in_chart_order
from spectrabox.calibrate.light_error import Departure, light_departures
from spectrabox.calibrate.prior.camera_prior import SMOOTH_SOURCE, CameraPrior
from spectrabox.calibrate.prior.curve_posterior import relit
from spectrabox.radiometry import errors, interreflection, light_scale, shaped
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.findings import Finding, Severity, worst
from spectrabox.radiometry.records import calibration as calibration_records
from spectrabox.radiometry.records import spectra
from spectrabox.radiometry.records.photos import MIN_PATCHES
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid

MIN_BANDS = 3


@dataclass(frozen=True, eq=False)
class ChartCalibration(shaped.Record):
    """A calibration with everything that led to it."""

    calibration: calibration_records.Calibration
    scale: calibration_records.LightScale           # also where the calibration has none
    predicted: Annotated[np.ndarray, "I K"]
    held_out: Annotated[np.ndarray, "I K"]          # each patch predicted from the others
    delta_e: Annotated[np.ndarray, "I"]             # CIEDE2000 of each patch, fitted
    held_out_delta_e: Annotated[np.ndarray, "I"]    # the same, the patch left out of the fit
    without: PatchesWithout                         # the first photo's patches, each left out
    # the same by fits without patches that others contradict
    cleaned: PatchesWithout
    excluded: Annotated[np.ndarray, "I"]            # bool: excluded from every fit
    saturated: Annotated[np.ndarray, "I"]           # bool: of the excluded, in every band
    reflectances: Annotated[np.ndarray, "I P"]      # that were taken for the first photo's chart
    prior_fit: sensitivity.PriorFit | None = None   # of the method "prior"
    departures: tuple[Departure, ...] = ()     # of the lights that may depart from the stated
    light_evidence: tuple[Finding, ...] = ()    # on each light of which something was stated
    copy: calibration_records.ChartCopy | None = None  # None: the reflectances were stated
    equations: ChartEquations | None = None     # of the first photo, as that fit took it

    def of_chart(self, patches: calibration_records.HeldOutPatches,
                 names: Sequence[str]) -> list[Finding]:
        """What is wrong with the first photo's chart itself, and what may be the cause.

        Parameters
        ----------
        patches : HeldOutPatches
            Of that chart.
        names : sequence of I str
            Of its patches.
        """
        light = "" if self.calibration.products else self.calibration.light.source
        findings = chart_findings.at_fault(patches, names, light)
        if self.equations is not None and self.prior_fit is not None:
            findings = doubts.told_apart(findings, self.equations, self.prior_fit.photos[0],
                                         self.light_evidence)
        # what the fit says already is not said twice
        known = worst(one for one in self.calibration.findings
                      if one.code == doubts.UNDECIDED_CAUSE)
        findings = [one for one in findings if one.code != doubts.UNDECIDED_CAUSE
                    or one.severity.value > known.value]
        if self.copy is not None:
            findings += chart_findings.departures(self.copy, names, light)
        return findings

    @property
    def white(self) -> calibration_records.ChartWhite | None:
        """White, field and glare of the first photo; None by methods that fit none."""
        return None if self.prior_fit is None else self.prior_fit.photos[0].white


def calibrate_chart(photos: Sequence[chart_photo.ChartPhoto], grid: spectra.WavelengthGrid,
                    method: str = "prior", prior: CameraPrior | None = None, *,
                    curves: np.ndarray | None = None) -> ChartCalibration:
    """Calibration of a camera and its light from photos of a chart.

    Parameters
    ----------
    photos : sequence of ChartPhoto
        By one camera; those of an unknown light all under the first one's. Light, scale, predicted
        signals and colour differences are those of the first; more than one needs the method
        ``prior``. With a known irradiance of the first, the calibration carries a light scale.
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    method : str
        ``prior``, or one of ``spline_fit.SPLINE_METHODS``.
    prior : CameraPrior or None
        None takes the shipped one, or smoothness for other bands.
    curves : (K, P) array, optional
        Measured; none are fitted then, whatever the method.

    Raises
    ------
    InputError
        If a photo has fewer than 3 bands, several are given to a method that takes one, the method
        is not known, or a light cannot be one (see ``light_power``).
    CheckError
        If no camera explains the patches, or given curves explain them only if the photo is read in
        another way; naming the patch without which one does, where it is a single one.
    CalibrationError
        If chart and light do not determine the curves (see ``fit_sensitivities``).
    """
    calibrated_by = partial(_calibrated, grid=grid, method=method, prior=prior, curves=curves)
    try:
        calibrated = calibrated_by(photos)
    except errors.UnexplainedChartError as error:
        alone = _wrong_patch(photos, calibrated_by, error.worst)
        if alone is None:
            raise
        raise errors.UnexplainedChartError(
            f"{error}; or look at patch {alone + 1}, {photos[0].chart.names[alone]}: a camera "
            f"explains the others. Leave it out: --leave-out {alone + 1} (leave_out = "
            f"[{alone + 1}] under [chart] of session.toml)", error.worst, alone) from None
    if calibrated.copy is None or calibrated.copy.edition == photos[0].editions[0].name:
        return calibrated
    return calibrated_by([chart_copy.of_edition(photo, calibrated.copy.edition)
                          for photo in photos])


def _wrong_patch(photos: Sequence[chart_photo.ChartPhoto],
                 calibrated_by: Callable[[Sequence[chart_photo.ChartPhoto]], ChartCalibration],
                 number: int) -> int | None:
    """The patch of the only photo without which its others are explained: this one of those that
    are used, which the others predict worst; None where they are not explained without it either.
    """
    used = np.flatnonzero(photos[0].used)
    if len(photos) > 1 or used.size <= MIN_PATCHES:
        return None
    excluded = ~photos[0].used
    excluded[used[number]] = True
    try:
        calibrated_by([replace(photos[0], excluded=excluded)])
    except errors.SpectraboxError:
        return None
    return int(used[number])


def _calibrated(photos: Sequence[chart_photo.ChartPhoto], grid: spectra.WavelengthGrid,
                method: str, prior: CameraPrior | None,
                curves: np.ndarray | None) -> ChartCalibration:
    """The calibration by the first edition that the chart may be of, and which it is likely of."""
    first = photos[0]
    _require_usable(photos, method if curves is None else "file")
    power, _ = chart_photo.light_power(first.light_on(grid), grid)
    if curves is not None:
        return _from_measured(first, power, grid, curves)
    if method == "prior":
        return _with_prior(photos, grid, prior)
    return _by_splines(first, power, grid, method)


def _of_fit(first: chart_photo.ChartPhoto, grid: spectra.WavelengthGrid,
            fit: calibration_records.SensitivityFit, scale: calibration_records.LightScale,
            predicted: np.ndarray, without: PatchesWithout, of_fit: Sequence[Finding],
            of_light: Sequence[Finding] = (),
            light_posterior: calibration_records.LightPosterior | None = None) -> ChartCalibration:
    """The calibration by curves, and how well it explains the first photo's chart.

    Parameters
    ----------
    first : ChartPhoto
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    fit : SensitivityFit
        With residuals; where no patch was left out of it, those are taken for the left-out ones.
    scale : LightScale
    predicted : (I, K) array
        Signals.
    without : PatchesWithout
    of_fit, of_light : sequences of Finding
    light_posterior : LightPosterior, optional
        Of an unknown light.
    """
    light = first.light_on(grid)
    _, unlit = chart_photo.light_power(light, grid)
    left_out = fit.held_out_residuals is not None
    held_out = fit.held_out_residuals if left_out else fit.residuals
    assert held_out is not None
    signals_without = first.samples.mean * (1 - held_out)
    covariance = sensitivity.relative_prediction_covariance(held_out, first.samples,
                                                            first.excluded)
    delta_e, delta_e_without = (
        trust.chart_colour_differences(first.samples.mean, signal, first.reflectances, grid)
        for signal in (predicted, signals_without))

    known = ~first.samples.clipped.any(axis=1)
    if first.excluded is not None:
        known &= ~first.excluded.astype(bool)
    findings = [
        *of_light,
        Finding("calibration.chart-colours", Severity.INFO, values={
            "mean": float(delta_e[known].mean()),
            "left_out": float(delta_e_without[known].mean()) if left_out else None}),
        Finding("calibration.signal-error", Severity.INFO, values={
            "error": float(np.sqrt(np.diag(covariance)).max()), "left_out": left_out})]
    if fit.condition_number is not None:
        findings.append(Finding("calibration.condition-number", Severity.INFO,
                                values={"value": float(fit.condition_number)}))
    if scale.standard_error is not None:
        findings.append(Finding("calibration.white", Severity.INFO, values={
            "error": float(scale.standard_error / scale.value)}))
    findings += [*unlit, *_clipped(without, first), *of_fit]
    # products with an unknown light are no curves that a matrix could be held against
    if light_posterior is None:
        findings += doubts.colour_matrix(first.samples.camera_from_xyz, fit.curves, grid)

    calibration = calibration_records.Calibration(fit, light,
                                                  None if first.irradiance is None else scale,
                                                  covariance, tuple(findings), light_posterior,
                                                  isinstance(first.light, spectra.UnknownLight))
    return ChartCalibration(calibration, scale, predicted, signals_without, delta_e,
                            delta_e_without, without, without, ~first.used,
                            first.samples.saturated, first.reflectances)


def _require_usable(photos: Sequence[chart_photo.ChartPhoto], method: str) -> None:
    """Refuse photos that the method cannot take."""
    first, bands = photos[0], photos[0].samples.mean.shape[1]
    if first.filter is not None:
        raise InputError("the first photo under a light must be without a filter; photos through "
                         "filters come after it")
    if bands < MIN_BANDS:
        raise InputError(f"the photo has {bands} band{'s' * (bands > 1)}; {MIN_BANDS} or more "
                         "are needed: stack photos that were taken through different filters into "
                         "one of several bands")
    if isinstance(first.light, spectra.UnknownLight):
        if method != "prior":
            raise InputError(f"method {method} needs the spectrum of the light, and the photo has "
                             f"an {first.light.words}; use method prior, or measure the light")
        if any(not isinstance(photo.light, spectra.UnknownLight) for photo in photos[1:]):
            raise InputError("several chart photos of which one has an unknown light must all be "
                             "under that light: fit those under other lights by themselves, or "
                             "measure it")
    if len(photos) > 1 and method != "prior":
        raise InputError(f"method {method} takes one photo; {len(photos)} photos need method prior")


def _clipped(without: PatchesWithout, photo: chart_photo.ChartPhoto) -> list[Finding]:
    """What it costs that clipped bands of patches could not be used."""
    samples, known = photo.samples, without.known_within(photo.reflectances)
    bands = np.array(photo.band_names)
    return [Finding("calibration.patch-clipped", Severity.NOTE, values={
                "patch": photo.chart.names[patch],
                "bands": [] if samples.saturated[patch] else bands[samples.clipped[patch]].tolist(),
                "error": float(known[patch, 0]), "error_if_used": float(known[patch, 1])})
            for patch in np.flatnonzero(samples.clipped.any(axis=1)).tolist()]


def _with_prior(photos: Sequence[chart_photo.ChartPhoto], grid: spectra.WavelengthGrid,
                prior: CameraPrior | None) -> ChartCalibration:
    """By the joint estimate from all photos; of an unknown light, products with it."""
    first = photos[0]
    used, excluded = chart_photo.used_and_excluded(photos, grid)
    cameras = sensitivity.default_prior(used, grid) if prior is None else prior
    fit, light = joint_estimate.estimate_through_glare(used, first.light, cameras, grid, excluded)
    joint_estimate.require_explained(fit, light, used, cameras, grid)

    of_fit = [*trust.fit_findings(fit, grid)]
    evidence = evidence_on_lights(photos, used, cameras, grid)
    of_light = [*evidence]
    departures: tuple[Departure, ...] = ()
    if isinstance(first.light, spectra.Spectrum):
        departures = light_departures(
            fit.posterior, [photo.light_on(grid) for photo in photos], grid)
        of_light += [departure for departure, _ in departures]
        of_fit.append(doubts.unlike_cameras(fit))
    elif light is not None:
        light = replace(light, findings=(*of_light, *light.findings))
        of_light = [*light.findings]
    else:
        of_light.append(Finding("light.lines-smoothed", Severity.NOTE,
                                values={"bands": cameras.bands}))
    if cameras.source == SMOOTH_SOURCE and fit.model_error > chart_photo.WORST_MODEL_ERROR:
        of_fit.append(doubts.disagreeing_bands(used[0].signal, fit.held_out[0], first.band_names))
    shown = relit(fit.posterior, used)
    for number in range(len(used)):
        drift = colour_drift(fit.posterior, shown, number)
        if drift is not None:
            of_fit.append(doubts.drifting_light(*drift, number + 1 if len(used) > 1 else None))

    without = in_chart_order(fit.without, first.used)
    signals_without = without.predicted(first.reflectances)
    predicted = signals_without.copy()      # excluded patches: what the fit without them predicts
    predicted[first.used] = fit.photos[0].predicted
    residuals = 1 - predicted / first.samples.mean
    held_out = 1 - signals_without / first.samples.mean
    made = _of_fit(first, grid,
                   replace(fit.sensitivity, residuals=residuals, held_out_residuals=held_out),
                   replace(fit.photos[0].light_scale, residuals=residuals), predicted, without,
                   [*of_fit, *joint_estimate.veiled(fit)], of_light, light)
    worst_photo = doubts.worst_explained(fit, used)
    findings = doubts.told_apart(made.calibration.findings, used[worst_photo],
                                 fit.photos[worst_photo], evidence)
    return replace(made, calibration=replace(made.calibration, findings=tuple(findings)),
                   cleaned=joint_estimate.without_suspects(photos, cameras, grid, without),
                   prior_fit=fit, departures=departures, light_evidence=evidence,
                   copy=chart_copy.copy_of_chart(photos, fit, grid), equations=used[0])


def evidence_on_lights(photos: Sequence[chart_photo.ChartPhoto], used: list[ChartEquations],
                       cameras: CameraPrior,
                       grid: spectra.WavelengthGrid) -> tuple[Finding, ...]:
    """What photos say for and against each light of which something was stated, see
    ``doubts.light_evidence``.

    Where no camera is known, smoothness alone, no lamp can be told from another. A photo through a
    filter says nothing of a spectrum that was stated.

    Parameters
    ----------
    photos : sequence of ChartPhoto
        By one camera.
    used : list of ChartEquations
        Of their patches that are used.
    cameras : CameraPrior
    grid : WavelengthGrid
        Working grid, every nm from 400 to 700 nm.
    """
    light = photos[0].light
    if cameras.source == SMOOTH_SOURCE or (isinstance(light, spectra.UnknownLight)
                                           and not light.stated):
        return ()
    if isinstance(light, spectra.UnknownLight):
        return (doubts.evidence_on_kind(light, used, cameras),)
    return tuple(
        doubts.evidence_on_spectrum(photo.light_on(grid).source, equations, cameras, grid)
        for photo, equations in zip(photos, used, strict=True) if photo.filter is None)


def _from_measured(photo: chart_photo.ChartPhoto, power: np.ndarray, grid: spectra.WavelengthGrid,
                   curves: np.ndarray) -> ChartCalibration:
    """Measured curves as they are; the photo gives the scale of its light."""
    samples, used, irradiance = photo.samples, photo.used, photo.irradiance_or_pi
    unscaled = _chart_signals(photo, grid, curves, power)
    patches, bands = samples.mean.shape

    def scale_by(chosen: np.ndarray) -> calibration_records.LightScale:
        return light_scale.scale_from_signals(
            samples.mean[chosen], unscaled[chosen],
            chart_copy.COPY_ERROR if photo.editions else sensitivity.CHART_ERROR, "chart photo",
            ~samples.clipped[chosen])

    scale = scale_by(used)
    others = [scale_by(used & rest).value for rest in ~np.eye(patches, dtype=bool)]
    predicted = scale.value * unscaled
    residuals = 1 - predicted / samples.mean
    relative = sensitivity.relative_prediction_covariance(residuals, samples)
    factor = (np.array(others) * irradiance / np.pi)[:, None, None]
    covariance = np.zeros((patches, bands * bands + bands, bands * bands + bands))
    covariance[:, bands * bands:, bands * bands:] = (
        relative * samples.mean[:, :, None] * samples.mean[:, None, :])
    without = PatchesWithout(curves.T, power * grid.weights_nm, factor * np.eye(bands),
                             np.zeros((patches, bands)), covariance, samples.mean,
                             samples.covariance_of_mean, samples.clipped)
    (equations,), _ = chart_photo.used_and_excluded([photo], grid)
    agreement = trust.check_measured_curves(equations, curves, grid)
    return _of_fit(photo, grid, _measured_curves(grid, curves, residuals),
                   replace(scale, residuals=residuals), predicted, without, [agreement])


def _by_splines(photo: chart_photo.ChartPhoto, power: np.ndarray, grid: spectra.WavelengthGrid,
                method: str) -> ChartCalibration:
    """By one of ``spline_fit.SPLINE_METHODS``."""
    fit, scale, without = sensitivity.fit_sensitivities(
        photo.samples, photo.reflectances, power, photo.irradiance_or_pi, grid, method=method,
        used=photo.used)
    predicted = scale.value * _chart_signals(photo, grid, fit.curves, power)
    band = "calibration.smooth-band" if method == "smooth" else "calibration.noise-band"
    return _of_fit(photo, grid, fit, scale, predicted, without,
                   [Finding(band, Severity.NOTE)])


def _chart_signals(photo: chart_photo.ChartPhoto, grid: spectra.WavelengthGrid, curves: np.ndarray,
                   power: np.ndarray) -> np.ndarray:
    return (photo.reflectances @ interreflection.response_matrix(grid, curves, power).T
            * (photo.irradiance_or_pi / np.pi)[:, None])


def through_filter(calibration: calibration_records.Calibration, fit: sensitivity.PriorFit,
                   number: int, grid: spectra.WavelengthGrid) -> calibration_records.Calibration:
    """The calibration of one photo of a fit: that of its light through the photo's filter.

    Parameters
    ----------
    calibration : Calibration
        Of the light that the photo was taken under, without a filter.
    fit : PriorFit
    number : int
        Of the photo in the fit.
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    """
    fitted, light = fit.photos[number].filter, calibration.light
    if fitted is None:
        return calibration
    passed = fitted.transmittance / fitted.transmittance.max()
    error = light.standard_error
    return replace(calibration, filter=fitted, light=spectra.Spectrum(
        grid, spectrum_on_grid(light, grid) * passed, light.quantity,
        f"{light.source} through {fitted.name}",
        None if error is None else np.interp(grid.nm, light.grid.nm, error) * passed))


def calibration_from_curves(grid: spectra.WavelengthGrid, curves: np.ndarray,
                            light: spectra.Spectrum,
                            relative_error: float) -> calibration_records.Calibration:
    """Calibration from measured curves alone, without a chart photo.

    Parameters
    ----------
    grid : WavelengthGrid
        Working grid, of P wavelengths.
    curves : (K, P) array
        Measured sensitivities, the largest value of all bands being 1.
    light : Spectrum
    relative_error : float
        Within which predicted signals are taken to be right, independent in each band.
    """
    covariance = np.eye(len(curves)) * relative_error**2
    return calibration_records.Calibration(_measured_curves(grid, curves, None), light, None,
                                           covariance, (
                                               Finding("calibration.curves-given", Severity.INFO,
                                                       values={"error": relative_error}),))


def _measured_curves(grid: spectra.WavelengthGrid, curves: np.ndarray,
                     residuals: np.ndarray | None) -> calibration_records.SensitivityFit:
    return calibration_records.SensitivityFit(grid, curves, None, None, None, None, residuals, None,
                                              None, "measured curves from a file",
                                              spectra.Outcome.CONVERGED)
