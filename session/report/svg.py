"""A matplotlib figure as inline SVG: unique ids, an accessible name, and a read-out under the
pointer.

Figures are made with ``figure()`` inside ``report_style()``; pyplot and its global state are never
touched.
"""
from __future__ import annotations

import contextlib
import io
import re
import unicodedata
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from spectrabox.measure.plots import INK, QUIET
from spectrabox.session.report.safe_json import json_for_script

DIGITS = 6          # significant, of a plotted number: far finer than a line is drawn
MARGIN_IN, LEGEND_ROW_IN, LEGEND_LETTER_IN = 0.12, 0.18, 7.5 / 72
NARROW_IN = 6.5      # wider figures scroll on a telephone instead of shrinking
GRID = "#e3e6ea"
STYLE = {
    "svg.fonttype": "none", "svg.hashsalt": "spectrabox", "svg.image_inline": True,
    "text.parse_math": False,  # a name may hold dollar signs
    "text.usetex": False, "axes.formatter.use_mathtext": False,
    "font.family": "sans-serif", "font.sans-serif": ["DejaVu Sans"], "font.size": 8,
    "axes.titlesize": 8.5, "axes.titleweight": "normal", "axes.labelsize": 8,
    "legend.fontsize": 7.5,
    "xtick.labelsize": 7.5, "ytick.labelsize": 7.5,
    "text.color": INK, "axes.labelcolor": INK, "xtick.color": QUIET, "ytick.color": QUIET,
    "xtick.labelcolor": INK, "ytick.labelcolor": INK, "axes.edgecolor": QUIET,
    "axes.linewidth": 0.6, "xtick.major.width": 0.6, "ytick.major.width": 0.6,
    "axes.spines.top": False, "axes.spines.right": False, "axes.axisbelow": True,
    "grid.color": GRID, "grid.linewidth": 0.6, "legend.frameon": False,
    "image.interpolation": "none", "hatch.linewidth": 0.4, "hatch.color": "#9aa1ab",
    "figure.facecolor": "none", "axes.facecolor": "none",
    }


class Drawing(Markup):
    """A figure as HTML, with its name on the page, its heading, and the numbers plotted in it."""

    name: str
    heading: str
    axes: list[dict[str, Any]]

    def __new__(cls, fragment: str, name: str, title: str,
                axes: list[dict[str, Any]]) -> Drawing:
        drawing = super().__new__(cls, fragment)
        drawing.name, drawing.heading, drawing.axes = name, title, axes
        return drawing


@dataclass(frozen=True)
class Readout:
    """What the pointer reads off ``axes``: the value of every series at one x."""

    axes: Axes
    x: np.ndarray                     # (P,) ascending
    series: dict[str, np.ndarray]     # label -> (P,)
    x_name: str
    x_unit: str
    digits: int = 3


@contextlib.contextmanager
def report_style() -> Iterator[None]:
    """The fonts, lines and SVG settings of the report, for figures made and written inside."""
    with matplotlib.rc_context(STYLE), warnings.catch_warnings():  # type: ignore[arg-type]
        # matplotlib only measures text; the browser draws it and has the glyphs that matplotlib's
        # font lacks
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        yield


def figure(width_in: float, height_in: float) -> Figure:
    """An empty figure whose parts arrange themselves."""
    return Figure(figsize=(width_in, height_in), layout="constrained")


def framed(width_in: float, height_in: float, left_in: float = 0.55) -> tuple[Figure, Axes]:
    """A figure of one pair of axes within fixed margins: arranging takes as long as drawing, and
    the browser's letters are of another width than those that would be measured.

    Parameters
    ----------
    left_in : float
        Inches beside the axes, for the values along them and their name.
    """
    drawing, right_in, below_in = Figure(figsize=(width_in, height_in)), 0.12, 0.42
    return drawing, drawing.add_axes((
        left_in / width_in, below_in / height_in, 1 - (left_in + right_in) / width_in,
        1 - (below_in + MARGIN_IN) / height_in))


