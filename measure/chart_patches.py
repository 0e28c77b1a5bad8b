"""A chart by itself: the edition of a ColorChecker that a photo tells, the patches that are not as
the others make them, and all patches as a table for other programs.

Whether a ColorChecker was made before or since November 2014, as its photo tells.

Camera and light are fitted to the chart together, by either edition; what the photo says for one of
them is how much better that one explains it, with the differences that copies have in any case.
"""


from __future__ import annotations

import csv
import io
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from spectrabox.calibrate import chart_findings, chart_photo
from spectrabox.calibrate.chart_calibration import calibrate_chart
from spectrabox.capture.chart import quality
from spectrabox.measure import camera, extras, texts
from spectrabox.measure.held_out_spectra import held_out_patches
from spectrabox.radiometry import errors, grid
from spectrabox.radiometry.chart import BEFORE_2014, COPIES_SINCE_2014, Chart
from spectrabox.radiometry.charts.references import editions
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records import photos, spectra


@dataclass(frozen=True)
class ChartEdition:
    """What a photo says of the edition of its chart.

    Attributes
    ----------
    edition : str or None
        "since November 2014" or "before November 2014"; None where the photo does not tell.
    evidence : float or None
        Nats for the edition since over the one before; None where nothing was compared.
    finding : Finding
        The same, or why it cannot be told.
    failed : Finding or None
        Where telling it failed.
    patches : tuple of Finding
        What a fit of camera and light says of single patches: soiled, shaded or misprinted ones.
    """

    edition: str | None
    evidence: float | None
    finding: Finding
    failed: Finding | None = None
    patches: tuple[Finding, ...] = ()

    @property
    def says(self) -> str:
        """The finding in a sentence."""
        return texts.says(self.finding)

    @property
    def facts(self) -> dict[str, Any]:
        """For JSON."""
        return {"edition": self.edition, "evidence": self.evidence, "says": self.says,
                "findings": [texts.facts(self.finding)]}


def edition_in_photo(image: photos.LinearImage, chart: Chart, samples: photos.PatchSamples,
                     excluded: np.ndarray | None = None) -> ChartEdition:
    """The edition of the chart in a photo, whatever its camera and its light.

    Parameters
    ----------
    image : LinearImage
    chart : Chart
    samples : PatchSamples
    excluded : (I,) bool array, optional
        Patches that the operator leaves out.
    """
    edition, failed = extras.attempt("edition of the chart",
                                     lambda: _edition(image, chart, samples, excluded), None)
    if failed is not None:
        return replace(_not_fitted(""), failed=failed)
    assert edition is not None
    return edition


def _edition(image: photos.LinearImage, chart: Chart, samples: photos.PatchSamples,
             excluded: np.ndarray | None) -> ChartEdition:
    if COPIES_SINCE_2014 not in chart.references:
        return _not_told(Finding("edition.unpublished", Severity.INFO, values={
            "chart": chart.name, "any": bool(chart.references)}))
    if image.kind is photos.PhotoKind.PROCESSED:
        return _not_told(Finding("edition.processed", Severity.INFO))
    if any(one.code == quality.CONVERTED for one in image.findings):
        return _not_told(Finding("edition.converted", Severity.INFO))
    of = editions(chart, samples.taken_at)
    photo = chart_photo.ChartPhoto(samples, of[0].mean, spectra.UnknownLight(), chart=chart,
                                   excluded=excluded, editions=of)
    left_out = ~photo.used
    try:
        try:
            fitted = calibrate_chart([photo], grid.FINE_GRID)
        except errors.UnexplainedChartError as error:
            if error.alone is None:
                raise
            without = left_out | (np.arange(len(left_out)) == error.alone)
            fitted = calibrate_chart([replace(photo, excluded=without)], grid.FINE_GRID)
        patches = tuple(chart_findings.at_fault(replace(
            held_out_patches(fitted, fitted.reflectances), excluded=left_out), chart.names))
    except errors.SpectraboxError as error:
        return _not_fitted(type(error).__name__)
    if len(of) == 1:
        return ChartEdition(BEFORE_2014, None, Finding("edition.by-date", Severity.INFO, values={
            "told": BEFORE_2014, "date": samples.taken_at[:10]}), patches=patches)
    copy = fitted.copy
    assert copy is not None, "a chart of several editions has a copy"
    told, nats = chart_findings.edition_told(copy), chart_findings.evidence_since(copy)
    return ChartEdition(told, nats, Finding("edition.told", Severity.INFO, values={
        "told": told, "nats": nats, "needed": chart_findings.TOLD}), patches=patches)


