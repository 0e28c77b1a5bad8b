"""Figures of the chart and of the convergence."""
from __future__ import annotations

import numpy as np
from markupsafe import Markup

from spectrabox.measure.plot_style import INK, QUIET, band_colours
from spectrabox.measure.words import SUPERSCRIPT, number
from spectrabox.session.report.patch_colours import css_colour
from spectrabox.session.report.pictures import LEVELS, coloured
from spectrabox.session.report.svg import Plot, Readout, figure, nice_ticks, plain_line

MAX_TICKS = 24      # patches numbered along an axis
WIDE, GOOD = 691.0, "#eef1f4"       # width in points of a figure across the page; the band of good
CELL = (43.0, 40.0)                 # width and height in points of a patch of the irradiance
DARKEST = 80.0                      # per cent: the lower end of the irradiance's colours, at most


@figure("the chart residuals")
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
    plot = Plot(name, WIDE, 216, (0.4, patches + 0.6), (-largest, largest))
    plot.rectangle((0.4, -100 * limit, patches + 0.6, 100 * limit), GOOD)
    plot.level(0, QUIET, 0.7)
    plot.x_axis("Patch", np.arange(1, patches + 1, -(-patches // MAX_TICKS)), grid=False)
    plot.y_axis("(photo − predicted) / photo (%)", nice_ticks(-largest, largest, 6))
    for k, (band, colour) in enumerate(zip(bands, band_colours(bands), strict=True)):
        at = np.arange(1, patches + 1) + 0.5 * ((k + 0.5) / len(bands) - 0.5)
        if held_out is not None:
            plot.dots(at, 100 * held_out[:, k], colour, 2.2, open_=True)
        plot.dots(at, 100 * residuals[:, k], colour, 1.8, label=plain_line(band, 24))
    if held_out is not None:
        plot.dots([], [], INK, 2.2, open_=True, label="left out of its own fit")
    return plot.drawn("Chart residuals",
                      f"Relative residual of the {patches} patches in each band.")


@figure("the irradiance over the chart")
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
    plot = Plot(name, max(CELL[0] * columns, 115.0), CELL[1] * rows + 22, (0, columns), (rows, 0),
                (0, 0, 0, 22))
    low = min(float(np.nanmin(field)), DARKEST)
    share = (field - low) / (100 - low)
    for (row, column), value in np.ndenumerate(field):
        measured = bool(np.isfinite(value))
        plot.rectangle((column, row, column + 1, row + 1), css_colour(
            coloured(share[row, column], LEVELS)) if measured else "#fff")
        plot.words(column + 0.5, row + 0.57, f"{value:.0f}" if measured else "?", 8,
                   "#fff" if measured and share[row, column] < 0.55 else "#000")
    plot.words(columns / 2, -0.2, "Irradiance, %", 8.5)     # of how much, the caption says
    return plot.drawn("Irradiance over the chart",
                      "Relative irradiance of each patch in per cent.")


@figure("the convergence")
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
    plot = Plot(name, WIDE, 194, (0, history.size - 1), (low - margin, high + margin),
                (58, 9, 31, 9))
    plot.x_axis("Iteration", nice_ticks(0, history.size - 1, 10))
    decades = np.arange(np.ceil(low - margin), np.floor(high + margin) + 1)
    if positive and len(decades) > 1:
        plot.y_axis("Loss", decades, [power_of_ten(10.0**decade) for decade in decades])
    else:
        ticks = nice_ticks(low - margin, high + margin, 5)
        plot.y_axis("Loss", ticks, [number(float(10**tick if positive else tick), 3)
                                    for tick in ticks])
    plot.line(steps, height, "#1f4e8c", 1.3, stated=history)
    start, end = number(float(history[0]), 3), number(float(history[-1]), 3)
    digits = int(np.clip(4 - np.floor(np.log10(max(float(np.abs(history).min()), 1e-12))), 3, 14))
    return plot.drawn("Loss history", f"The loss fell from {start} to {end}.",
                      Readout(steps.astype(float), {"loss": history}, "Iteration", "", digits))


def power_of_ten(value: float) -> str:
    """A power of ten as a tick label."""
    return "10" + str(round(np.log10(value))).translate(SUPERSCRIPT)
