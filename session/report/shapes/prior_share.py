"""How much of each sensitivity curve is the prior's and not the chart's, as areas."""
from __future__ import annotations

import numpy as np
from markupsafe import Markup, escape

from spectrabox.radiometry.grid import WavelengthGrid
from spectrabox.session.report.checked.drawing import Drawing
from spectrabox.session.report.svg import band_colours, plain_line

LEFT, WIDTH, ROW, GAP = 48.0, 480.0, 34.0, 10.0    # in the drawing's own unit
HALF = 0.5              # share above which the prior decides
TICKS_NM = 50


def prior_share_figure(name: str, share: np.ndarray, grid: WavelengthGrid,
                       bands: tuple[str, ...]) -> Drawing:
    """One area a band: 0 where the chart decides, full height where nothing but the prior speaks.

    Parameters
    ----------
    name : str
        Of the figure on its page, unique there.
    share : (K, P) array
        Of the prior's standard deviation that the chart left, 0 to 1.
    grid : WavelengthGrid
    bands : tuple of str
        K names.
    """
    nm = grid.nm
    x = LEFT + (nm - nm[0]) / (nm[-1] - nm[0]) * WIDTH
    axes, rows = [], []
    for k, (band, colour) in enumerate(zip(bands, band_colours(bands), strict=True)):
        top = 4 + k * (ROW + GAP)
        bottom = top + ROW
        y = bottom - np.clip(share[k], 0, 1) * ROW
        line = "L".join(f"{a:.2f} {b:.2f}" for a, b in zip(x, y, strict=True))
        axes.append({"box": [LEFT, top, LEFT + WIDTH, bottom],
                     "x_limits": [float(nm[0]), float(nm[-1])], "y_limits": [0.0, 1.0],
                     "y_scale": "linear", "x_name": "Wavelength (nm)", "y_name": "share",
                     "lines": [{"id": f"s{k}", "label": band, "x": nm, "y": share[k]}],
                     "bars": [], "curves": []})
        rows.append(
            f'<path d="M{LEFT} {bottom}L{line}L{LEFT + WIDTH} {bottom}z" fill="{colour}" '
            f'fill-opacity=".25"/><g id="{name}-s{k}"><path d="M{line}" fill="none" '
            f'stroke="{colour}" stroke-width="1.5"/></g>'
            f'<path d="M{LEFT} {bottom}H{LEFT + WIDTH}" class="axis"/>'
            f'<path d="M{LEFT} {bottom - HALF * ROW}H{LEFT + WIDTH}" class="half"/>'
            f'<text x="{LEFT - 8}" y="{bottom - ROW / 2 + 4}" text-anchor="end">'
            f"{escape(plain_line(band, 10))}</text>")
    foot = 4 + len(bands) * (ROW + GAP)
    ticks = "".join(f'<text x="{LEFT + (at - nm[0]) / (nm[-1] - nm[0]) * WIDTH:.1f}" '
                    f'y="{foot + 8}" text-anchor="middle">{at:.0f}</text>'
                    for at in np.arange(np.ceil(nm[0] / TICKS_NM) * TICKS_NM, nm[-1] + 1, TICKS_NM))
    title = "Share of the prior"
    box = (f'<div class="plot-box" id="{name}"><svg class="plot shapes" role="img" '
           f'aria-labelledby="{name}-title" viewBox="0 0 {LEFT + WIDTH + 16} {foot + 14}">'
           f'<title id="{name}-title">{title}</title>{"".join(rows)}{ticks}</svg></div>')
    return Drawing(Markup(box), name, title, axes)
