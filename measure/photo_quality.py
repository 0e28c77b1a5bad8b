"""Whether a photo is worth keeping: its exposure, and the chart in it."""
from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from spectrabox.capture.chart.detection import locate_chart
from spectrabox.capture.chart.quality import judge_chart
from spectrabox.measure.camera import chart_signals
from spectrabox.radiometry import errors, grid
from spectrabox.radiometry.chart import CLASSIC, Chart
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records.photos import LinearImage

BRIGHT = 0.75           # of saturation, where the brightest parts should lie
DARKEST = 0.2           # of it, below which a photo is shot again
MAX_CLIPPED = 0.002     # share of pixels that may be clipped: a lamp in view, a highlight
BRIGHT_PERCENTILE = 99.5


def judge_photo(image: LinearImage, chart: Chart = CLASSIC) -> tuple[tuple[Finding, ...], bool]:
    """What was found of a photo, and whether a chart is in it.

    Parameters
    ----------
    image : LinearImage
    chart : Chart
        Layout that is looked for.

    Returns
    -------
    findings : tuple of Finding
        Without ``faults`` for a good photo.
    chart : bool
    """
    findings = exposed(clipped_share(image), brightest_signal(image))
    if not chart.has_known_colours:
        return tuple(findings), False
    try:
        signals = chart_signals(chart, None, grid.visible_grid())
        detection = locate_chart(image, signals, None, chart)
    except errors.SpectraboxError:
        return tuple(findings), False
    verdict = judge_chart(image, detection, signals, chart)
    if detection.mirrored:
        findings.append(Finding("chart.mirrored", Severity.WARN))
    return (*findings, *verdict.findings), True


def exposed(clipped: Sequence[float], brightest: Sequence[float]) -> list[Finding]:
    """Pixels that are clipped, or a photo that is too dark.

    Parameters
    ----------
    clipped, brightest : sequences of K float
        As ``clipped_share`` and ``brightest_signal``.
    """
    if max(clipped) > MAX_CLIPPED:
        return [Finding("photo.clipped", Severity.WARN, values={
            "clipped": max(clipped), "limit": MAX_CLIPPED})]
    if max(brightest) < DARKEST:
        return [Finding("photo.dark", Severity.WARN, values={
            "brightest": max(brightest), "least": DARKEST, "stops": _stops_to_bright(brightest)})]
    return []


def clipped_share(image: LinearImage) -> tuple[float, ...]:
    """Share of clipped pixels, by band."""
    return tuple(float(share) for share in image.saturated.mean(axis=(0, 1)))


def brightest_signal(image: LinearImage) -> tuple[float, ...]:
    """Signal of the brightest parts, by band: of saturation."""
    stride = max(1, int(math.sqrt(image.signal[..., 0].size / 250_000)))
    return tuple(float(value) for value in np.percentile(
        image.signal[::stride, ::stride].reshape(-1, image.signal.shape[2]), BRIGHT_PERCENTILE,
        axis=0))


def exposure_stops(image: LinearImage) -> float:
    """By how many stops a longer exposure brings the brightest parts to ``BRIGHT``."""
    return _stops_to_bright(brightest_signal(image))


def _stops_to_bright(brightest: Sequence[float]) -> float:
    return float(np.log2(BRIGHT / max(max(brightest), 1e-6)))
