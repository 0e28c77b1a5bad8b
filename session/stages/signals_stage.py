"""The stage that turns photographed regions into signals relative to white, with every error."""
from __future__ import annotations

import numpy as np

from spectrabox.calibrate.chart_equations import PatchError
from spectrabox.capture.chart.patches import clipped_bands
from spectrabox.measure.flat import flat_signals
from spectrabox.measure.white import (
    FlatErrors,
    FlatPhoto,
    far_notes,
    level_notes,
    light_map,
    white_at_regions,
)
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.session.config.session_chart import session_chart
from spectrabox.session.config.session_rules import nothing_to_measure
from spectrabox.session.config.session_schema import SessionConfig
from spectrabox.session.stages.inputs import band_names, read_reflectance
from spectrabox.session.stages.records import RegionLight, SessionRecords, SignalRecords
from spectrabox.session.stages.stage_task import StageTask


def find_signals(task: StageTask) -> SignalRecords:
    """Signals of regions, charts and calibrations to signals relative to white.

    Parameters
    ----------
    task : StageTask

    Raises
    ------
    InputError
        If there is no region to estimate, or chart and samples were exposed differently and do not
        say how.
    CheckError
        If a region of known spectrum shows another light than the chart.
    """
    config = task.config
    if problems := nothing_to_measure(config):
        raise InputError("\n".join(problems))
    photos, known, errors = flat_photos(config, task.records), known_spectra(config), \
        flat_errors(config, task.records)
    notes: tuple[str, ...] = ()
    lights: dict[str, RegionLight] = {}
    whites = []
    for number, (view, photo) in enumerate(zip(config.all_views, photos, strict=True)):
        task.progress(number / len(photos), view.photo_files[0])
        white = white_at_regions(photo, known, errors)
        whites.append(white)
        if white is not None:
            notes += far_notes(white) + level_notes(white)
            lights[view.name] = RegionLight(
                np.exp(white.log_field), white.field_error,
                np.array(list(white.level_misfits.values())),
                light_map(photo, known, errors))
    families = {name: region.families for name, region in config.regions.items()}
    swatches = {name: spectrum_on_grid(read_reflectance(config, region.swatch), FINE_GRID)
                for name, region in config.regions.items() if region.swatch is not None}
    signals = flat_signals(photos, whites, families, known | swatches,
                           band_names(config, task.records.photo.bands), errors)
    drift = photos[0].drift
    return SignalRecords(signals, lights, drift,
                         notes if drift is None else (*notes, drift.sentence))


def flat_photos(config: SessionConfig, records: SessionRecords) -> list[FlatPhoto]:
    """Every photo of the session, with the chart photo that shows its light.

    Parameters
    ----------
    config : SessionConfig
    records : SessionRecords
        Of the stages up to "calibrate".
    """
    layout, photos = session_chart(config), []
    for view, calibration in zip(config.all_views, records.calibrations(config), strict=True):
        with_chart = view if view.chart else config.all_views[0]
        chart = records.chart.charts[with_chart.name]
        photos.append(FlatPhoto(
            view.title, records.photo.regions.get(view.name),
            records.photo.photos[view.name], chart.thumbnail,
            with_chart.chart_files == view.photo_files, chart.detection.corners_px, layout,
            records.calibrate.whites[with_chart.name], calibration,
            None if view.name else records.drift(config), view.lamp,
            clipped_bands(chart.samples, layout.neutrals)))
    return photos


def flat_errors(config: SessionConfig, records: SessionRecords) -> FlatErrors:
    """What the session states of errors, and the disagreement that the chart's patches show.

    Parameters
    ----------
    config : SessionConfig
    records : SessionRecords
    """
    fit = records.calibrate.chart
    assert fit is not None and fit.patch_error is not None      # flat samples need chart and prior
    own, common = fit.patch_error
    return FlatErrors(config.repeatability.relative_error, config.stray_light.glare,
                      PatchError(float(own), float(common)), bool(config.photos.flats),
                      config.repeatability.plane,
                      {name: region.surface for name, region in config.regions.items()
                       if region.surface is not None}, config.session.seed)


def known_spectra(config: SessionConfig) -> dict[str, np.ndarray]:
    """Reflectances (P,) of the regions whose spectrum is known."""
    return {name: spectrum_on_grid(read_reflectance(config, section.known), FINE_GRID)
            for name, section in config.regions.items() if section.known is not None}
