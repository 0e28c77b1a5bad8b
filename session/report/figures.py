"""Figures of the report: chart, convergence, photos of flat samples, and small ones without axes.
"""


from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from markupsafe import Markup, escape

from spectrabox.measure import plots, words
from spectrabox.measure.results import flat_result, surface_result
from spectrabox.measure.words import fixed
from spectrabox.radiometry.grid import WavelengthGrid
from spectrabox.session.report import pictures, svg
from spectrabox.session.report.spectra import css_colour

MAX_TICKS = 24      # patches numbered along an axis
WIDE, GOOD = 691.0, "#eef1f4"       # width in points of a figure across the page; the band of good
CELL = (43.0, 40.0)                 # width and height in points of a patch of the irradiance
DARKEST = 80.0                      # per cent: the lower end of the irradiance's colours, at most


@svg.figure("the chart residuals")
def chart_residual_figure(name: str, residuals: np.ndarray, held_out: np.ndarray | None,
                          bands: tuple[str, ...],
                          limit: float) -> Markup:
    """Residuals (I, K) of the patches: filled as fitted, open where the patch was left out of its
    own fit.

    Parameters
    ----------
    name : str
        Of the figure on its page, unique there.
    residuals, held_out : (I, K) arrays
        (photo - predicted) / photo, chart order; the latter None where nothing was left out.
    limit : float
        Of a chart that is good; drawn as a grey band.
    """
    patches = len(residuals)
    shown = np.abs(residuals if held_out is None else np.r_[residuals, held_out])
    largest = 108 * max(float(np.nanmax(shown)), limit)     # per cent, and a margin
    plot = svg.Plot(name, WIDE, 216, (0.4, patches + 0.6), (-largest, largest))
    plot.rectangle((0.4, -100 * limit, patches + 0.6, 100 * limit), GOOD)
    plot.level(0, plots.QUIET, 0.7)
    plot.x_axis("Patch", np.arange(1, patches + 1, -(-patches // MAX_TICKS)), grid=False)
    plot.y_axis("(photo − predicted) / photo (%)", svg.nice_ticks(-largest, largest, 6))
    for k, (band, colour) in enumerate(zip(bands, plots.band_colours(bands), strict=True)):
        at = np.arange(1, patches + 1) + 0.5 * ((k + 0.5) / len(bands) - 0.5)
        if held_out is not None:
            plot.dots(at, 100 * held_out[:, k], colour, 2.2, open_=True)
        plot.dots(at, 100 * residuals[:, k], colour, 1.8, label=svg.plain_line(band, 24))
    if held_out is not None:
        plot.dots([], [], plots.INK, 2.2, open_=True, label="left out of its own fit")
    return plot.drawn("Chart residuals",
                      f"Relative residual of the {patches} patches in each band.")


@svg.figure("the irradiance over the chart")
def irradiance_figure(name: str, irradiance: np.ndarray, rows: int) -> Markup:
    """Relative irradiance (I,) over the chart, row by row as printed.

    Parameters
    ----------
    name : str
        Of the figure on its page, unique there.
    irradiance : (I,) array
        Relative to the brightest patch, in chart order.
    rows : int
        Of the chart.
    """
    field = 100 * irradiance.reshape(rows, -1)
    columns = field.shape[1]
    plot = svg.Plot(name, max(CELL[0] * columns, 115.0), CELL[1] * rows + 22, (0, columns),
                    (rows, 0), (0, 0, 0, 22))
    low = min(float(np.nanmin(field)), DARKEST)
    share = (field - low) / (100 - low)
    for (row, column), value in np.ndenumerate(field):
        measured = bool(np.isfinite(value))
        plot.rectangle((column, row, column + 1, row + 1), css_colour(
            pictures.coloured(share[row, column], pictures.LEVELS)) if measured else "#fff")
        plot.words(column + 0.5, row + 0.57, f"{value:.0f}" if measured else "?", 8,
                   "#fff" if measured and share[row, column] < 0.55 else "#000")
    plot.words(columns / 2, -0.2, "Irradiance, %", 8.5)     # of how much, the caption says
    return plot.drawn("Irradiance over the chart",
                      "Relative irradiance of each patch in per cent.")


@svg.figure("the convergence")
def loss_figure(name: str, history: np.ndarray) -> Markup | None:
    """Loss against iteration, logarithmic where all losses are positive; None where there is no
    history.

    Parameters
    ----------
    name : str
        Of the figure on its page, unique there.
    history : (I,) array
        Loss after each iteration.
    """
    if history.size < 2:
        return None
    steps, positive = np.arange(history.size), bool(np.all(history > 0))
    height = np.log10(history) if positive else history
    low, high = float(height.min()), float(height.max())
    margin = 0.05 * max(high - low, 1e-3 * max(abs(high), 1e-12))
    plot = svg.Plot(name, WIDE, 194, (0, history.size - 1), (low - margin, high + margin),
                (58, 9, 31, 9))
    plot.x_axis("Iteration", svg.nice_ticks(0, history.size - 1, 10))
    decades = np.arange(np.ceil(low - margin), np.floor(high + margin) + 1)
    if positive and len(decades) > 1:
        plot.y_axis("Loss", decades, [power_of_ten(10.0**decade) for decade in decades])
    else:
        ticks = svg.nice_ticks(low - margin, high + margin, 5)
        plot.y_axis("Loss", ticks, [words.number(float(10**tick if positive else tick), 3)
                                    for tick in ticks])
    plot.line(steps, height, "#1f4e8c", 1.3, stated=history)
    start, end = words.number(float(history[0]), 3), words.number(float(history[-1]), 3)
    digits = int(np.clip(4 - np.floor(np.log10(max(float(np.abs(history).min()), 1e-12))), 3, 14))
    plot.readout(steps.astype(float), {"loss": history}, "Iteration", "", digits)
    return plot.drawn("Loss history", f"The loss fell from {start} to {end}.")


def power_of_ten(value: float) -> str:
    """A power of ten as a tick label."""
    return "10" + str(round(np.log10(value))).translate(words.SUPERSCRIPT)


# ---- small drawings that need no axes ------------------------------------------------------------

LEFT, WIDTH, ROW, GAP = 48.0, 480.0, 34.0, 10.0    # of the share of the prior, in SVG units
HALF = 0.5              # share above which the prior decides
TICKS_NM = 50
WHISKER_WIDTH, WHISKER_HEIGHT = 120.0, 16.0     # of the light on a region, in SVG units
SIGMA = 2.0             # standard errors either side of a whisker
MAX_COLUMNS = 4         # bands whose errors are written out; of more, the least and the largest


@svg.figure("the share of the prior")
def prior_share_figure(name: str, share: np.ndarray, grid: WavelengthGrid,
                       bands: tuple[str, ...]) -> svg.Drawing:
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
    for k, (band, colour) in enumerate(zip(bands, plots.band_colours(bands), strict=True)):
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
            f"{escape(svg.plain_line(band, 10))}</text>")
    foot = 4 + len(bands) * (ROW + GAP)
    ticks = "".join(f'<text x="{LEFT + (at - nm[0]) / (nm[-1] - nm[0]) * WIDTH:.1f}" '
                    f'y="{foot + 8}" text-anchor="middle">{at:.0f}</text>'
                    for at in np.arange(np.ceil(nm[0] / TICKS_NM) * TICKS_NM, nm[-1] + 1, TICKS_NM))
    title = "Share of the prior"
    box = (f'<div class="plot-box" id="{name}"><svg class="plot shapes" role="img" '
           f'aria-labelledby="{name}-title" viewBox="0 0 {LEFT + WIDTH + 16} {foot + 14}">'
           f'<title id="{name}-title">{title}</title>{"".join(rows)}{ticks}</svg></div>')
    return svg.Drawing(Markup(box), name, title, axes)


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


@svg.figure("the error budget")
def error_budget_bars(name: str, surface: surface_result.SurfaceResult) -> svg.Drawing | None:
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
             in zip(surface.bands, plots.band_colours(surface.bands), surface.signal, strict=True)
             if np.isfinite(value)]
    errors = {cause: [100 * float(value) for value in values] for cause, values in budget.items()}
    largest = max(max(values) for values in errors.values()) or 1.0
    few = len(shown) <= MAX_COLUMNS
    legend = [Markup('<span class="dot" style="background: {}"></span>{}').format(
        colour, svg.plain_line(band, 24)) for band, colour in shown]
    columns = [Markup('<th class="n">{}</th>').format(words)
               for words in (legend if few else ("least", "largest"))]
    rows = [Markup('<tr><th scope="row">{}</th><td class="bar"><span class="bars">{}</span></td>{}'
                   "</tr>").format(
        svg.plain_line(cause, 40),
        Markup("").join(Markup('<span style="width: {:.1f}%; background: {}"></span>').format(
            100 * value / largest, colour)
            for value, (_, colour) in zip(values, shown, strict=True)),
        Markup("").join(Markup('<td class="n">{}</td>').format(fixed(value, 2))
                        for value in (values if few else (min(values), max(values)))))
        for cause, values in errors.items()]
    title = f"Error budget of {svg.plain_line(surface.name)}"
    box = Markup('<div class="plot-box" id="{}">{}<table class="shares causes" aria-label="{}">'
                 "<thead><tr><th>Cause</th><th>Error, %</th>{}</tr></thead>"
                 "<tbody>{}</tbody></table></div>").format(
        name, "" if few else Markup('<p class="legend">{}</p>').format(Markup(" ").join(
            Markup("<span>{}</span>").format(words) for words in legend)),
        title, Markup("").join(columns), Markup("").join(rows))
    height = 1 / len(shown)
    bars = [{
        "label": svg.plain_line(band, 24), "corners":
        svg.rounded([0, row + k * height, errors[cause][k], row + (k + 1) * height])
    } for row, cause in enumerate(errors) for k, (band, _) in enumerate(shown)]
    return svg.Drawing(box, name, title, [{
        "x_limits": svg.rounded([0, largest]), "y_limits": [0, len(errors)],
        "x_name": "Relative standard error (%)", "y_name": "", "lines": [], "bars": bars,
        "curves": []}])


# ---- figures of photos of flat samples: what they show, and the light over them ------------------

RAW_PX = 500                # a side of the photo as the camera saw it, which a switch shows
PHOTO_WIDTH, MAP = 446.0, 216.0           # in points, of the photo and of the map of the light
BAR, BAR_SHADES = 9.0, 64           # width in points of the bar of colours, and its shades
CHART, REGION, EDGE, RIM = "#ffffff", "#ffd34d", "#ff5a3c", "#000"
CONTOURS = (0.01, 0.02, 0.05, 0.1, 0.2)     # of the light's relative error


@svg.figure("the photo")
def photo_figure(name: str, photo: flat_result.PhotoOfRegions, preview: Path,
                 links: Mapping[str, tuple[str, int]], calibrated: Path | None = None) -> Markup:
    """The photo with its chart and regions outlined, edges across these and the larger part beside
    them in red; the axes count pixels. A region leads to its card.

    Parameters
    ----------
    name : str
        Of the figure on its page, unique there.
    photo : PhotoOfRegions
    preview : Path
        PNG of the whole photo as the camera saw it.
    links : mapping
        From the name of a region.
    calibrated : Path, optional
        The same in the colours of the calibration; the other lies hidden above it.
    """
    width, height = photo.size_px
    plot = _over_photo(name, photo, PHOTO_WIDTH, (30, 4, 20, 4))
    if calibrated is not None:
        plot.picture(_corners(photo), pictures.picture_data_uri(calibrated), smooth=True)
        plot.picture(_corners(photo), pictures.picture_data_uri(preview, RAW_PX), smooth=True,
                     kind="raw")
    else:
        plot.picture(_corners(photo), pictures.picture_data_uri(preview), smooth=True)
    for patch in () if photo.chart_px is None else photo.chart_px:
        plot.outline(patch, CHART, 0.7)
    for region, corners in photo.outlines.items():
        shape = svg.path(plot.x(corners[:, 0]), plot.y(corners[:, 1])) + "z"
        plot.linked(shape, svg.plain_line(region), *links[region], REGION, 1.1)
    plot.lines([edge.line_px for edge in photo.edges.values()], EDGE, 1.6, dash="4 2")
    for edge in photo.edges.values():
        if edge.larger_part_px is not None:
            x0, y0, x1, y1 = edge.larger_part_px
            plot.outline(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]), EDGE, 0.7)
    for region, corners in photo.outlines.items():
        plot.words(corners[:, 0].mean(), corners[:, 1].min() - 0.008 * height,
                   svg.plain_line(region, 24), 7, REGION, rim=RIM)
    plot.x_axis("", svg.nice_ticks(0, width, 8), grid=False)
    plot.y_axis("", svg.nice_ticks(0, height, 8))
    return plot.drawn(f"Photo {svg.plain_line(photo.name)}",
                      "The photo with the patches of the chart and the measured regions outlined"
                      + (", in red the edges across regions and the part that is free of them."
                         if photo.edges else "."))


