"""The stage that fits one camera to all chart photos, and a light with its scale to every view."""
from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from spectrabox.calibrate.chart_calibration import (
    CalibrationOptions,
    ChartCalibration,
    ChartPhoto,
    calibrate_chart,
    calibration_from_curves,
)
from spectrabox.calibrate.prior.camera_prior import load_camera_prior
from spectrabox.calibrate.trust import certain_glare
from spectrabox.capture.chart.quality import uneven_light_reasons
from spectrabox.measure.chart_check import held_out_patches
from spectrabox.radiometry.error_model import LAMP_AT_CHART, with_common_error
from spectrabox.radiometry.records import (
    Calibration,
    LightScale,
    PatchSamples,
    Progress,
    Spectrum,
    UnknownLight,
)
from spectrabox.reconstruct.rendering.irradiance import lamp_position_error, patch_irradiance
from spectrabox.reconstruct.rendering.renderer import start_mitsuba
from spectrabox.session.config.session_chart import session_chart
from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.stages.chart_stage import light_on_chart
from spectrabox.session.stages.inputs import (
    GRID,
    excluded_patches,
    read_chart_reference,
    read_light,
    read_sensitivities,
)
from spectrabox.session.stages.scenes import read_chart_scene
from spectrabox.session.stages.stage_task import StageTask
from spectrabox.session.stages.stored_records import chart_of
from spectrabox.session.store.store import StoredStage


def calibrate_views(task: StageTask) -> dict[str, Any]:
    """Patch statistics and lights to one camera, and to the light and its scale of every view.

    With the method ``prior`` the charts under all lights are one fit; other methods fit the camera
    to the first. Where a light is unknown, every chart has a fit of its own.

    Returns
    -------
    dict
        The "calibration" of every view, and of the first chart the "irradiance" (I,), the
        "predicted" signals (I, K), its "white" (ChartWhite, by methods that fit one), what is the
        "prior"'s (PriorInfluence) and its patches "left out" (HeldOutPatches); None where there is
        no chart.
    """
    config = task.config
    lights = [read_light(config, view.light) for view in config.all_views]
    charts = [chart_of(task.stored, view) for view in config.all_views]
    shown = {number: chart[1] for number, chart in enumerate(charts) if chart is not None}
    irradiance = _irradiance(config, task.device, task.progress) if shown else None
    task.progress(0.6, "fitting sensitivities")
    curves = None if config.sensitivity.from_chart else read_sensitivities(config)[1]
    first = _first_chart(config, shown, lights, irradiance, curves) if 0 in shown else None
    if first is not None:
        camera = first.calibration
    else:
        assert curves is not None
        camera = calibration_from_curves(GRID, curves, _stated(lights[0]),
                                         config.sensitivity.relative_error)
    on_patches = None
    if first is not None:   # pi where the scene does not say: a reflectance of 1 has signal 1
        on_patches = np.full(len(first.predicted), np.pi) if irradiance is None else irradiance
    records: dict[str, Any] = {"calibration": camera, "irradiance": on_patches,
               "predicted": None if first is None else first.predicted,
               "white": None if first is None else first.white,
               "prior": None if first is None else first.prior_influence}
    records |= _other_calibrations(config, shown, lights, irradiance, curves, first, camera)
    records["glare"] = np.zeros(1) if first is None or charts[0] is None else certain_glare(
        first.prior_fit, charts[0][2])
    if irradiance is not None:
        _widen_by_lamp_position(config, records)
    records["notes"] = () if irradiance is None else _uneven_notes(config, task.stored, irradiance)
    records["left out"] = None if first is None else held_out_patches(
        first, read_chart_reference(config))
    return records


def _other_calibrations(config: SessionConfig, shown: Mapping[int, PatchSamples],
                        lights: Sequence[Spectrum | UnknownLight], irradiance: np.ndarray | None,
                        curves: np.ndarray | None, first: ChartCalibration | None,
                        camera: Calibration) -> dict[str, Any]:
    """Of every view but the first."""
    records, vague = {}, any(isinstance(light, UnknownLight) for light in lights)
    for number, view in enumerate(config.all_views[1:], start=1):
        if number in shown and vague:
            own = calibrate_chart([_chart_photo(config, number, shown, lights, irradiance)], GRID,
                                  _options(config, curves))
            records[view.record("calibration")] = own.calibration
            continue
        if number in shown:
            scale = _scale_under(config, number, shown, _stated(lights[number]), irradiance, first,
                                 camera.sensitivity.curves)
        else:
            scale = camera.light_scale if view.light == config.all_views[0].light else None
        light = camera.light if vague else _stated(lights[number])
        records[view.record("calibration")] = dataclasses.replace(camera, light=light,
                                                                  light_scale=scale)
    return records


