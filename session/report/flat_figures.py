"""Figures of photos of flat samples: what they show, and the light over them."""
from __future__ import annotations

from pathlib import Path

import numpy as np
from markupsafe import Markup
from matplotlib import image as raster
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from matplotlib.patheffects import withStroke

from spectrabox.measure.results import PhotoOfRegions
from spectrabox.session.report.svg import figure, inline_svg, plain_line

WIDTH_IN, MAP_IN = 6.2, 3.6
CHART, REGION = "#ffffff", "#ffd34d"
OUTLINED = [withStroke(linewidth=2.2, foreground="black")]
CONTOURS = (0.01, 0.02, 0.05, 0.1, 0.2)     # of the light's relative error


def photo_figure(name: str, photo: PhotoOfRegions, preview: Path) -> Markup:
    """The photo with its chart and regions outlined; the axes count pixels.

    Parameters
    ----------
    name : str
        Of the figure on its page, unique there.
    photo : PhotoOfRegions
    preview : Path
        PNG of the whole photo.
    """
    axes, drawing = _axes(photo, WIDTH_IN)
    width, height = photo.size_px
    axes.imshow(raster.imread(preview), extent=(-0.5, width - 0.5, height - 0.5, -0.5))
    _outlines(axes, photo)
    axes.set(xlabel="pixel", ylabel="pixel")
    return inline_svg(drawing, name, f"Photo {plain_line(photo.name)}",
                      "The photo with the patches of the chart and the measured regions outlined.")


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
    axes, drawing = _axes(photo, MAP_IN)
    width, height = photo.size_px
    extent = (-0.5, width - 0.5, height - 0.5, -0.5)
    shown = axes.imshow(100 * level, extent=extent, cmap="cividis", interpolation="bilinear")
    x, y = ((np.arange(count) + 0.5) / count * size
            for count, size in zip(level.shape[::-1], (width, height), strict=True))
    inside = [value for value in CONTOURS if error.min() < value < error.max()]
    if inside:
        lines = axes.contour(x, y, error, levels=inside, colors="white", linewidths=0.7)
        axes.clabel(lines, fmt=lambda value: f"±{100 * value:g} %", fontsize=6.5)
    _outlines(axes, photo, names=False)
    axes.set(xticks=[], yticks=[])
    drawing.colorbar(shown, ax=axes, shrink=0.8, label="% of the light on the chart")
    return inline_svg(drawing, name, f"Light over {plain_line(photo.name)}",
                      "Light relative to its mean over the chart; white lines: its standard error.")


def _axes(photo: PhotoOfRegions, width_in: float):  # type: ignore[no-untyped-def]
    width, height = photo.size_px
    drawing = figure(width_in, width_in * min(height / width, 1.5) + 0.3)
    return drawing.add_subplot(), drawing


def _outlines(axes: Axes, photo: PhotoOfRegions, names: bool = True) -> None:
    for patch in () if photo.chart_px is None else photo.chart_px:
        axes.add_patch(Polygon(patch, fill=False, ec=CHART, lw=0.7, path_effects=OUTLINED))
    for region, corners in photo.outlines.items():
        axes.add_patch(Polygon(corners, fill=False, ec=REGION, lw=1.1, path_effects=OUTLINED))
        if names:
            x, y = corners[:, 0].mean(), corners[:, 1].min()
            axes.annotate(plain_line(region, 24), (x, y), (0, 3), textcoords="offset points",
                          ha="center", va="bottom", color=REGION, fontsize=7,
                          path_effects=OUTLINED)