@svg.figure("the light over the photo")
def light_figure(name: str, photo: flat_result.PhotoOfRegions) -> Markup | None:
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
    plot.picture(
        _corners(photo),
        pictures.pixels_data_uri(pictures.coloured((100 * level - low) / span, pictures.LEVELS)),
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
    return plot.drawn(f"Light over {svg.plain_line(photo.name)}",
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


def _over_photo(name: str, photo: flat_result.PhotoOfRegions, width: float,
                margins: tuple[float, float, float, float]) -> svg.Plot:
    """A figure in the pixels of the photo."""
    left, right, below, above = margins
    columns, rows = photo.size_px
    height = (width - left - right) * min(rows / columns, 1.5)
    return svg.Plot(name, width, height + below + above, (-0.5, columns - 0.5), (rows - 0.5, -0.5),
                margins)


def _corners(photo: flat_result.PhotoOfRegions) -> tuple[float, float, float, float]:
    width, height = photo.size_px
    return -0.5, -0.5, width - 0.5, height - 0.5


def _outlines(plot: svg.Plot, photo: flat_result.PhotoOfRegions) -> None:
    for patch in () if photo.chart_px is None else photo.chart_px:
        plot.outline(patch, CHART, 0.7)
    for corners in photo.outlines.values():
        plot.outline(corners, REGION, 1.1)


def _colour_bar(plot: svg.Plot, photo: flat_result.PhotoOfRegions, low: float, span: float) -> None:
    """Beside the map, what its colours stand for, in per cent."""
    _, top, right, bottom = plot.box
    width, height = photo.size_px
    pixel = width / (plot.width - 60)           # a point in pixels, across
    shades = pictures.pixels_data_uri(
        pictures.coloured(np.linspace(1, 0, BAR_SHADES)[:, None], pictures.LEVELS))
    plot.beside((right + 8, top, right + 8 + BAR, bottom), shades)
    ticks = svg.nice_ticks(low, low + span, 5)
    for value, label in zip(ticks, svg.tick_labels(ticks), strict=True):
        plot.words(width - 0.5 + (11 + BAR) * pixel, (1 - (value - low) / span) * height, label,
                   anchor="start")
    plot.words(width - 0.5 + 50 * pixel, height / 2, "% of the light on the chart", turned=True)