def _widen_by_lamp_position(config: SessionConfig, records: dict[str, Any]) -> None:
    """Add to every light scale from a chart what the lamp's position in the chart scene leaves
    open.
    """
    scene = read_chart_scene(config)
    assert scene is not None
    chart = session_chart(config)
    error = lamp_position_error(scene, chart.centres_uv, chart.sizes_uv,
                                config.repeatability.lamp_position, config.session.seed)
    for view in config.all_views:
        calibration = records[view.record("calibration")]
        if calibration.light_scale is not None:
            records[view.record("calibration")] = dataclasses.replace(
                calibration, light_scale=with_common_error(calibration.light_scale, LAMP_AT_CHART,
                                                           error))


def _uneven_notes(config: SessionConfig, stored: Mapping[str, StoredStage],
                  irradiance: np.ndarray) -> tuple[str, ...]:
    """Chart photos whose light changes by more than lamp and chart in their places explain."""
    return tuple(f"{view.chart_files[0]} should be shot again: {reason}"
                 for view in config.views_with_chart
                 for reason in uneven_light_reasons(light_on_chart(stored, view), irradiance))


def _irradiance(config: SessionConfig, device: str, progress: Progress) -> np.ndarray | None:
    """On each patch for a light spectrum of 1; None where the geometry is not known."""
    scene = read_chart_scene(config)
    if scene is None:
        return None
    progress(0.2, "irradiance on the chart")
    start_mitsuba(device)
    chart = session_chart(config)
    return patch_irradiance(scene, chart.centres_uv, chart.sizes_uv, config.session.seed)


def _stated(light: Spectrum | UnknownLight) -> Spectrum:
    assert isinstance(light, Spectrum)      # session_rules refuses what would need it
    return light


def _first_chart(config: SessionConfig, shown: Mapping[int, PatchSamples],
                 lights: Sequence[Spectrum | UnknownLight], irradiance: np.ndarray | None,
                 curves: np.ndarray | None) -> ChartCalibration:
    """The first view's chart, together with those under other lights where the method takes
    several and all are known.
    """
    known = not any(isinstance(light, UnknownLight) for light in lights)
    several = curves is None and config.sensitivity.method in (None, "prior") and known
    photos = [_chart_photo(config, number, shown, lights, irradiance) for number in shown
              if several or number == 0]
    return calibrate_chart(photos, GRID, _options(config, curves))


def _chart_photo(config: SessionConfig, number: int, shown: Mapping[int, PatchSamples],
                 lights: Sequence[Spectrum | UnknownLight],
                 irradiance: np.ndarray | None) -> ChartPhoto:
    return ChartPhoto(shown[number], read_chart_reference(config), lights[number], irradiance,
                      excluded_patches(config), chart=session_chart(config))


def _options(config: SessionConfig, curves: np.ndarray | None) -> CalibrationOptions:
    chosen = config.sensitivity
    prior = None if chosen.prior is None else load_camera_prior(config.path(chosen.prior))
    return CalibrationOptions(chosen.method or "prior", prior, chosen.coefficients, curves)


def _scale_under(config: SessionConfig, number: int, shown: Mapping[int, PatchSamples],
                 light: Spectrum, irradiance: np.ndarray | None, first: ChartCalibration | None,
                 curves: np.ndarray) -> LightScale | None:
    """Scale of the light of one view from its own chart photo; None where the geometry is not
    known.
    """
    if irradiance is None:
        return None
    if first is not None and first.prior_fit is not None:
        return first.prior_fit.photos[list(shown).index(number)].light_scale
    photo = ChartPhoto(shown[number], read_chart_reference(config), light, irradiance,
                       chart=session_chart(config))
    return calibrate_chart([photo], GRID, CalibrationOptions(curves=curves)).scale
