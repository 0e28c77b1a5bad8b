"""The step that fits one camera to all chart photos, and a light with its scale to every view.

Where it is stated how light and chart stood, the irradiance of the chart is rendered; elsewhere
the fit estimates a smooth field over the chart, and there is no light scale.
"""
from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from spectrabox.calibrate import chart_calibration, chart_photo, light_error, sensitivity, trust
from spectrabox.calibrate.prior.camera_prior import prior_of_curves
from spectrabox.capture.chart import quality
from spectrabox.measure import captured, opened_photos
from spectrabox.measure.records import CalibrationRecords, CaptureRecords, ChartFit, MeasuredChart
from spectrabox.measure.steps import chart_fit, work
from spectrabox.radiometry.errors import CheckError, InputError
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records import calibration as calibration_records
from spectrabox.radiometry.records.spectra import Spectrum, UnknownLight


def calibrate_flat(capture: captured.FlatCapture, records: CaptureRecords,
                   work: work.Work) -> CalibrationRecords:
    """Patch statistics and lights to one camera, and to the light of every view; the light over
    each chart is a smooth field that the fit estimates.

    Parameters
    ----------
    capture : FlatCapture
    records : CaptureRecords
        Of charts and photos.
    work : Work

    Raises
    ------
    CalibrationError
        If chart and light do not determine the camera.
    CheckError
        If photos that are stated to be under one lamp show two.
    """
    charts = records.charts
    opened_photos.require_curves_of_bands(capture)
    work.progress(0.6, "fitting sensitivities")
    photos = _chart_photos(capture, records, None)
    groups, of_lights = _groups_by_light(capture, charts)
    fitted = _fitted(capture, groups, charts, photos, _chosen_of_flat(capture))
    return dataclasses.replace(fitted, findings=(*of_lights, *fitted.findings))


def calibrate_scene(capture: captured.SceneCapture, records: CaptureRecords,
                    work: work.Work) -> CalibrationRecords:
    """Patch statistics and lights to one camera, and to the light and its scale of every view;
    where it is stated how light and chart stood, the irradiance of the chart is rendered.

    Parameters
    ----------
    capture : SceneCapture
    records : CaptureRecords
        Of charts and photos.
    work : Work

    Raises
    ------
    CalibrationError
        If chart and light do not determine the camera.
    """
    charts = records.charts
    opened_photos.require_curves_of_bands(capture)
    irradiance = _irradiance(capture, work) if charts else None
    work.progress(0.6, "fitting sensitivities")
    photos = _chart_photos(capture, records, irradiance)
    fitted = _fitted(capture, _fits_of_scene(capture), charts, photos, capture.sensitivity)
    if irradiance is None:
        return fitted
    return dataclasses.replace(
        fitted, calibrations=_with_lamp_error(capture, fitted.calibrations),
        findings=(*_uneven_light(capture, charts, irradiance), *fitted.findings))


def _chart_photos(capture: captured.Capture, records: CaptureRecords,
                  irradiance: np.ndarray | None) -> dict[str, chart_photo.ChartPhoto]:
    """The charts as their fits take them, by view."""
    bands = capture.band_names(records.photo.bands)
    views = capture.views_with_chart
    if not views:
        return {}
    photos = chart_fit.as_fitted(
        [records.charts[view.name].samples for view in views],
        [capture.lit_chart] * len(views), [view.light_of_fit for view in views], irradiance,
        [view.filter_of_fit for view in views], bands)
    return {view.name: photo for view, photo in zip(views, photos, strict=True)}


