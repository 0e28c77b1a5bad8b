"""What notebooks show: axes to draw into, and short HTML with a swatch and a plot of a surface."""
from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from markupsafe import Markup

from spectrabox.measure.plot_style import band_colours
from spectrabox.radiometry.appearance import reflectance_to_srgb

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from spectrabox.measure.estimate import Estimate

WIDTH, HEIGHT = 150, 36     # of the small plot, in pixels


def axes_for(axes: Axes | None, inches: tuple[float, float] | None = None) -> Axes:
    """The given axes, or new ones in a figure of that size."""
    return plt.subplots(figsize=inches, layout="constrained")[1] if axes is None else axes


def spectrum_html(estimates: Sequence[Estimate]) -> str:
    """A table with one row a surface, and below it what was not stated of their signals."""
    rows = Markup("").join(_row(estimate) for estimate in estimates)
    table = Markup("<table><thead><tr><th>surface</th><th>colour</th><th>400 to 700 nm, 0 to 1</th>"
                   "<th>band width</th></tr></thead><tbody>{}</tbody></table>")
    caveats = dict.fromkeys(caveat for estimate in estimates for caveat in estimate.caveats)
    return str(table.format(rows) + Markup("").join(Markup("<p>{}</p>").format(caveat)
                                                    for caveat in caveats))


def _row(estimate: Estimate) -> Markup:
    nm = estimate.nm
    red, green, blue = (round(255 * float(value)) for value
                        in reflectance_to_srgb(nm, np.clip(estimate.mean, 0, 1)))
    width = "given" if estimate.given is not None else f"{estimate.band_width:.3f}"
    return Markup('<tr><td>{}</td><td><span style="display:inline-block;width:2.5em;height:1.4em;'
                  'background:rgb({},{},{})"></span></td><td>{}</td><td>{}</td></tr>').format(
                      estimate.name, red, green, blue, _small_plot(estimate), width)


def _small_plot(estimate: Estimate) -> Markup:
    nm = estimate.nm
    x = (nm - nm[0]) / (nm[-1] - nm[0]) * WIDTH
    lower, upper = estimate.band()
    step = max(len(nm) // 60, 1)

    def points(values: np.ndarray, order: slice) -> str:
        return " ".join(f"{a:.1f},{HEIGHT * (1 - min(float(b), 1.0)):.1f}"
                        for a, b in zip(x[::step][order], values[::step][order], strict=True))

    forward, backward = slice(None), slice(None, None, -1)
    return Markup('<svg width="{}" height="{}" role="img" aria-label="mean and band of {}">'
                  '<polygon points="{} {}" fill="#1f4e8c" fill-opacity=".18"/><polyline '
                  'points="{}" fill="none" stroke="#1f4e8c" stroke-width="1.5"/></svg>').format(
                      WIDTH, HEIGHT, estimate.name, points(upper, forward),
                      points(lower, backward), points(estimate.mean, forward))


def curves_html(nm: np.ndarray, curves: np.ndarray, bands: Sequence[str],
                said: Sequence[str]) -> str:
    """A small plot of curves (K, P), and sentences on them."""
    top = float(curves.max())
    x = (nm - nm[0]) / (nm[-1] - nm[0]) * 2 * WIDTH
    step = max(len(nm) // 60, 1)
    lines = Markup("").join(
        Markup('<polyline points="{}" fill="none" stroke="{}" stroke-width="1.5"/>').format(
            " ".join(f"{a:.1f},{2 * HEIGHT * (1 - max(float(b), 0.0) / top):.1f}"
                     for a, b in zip(x[::step], curve[::step], strict=True)), colour)
        for curve, colour in zip(curves, band_colours(bands), strict=True))
    items = Markup("").join(Markup("<li>{}</li>").format(sentence) for sentence in said)
    return str(Markup('<svg width="{}" height="{}" role="img" aria-label="sensitivities">{}</svg>'
                      "<ul>{}</ul>").format(2 * WIDTH, 2 * HEIGHT, lines, items))
