"""Where lamp and cameras were stated to be and where they were found, with the marks on photos."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib import image as raster
from matplotlib.collections import LineCollection

from spectrabox.radiometry.placements import MarkedView, SceneGeometry
from spectrabox.session.report.svg import figure, inline_svg, plain_line

WIDTH_IN = 4.7
MAX_SIDE_PX = 480       # of the photo behind the edges
GREEN, RED = "#16a34a", "#dc2626"


def geometry_section(geometry: SceneGeometry | None, previews: dict[str, Path]
                     ) -> dict[str, Any] | None:
    """What the page shows of the scene's geometry; None where nothing of it was estimated.

    Parameters
    ----------
    geometry : SceneGeometry or None
    previews : dict
        PNG of each photo by the name of its view.
    """
    if geometry is None:
        return None
    return {"rows": geometry.placements,
            "photos": [(view.name, _marks_figure(number, view, previews[view.name]))
                       for number, view in enumerate(geometry.views, start=1)]}


def _marks_figure(number: int, view: MarkedView, preview: Path) -> Markup:
    """The photo with the scene's edges, rings where corners were marked, crosses where the camera
    sees them.
    """
    picture = raster.imread(preview)
    step = -(-max(picture.shape[:2]) // MAX_SIDE_PX)
    picture = picture[::step, ::step]
    height, width = picture.shape[:2]
    drawing = figure(WIDTH_IN, WIDTH_IN * height / width)
    axes = drawing.add_subplot()
    axes.imshow(picture, extent=(0, 1, 1, 0), aspect=height / width)
    axes.add_collection(LineCollection(list(view.edges), colors=RED, linewidths=0.6))
    axes.plot(*view.marked.T, "o", markersize=6, markerfacecolor="none", markeredgecolor=GREEN,
              markeredgewidth=1)
    axes.plot(*view.seen.T, "x", markersize=4, color=RED, markeredgewidth=1)
    axes.set(xlim=(0, 1), ylim=(1, 0))
    axes.set_axis_off()
    worst = int(np.argmax(view.residuals_px)) if len(view.residuals_px) else None
    said = "no corner is marked in it" if worst is None else (
        f"{len(view.corners)} corners marked, {plain_line(view.corners[worst])} is off by "
        f"{view.residuals_px[worst]:.2f} pixels")
    title = f"Edges over the photo {plain_line(view.name)}".strip()
    return inline_svg(drawing, f"geometry-{number}", title, said)
