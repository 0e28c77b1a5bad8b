"""The step that fits one camera to all chart photos, and a light with its scale to every view.

Where it is stated how light and chart stood, the irradiance of the chart is rendered; elsewhere
the fit estimates a smooth field over the chart, and there is no light scale.
"""
from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from spectrabox.calibrate.chart_calibration import (
    CalibrationOptions,
    ChartCalibration,
    ChartPhoto,
    calibrate_chart,
    calibration_from_curves,
    through_filter,
)
from spectrabox.calibrate.light_difference import OTHER_LIGHT, SAME_LIGHT, light_difference
from spectrabox.calibrate.prior.plain_priors import prior_of_curves
from spectrabox.calibrate.sensitivity import PriorFit
from spectrabox.calibrate.trust import certain_glare
from spectrabox.capture.chart.quality import uneven_light_reasons
from spectrabox.measure.captured import Capture, FlatCapture, View
from spectrabox.measure.left_out_patches import held_out_patches
from spectrabox.measure.opened_photos import require_curves_of_bands
from spectrabox.measure.records import (
    CalibrationRecords,
    CaptureRecords,
    ChartFit,
    MeasuredChart,
)
from spectrabox.measure.results.chart_words import chart_level_notes
from spectrabox.measure.steps.work import Work
from spectrabox.radiometry.error_model import LAMP_AT_CHART, with_common_error
from spectrabox.radiometry.errors import CheckError, InputError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records import (
    Calibration,
    ChartWhite,
    HeldOutPatches,
    LightScale,
    LinearImage,
    Spectrum,
    UnknownLight,
)
from spectrabox.reconstruct.rendering.irradiance import lamp_position_error, patch_irradiance
from spectrabox.reconstruct.rendering.renderer import start_mitsuba