def _fitted(capture: captured.Capture, groups: list[list[captured.View]],
            charts: Mapping[str, MeasuredChart], photos: Mapping[str, chart_photo.ChartPhoto],
            chosen: captured.Sensitivity) -> CalibrationRecords:
    """One camera, and the light of every view, of each group of views.

    With the method ``prior`` the charts of a group are one fit; other methods fit the camera to the
    first.

    Parameters
    ----------
    capture : Capture
    groups : list of lists of View
        A fit each.
    charts, photos : mappings
        Of charts, by view, as they were measured and as fits take them.
    chosen : Sensitivity
        How every fit is made.
    """
    several = chosen.method == "prior" and chosen.curves is None
    calibrations: dict[str, calibration_records.Calibration] = {}
    whites: dict[str, calibration_records.ChartWhite] = {}
    held_out: dict[str, calibration_records.HeldOutPatches] = {}
    findings: list[Finding] = []
    chart, glare = None, np.zeros(1)
    for first, *others in groups:
        fitted = [view.name for view in (first, *others) if view.chart and (several
                                                                            or view == first)]
        fit, prior_fit = None, None
        if first.chart:
            fit, held_out[first.name] = chart_fit.fit([photos[name] for name in fitted],
                                                      FINE_GRID, chosen)
            camera, prior_fit = fit.calibration, fit.prior_fit
            findings += [dataclasses.replace(one, subject=first.name) for one
                         in fit.of_chart(held_out[first.name], capture.layout.names)]
            if not first.name:
                chart = _chart_fit(capture, photos[""], fit, held_out[""])
                glare = trust.certain_glare(prior_fit, charts[""].thumbnail)
        else:
            camera = _camera_of_curves(capture, first)
        if prior_fit is not None:
            whites |= {name: state.white for name, state
                       in zip(fitted, prior_fit.photos, strict=True)}
        calibrations[first.name] = camera
        for view in others:
            scale = camera.light_scale if view.same_light(first) else None
            if view.chart:
                scale = _own_scale(photos[view.name], camera, prior_fit,
                                   fitted.index(view.name) if several else 0)
            own = _of_view(camera, view, scale)
            if prior_fit is not None and view.chart:
                own = chart_calibration.through_filter(own, prior_fit, fitted.index(view.name),
                                                       FINE_GRID)
            calibrations[view.name] = own
    return CalibrationRecords(
        calibrations, whites, chart, {name: patches for name, patches in held_out.items() if name},
        tuple(findings), glare)


def _camera_of_curves(capture: captured.Capture,
                      view: captured.View) -> calibration_records.Calibration:
    """A camera of measured curves, which no chart is needed for."""
    chosen = capture.sensitivity
    assert chosen.curves is not None
    return chart_calibration.calibration_from_curves(FINE_GRID, chosen.curves,
                                                     require_spectrum(view.light),
                                                     chosen.relative_error)


def _of_view(camera: calibration_records.Calibration, view: captured.View,
             scale: calibration_records.LightScale | None) -> calibration_records.Calibration:
    """The calibration of a further view."""
    light = view.light_of_fit
    return dataclasses.replace(camera, light_scale=scale, light=camera.light if isinstance(
        light, UnknownLight) else light)


def _chart_fit(capture: captured.Capture, photo: chart_photo.ChartPhoto,
               fit: chart_calibration.ChartCalibration,
               held_out: calibration_records.HeldOutPatches) -> ChartFit:
    """How the calibration explains the first chart photo."""
    irradiance, known = photo.irradiance_or_pi, fit.prior_fit
    if known is not None and isinstance(capture, captured.FlatCapture):
        # the fit estimates the light over it
        irradiance = np.full(len(fit.predicted), np.nan)        # not known of excluded patches
        irradiance[photo.used] = known.photos[0].field
    made = ChartFit(fit.predicted, irradiance / np.fmax.reduce(irradiance), held_out, fit.copy)
    return made if known is None else dataclasses.replace(
        made, prior_share=known.prior_share, families=known.families,
        patch_error=np.array(known.patch_error))


def require_spectrum(light: Spectrum | UnknownLight) -> Spectrum:
    """A light whose spectrum is stated.

    Raises
    ------
    InputError
        If it is not.
    """
    if isinstance(light, UnknownLight):
        raise InputError(f"this needs the spectrum of a light and has an {light.words}; measure "
                         "it, or name a CIE illuminant")
    return light


def _fits_of_scene(capture: captured.SceneCapture) -> list[list[captured.View]]:
    """Views whose charts are one fit: all, or where a light is unknown each chart, the first of
    them with the views that have none.
    """
    views: list[captured.View] = list(capture.views)
    if all(view.spectrum_stated for view in views):
        return [views]
    first = [view for view in views if not view.name or not view.chart]
    return [first, *([view] for view in views[1:] if view.chart)]


def _fits_of_flat(capture: captured.FlatCapture) -> list[list[captured.View]]:
    """Views whose charts are one fit: all, or where a light is unknown those under each lamp, with
    and without filters.
    """
    views = list(capture.views)
    if all(view.light_stated for view in views):
        return [views]
    return [sorted((view for view in views if view.lamp == lamp),
                   key=lambda view: view.filter is not None)
            for lamp in dict.fromkeys(view.lamp for view in views)]


