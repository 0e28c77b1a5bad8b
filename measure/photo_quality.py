"""Whether a photo is worth keeping: its exposure, and the chart in it."""
from __future__ import annotations

import math

import numpy as np

from spectrabox.capture.chart.detection import locate_chart
from spectrabox.capture.chart.quality import judge_chart
from spectrabox.measure.camera import chart_signals
from spectrabox.radiometry.chart import CLASSIC, Chart
from spectrabox.radiometry.errors import SpectraboxError
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records.photos import LinearImage

BRIGHT = 0.75           # of saturation, where the brightest parts should lie
DARKEST = 0.2           # of it, below which a photo is shot again
MAX_CLIPPED = 0.002     # share of pixels that may be clipped: a lamp in view, a highlight
BRIGHT_PERCENTILE = 99.5


def judge_photo(image: LinearImage, chart: Chart = CLASSIC) -> tuple[tuple[str, ...], bool]:
    """Why a photo should be shot again, and whether a chart is in it.

    Parameters
    ----------
    image : LinearImage
    chart : Chart
        Layout that is looked for.

    Returns
    -------
    reasons : tuple of str
        Empty for a good photo.
    chart : bool
    """
    reasons = []
    clipped = clipped_share(image)
    brightest = brightest_signal(image)
    if max(clipped) > MAX_CLIPPED:
        reasons.append(f"{max(clipped):.1%} of the pixels are clipped; expose "
                       f"{_stops_words(-1.0)}")
    elif max(brightest) < DARKEST:
        reasons.append(f"the brightest parts reach {max(brightest):.0%} of saturation; expose "
                       f"{_stops_words(exposure_stops(image))}")
    if not chart.has_known_colours:
        return tuple(reasons), False
    try:
        signals = chart_signals(chart, None, visible_grid())
        detection = locate_chart(image, signals, None, chart)
    except SpectraboxError:
        return tuple(reasons), False
    verdict = judge_chart(image, detection, signals, chart)
    if detection.mirrored:
        reasons.append("the chart is mirrored")
    return (*reasons, *verdict.reasons), True


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
    return float(np.log2(BRIGHT / max(max(brightest_signal(image)), 1e-6)))


def _stops_words(stops: float) -> str:
    return f"{abs(stops):.1f} stops {'longer' if stops > 0 else 'shorter'}"
