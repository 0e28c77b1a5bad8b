"""Small drawings that need no axes: share of the prior in each curve, light on each region, causes
of error as bars.
"""
from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from markupsafe import Markup, escape

from spectrabox.measure.plot_style import band_colours
from spectrabox.measure.results.surface_result import SurfaceResult
from spectrabox.measure.words import fixed
from spectrabox.radiometry.grid import WavelengthGrid
from spectrabox.session.report.svg import Drawing, figure, plain_line, rounded

LEFT, WIDTH, ROW, GAP = 48.0, 480.0, 34.0, 10.0    # of the share of the prior, in SVG units
HALF = 0.5              # share above which the prior decides
TICKS_NM = 50
WHISKER_WIDTH, WHISKER_HEIGHT = 120.0, 16.0     # of the light on a region, in SVG units
SIGMA = 2.0             # standard errors either side of a whisker
MAX_COLUMNS = 4         # bands whose errors are written out; of more, the least and the largest


@figure("the share of the prior")
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
        axes.append({"x_limits": [float(nm[0]), float(nm[-1])], "y_limits": [0.0, 1.0],
                     "x_name": "Wavelength (nm)", "y_name": "share",
                     "lines": [{"label": band, "x": nm, "y": share[k]}],
                     "bars": [], "curves": []})
        rows.append(
            f'<path d="M{LEFT} {bottom}L{line}L{LEFT + WIDTH} {bottom}z" fill="{colour}" '
            f'fill-opacity=".25"/><path d="M{line}" fill="none" stroke="{colour}" '
            f'stroke-width="1.5"/>'
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


def field_whiskers(light: Mapping[str, tuple[float, float]]) -> dict[str, Markup]:
    """A mark with its error for the light on each region, all on one scale.

    The whisker spans two standard errors; the dashed line is the mean over the chart.

    Parameters
    ----------
    light : dict
        From regions to level, relative to the chart's mean, and its standard error.

    Returns
    -------
    dict
        From regions to inline SVG.
    """
    if not light:
        return {}
    ends = [level + side * SIGMA * error for level, error in light.values() for side in (-1, 1)]
    low, high = min(*ends, 1.0), max(*ends, 1.0)
    scale = (WHISKER_WIDTH - 6) / max(high - low, 1e-6)

    def at(value: float) -> float:
        return 3 + (value - low) * scale

    middle = WHISKER_HEIGHT / 2
    return {name: Markup(
        '<svg class="whisker" viewBox="0 0 {} {}" role="img" aria-label="{}"><path class="half" '
        'd="M{:.1f} 0V{}"/><path d="M{:.1f} {}H{:.1f}" stroke="currentColor"/><circle cx="{:.1f}" '
        'cy="{}" r="3" fill="currentColor"/></svg>').format(
            WHISKER_WIDTH, WHISKER_HEIGHT, f"{100 * level:.0f} % of the light on the chart, two "
            f"standard errors {200 * error:.1f} %", at(1.0), WHISKER_HEIGHT,
            at(level - SIGMA * error), middle, at(level + SIGMA * error), at(level), middle)
        for name, (level, error) in light.items()}


@figure("the error budget")
def error_budget_bars(name: str, surface: SurfaceResult) -> Drawing | None:
    """A table with a bar for each cause and band: relative standard error of the surface's signal;
    None where no cause was stated.

    Parameters
    ----------
    name : str
        Of the figure on its page, unique there.
    surface : SurfaceResult
        Bands that do not show it have no bars.
    """
    budget = surface.error_budget
    if not budget:
        return None
    shown = [(band, colour) for band, colour, value
             in zip(surface.bands, band_colours(surface.bands), surface.signal, strict=True)
             if np.isfinite(value)]
    errors = {cause: [100 * float(value) for value in values] for cause, values in budget.items()}
    largest = max(max(values) for values in errors.values()) or 1.0
    few = len(shown) <= MAX_COLUMNS
    legend = [Markup('<span class="dot" style="background: {}"></span>{}').format(
        colour, plain_line(band, 24)) for band, colour in shown]
    columns = [Markup('<th class="n">{}</th>').format(words)
               for words in (legend if few else ("least", "largest"))]
    rows = [Markup('<tr><th scope="row">{}</th><td class="bar"><span class="bars">{}</span></td>{}'
                   "</tr>").format(
        plain_line(cause, 40),
        Markup("").join(Markup('<span style="width: {:.1f}%; background: {}"></span>').format(
            100 * value / largest, colour)
            for value, (_, colour) in zip(values, shown, strict=True)),
        Markup("").join(Markup('<td class="n">{}</td>').format(fixed(value, 2))
                        for value in (values if few else (min(values), max(values)))))
        for cause, values in errors.items()]
    title = f"Error budget of {plain_line(surface.name)}"
    box = Markup('<div class="plot-box" id="{}">{}<table class="shares causes" aria-label="{}">'
                 "<thead><tr><th>Cause</th><th>Error, %</th>{}</tr></thead>"
                 "<tbody>{}</tbody></table></div>").format(
        name, "" if few else Markup('<p class="legend">{}</p>').format(Markup(" ").join(
            Markup("<span>{}</span>").format(words) for words in legend)),
        title, Markup("").join(columns), Markup("").join(rows))
    height = 1 / len(shown)
    bars = [{"label": plain_line(band, 24),
             "corners": rounded([0, row + k * height, errors[cause][k], row + (k + 1) * height])}
            for row, cause in enumerate(errors) for k, (band, _) in enumerate(shown)]
    return Drawing(box, name, title, [{
        "x_limits": rounded([0, largest]), "y_limits": [0, len(errors)],
        "x_name": "Relative standard error (%)", "y_name": "", "lines": [], "bars": bars,
        "curves": []}])
