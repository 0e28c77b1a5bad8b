"""The patches of a chart in a photo as a table: where they lie, what they read, and how surely."""
from __future__ import annotations

import csv
import io

import numpy as np

from spectrabox.measure.camera import ERROR_PREFIX
from spectrabox.radiometry.chart import Chart
from spectrabox.radiometry.records.photos import ChartDetection, PatchSamples
from spectrabox.radiometry.records.spectra import default_band_names

CORNERS = ("top_left", "top_right", "bottom_right", "bottom_left")      # of a patch as printed
# before a band's name, of columns that are no signals, and further ones
SPREAD_PREFIX, CLIPPED_PREFIX = "spread", "clipped"
POSITIONS = tuple(f"{axis}_{place}_px" for place in ("centre", *CORNERS) for axis in "xy")
COUNTS = ("pixels", "left_out")
DIGITS = 7


def centres_px(detection: ChartDetection) -> np.ndarray:
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


def angle_deg(detection: ChartDetection, chart: Chart) -> float:
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


def patch_columns(chart: Chart, detection: ChartDetection, samples: PatchSamples,
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
    bands = default_band_names(samples.mean.shape[1])
    columns = {"patch": np.array(chart.names)}
    for prefix, values in (("", samples.mean), (f"{ERROR_PREFIX} ", samples.standard_error),
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
