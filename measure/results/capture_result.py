"""What a measurement found, whatever was photographed; nothing here knows a folder or a file."""
from __future__ import annotations

import textwrap
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np

from spectrabox.measure import captured, conditions, extras, rules, tables, texts, words
from spectrabox.measure.advice.advice import Advised
from spectrabox.measure.records import CaptureRecords, ChartFit, MeasuredChart, PictureRecords
from spectrabox.measure.results import calibration_facts, facts, surface_result
from spectrabox.radiometry.chart import CLASSIC, Chart
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.grid import WavelengthGrid
from spectrabox.radiometry.records import calibration as calibration_records
from spectrabox.radiometry.records import photos as photo_records
from spectrabox.radiometry.spectra.cameras import known_camera, known_camera_words
from spectrabox.sampling.prior.mixture import load_prior, of_families

SHOWN = 10      # surfaces of a short answer


@dataclass(frozen=True, eq=False, kw_only=True)
class CaptureResult(ABC):
    """What was found, what the verdict rests on, and the words of both."""

    bands: tuple[str, ...]            # band names, "R", "G", "B" for a colour camera
    chart: ChartFit | None            # None where sensitivities came from a file
    measured_chart: MeasuredChart | None = None         # that it explains; of the first photo
    layout: Chart = CLASSIC           # of every chart
    # by view, of charts with a fit of their own: each patch by a calibration without it
    other_charts: Mapping[str, calibration_records.HeldOutPatches] = field(default_factory=dict)
    calibration: calibration_records.Calibration
    # by view, of further photos whose charts are a fit of their own
    other_calibrations: Mapping[str, calibration_records.Calibration] = field(default_factory=dict)
    # by view with a chart, why to photograph that again; none of a good photo
    chart_findings: Mapping[str, tuple[Finding, ...]] = field(default_factory=dict)
    # by view, the first by "": at the render's size, or thumbnails
    photo_of_view: Mapping[str, photo_records.LinearImage]
    grid: WavelengthGrid              # of the spectra
    signal_bands: tuple[str, ...]     # J names: the bands of all photos that differ in light
    surfaces: tuple[surface_result.SurfaceResult, ...]
    stated: captured.Capture          # the conditions that the result rests on
    processed: bool = False           # a photo by the camera, and decoded as sRGB
    kept: tuple[Finding, ...] = ()    # of the steps, but for the calibration
    # of charts and lights, beside those of each calibration
    calibration_findings: tuple[Finding, ...] = ()
    picture: PictureRecords | None = None       # the spectra of every pixel, where asked for
    picture_folder: str = ""          # where the picture's files lie, as its reader knows it
    # forecasts what to do next, which takes as long as a fit: called when it is asked for
    advise: Callable[..., Advised] = Advised

    @property
    def photo(self) -> photo_records.LinearImage:
        """The first."""
        return self.photo_of_view[""]

    @property
    def advice(self) -> Advised:
        """What to do next, of all surfaces and of each, the best first; nothing where that failed,
        as ``failed_extras`` says.
        """
        return self._advised[0]

    @cached_property
    def _advised(self) -> tuple[Advised, Finding | None]:
        return extras.attempt("advice", self.advise, Advised())

    @property
    def failed_advice(self) -> Finding | None:
        """Why there is no advice; None where there is."""
        return self._advised[1]

    @cached_property
    def failed_extras(self) -> tuple[Finding, ...]:
        """What of that which is no part of the answer could not be made, and why."""
        each = (self.failed_advice, *(surface.compared[1] for surface in self.surfaces))
        return extras.different(one for one in each if one is not None)

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """All that was found of it, by the steps and by the rules, but for its conditions."""
        return rules.findings_on(self)

    @cached_property
    def verdict(self) -> rules.Verdict:
        """The worst of all findings, and what it rests on."""
        known = [one for one in self.findings if one.code == "surface.known-to"]
        right = Finding(self.right, Severity.INFO, values={
            "surfaces": len(known), "weak": [one.subject for one in known if one.values["weak"]]})
        return rules.Verdict(self.findings, right, conditions.named(self.conditions))

    @property
    def notes(self) -> tuple[Finding, ...]:
        """What is worth knowing beside the verdict."""
        return tuple(one for one in self.findings if one.severity is Severity.NOTE)

    @property
    def warnings(self) -> list[str]:
        """The same in sentences."""
        return [*dict.fromkeys(map(texts.says, self.notes))]

    @property
    def light_scale(self) -> calibration_records.LightScale | None:
        """From rendered signal to that of the first photo; None where nothing is rendered."""
        return None

    @property
    @abstractmethod
    def own_findings(self) -> list[Finding]:
        """What captures of this kind alone are judged by."""

    @property
    @abstractmethod
    def right(self) -> str:
        """Code of what is said where nothing is wrong."""

    @property
    @abstractmethod
    def conditions(self) -> tuple[Finding, ...]:
        """What the result rests on: measured, stated or assumed, and what it costs if it fails."""

    @property
    @abstractmethod
    def own_facts(self) -> dict[str, Any]:
        """What is found in captures of this kind alone, for JSON."""

    @property
    def own_lines(self) -> list[str]:
        """The same for a person."""
        return []

    @property
    @abstractmethod
    def methods(self) -> list[str]:
        """Paragraphs for the methods section of a paper, with the numbers of this measurement."""

    @property
    @abstractmethod
    def surface_word(self) -> str:
        """What its surfaces are called: region or material."""

    def facts(self) -> dict[str, Any]:
        """Everything that was found, as plain numbers and sentences: the ``--json`` object of
        ``spectrabox run`` but for what is known of its folder (docs/reference/json.md).
        """
        chart = self.chart
        facts = {"verdict": self.verdict.word, "says": self.verdict.says,
                 "findings": [texts.facts(one) for one in self.findings],
                 "conditions": [conditions.facts(one) for one in self.conditions],
                 "left_out": None,
                 "chart_generation": None,
                 "light": calibration_facts.light_facts(self.calibration), **self.own_facts,
                 "known_camera": known_camera(self.photo.camera), "warnings": self.warnings,
                 "advice": self.advice.facts,
                 "failed_extras": [extras.facts(one) for one in self.failed_extras]}
        if chart is not None and chart.left_out is not None:
            facts["left_out"] = calibration_facts.held_out_facts(chart.left_out, self.layout.names)
            facts["chart_generation"] = calibration_facts.copy_facts(chart.copy, self.layout.names)
        if self.picture is not None:
            facts["picture"] = self.picture.facts(self.picture_folder)
        return facts

    def text(self, title: str = "") -> str:
        """A row for each condition and surface, what to beware of, the verdict with its reason, and
        what to do next.

        Parameters
        ----------
        title : str
            Of the table.
        """
        lines = [conditions.conditions_text(self.conditions, title), self._table()]
        if self.picture is not None:
            lines += [f"picture: {len(self.picture.files)} files in {self.picture_folder}",
                      *map(texts.says, self.picture.findings)]
        lines += self.own_lines
        known = known_camera(self.photo.camera)
        if known is not None:
            lines.append(known_camera_words(known))
        lines += [f"note: {sentence}" for sentence in self.warnings]
        lines += [f"note: {texts.says(one)}" for one in self.failed_extras]
        return "\n".join(filter(None, [*lines, self.verdict.line, self.advice.line]))

    def brief(self) -> str:
        """Verdict, colours and what to do next, in at most 24 lines of 80 letters."""
        notes = len(self.warnings)
        more = ["what the answer rests on",
                *([f"{notes} note{'s' if notes > 1 else ''}"] if notes else [])]
        lines = [*_wrapped(self.verdict.line, 5), "", *self._brief_table(), "",
                 f"{words.listed(more)}: --verbose, or the report".capitalize()]
        if self.picture is not None:
            lines.append(f"picture: {self.picture_folder}")
        lines += [f"note: {texts.says(one)}" for one in self.failed_extras]
        return "\n".join([*lines, *_wrapped(self.advice.line, 3)])

    def _brief_table(self) -> Iterator[str]:
        scored = any(surface.scores is not None for surface in self.surfaces)
        width = min(max(len(surface.name) for surface in self.surfaces), 24)
        yield (f"{self.surface_word:<{width}}     L*     a*     b*  ΔE00 within  spectrum within"
               + ("   RMSE" if scored else ""))
        shown = self.surfaces if len(self.surfaces) <= SHOWN else self.surfaces[:SHOWN - 1]
        for surface in shown:
            name = surface.name if len(surface.name) <= width else surface.name[:width - 1] + "…"
            row = f"{name:<{width}}" + "".join(f"{number:7.1f}" for number in surface.lab().value)
            if surface.known:
                row += "  as given"
            elif surface.within is not None:
                colour, spectrum = surface.within
                row += f"{colour:13.1f}{spectrum:17.3f}"
                if surface.scores is not None:
                    row += f"{surface.scores.rmse_mean:7.3f}"
            yield row
        if len(shown) < len(self.surfaces):
            yield f"... and {len(self.surfaces) - len(shown)} more: --verbose, or spectra.csv"

    def _table(self) -> str:
        estimated = [surface for surface in self.surfaces if not surface.known]
        headings, cells = facts.columns(surface_result.SURFACE_FACTS, estimated)
        rows = [[surface.name, *row] for surface, row in zip(estimated, cells, strict=True)]
        rows += [[surface.name, "given", *[""] * (len(headings) - 1)]
                 for surface in self.surfaces if surface.known]
        return tables.text_table([self.surface_word, *(headings or [""])], rows,
                                 text=[self.surface_word])