def calibrate_views(capture: Capture, records: CaptureRecords, work: Work) -> CalibrationRecords:
    """Patch statistics and lights to one camera, and to the light and its scale of every view.

    With the method ``prior`` the charts under all lights are one fit; other methods fit the camera
    to the first.

    Parameters
    ----------
    capture : Capture
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
    charts = records.chart.charts
    require_curves_of_bands(capture)
    irradiance = _irradiance(capture, work) if charts else None
    work.progress(0.6, "fitting sensitivities")
    options = _options(capture)
    several = options.method == "prior" and options.curves is None
    bands = capture.band_names(records.photo.bands)
    photos = {view.name: _chart_photo(capture, view, charts[view.name], irradiance, bands)
              for view in capture.views_with_chart}
    calibrations: dict[str, Calibration] = {}
    whites: dict[str, ChartWhite] = {}
    other_charts: dict[str, HeldOutPatches] = {}
    chart, notes = None, _uneven_notes(capture, charts, irradiance)
    lights, same = _lights_by_evidence(capture, charts, _one_fit_each(capture))
    notes += same
    for first, *others in lights:
        fitted = [view.name for view in (first, *others) if view.chart and (several
                                                                            or view == first)]
        fit = None
        if first.chart:
            fit = calibrate_chart([photos[name] for name in fitted], FINE_GRID, options)
            camera = fit.calibration
            held_out = held_out_patches(fit, photos[first.name].reflectances)
            notes += tuple(f"{first.chart_names[0]}: {note}" for note
                           in chart_level_notes(held_out, capture.layout.names))
            if fit.prior_fit is not None:
                whites |= {name: state.white for name, state
                           in zip(fitted, fit.prior_fit.photos, strict=True)}
            if first.name:
                other_charts[first.name] = held_out
            else:
                chart = _chart_fit(capture, fit, photos[""], charts[""].thumbnail, held_out)
        else:
            assert capture.sensitivity.curves is not None
            camera = calibration_from_curves(FINE_GRID, capture.sensitivity.curves,
                                             require_spectrum(first.light),
                                             capture.sensitivity.relative_error)
        calibrations[first.name] = camera
        for view in others:
            scale = camera.light_scale if view.same_light(first) else None
            if view.chart:
                scale = _own_scale(photos[view.name], camera, None if fit is None
                                   else fit.prior_fit, fitted.index(view.name) if several else 0)
            calibrations[view.name] = _calibration_of(capture, view, camera, fit, None if not (
                view.chart and several) else fitted.index(view.name), scale)
    if irradiance is not None:
        calibrations = _with_lamp_error(capture, calibrations)
    return CalibrationRecords(calibrations, whites, chart, other_charts, notes)


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


def _one_fit_each(capture: Capture) -> list[list[View]]:
    """Views whose charts are one fit: all, or where a light is unknown those of flat samples under
    each lamp, with and without filters, and each chart of a scene with the views that have none.
    """
    views = list(capture.views)
    if all(view.light_stated if capture.flat else view.spectrum_stated for view in views):
        return [views]
    if capture.flat:
        return [sorted((view for view in views if view.lamp == lamp),
                       key=lambda view: view.filter is not None)
                for lamp in dict.fromkeys(view.lamp for view in views)]
    first = [view for view in views if not view.name or not view.chart]
    return [first, *([view] for view in views[1:] if view.chart)]


def _lights_by_evidence(capture: Capture, charts: Mapping[str, MeasuredChart],
                        stated: list[list[View]]) -> tuple[list[list[View]], tuple[str, ...]]:
    """Views of flat samples under each light: as stated, where no chart contradicts it, and lights
    that nobody measured as one where their charts show one; with a sentence for each of those.

    Raises
    ------
    CheckError
        If photos that are stated to be under one lamp show two.
    """
    if not isinstance(capture, FlatCapture):
        return stated, ()
    positions = capture.layout.centres_uv
    lights: list[list[View]] = []
    notes: tuple[str, ...] = ()
    for views in stated:
        first = views[0]
        for view in views[1:]:
            if view.chart and view.same_light(first) and (difference := light_difference(
                    charts[first.name].samples, charts[view.name].samples,
                    positions)) > OTHER_LIGHT:
                raise CheckError(
                    f"{view.chart_names[0]} is stated to be under the lamp of "
                    f"{first.chart_names[0]}, and its chart shows a light that differs by "
                    f"{difference:.0%}: give the view a light of its own (light = \"unknown\"), or "
                    "take both photos under one lamp that has warmed up")
        before = None if any(view.light_stated for view in capture.views) else next(
            (light for light in lights if light_difference(
                charts[light[0].name].samples, charts[first.name].samples,
                positions) < SAME_LIGHT), None)
        if before is None:
            lights.append(views)
        else:
            notes += (f"{before[0].title!r} and {first.title!r} show the same light: their bands "
                      "are averaged against noise and add nothing new; take one under another kind "
                      "of lamp, or through a filter",)
            before += views
    return lights, notes


def _options(capture: Capture) -> CalibrationOptions:
    """Options of every fit. Measured curves of a camera before flat samples are the middle of a
    prior, since only a fit gives the field over the chart.
    """
    chosen = capture.sensitivity
    prior, curves = chosen.prior, chosen.curves
    if capture.flat and curves is not None:
        prior, curves = prior_of_curves(FINE_GRID, curves, chosen.relative_error), None
    return CalibrationOptions(chosen.method or "prior", prior, chosen.coefficients, curves)


def _chart_photo(capture: Capture, view: View, measured: MeasuredChart,
                 irradiance: np.ndarray | None, bands: tuple[str, ...]) -> ChartPhoto:
    # of flat samples a filter is part of the fit, of a scene part of the light
    light, through = (view.light, view.filter) if capture.flat else (view.filtered_light, None)
    chart = capture.lit_chart
    return ChartPhoto(measured.samples, chart.reflectances, light, irradiance, chart.excluded,
                      chart.layout, through, bands)


def _calibration_of(capture: Capture, view: View, camera: Calibration,
                    fit: ChartCalibration | None, number: int | None,
                    scale: LightScale | None) -> Calibration:
    """The calibration of a further view, its chart being photo ``number`` of the fit."""
    light = view.light if capture.flat else view.filtered_light
    own = dataclasses.replace(camera, light_scale=scale, light=camera.light if isinstance(
        light, UnknownLight) else light)
    if not capture.flat or fit is None or fit.prior_fit is None or number is None:
        return own
    return through_filter(own, fit.prior_fit, number, FINE_GRID)


def _chart_fit(capture: Capture, fit: ChartCalibration, photo: ChartPhoto,
               thumbnail: LinearImage, held_out: HeldOutPatches) -> ChartFit:
    """How the fit explains the first chart photo."""
    irradiance, patch_error = photo.irradiance_or_pi, None
    if fit.prior_fit is not None:
        patch_error = np.array(fit.prior_fit.patch_error)
        if capture.flat:
            irradiance = np.full(len(fit.predicted), np.nan)    # not known of excluded patches
            irradiance[photo.used] = fit.prior_fit.photos[0].field
    return ChartFit(fit.predicted, irradiance, certain_glare(fit.prior_fit, thumbnail), patch_error,
                    fit.prior_influence, held_out)


def _own_scale(photo: ChartPhoto, camera: Calibration, prior_fit: PriorFit | None,
               index: int) -> LightScale | None:
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
    options = CalibrationOptions(curves=camera.sensitivity.curves)
    return calibrate_chart([photo], FINE_GRID, options).scale


def _irradiance(capture: Capture, work: Work) -> np.ndarray | None:
    """On each patch for a light spectrum of 1; None where the geometry is not known."""
    if capture.chart_scene is None:
        return None
    work.progress(0.2, "irradiance on the chart")
    start_mitsuba(work.device)
    chart = capture.layout
    return patch_irradiance(capture.chart_scene, chart.centres_uv, chart.sizes_uv, capture.seed)


def _with_lamp_error(capture: Capture,
                     calibrations: Mapping[str, Calibration]) -> dict[str, Calibration]:
    """With what the lamp's position in the chart scene leaves open in every light scale from a
    chart.
    """
    chart = capture.layout
    assert capture.chart_scene is not None
    error = lamp_position_error(capture.chart_scene, chart.centres_uv, chart.sizes_uv,
                                capture.repeatability.lamp_position, capture.seed)
    return {name: calibration if calibration.light_scale is None else dataclasses.replace(
                calibration,
                light_scale=with_common_error(calibration.light_scale, LAMP_AT_CHART, error))
            for name, calibration in calibrations.items()}


def _uneven_notes(capture: Capture, charts: Mapping[str, MeasuredChart],
                  irradiance: np.ndarray | None) -> tuple[str, ...]:
    """Chart photos whose light changes by more than lamp and chart in their places explain."""
    return () if irradiance is None else tuple(
        f"{view.chart_names[0]} should be shot again: {reason}"
        for view in capture.views_with_chart
        for reason in uneven_light_reasons(charts[view.name].light, irradiance))