def _groups_by_light(capture: captured.FlatCapture, charts: Mapping[str, MeasuredChart]
                     ) -> tuple[list[list[captured.View]], tuple[Finding, ...]]:
    """Views of flat samples under each light: as stated, where no chart contradicts it, and lights
    that nobody measured as one where their charts show one; with a finding for each of those.

    Raises
    ------
    CheckError
        If photos that are stated to be under one lamp show two.
    """
    def difference(first: captured.View, other: captured.View) -> float:
        return light_error.light_difference(charts[first.name].samples, charts[other.name].samples,
                                capture.layout.centres_uv)

    groups: list[list[captured.View]] = []
    findings: tuple[Finding, ...] = ()
    for views in _fits_of_flat(capture):
        first = views[0]
        for view in views[1:]:
            if view.chart and view.same_light(first) and (
                    shown := difference(first, view)) > light_error.OTHER_LIGHT:
                remedy = "put the lamp lower, where no patch mirrors it, and light nothing else" \
                    if view.moved else "give the view a light of its own (light = \"unknown\")"
                raise CheckError(
                    f"{view.chart_names[0]} is stated to be under the lamp of "
                    f"{first.chart_names[0]}, and its chart shows a light that differs by "
                    f"{shown:.0%}: {remedy}, or take both photos under one lamp that has warmed up")
        before = None
        if not any(view.light_stated for view in capture.views):
            before = next((group for group in groups
                           if difference(group[0], first) < light_error.SAME_LIGHT), None)
        if before is None:
            groups.append(views)
        else:
            findings += (Finding("light.same-in-photos", Severity.NOTE,
                                 values={"names": [before[0].title, first.title]}),)
            before += views
    return groups, findings


def _chosen_of_flat(capture: captured.FlatCapture) -> captured.Sensitivity:
    """How every fit is made. Measured curves of a camera before flat samples are the middle of a
    prior, since only a fit gives the field over the chart.
    """
    chosen = capture.sensitivity
    if chosen.curves is None:
        return chosen
    return dataclasses.replace(chosen, curves=None, prior=prior_of_curves(
        FINE_GRID, chosen.curves, chosen.relative_error))


def _own_scale(photo: chart_photo.ChartPhoto, camera: calibration_records.Calibration,
               prior_fit: sensitivity.PriorFit | None,
               index: int) -> calibration_records.LightScale | None:
    """Scale of the light of a further view from its own chart photo; None where the irradiance of
    the chart is not known.

    Parameters
    ----------
    index : int
        Of the photo in the prior's fit.
    """
    if photo.irradiance is None:
        return None
    if prior_fit is not None:
        return prior_fit.photos[index].light_scale
    return chart_calibration.calibrate_chart([photo], FINE_GRID,
                                             curves=camera.sensitivity.curves).scale


def _irradiance(capture: captured.SceneCapture, work: work.Work) -> np.ndarray | None:
    """On each patch for a light spectrum of 1; None where the geometry is not known."""
    if capture.chart_scene is None:
        return None
    work.progress(0.2, "irradiance on the chart")
    return chart_fit.irradiance_on(capture.layout, capture.chart_scene, capture.seed, work.device)


def _with_lamp_error(capture: captured.SceneCapture,
                     calibrations: Mapping[str,
                                           calibration_records.Calibration]) -> dict[
                                               str, calibration_records.Calibration]:
    """With what the lamp's position in the chart scene leaves open in every light scale from a
    chart.
    """
    assert capture.chart_scene is not None
    error = chart_fit.lamp_error(capture.layout, capture.chart_scene,
                                 capture.repeatability.lamp_position, capture.seed)
    return {name: chart_fit.with_lamp_error(calibration, error)
            for name, calibration in calibrations.items()}


def _uneven_light(capture: captured.SceneCapture, charts: Mapping[str, MeasuredChart],
                  irradiance: np.ndarray) -> tuple[Finding, ...]:
    """Chart photos whose light changes by more than lamp and chart in their places explain."""
    return tuple(finding for view in capture.views_with_chart
                 for finding in quality.uneven_light(charts[view.name].light, irradiance,
                                                     view.name))
