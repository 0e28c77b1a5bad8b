"""The stage that fits one camera to all chart photos, and a light with its scale to every view.

Where the session says how light and chart stood, the irradiance of the chart is rendered; elsewhere
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
from spectrabox.calibrate.prior.camera_prior import load_camera_prior
from spectrabox.calibrate.prior.plain_priors import prior_of_curves
from spectrabox.calibrate.sensitivity import PriorFit
from spectrabox.calibrate.trust import certain_glare
from spectrabox.capture.chart.quality import uneven_light_reasons
from spectrabox.measure.chart_check import chart_level_notes, held_out_patches
from spectrabox.radiometry.error_model import LAMP_AT_CHART, with_common_error
from spectrabox.radiometry.errors import CheckError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records import (
    Calibration,
    ChartWhite,
    HeldOutPatches,
    LightScale,
    LinearImage,
    UnknownLight,
)
from spectrabox.reconstruct.rendering.irradiance import lamp_position_error, patch_irradiance
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
from spectrabox.session.config.session_chart import session_chart
from spectrabox.session.config.session_schema import SessionConfig, ViewInputs
from spectrabox.session.stages.inputs import (
    band_names,
    excluded_patches,
    read_chart_reference,
    read_filter,
    read_known_light,
    read_light,
    read_light_of,
    read_sensitivities,
    require_curves_of_bands,
)
from spectrabox.session.stages.records import CalibrationRecords, ChartFit, MeasuredChart
from spectrabox.session.stages.scenes import read_chart_scene
from spectrabox.session.stages.stage_task import StageTask


def calibrate_views(task: StageTask) -> CalibrationRecords:
    """Patch statistics and lights to one camera, and to the light and its scale of every view.

    With the method ``prior`` the charts under all lights are one fit; other methods fit the camera
    to the first.

    Parameters
    ----------
    task : StageTask
    """
    config, charts = task.config, task.records.chart.charts
    require_curves_of_bands(config)
    irradiance = _irradiance(task) if charts else None
    task.progress(0.6, "fitting sensitivities")
    curves = None if config.sensitivity.from_chart else read_sensitivities(config)[1]
    options = _options(config, curves)
    several = options.method == "prior" and options.curves is None
    bands = band_names(config, task.records.photo.bands)
    photos = {view.name: _chart_photo(config, view, charts[view.name], irradiance, bands)
              for view in config.views_with_chart}
    calibrations: dict[str, Calibration] = {}
    whites: dict[str, ChartWhite] = {}
    other_charts: dict[str, HeldOutPatches] = {}
    chart, notes = None, _uneven_notes(config, charts, irradiance)
    lights, same = _lights_by_evidence(config, charts, _one_fit_each(config))
    notes += same
    for first, *others in lights:
        fitted = [view.name for view in (first, *others) if view.chart and (several
                                                                            or view == first)]
        fit = None
        if first.chart:
            fit = calibrate_chart([photos[name] for name in fitted], FINE_GRID, options)
            camera = fit.calibration
            held_out = held_out_patches(fit, photos[first.name].reflectances)
            notes += tuple(f"{first.chart_files[0]}: {note}" for note
                           in chart_level_notes(held_out, session_chart(config).names))
            if fit.prior_fit is not None:
                whites |= {name: state.white for name, state
                           in zip(fitted, fit.prior_fit.photos, strict=True)}
            if first.name:
                other_charts[first.name] = held_out
            else:
                chart = _chart_fit(config, fit, photos[""], charts[""].thumbnail, held_out)
        else:
            assert curves is not None       # session_rules asks for a chart photo otherwise
            camera = calibration_from_curves(FINE_GRID, curves,
                                             read_known_light(config, first.light),
                                             config.sensitivity.relative_error)
        calibrations[first.name] = camera
        for view in others:
            scale = camera.light_scale if view.same_light(first) else None
            if view.chart:
                scale = _own_scale(photos[view.name], camera, None if fit is None
                                   else fit.prior_fit, fitted.index(view.name) if several else 0)
            calibrations[view.name] = _calibration_of(config, view, camera, fit, None if not (
                view.chart and several) else fitted.index(view.name), scale)
    if irradiance is not None:
        calibrations = _with_lamp_error(config, calibrations)
    return CalibrationRecords(calibrations, whites, chart, other_charts, notes)


def _one_fit_each(config: SessionConfig) -> list[list[ViewInputs]]:
    """Views whose charts are one fit: all, or where a light is unknown those of flat samples under
    each lamp, with and without filters, and each chart of a scene with the views that have none.
    """
    views = list(config.all_views)
    if all(view.light.stated if config.flat else view.spectrum_stated for view in views):
        return [views]
    if config.flat:
        return [sorted((view for view in views if view.lamp == lamp),
                       key=lambda view: view.filter is not None)
                for lamp in dict.fromkeys(view.lamp for view in views)]
    first = [view for view in views if not view.name or not view.chart]
    return [first, *([view] for view in views[1:] if view.chart)]


def _lights_by_evidence(config: SessionConfig, charts: Mapping[str, MeasuredChart],
                        stated: list[list[ViewInputs]]
                        ) -> tuple[list[list[ViewInputs]], tuple[str, ...]]:
    """Views of flat samples under each light: as stated, where no chart contradicts it, and lights
    that nobody measured as one where their charts show one; with a sentence for each of those.

    Raises
    ------
    CheckError
        If photos that are stated to be under one lamp show two.
    """
    if not config.flat:
        return stated, ()
    positions = session_chart(config).centres_uv
    lights: list[list[ViewInputs]] = []
    notes: tuple[str, ...] = ()
    for views in stated:
        first = views[0]
        for view in views[1:]:
            if view.chart and view.same_light(first) and (difference := light_difference(
                    charts[first.name].samples, charts[view.name].samples,
                    positions)) > OTHER_LIGHT:
                raise CheckError(
                    f"{view.chart_files[0]} is stated to be under the lamp of "
                    f"{first.chart_files[0]}, and its chart shows a light that differs by "
                    f"{difference:.0%}: give the view a light of its own (light = \"unknown\"), or "
                    "take both photos under one lamp that has warmed up")
        before = None if any(
            view.light.stated for view in config.all_views) else next(
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


def _options(config: SessionConfig, curves: np.ndarray | None) -> CalibrationOptions:
    """Options of every fit.

    Parameters
    ----------
    curves : (K, P) array or None
        Measured sensitivities; those of a camera before flat samples are the middle of a prior,
        since only a fit gives the field over the chart.
    """
    chosen = config.sensitivity
    prior = None if chosen.prior is None else load_camera_prior(config.path(chosen.prior))
    if config.flat and curves is not None:
        prior, curves = prior_of_curves(FINE_GRID, curves, chosen.relative_error), None
    return CalibrationOptions(chosen.method or "prior", prior, chosen.coefficients, curves)


def _chart_photo(config: SessionConfig, view: ViewInputs, chart: MeasuredChart,
                 irradiance: np.ndarray | None, bands: tuple[str, ...]) -> ChartPhoto:
    # of flat samples a filter is part of the fit, of a scene part of the light
    through = read_filter(config, view.filter) if config.flat and view.filter else None
    light = read_light(config, view.light) if config.flat else read_light_of(config, view)
    return ChartPhoto(chart.samples, read_chart_reference(config), light, irradiance,
                      excluded_patches(config), session_chart(config), through, bands)


def _calibration_of(config: SessionConfig, view: ViewInputs, camera: Calibration,
                    fit: ChartCalibration | None, number: int | None,
                    scale: LightScale | None) -> Calibration:
    """The calibration of a further view, its chart being photo ``number`` of the fit."""
    light = read_light(config, view.light) if config.flat else read_light_of(config, view)
    own = dataclasses.replace(camera, light_scale=scale, light=camera.light if isinstance(
        light, UnknownLight) else light)
    if not config.flat or fit is None or fit.prior_fit is None or number is None:
        return own
    return through_filter(own, fit.prior_fit, number, FINE_GRID)


def _chart_fit(config: SessionConfig, fit: ChartCalibration, photo: ChartPhoto,
               thumbnail: LinearImage, held_out: HeldOutPatches) -> ChartFit:
    """How the fit explains the first chart photo."""
    irradiance, patch_error = photo.irradiance_or_pi, None
    if fit.prior_fit is not None:
        patch_error = np.array(fit.prior_fit.patch_error)
        if config.flat:
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


def _irradiance(task: StageTask) -> np.ndarray | None:
    """On each patch for a light spectrum of 1; None where the geometry is not known."""
    scene = read_chart_scene(task.config)
    if scene is None:
        return None
    task.progress(0.2, "irradiance on the chart")
    start_mitsuba(task.device)
    chart = session_chart(task.config)
    return patch_irradiance(scene, chart.centres_uv, chart.sizes_uv, task.config.session.seed)


def _with_lamp_error(config: SessionConfig,
                     calibrations: Mapping[str, Calibration]) -> dict[str, Calibration]:
    """With what the lamp's position in the chart scene leaves open in every light scale from a
    chart.
    """
    scene, chart = read_chart_scene(config), session_chart(config)
    assert scene is not None
    error = lamp_position_error(scene, chart.centres_uv, chart.sizes_uv,
                                config.repeatability.lamp_position, config.session.seed)
    return {name: calibration if calibration.light_scale is None else dataclasses.replace(
                calibration,
                light_scale=with_common_error(calibration.light_scale, LAMP_AT_CHART, error))
            for name, calibration in calibrations.items()}


def _uneven_notes(config: SessionConfig, charts: Mapping[str, MeasuredChart],
                  irradiance: np.ndarray | None) -> tuple[str, ...]:
    """Chart photos whose light changes by more than lamp and chart in their places explain."""
    return () if irradiance is None else tuple(
        f"{view.chart_files[0]} should be shot again: {reason}" for view in config.views_with_chart
        for reason in uneven_light_reasons(charts[view.name].light, irradiance))