def _wrapped(sentence: str, lines: int) -> list[str]:
    return textwrap.wrap(sentence, 80, max_lines=lines, placeholder=" ... (--verbose)")


def common_findings(capture: captured.Capture, records: CaptureRecords) -> dict[str, Any]:
    """What is known of captures of every kind, by the fields of `CaptureResult`, but the surfaces.

    Parameters
    ----------
    capture : Capture
    records : CaptureRecords
        Of all steps.
    """
    calibrations = records.calibrate.calibrations
    photos = [*records.photo.photos.values(),
              *(chart.thumbnail for chart in records.charts.values())]
    return {"bands": capture.band_names(records.photo.bands),
            "chart": records.calibrate.chart, "measured_chart": records.charts.get(""),
            "layout": CLASSIC if capture.chart is None else capture.layout,
            "other_charts": records.calibrate.other_charts,
            "calibration": records.calibrations(capture.views)[0],
            "other_calibrations": {name: calibrations[name]
                                   for name in records.calibrate.other_charts},
            "chart_findings": {name: chart.findings
                               for name, chart in records.charts.items()},
            "grid": records.signals.grid, "signal_bands": records.signals.bands,
            "photo_of_view": records.photo.photos, "stated": capture,
            "processed": any(photo.kind is photo_records.PhotoKind.PROCESSED for photo in photos),
            "calibration_findings": records.calibrate.findings,
            "kept": records.findings,
            "picture": records.picture,
            "advise": partial(_advice_on, capture, records)}


def _advice_on(capture: captured.Capture, records: CaptureRecords, *at_hand: Any) -> Advised:
    from spectrabox.measure.advice import advise  # a report has it among the stored results
    return advise.advice_on_capture(capture, records, *at_hand)


def surface_of_records(capture: captured.Capture, records: CaptureRecords, name: str,
                     inverse_rendering: np.ndarray | None = None,
                     light: tuple[float, float] | None = None,
                     scatter: float | None = None,
                     edge: photo_records.RegionEdge | None = None) -> surface_result.SurfaceResult:
    """What the records of all steps say of one surface.

    Parameters
    ----------
    capture : Capture
    records : CaptureRecords
        Of all steps.
    name : str
        Of the surface.
    inverse_rendering, light, scatter, edge
        As of `surface_result`.
    """
    signals, stated = records.signals, capture.surfaces[name]
    index = signals.names.index(name)
    summary = None if signals.known[index] else records.spectra[name]
    prior = of_families(load_prior(), stated.families) \
        if capture.sampling.method == "prior" else None
    return surface_result.surface_result(signals, index, summary, prior, stated.truth,
                                         inverse_rendering, light, scatter, edge)