def _not_told(finding: Finding) -> ChartEdition:
    return ChartEdition(None, None, finding)


def _not_fitted(refusal: str) -> ChartEdition:
    """By the kind of error that refused the chart; empty of one that is unexpected."""
    return _not_told(Finding("edition.not-fitted", Severity.INFO, values={"refusal": refusal}))


# ---- the patches of a chart in a photo as a table ------------------------------------------------

CORNERS = ("top_left", "top_right", "bottom_right", "bottom_left")      # of a patch as printed
# before a band's name, of columns that are no signals, and further ones
SPREAD_PREFIX, CLIPPED_PREFIX = "spread", "clipped"
POSITIONS = tuple(f"{axis}_{place}_px" for place in ("centre", *CORNERS) for axis in "xy")
COUNTS = ("pixels", "left_out")
DIGITS = 7


def centres_px(detection: photos.ChartDetection) -> np.ndarray:
    """Centres (I, 2) of the patches in pixels of the photo: where the diagonals of each cross.

    Parameters
    ----------
    detection : ChartDetection
    """
    start, _, middle, _ = corners = detection.corners_px.transpose(1, 0, 2)
    along, across = middle - start, corners[3] - corners[1]
    offset = corners[1] - start
    share = (offset[:, 0] * across[:, 1] - offset[:, 1] * across[:, 0]) / (
        along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0])
    return np.asarray(start + share[:, None] * along)


def angle_deg(detection: photos.ChartDetection, chart: Chart) -> float:
    """How far a chart is turned clockwise in its photo, -180 to 180: 0 where its first row runs
    from left to right, as printed.

    Parameters
    ----------
    detection : ChartDetection
    chart : Chart
    """
    rows = centres_px(detection).reshape(chart.rows, chart.columns, 2)
    x, y = (rows[:, -1] - rows[:, 0]).mean(axis=0)
    return float(np.degrees(np.arctan2(y, x)))


def patch_columns(chart: Chart, detection: photos.ChartDetection, samples: photos.PatchSamples,
                  excluded: np.ndarray) -> dict[str, np.ndarray]:
    """What a photo says of the patches of a chart, a column (I,) each.

    Parameters
    ----------
    chart : Chart
    detection : ChartDetection
    samples : PatchSamples
    excluded : (I,) array
        Share of samples left out as dust or glints.
    """
    bands = spectra.default_band_names(samples.mean.shape[1])
    columns = {"patch": np.array(chart.names)}
    for prefix, values in (("", samples.mean), (f"{camera.ERROR_PREFIX} ", samples.standard_error),
                           (f"{SPREAD_PREFIX} ", samples.spread),
                           (f"{CLIPPED_PREFIX} ", samples.clipped.astype(int))):
        columns |= {f"{prefix}{band}": values[:, number] for number, band in enumerate(bands)}
    points = np.concatenate([centres_px(detection)[:, None], detection.corners_px], axis=1)
    columns |= dict(zip(COUNTS, (samples.pixels, excluded), strict=True))
    return columns | dict(zip(POSITIONS, points.reshape(len(points), -1).T, strict=True))


def table_of_columns(columns: dict[str, np.ndarray]) -> str:
    """Columns as comma-separated text under their names."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    for row in zip(*(column.tolist() for column in columns.values()), strict=True):
        writer.writerow([f"{cell:.{DIGITS}g}" if isinstance(cell, float) else cell for cell in row])
    return stream.getvalue()
