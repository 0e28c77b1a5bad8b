"""The stage that turns photographed regions into signals relative to white, with every error."""
from __future__ import annotations

from typing import Any

import numpy as np

from spectrabox.calibrate.chart_equations import PatchError
from spectrabox.measure.flat import flat_signals
from spectrabox.measure.white import (
    FlatErrors,
    FlatPhoto,
    far_notes,
    level_notes,
    light_map,
    white_at_regions,
)
from spectrabox.radiometry.light_scale import drift_between
from spectrabox.radiometry.records import ChartWhite, LightDrift, RegionSamples
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.session.config.session_chart import session_chart
from spectrabox.session.config.session_schema import FIRST_PHOTO, SessionConfig
from spectrabox.session.stages.inputs import GRID, band_names, read_reflectance
from spectrabox.session.stages.stage_task import StageTask
from spectrabox.session.stages.stored_records import (
    calibrations_of,
    chart_of,
    photo_of,
    reference_signals,
)


def find_signals(task: StageTask) -> dict[str, Any]:
    """Signals of regions, charts and calibrations to signals relative to white.

    Returns
    -------
    dict
        "signals", a SurfaceSignals; of every photo the "light" (R, 2) on its regions, relative to
        that on the chart, with its relative error, and both over the photo as "light map" (2, h,
        w), None where it shows no region, and how far the levels of its known regions are from the
        light's as "level misfits", in standard errors; the "drift" of the light, a LightDrift or
        None; "notes".

    Raises
    ------
    InputError
        If chart and samples were exposed differently and do not say how.
    CheckError
        If a region of known spectrum shows another light than the chart.
    """
    config = task.config
    photos, known, errors = flat_photos(task), known_spectra(config), flat_errors(task)
    records: dict[str, Any] = {"drift": photos[0].drift, "notes": ()}
    whites = []
    for number, (view, photo) in enumerate(zip(config.all_views, photos, strict=True)):
        task.progress(number / len(photos), view.photo_files[0])
        white = white_at_regions(photo, known, errors)
        whites.append(white)
        maps: dict[str, np.ndarray | None] = {"level misfits": None, "light": None,
                                              "light map": None}
        if white is not None:
            records["notes"] += far_notes(white) + level_notes(white)
            maps = {"level misfits": np.array(list(white.level_misfits.values())),
                    "light": np.column_stack([np.exp(white.log_field), white.field_error]),
                    "light map": light_map(photo, errors)}
        records |= {view.record(name): value for name, value in maps.items()}
    families = {name: region.families for name, region in config.regions.items()}
    bands = band_names(config, len(photos[0].response))
    records["signals"] = flat_signals(photos, whites, families, known, bands, errors)
    if photos[0].drift is not None:
        records["notes"] += (photos[0].drift.sentence,)
    return records


def flat_photos(task: StageTask) -> list[FlatPhoto]:
    """Every photo of the session, with the chart photo that shows its light."""
    config, stored, layout = task.config, task.stored, session_chart(task.config)
    photos = []
    for view, calibration in zip(config.all_views, calibrations_of(config, stored), strict=True):
        with_chart = view if view.chart else config.all_views[0]
        chart = chart_of(stored, with_chart)
        assert chart is not None
        photos.append(FlatPhoto(
            view.name or FIRST_PHOTO, stored["photo"].record(RegionSamples, view.record("regions")),
            photo_of(stored, view), chart[2], with_chart.chart_files == view.photo_files,
            chart[0].corners_px, layout,
            stored["calibrate"].record(ChartWhite, with_chart.record("white")), calibration,
            None if view.name else _drift_of(task)))
    return photos


def flat_errors(task: StageTask) -> FlatErrors:
    """What the session states of errors, and the disagreement that the chart's patches show."""
    config = task.config
    own, common = task.stored["calibrate"].record(np.ndarray, "model error")
    return FlatErrors(config.repeatability.relative_error, config.stray_light.glare,
                      PatchError(float(own), float(common)), bool(config.photos.flats),
                      config.session.seed)


def known_spectra(config: SessionConfig) -> dict[str, np.ndarray]:
    """Reflectances (P,) of the regions whose spectrum is known."""
    return {name: spectrum_on_grid(read_reflectance(config, section.known), GRID)
            for name, section in config.regions.items() if section.known is not None}


def _drift_of(task: StageTask) -> LightDrift | None:
    """Change of the light from the first chart photo to the first photo of samples, where both
    show references.
    """
    chart = chart_of(task.stored)
    if not task.config.drift.chart_px or chart is None:
        return None
    return drift_between(chart[2], reference_signals(task.stored["chart"]), photo_of(task.stored),
                         reference_signals(task.stored["photo"]), task.config.drift.relative_error)
