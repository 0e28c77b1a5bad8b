"""Figures of photos of flat samples: what they show, and the light over them."""
from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from markupsafe import Markup

from spectrabox.measure.results.flat_result import PhotoOfRegions
from spectrabox.session.report.pictures import (
    LEVELS,
    coloured,
    picture_data_uri,
    pixels_data_uri,
)
from spectrabox.session.report.svg import (
    MarkLink,
    Plot,
    figure,
    nice_ticks,
    path,
    plain_line,
    tick_labels,
)

WIDTH, MAP = 446.0, 216.0           # in points, of the photo and of the map of the light
BAR, BAR_SHADES = 9.0, 64           # width in points of the bar of colours, and its shades
CHART, REGION, EDGE, RIM = "#ffffff", "#ffd34d", "#ff5a3c", "#000"
CONTOURS = (0.01, 0.02, 0.05, 0.1, 0.2)     # of the light's relative error


@figure("the photo")
def photo_figure(name: str, photo: PhotoOfRegions, preview: Path,
                 links: Mapping[str, MarkLink]) -> Markup:
    """The photo with its chart and regions outlined, edges across these and the larger part beside
    them in red; the axes count pixels. A region leads to its card.

    Parameters
    ----------
    name : str
        Of the figure on its page, unique there.
    photo : PhotoOfRegions
    preview : Path
        PNG of the whole photo.
    links : mapping
        From the name of a region.
    """
    width, height = photo.size_px
    plot = _over_photo(name, photo, WIDTH, (30, 4, 20, 4))
    plot.picture(_corners(photo), picture_data_uri(preview), smooth=True)
    for patch in () if photo.chart_px is None else photo.chart_px:
        plot.outline(patch, CHART, 0.7)
    for region, corners in photo.outlines.items():
        shape = path(plot.x(corners[:, 0]), plot.y(corners[:, 1])) + "z"
        plot.linked(shape, plain_line(region), links[region], REGION, 1.1)
    plot.lines([edge.line_px for edge in photo.edges.values()], EDGE, 1.6, dash="4 2")
    for edge in photo.edges.values():
        if edge.larger_part_px is not None:
            x0, y0, x1, y1 = edge.larger_part_px
            plot.outline(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]), EDGE, 0.7)
    for region, corners in photo.outlines.items():
        plot.words(corners[:, 0].mean(), corners[:, 1].min() - 0.008 * height,
                   plain_line(region, 24), 7, REGION, rim=RIM)
    plot.x_axis("", nice_ticks(0, width, 8), grid=False)
    plot.y_axis("", nice_ticks(0, height, 8))
    return plot.drawn(f"Photo {plain_line(photo.name)}",
                      "The photo with the patches of the chart and the measured regions outlined"
                      + (", in red the edges across regions and the part that is free of them."
                         if photo.edges else "."))


@figure("the light over the photo")
def light_figure(name: str, photo: PhotoOfRegions) -> Markup | None:
    """The light over the photo with contours of its error; None where it shows no region.

    Parameters
    ----------
    name : str
        Of the figure on its page, unique there.
    photo : PhotoOfRegions
    """
    if photo.light_map is None:
        return None
    level, error = photo.light_map
    low, high = 100 * float(level.min()), 100 * float(level.max())
    span = max(high - low, 1e-6)
    plot = _over_photo(name, photo, MAP, (2, 58, 4, 4))
    plot.picture(_corners(photo), pixels_data_uri(coloured((100 * level - low) / span, LEVELS)),
                 smooth=True)
    width, height = photo.size_px
    x, y = ((np.arange(count) + 0.5) / count * size
            for count, size in zip(level.shape[::-1], (width, height), strict=True))
    for value in CONTOURS:
        segments = contour(x, y, error, value)
        if len(segments):
            plot.lines(segments, CHART, 0.7)
            middle = segments.mean(axis=1)
            inside = np.minimum(middle, np.array([width, height]) - middle).min(axis=1)
            across, down = middle[np.argmax(inside)].tolist()
            plot.words(across, down, f"±{100 * value:g} %", 6.5, CHART, rim=RIM)
    _outlines(plot, photo)
    _colour_bar(plot, photo, low, span)
    return plot.drawn(f"Light over {plain_line(photo.name)}",
                      "Light relative to its mean over the chart; white lines: its standard error.")


def contour(x: np.ndarray, y: np.ndarray, values: np.ndarray, level: float) -> np.ndarray:
    """Segments (n, 2, 2) along which values (H, W), linear in triangles between x (W,) and y (H,),
    are at a level.

    Parameters
    ----------
    x, y : (W,), (H,) arrays
    values : (H, W) array
    level : float
    """
    points = np.stack([*np.meshgrid(x, y), values], axis=-1)
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, :-1], points[1:, 1:]
    corners = np.stack([np.stack([a, b, c], axis=2), np.stack([d, b, c], axis=2)]).reshape(-1, 3, 3)
    ends = np.roll(corners, -1, axis=1)
    # a triangle that the level passes through has exactly two sides with ends above and below it
    crossed = (corners[..., 2] < level) != (ends[..., 2] < level)
    one, other = corners[crossed], ends[crossed]
    share = (level - one[:, 2]) / (other[:, 2] - one[:, 2])
    return np.asarray(one[:, :2] + share[:, None] * (other - one)[:, :2]).reshape(-1, 2, 2)


def _over_photo(name: str, photo: PhotoOfRegions, width: float,
                margins: tuple[float, float, float, float]) -> Plot:
    """A figure in the pixels of the photo."""
    left, right, below, above = margins
    columns, rows = photo.size_px
    height = (width - left - right) * min(rows / columns, 1.5)
    return Plot(name, width, height + below + above, (-0.5, columns - 0.5), (rows - 0.5, -0.5),
                margins)


def _corners(photo: PhotoOfRegions) -> tuple[float, float, float, float]:
    width, height = photo.size_px
    return -0.5, -0.5, width - 0.5, height - 0.5


def _outlines(plot: Plot, photo: PhotoOfRegions) -> None:
    for patch in () if photo.chart_px is None else photo.chart_px:
        plot.outline(patch, CHART, 0.7)
    for corners in photo.outlines.values():
        plot.outline(corners, REGION, 1.1)


def _colour_bar(plot: Plot, photo: PhotoOfRegions, low: float, span: float) -> None:
    """Beside the map, what its colours stand for, in per cent."""
    _, top, right, bottom = plot.box
    width, height = photo.size_px
    pixel = width / (plot.width - 60)           # a point in pixels, across
    shades = pixels_data_uri(coloured(np.linspace(1, 0, BAR_SHADES)[:, None], LEVELS))
    plot.beside((right + 8, top, right + 8 + BAR, bottom), shades)
    ticks = nice_ticks(low, low + span, 5)
    for value, label in zip(ticks, tick_labels(ticks), strict=True):
        plot.words(width - 0.5 + (11 + BAR) * pixel, (1 - (value - low) / span) * height, label,
                   anchor="start")
    plot.words(width - 0.5 + 50 * pixel, height / 2, "% of the light on the chart", turned=True)