def legend_above(drawing: Figure, columns: int, handle: float, spacing: float) -> None:
    """A legend above the axes of ``framed``, which give way to its rows.

    Parameters
    ----------
    columns : int
        At most.
    handle, spacing : float
        Length of a line before its name and space between columns, in heights of a letter.
    """
    axes, = drawing.axes
    rows = -(-len(axes.get_legend_handles_labels()[1]) // columns)
    left, below, width, height = axes.get_position().bounds
    height -= rows * LEGEND_ROW_IN / drawing.get_figheight()
    axes.set_position((left, below, width, height))
    drawing.legend(loc="upper left", ncols=columns, handlelength=handle, columnspacing=spacing,
                   borderpad=0, borderaxespad=MARGIN_IN / LEGEND_LETTER_IN / 2)


def plain_line(text: str, longest: int = 60) -> str:
    """``text`` on one line, without control characters, cut to ``longest`` characters with an
    ellipsis.
    """
    line = " ".join("".join(" " if unicodedata.category(c).startswith("C") else c
                            for c in text).split())
    return line if len(line) <= longest else line[:longest - 1] + "…"


def inline_svg(drawing: Figure, name: str, title: str, description: str,
               readout: Readout | None = None) -> Drawing:
    """The figure as an HTML fragment: SVG, and the numbers of its read-out where it has one.

    Parameters
    ----------
    name : prefix of every id in the fragment; letters, digits and hyphens, unique on the page
    title, description : what a screen reader says; any text
    """
    view_box, body = _split(_svg_text(drawing))
    opening = Markup('<svg class="plot" viewBox="{}" role="img" aria-labelledby="{}-title {}-desc">'
                     '<title id="{}-title">{}</title><desc id="{}-desc">{}</desc>').format(
                         view_box, name, name, name, title, name, description)
    svg = opening + Markup(_with_prefix(body, name)) + Markup("</svg>")
    # what scrolls is reached by keyboard: a plot with a read-out is so already
    wide = drawing.get_figwidth() > NARROW_IN
    box = Markup('<div class="plot-box{}" id="{}"{}>{}{}</div>')
    focus = Markup(' tabindex="0"') if wide and readout is None else ""
    content = box.format(" wide" if wide else "", name, focus, svg, _readout_html(drawing, readout))
    return Drawing(content, name, title, plotted_numbers(drawing))


def plotted_numbers(drawing: Figure) -> list[dict[str, Any]]:
    """What each pair of axes of a drawn figure shows, to six significant digits.

    Returns
    -------
    list of dict
        ``x_limits``, ``y_limits``, ``x_name``, ``y_name``; ``lines`` with ``label``, ``x``, ``y``;
        ``bars`` with ``label`` and ``corners`` (x0, y0, x1, y1); ``curves``, collections of lines
        or areas, with ``label`` and ``points``.
    """
    return [{
        "x_limits": _rounded(axes.get_xlim()), "y_limits": _rounded(axes.get_ylim()),
        "x_name": axes.get_xlabel(), "y_name": axes.get_ylabel(),
        "lines": [{"label": _label(line), "x": _rounded(line.get_xdata()),
                   "y": _rounded(line.get_ydata())} for line in axes.lines
                  if line.get_transform() is axes.transData and np.size(line.get_xdata())],
        "bars": [{"label": str(bars.get_label()),
                  "corners": _rounded([bar.get_x(), bar.get_y(), bar.get_x() + bar.get_width(),
                                       bar.get_y() + bar.get_height()])}
                 for bars in axes.containers for bar in bars if isinstance(bar, Rectangle)],
        "curves": [{"label": _label(curves), "points": [_rounded(np.transpose(path.vertices))
                                                        for path in curves.get_paths()]}
                   for curves in axes.collections
                   if isinstance(curves, LineCollection | PolyCollection)],
        } for axes in drawing.axes if axes.lines or axes.containers or axes.collections]


def _label(artist: Any) -> str:
    label = str(artist.get_label())
    return "" if label.startswith("_") else label


def _rounded(values: Any) -> np.ndarray:
    array = np.asarray(values, dtype=float)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 10.0 ** (DIGITS - 1 - np.floor(np.log10(np.abs(array))))
        return np.where(np.isfinite(scale), np.round(array * scale) / scale, array)


def _svg_text(drawing: Figure) -> str:
    buffer = io.StringIO()
    # Not savefig: it draws every figure twice, the first time for bounding boxes that are not asked
    # for.
    FigureCanvasSVG(drawing).print_svg(buffer, metadata={"Date": None, "Creator": None,
                                                         "Format": None, "Type": None})
    return buffer.getvalue()


def _split(svg: str) -> tuple[str, str]:
    """The view box, and what stands between the outer tags less the style sheet that would leak
    into the page.
    """
    opening = re.search(r'<svg [^>]*viewBox="([^"]*)"[^>]*>', svg)
    assert opening is not None, "matplotlib writes a view box into every SVG"
    body = svg[opening.end():svg.rindex("</svg>")]
    return opening[1], re.sub(r"<defs>\s*<style[^>]*>.*?</style>\s*</defs>", "", body, count=1,
                              flags=re.DOTALL)


def _with_prefix(body: str, name: str) -> str:
    """Ids and the references to them made unique to the page; only inside tags, so no drawn text is
    changed.
    """
    def rename(tag: re.Match[str]) -> str:
        text = re.sub(r'\sid="', f' id="{name}-', tag[0])
        text = text.replace("url(#", f"url(#{name}-").replace('xlink:href="#', f'href="#{name}-')
        return re.sub(r'\sd="[^"]*"', lambda path: re.sub(r"(\.\d\d)\d+", r"\1", path[0]), text)
    return re.sub(r"<[^>]+>", rename, body)


def _readout_html(drawing: Figure, readout: Readout | None) -> Markup:
    if readout is None:
        return Markup("")
    width, height = drawing.get_size_inches() * 72
    box = readout.axes.get_position()  # in its place only after the figure was drawn
    numbers = {
        "box": [box.x0 * width, (1 - box.y1) * height, box.x1 * width, (1 - box.y0) * height],
        "limits": readout.axes.get_xlim(), "name": readout.x_name, "unit": readout.x_unit,
        "digits": readout.digits, "x": np.round(readout.x, 3),
        "series": [[label, np.round(np.asarray(y, dtype=float), readout.digits + 1)]
                   for label, y in readout.series.items()],
        }
    return Markup('<script type="application/json" class="readout">{}</script><output>Point at the '
                  'plot to read its values.</output>').format(json_for_script(numbers))
