"""What was found of flat samples: their photos, the light on every region, the verdict's share."""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from spectrabox.measure import captured, conditions, records, rules, texts
from spectrabox.measure.results import capture_result, methods
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records.photos import RegionEdge, RegionSamples
from spectrabox.radiometry.records.spectra import SurfaceSignals


@dataclass(frozen=True, eq=False)
class PhotoOfRegions:
    """One photo of flat samples with what it shows."""

    name: str
    view: str                           # name of the photo, empty of the first
    # of each region: light relative to the chart's mean, and its relative standard error
    light: dict[str, tuple[float, float]]
    # of each known region: its level against the light's, in standard errors of both
    level_misfits: dict[str, float]
    # of each region: relative scatter of its pixels beyond noise and a plane, in the worst band
    scatter: dict[str, float]
    edges: dict[str, RegionEdge]        # of the regions across which one runs
    size_px: tuple[int, int]            # width and height of the photo itself
    outlines: dict[str, np.ndarray]     # (C, 2) corners of each region in its pixels
    chart_px: np.ndarray | None         # (I, 4, 2) patches, where the chart lies in this photo
    # over the photo: light and its relative error, (2, h, w); None where it shows no region
    light_map: np.ndarray | None
    shift_px: float | None = None       # against the first photo; None: not compared
    residual_px: float | None = None    # what the registration left
    silent_bands: tuple[str, ...] = ()  # too dark or saturated on all its regions
    # of a chart with a fit of its own: mean share of the bands of left-out patches that hold
    chart_held: float | None = None
    # what lights it: the lamp as stated, or the photo with the same; where that was moved; filter
    lamp: Mapping[str, str] = field(default_factory=dict)

    @property
    def finding(self) -> Finding:
        """Its light, its chart, how it was registered and what it does not tell."""
        return Finding("photo.of-regions", Severity.INFO, self.name, {
            **self.lamp, "shift_px": self.shift_px, "residual_px": self.residual_px,
            "left_out_bands": list(self.silent_bands), "chart_held": self.chart_held})

    @property
    def facts(self) -> dict[str, Any]:
        """For JSON."""
        return {"name": self.name, "says": texts.sentence(self.finding), "shift_px": self.shift_px,
                "residual_px": self.residual_px, "left_out_bands": self.silent_bands,
                "chart_held": self.chart_held}


@dataclass(frozen=True, eq=False, kw_only=True)
class FlatResult(capture_result.CaptureResult):
    """What was found of flat samples."""

    photos: tuple[PhotoOfRegions, ...]

    surface_word = "region"
    right = "flat.right"

    @property
    def own_findings(self) -> list[Finding]:
        return rules.flat_findings(self)

    @cached_property
    def conditions(self) -> tuple[Finding, ...]:
        return conditions.flat_conditions(self)

    @property
    def own_facts(self) -> dict[str, Any]:
        return {"regions": [surface.facts() for surface in self.surfaces],
                "photos": [photo.facts for photo in self.photos]}

    @property
    def own_lines(self) -> list[str]:
        if len(self.photos) < 2:
            return []
        return [texts.sentence(photo.finding) for photo in self.photos]

    @property
    def methods(self) -> list[str]:
        return methods.flat_methods(self)

    @property
    def light(self) -> dict[str, tuple[float, float]]:
        """Of each region: the light on it in the first photo that shows it, relative to the chart's
        mean, and its relative error.
        """
        return {surface.name: surface.light for surface in self.surfaces
                if surface.light is not None}


def flat_result(capture: captured.FlatCapture, records: records.CaptureRecords,
                picture_folder: str = "") -> FlatResult:
    """What was found of flat samples.

    Parameters
    ----------
    capture : FlatCapture
    records : CaptureRecords
        Of all steps.
    picture_folder : str
        Where the picture's files lie, as its reader knows it.
    """
    photos = tuple(_photo_of_regions(capture, records, view) for view in capture.views)
    light: dict[str, tuple[float, float]] = {}
    scatter: dict[str, float] = {}
    edges: dict[str, RegionEdge] = {}
    for photo in photos:
        light = photo.light | light
        edges = photo.edges | edges
        for name, value in photo.scatter.items():
            scatter[name] = max(value, scatter.get(name, value))
    surfaces = tuple(
        capture_result.surface_of_records(capture, records, name, None, light.get(name),
                                          scatter.get(name), edges.get(name))
        for name in capture.surfaces if name in records.signals.names)
    return FlatResult(**capture_result.common_findings(capture, records), surfaces=surfaces,
                      photos=photos, picture_folder=picture_folder)


def _photo_of_regions(capture: captured.FlatCapture, records: records.CaptureRecords,
                      view: captured.View) -> PhotoOfRegions:
    photo = records.photo.photos[view.name]
    chart = records.charts.get(view.name)
    height, width = photo.signal.shape[:2]
    shown = capture.regions_in(view)
    signals = records.flat_signals
    samples = records.photo.regions.get(view.name)
    registration = records.photo.registrations.get(view.name)
    held = records.calibrate.other_charts.get(view.name)
    if not view.name and records.calibrate.chart is not None:
        held = records.calibrate.chart.left_out
    scatter, edges = {}, {}
    if samples is not None:
        scatter = dict(zip(samples.names, samples.scatter.max(axis=1).tolist(), strict=True))
        edges = dict(samples.edges)
    return PhotoOfRegions(
        name=view.title, view=view.name, light=signals.light.get(view.name, {}),
        level_misfits=signals.level_misfits.get(view.name, {}), scatter=scatter, edges=edges,
        size_px=(round(width * photo.sensor_step), round(height * photo.sensor_step)),
        outlines={name: np.array(region.outline) for name, region in shown.items()},
        chart_px=None if chart is None or not view.shows_chart else chart.detection.corners_px,
        light_map=signals.light_maps.get(view.name), lamp=_lamp(view),
        shift_px=None if registration is None else registration.shift_px,
        residual_px=None if registration is None else registration.residual_px,
        silent_bands=_silent_bands(records.signals, capture.views.index(view), samples),
        chart_held=None if held is None else held.means[1])


def _lamp(view: captured.View) -> dict[str, str]:
    """What lights a photo, as values of its finding."""
    return {"light": view.light_words, "lamp_of": view.lamp, "moved": view.moved or "",
            "filter": "" if view.filter is None else view.filter_words}


def _silent_bands(signals: SurfaceSignals, number: int,
                  samples: RegionSamples | None) -> tuple[str, ...]:
    """Bands of a photo, by its number, that say nothing of any region that it shows."""
    rows = [] if samples is None else [signals.names.index(name) for name in samples.names]
    return tuple(band for index, band in enumerate(signals.bands)
                 if rows and signals.view_of_band[index] == number
                 and np.isnan(signals.signal[rows, index]).all())
