"""Stored results of a finished session of flat samples to what the report shows."""
from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from spectrabox.session.calibration_facts import light_facts
from spectrabox.session.config.session_schema import FIRST_PHOTO, SessionConfig, ViewInputs
from spectrabox.session.flat.flat_results import FlatResults, PhotoOfRegions
from spectrabox.session.flat.region_stage import regions_of
from spectrabox.session.pictures.picture_results import picture_of
from spectrabox.session.pipeline import FinishedRun
from spectrabox.session.stages.assemble import (
    chart_result,
    doubtful_materials,
    input_files,
    sensitivity_truth,
    surface_result,
)
from spectrabox.session.stages.inputs import band_names
from spectrabox.session.stages.stored_records import (
    calibrations_of,
    chart_of,
    notes_of,
    photo_of,
    signals_of,
)
from spectrabox.session.store.store import StoredStage


def assemble_flat(config: SessionConfig, run: FinishedRun,
                  provenance: dict[str, Any]) -> FlatResults:
    """Everything the report of a session of flat samples shows."""
    stored = run.stored
    calibration, signals = calibrations_of(config, stored)[0], signals_of(stored)
    photo = photo_of(stored)
    regions = [surface_result(config, signals, run, index, None)
               for index in range(len(signals.names))]
    return FlatResults(
        folder=config.folder, name=config.session.name, operator=config.session.operator,
        notes=config.session.notes, bands=band_names(config, photo.signal.shape[2]),
        inputs=input_files(config, run), chart=chart_result(config, run), calibration=calibration,
        sensitivity_truth=sensitivity_truth(config), photo=photo,
        photo_preview=config.results_folder / "photo" / "preview.png", materials=regions,
        signal_bands=signals.bands, provenance=provenance, input_digests=run.input_digests(config),
        warnings=[*notes_of(stored), *stored["signals"].record(tuple[str, ...], "notes"),
                  *(f"Calibration: {doubt.value}." for doubt in calibration.doubts),
                  *doubtful_materials(regions)],
        stages=[{"name": name, "seconds": stage.seconds, "state": run.states[name]}
                for name, stage in stored.items()],
        photos=[_photo(config, stored, view) for view in config.all_views], signals=signals,
        light=light_facts(calibration), picture=picture_of(config, stored))


def _photo(config: SessionConfig, stored: Mapping[str, StoredStage],
           view: ViewInputs) -> PhotoOfRegions:
    photo, chart = photo_of(stored, view), chart_of(stored, view)
    height, width = photo.signal.shape[:2]
    own_chart = chart is not None and view.chart_files == view.photo_files
    shown = regions_of(config, view)
    light = stored["signals"].record(np.ndarray, view.record("light"))
    over = {} if light is None else {
        name: (float(level), float(error))
        for (name, _), (level, error) in zip(shown, light, strict=True)}
    return PhotoOfRegions(
        view.name or FIRST_PHOTO, config.results_folder / "photo" / f"{view.record('preview')}.png",
        (round(width * photo.sensor_step), round(height * photo.sensor_step)),
        {name: np.array(region.outline()) for name, region in shown},
        chart[0].corners_px if chart is not None and own_chart else None, over,
        stored["signals"].record(np.ndarray, view.record("light map")),
        _misfits(config, stored, view))


def _misfits(config: SessionConfig, stored: Mapping[str, StoredStage],
             view: ViewInputs) -> dict[str, float]:
    known = [name for name, section in regions_of(config, view) if section.known is not None]
    misfits = stored["signals"].record(np.ndarray, view.record("level misfits"))
    return {} if misfits is None else dict(zip(known, misfits.tolist(), strict=True))
