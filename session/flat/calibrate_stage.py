"""The stage that fits one camera to the charts of all photos, and white and field to each."""
from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from spectrabox.calibrate.calibration import CalibrationOptions, ChartPhoto, calibrate_chart
from spectrabox.calibrate.prior.camera_prior import CameraPrior, load_prior
from spectrabox.calibrate.prior.measured_prior import prior_of_curves
from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.stages.inputs import (
    GRID,
    read_chart_reference,
    read_light,
    read_sensitivities,
)
from spectrabox.session.stages.stage_task import StageTask
from spectrabox.session.stages.stored_records import chart_of


def calibrate_photos(task: StageTask) -> dict[str, Any]:
    """Patch statistics and lights to one camera, and to the white and the field of every photo.

    Returns
    -------
    dict
        The "calibration" of every view; of every view with a chart what "white" reads there, a
        ChartWhite; of the first chart the "irradiance" (24,) and the "predicted" signals (24, K);
        the relative "model error" of patches that the fit found.
    """
    config = task.config
    lights = {view.name: read_light(config, view.light) for view in config.all_views}
    reference = read_chart_reference(config)
    shown, photos = config.views_with_chart, []
    for view in shown:
        chart = chart_of(task.stored, view)
        assert chart is not None
        photos.append(ChartPhoto(chart[1], reference, lights[view.name]))
    task.progress(0.1, "fitting sensitivities")
    made = calibrate_chart(photos, GRID, CalibrationOptions(prior=_prior(config)))
    assert made.prior_fit is not None
    records: dict[str, Any] = {"predicted": made.predicted, "notes": (),
                               "irradiance": made.prior_fit.photos[0].field,
                               "model error": np.array([made.prior_fit.model_error])}
    for view in config.all_views:
        records[view.record("calibration")] = dataclasses.replace(made.calibration,
                                                                  light=lights[view.name])
    for view, state in zip(shown, made.prior_fit.photos, strict=True):
        records[view.record("white")] = state.white
    return records


def _prior(config: SessionConfig) -> CameraPrior | None:
    """The prior that the operator named, or one about measured curves; None for the shipped."""
    if not config.sensitivity.from_chart:
        _, curves = read_sensitivities(config)
        return prior_of_curves(GRID, curves, config.sensitivity.relative_error)
    return None if config.sensitivity.prior is None else \
        load_prior(config.path(config.sensitivity.prior))
