"""A drawn figure with the numbers in it, so that a page can be held against its own data.

``report.js`` reads the same pieces of a drawing, in the same order, as ``drawing_digest``.
"""
from __future__ import annotations

import hashlib
import html
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from spectrabox.session.report.checked.cells import BLANK

DIGITS = 6          # significant, of a plotted number: far finer than a line is drawn
# what of a drawing is seen: attributes of these names, and text
OUTPUT = re.compile("<output>.*?</output>", re.DOTALL)     # changes under the pointer
PIECES = re.compile(r'\s(?:d|x|y|points|transform|style|href|xlink:href)="([^"]*)"|>([^<]+)')


class Drawing(Markup):
    """A figure as HTML, with its name on the page and what is plotted in it."""

    name: str
    facts: dict[str, Any]

    def __new__(cls, fragment: str, name: str, title: str,
                axes: list[dict[str, Any]]) -> Drawing:
        drawing = super().__new__(cls, fragment)
        drawing.name = name
        drawing.facts = {"title": title, "sha256": drawing_digest(fragment), "axes": axes}
        return drawing

    def __getnewargs__(self) -> tuple[Any, ...]:    # a second process hands it over
        return str(self), self.name, self.facts["title"], self.facts["axes"]


def drawing_digest(fragment: str) -> str:
    """SHA-256 of what is seen of a drawing: places, shapes, styles and texts, in their order.

    Parameters
    ----------
    fragment : str
        SVG, and what stands beside it in its box.
    """
    pieces = (BLANK.sub("", html.unescape(attribute or text))
              for attribute, text in PIECES.findall(OUTPUT.sub("", fragment)))
    seen = "|".join(piece for piece in pieces if piece)
    return hashlib.sha256(seen.encode("utf-8", "backslashreplace")).hexdigest()


def named_series(figure: Figure) -> None:
    """Give the lines and bars of a figure the ids by which ``plotted`` names them."""
    for number, artist in enumerate(_series(figure)):
        artist.set_gid(f"s{number}")


def plotted(figure: Figure) -> list[dict[str, Any]]:
    """What each pair of axes of a drawn figure shows: its box, limits, lines, bars and curves.

    Returns
    -------
    list of dict
        ``box`` (left, top, right, bottom) in the drawing's own unit.
    """
    return [_axes_facts(figure, axes) for axes in figure.axes
            if axes.lines or axes.containers or axes.collections]


def drawings_in(content: Any) -> Iterator[Drawing]:
    """Every drawing among the values of a page."""
    if isinstance(content, Drawing):
        yield content
    elif isinstance(content, dict):
        for value in content.values():
            yield from drawings_in(value)
    elif isinstance(content, list | tuple):
        for value in content:
            yield from drawings_in(value)


def _series(figure: Figure) -> Iterator[Any]:
    for axes in figure.axes:
        yield from _lines(axes)
        for _, bar in _bars(axes):
            yield bar


def _lines(axes: Axes) -> Iterator[Any]:
    return (line for line in axes.lines
            if line.get_transform() is axes.transData and np.size(line.get_xdata()))


def _bars(axes: Axes) -> Iterator[tuple[str, Rectangle]]:
    for bars in axes.containers:
        for bar in bars:
            if isinstance(bar, Rectangle):
                yield str(bars.get_label()), bar


def _axes_facts(figure: Figure, axes: Axes) -> dict[str, Any]:
    width, height = figure.get_size_inches() * 72
    box = axes.get_position()
    return {
        "box": _short([box.x0 * width, (1 - box.y1) * height, box.x1 * width,
                       (1 - box.y0) * height]),
        "x_limits": _short(axes.get_xlim()), "y_limits": _short(axes.get_ylim()),
        "y_scale": axes.get_yscale(), "x_name": axes.get_xlabel(), "y_name": axes.get_ylabel(),
        "lines": [{"id": line.get_gid(), "label": _label(line), "x": _short(line.get_xdata()),
                   "y": _short(line.get_ydata())} for line in _lines(axes)],
        "bars": [{"id": bar.get_gid(), "label": label,
                  "corners": _short([bar.get_x(), bar.get_y(), bar.get_x() + bar.get_width(),
                                     bar.get_y() + bar.get_height()])}
                 for label, bar in _bars(axes)],
        "curves": [{"label": _label(curves), "points": [_short(np.transpose(path.vertices))
                                                        for path in curves.get_paths()]}
                   for curves in axes.collections
                   if isinstance(curves, LineCollection | PolyCollection)],
        }


def _label(artist: Any) -> str:
    label = str(artist.get_label())
    return "" if label.startswith("_") else label


def _short(values: Any) -> np.ndarray:
    """Numbers cut to the digits that are kept."""
    array = np.asarray(values, dtype=float)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 10.0 ** (DIGITS - 1 - np.floor(np.log10(np.abs(array))))
        return np.where(np.isfinite(scale), np.round(array * scale) / scale, array)
