"""The stage that fits one camera to the charts of all photos, and white and field to each."""
from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from spectrabox.calibrate.chart_calibration import (
    CalibrationOptions,
    ChartCalibration,
    ChartPhoto,
    calibrate_chart,
)
from spectrabox.calibrate.prior.camera_prior import CameraPrior, load_camera_prior
from spectrabox.calibrate.prior.plain_priors import prior_of_curves
from spectrabox.measure.chart_check import held_out_patches
from spectrabox.radiometry.records import PatchSamples, UnknownLight
from spectrabox.session.config.session_chart import session_chart
from spectrabox.session.config.session_schema import SessionConfig, ViewInputs
from spectrabox.session.stages.inputs import (
    GRID,
    excluded_patches,
    read_chart_reference,
    read_light,
    read_sensitivities,
)
from spectrabox.session.stages.stage_task import StageTask
from spectrabox.session.stages.stored_records import chart_of

SHADED, BRIGHT = 0.06, 0.03     # darker than this is a shadow; of the brightest signal


def calibrate_photos(task: StageTask) -> dict[str, Any]:
    """Patch statistics and lights to one camera, and to the white and the field of every photo.

    Returns
    -------
    dict
        The "calibration" of every view; of every view with a chart what "white" reads there, a
        ChartWhite; of the first chart the "irradiance" (I,) and the "predicted" signals (I, K);
        the "model error" (2,) of patches that the fit found, a PatchError; what is the
        "prior"'s (PriorInfluence), and its patches "left out".
    """
    config = task.config
    reference, layout = read_chart_reference(config), session_chart(config)
    task.progress(0.1, "fitting sensitivities")
    groups = _one_fit_each(config)
    records: dict[str, Any] = {"notes": ()}
    for number, views in enumerate(groups):
        shown = [view for view in views if view.chart]
        lights = {view.light: read_light(config, view.light) for view in views}
        photos = [ChartPhoto(_patches(task, view), reference, lights[view.light],
                             excluded=excluded_patches(config), chart=layout) for view in shown]
        made = calibrate_chart(photos, GRID, CalibrationOptions(prior=_prior(config)))
        assert made.prior_fit is not None
        records["notes"] += _shadow_notes(shown[0], made, session_chart(config).names)
        if number == 0:
            lit = np.full(len(made.predicted), np.nan)      # patches that are left out: not known
            lit[photos[0].used] = made.prior_fit.photos[0].field
            records |= {"predicted": made.predicted, "irradiance": lit,
                        "prior": made.prior_influence,
                        "model error": np.array(made.prior_fit.patch_error),
                        "left out": held_out_patches(made, reference)}
        for view in views:
            light = lights[view.light]
            records[view.record("calibration")] = made.calibration if isinstance(
                light, UnknownLight) else dataclasses.replace(made.calibration, light=light)
        for view, state in zip(shown, made.prior_fit.photos, strict=True):
            records[view.record("white")] = state.white
    return records


def _shadow_notes(view: ViewInputs, made: ChartCalibration,
                  names: Sequence[str]) -> tuple[str, ...]:
    """Patches that are darker in all bands alike than the rest of the chart makes them."""
    predicted = made.held_out
    bright = predicted.min(axis=1) > BRIGHT * predicted.max()
    residuals = made.calibration.sensitivity.residuals
    assert residuals is not None
    measured = made.predicted / (1 - residuals)
    off = measured / np.where(bright[:, None], predicted, np.inf) - 1
    darker = np.flatnonzero(bright & (off.mean(axis=1) < -SHADED)
                            & (np.ptp(off, axis=1) < -off.mean(axis=1)))
    if not darker.size:
        return ()
    return (f"{view.chart_files[0]}: {', '.join(names[patch] for patch in darker[:6])} read up to "
            f"{-off[darker].mean(axis=1).min():.0%} darker in all bands than the rest of the chart "
            "makes them: a shadow lies across it, or they are soiled; photograph it again without, "
            "or leave them out (chart.leave_out)",)


def _one_fit_each(config: SessionConfig) -> list[list[ViewInputs]]:
    """Views whose charts are one fit: all, or those under each light where one is unknown."""
    views = list(config.all_views)
    if all(view.light.stated for view in views):
        return [views]
    return [[view for view in views if view.light == light]
            for light in dict.fromkeys(view.light for view in views)]


def _patches(task: StageTask, view: ViewInputs) -> PatchSamples:
    chart = chart_of(task.stored, view)
    assert chart is not None
    return chart[1]


def _prior(config: SessionConfig) -> CameraPrior | None:
    """The prior that the operator named, or one about measured curves; None for the shipped."""
    if not config.sensitivity.from_chart:
        _, curves = read_sensitivities(config)
        return prior_of_curves(GRID, curves, config.sensitivity.relative_error)
    return None if config.sensitivity.prior is None else \
        load_camera_prior(config.path(config.sensitivity.prior))
