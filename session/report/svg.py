"""The report's figures as inline SVG: curves, areas and dots over two axes, or marks on pictures,
with unique ids, an accessible name, the numbers that are plotted, and a read-out under the pointer.

Drawn without a plotting library: loading one and drawing with it took most of a report's time.
"""
from __future__ import annotations

import functools
import unicodedata
from collections.abc import Callable, Iterable, Sequence
from typing import Any, ParamSpec, TypeVar, cast

import numpy as np
from markupsafe import Markup, escape

from spectrabox.measure import extras, plots, texts
from spectrabox.radiometry.findings import Finding
from spectrabox.session.report.pictures import json_for_script

DIGITS = 6          # significant, of a plotted number: far finer than a line is drawn
# Points, 72 to the inch: margins about the axes, height of letters, and of a row of the legend.
LEFT, RIGHT, BELOW, ABOVE = 40.0, 9.0, 31.0, 9.0
LETTERS, LEGEND_ROW, SYMBOL, SPACE = 7.5, 13.0, 13.0, 9.0
LETTER_WIDTH = 0.56         # of its height, on average, in wide fonts
NARROW = 468.0              # wider figures scroll on a telephone instead of shrinking
GRID = "#e3e6ea"
NICE_STEPS = (1, 2, 2.5, 5, 10)
DASHED, DOTTED = "3.5 1.5", "1 1.3"
Arguments = ParamSpec("Arguments")
Figure = TypeVar("Figure")


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


class MissingDrawing(Markup):
    """What stands in the place of a figure that could not be drawn."""

    failed: Finding

    def __new__(cls, failed: Finding) -> MissingDrawing:
        missing = super().__new__(cls, Markup('<p class="quiet">There is {}.</p>').format(
            texts.sentence(failed)))
        missing.failed = failed
        return missing


def figure(words: str) -> Callable[[Callable[Arguments, Figure]],
                                   Callable[Arguments, Figure | MissingDrawing]]:
    """Marks a function that draws a figure: where it fails, the page has a sentence in its place.

    Parameters
    ----------
    words : str
        What the figure shows, after "picture of".
    """
    def marked(draw: Callable[Arguments, Figure]) -> Callable[Arguments, Figure | MissingDrawing]:
        @functools.wraps(draw)
        def drawn(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Figure | MissingDrawing:
            drawing, failed = extras.attempt(f"picture of {words}", lambda: draw(*args, **kwargs),
                                             None)
            return cast(Figure, drawing) if failed is None else MissingDrawing(failed)
        return drawn
    return marked


class Plot:
    """A figure that is being drawn: each mark is written as it is added, over those before it.

    Parameters
    ----------
    name : str
        Prefix of every id in the figure; letters, digits and hyphens, unique on the page.
    width, height : float
        In points, those of a legend apart, which is put above.
    x_limits, y_limits : two floats
        At the left and right, lower and upper ends of the axes.
    margins : four floats
        Points left, right, below and above the axes.
    """

    def __init__(self, name: str, width: float, height: float, x_limits: Sequence[float],
                 y_limits: Sequence[float],
                 margins: tuple[float, float, float, float] = (LEFT, RIGHT, BELOW, ABOVE)) -> None:
        left, right, below, above = margins
        self.name, self.width, self.height = name, width, height
        self.box = (left, above, width - right, height - below)
        self.x_limits, self.y_limits = x_limits, y_limits
        self._under, self._marks, self._over = list[str](), list[str](), list[str]()
        self._legend = list[tuple[str, str]]()
        self._role, self._readout = "img", Markup("")
        self._numbers: dict[str, Any] = {
            "x_limits": rounded(x_limits), "y_limits": rounded(y_limits), "x_name": "",
            "y_name": "", "lines": [], "bars": [], "curves": []}

    def x(self, values: Any) -> np.ndarray:
        """Points from the left edge of the figure."""
        left, _, right, _ = self.box
        start, end = self.x_limits
        return np.asarray(left + (np.asarray(values, float) - start) / (end - start)
                          * (right - left))

    def y(self, values: Any) -> np.ndarray:
        """Points from the upper edge of the figure, less the legend."""
        _, top, _, bottom = self.box
        start, end = self.y_limits
        return np.asarray(bottom - (np.asarray(values, float) - start) / (end - start)
                          * (bottom - top))

    def x_axis(self, name: str, ticks: Any, labels: Sequence[str] | None = None,
               grid: bool = True) -> None:
        """The lower axis with its name, and labels at ticks."""
        left, top, right, bottom = self.box
        self._numbers["x_name"] = name
        for at, label in zip(self.x(ticks).tolist(), labels or tick_labels(ticks), strict=True):
            if grid:
                self._under.append(_stroke(f"M{at:.2f} {top:.2f}V{bottom:.2f}", GRID, 0.6))
            self._over.append(_text(at, bottom + 10, label))
        self._over.append(_stroke(f"M{left:.2f} {bottom:.2f}H{right:.2f}", plots.QUIET, 0.6))
        self._over.append(_text((left + right) / 2, bottom + 23, name))

    def y_axis(self, name: str, ticks: Any, labels: Sequence[str] | None = None) -> None:
        """The axis at the left with its name, and labels at ticks."""
        left, top, right, bottom = self.box
        self._numbers["y_name"] = name
        for at, label in zip(self.y(ticks).tolist(), labels or tick_labels(ticks), strict=True):
            self._under.append(_stroke(f"M{left:.2f} {at:.2f}H{right:.2f}", GRID, 0.6))
            self._over.append(_text(left - 4, at + 2.6, label, "end"))
        self._over.append(_stroke(f"M{left:.2f} {top:.2f}V{bottom:.2f}", plots.QUIET, 0.6))
        middle = (top + bottom) / 2
        self._over.append(_text(9, middle, name, turned=True))

    def line(self, x: Any, y: Any, colour: str, width: float, dash: str = "", label: str = "",
             stated: np.ndarray | None = None) -> None:
        """A curve, interrupted where it is not a number; ``stated`` is among the numbers in place
        of its logarithm. Of no points it stands in the legend alone.
        """
        if len(x):
            self._marks.append(_stroke(path(self.x(x), self.y(y)), colour, width, dash))
            self._numbers["lines"].append({"label": label, "x": rounded(x),
                                           "y": rounded(y if stated is None else stated)})
        self._explain(_stroke(f"M0 -2.6H{SYMBOL}", colour, width, dash), label)

    def lines(self, curves: Iterable[np.ndarray], colour: str, width: float, dash: str = "",
              opacity: float = 1.0, label: str = "") -> None:
        """Many curves (n, 2) of one look."""
        curves = list(curves)
        self._marks.append(
            f'<g opacity="{opacity:g}">' + "".join(
                _stroke(path(self.x(curve[:, 0]), self.y(curve[:, 1])), colour, width, dash)
                for curve in curves) + "</g>")
        self._numbers["curves"].append({"label": label, "points": [rounded(curve.T)
                                                                   for curve in curves]})
        self._explain(_stroke(f"M0 -2.6H{SYMBOL}", colour, max(width, 0.7), dash), label)

    def areas(self, x: Any, lower: np.ndarray, upper: np.ndarray, colour: str, opacity: float,
              label: str = "") -> None:
        """Between two curves (P,), or several pairs of them (n, P)."""
        outlines = [np.stack([np.r_[along, along[::-1]], np.r_[below, above[::-1]]])
                    for along, below, above in zip(*np.broadcast_arrays(
                        np.atleast_2d(x), np.atleast_2d(lower), np.atleast_2d(upper)), strict=True)]
        shape = "".join(path(self.x(outline[0]), self.y(outline[1])) + "z" for outline in outlines)
        look = f'fill="{colour}" fill-opacity="{opacity:g}"'
        self._marks.append(f'<path d="{shape}" {look}/>')
        self._numbers["curves"].append({"label": label, "points": [rounded(outline)
                                                                   for outline in outlines]})
        self._explain(f'<rect y="-6" width="{SYMBOL}" height="6.5" {look}/>', label)

    def dots(self, x: Any, y: Any, colour: str, radius: float, open_: bool = False,
             label: str = "") -> None:
        """Dots, or rings."""
        look = f'fill="none" stroke="{colour}" stroke-width=".8"' if open_ else f'fill="{colour}"'
        self._over += [f'<circle cx="{a:.2f}" cy="{b:.2f}" r="{radius:g}" {look}/>'
                       for a, b in zip(self.x(x).tolist(), self.y(y).tolist(), strict=True)
                       if np.isfinite(b)]
        if len(x):
            self._numbers["lines"].append({"label": label, "x": rounded(x), "y": rounded(y)})
        self._explain(f'<circle cx="{SYMBOL / 2}" cy="-2.6" r="{radius:g}" {look}/>', label)

    def crosses(self, x: Any, y: Any, colour: str) -> None:
        """Small oblique crosses."""
        self._over += [_stroke(f"M{a - 2:.2f} {b - 2:.2f}l4 4m0 -4l-4 4", colour, 1)
                       for a, b in zip(self.x(x).tolist(), self.y(y).tolist(), strict=True)]
        self._numbers["lines"].append({"label": "", "x": rounded(x), "y": rounded(y)})

    def upright(self, x: float, colour: str, width: float, dash: str, label: str) -> None:
        """A line from the lower end of the axes to the upper one."""
        _, top, _, bottom = self.box
        at = float(self.x(x))
        self._marks.append(_stroke(f"M{at:.2f} {top:.2f}V{bottom:.2f}", colour, width, dash))
        self._explain(_stroke(f"M0 -2.6H{SYMBOL}", colour, width, dash), label)

    def level(self, y: float, colour: str, width: float) -> None:
        """A line from the left end of the axes to the right one."""
        left, _, right, _ = self.box
        self._marks.append(_stroke(f"M{left:.2f} {float(self.y(y)):.2f}H{right:.2f}", colour,
                                   width))

    def rectangle(self, corners: Sequence[float], fill: str) -> None:
        """A filled rectangle between (x0, y0) and (x1, y1)."""
        left, right = sorted(self.x(corners[0::2]).tolist())
        top, bottom = sorted(self.y(corners[1::2]).tolist())
        self._marks.append(f'<rect x="{left:.2f}" y="{top:.2f}" width="{right - left:.2f}" '
                           f'height="{bottom - top:.2f}" fill="{fill}"/>')

    def picture(self, corners: Sequence[float], uri: str, smooth: bool = False,
                kind: str = "") -> None:
        """A picture, from a data URI, between (x0, y0) and (x1, y1); of a kind for the style sheet.
        """
        left, right = sorted(self.x(corners[0::2]).tolist())
        top, bottom = sorted(self.y(corners[1::2]).tolist())
        self._marks.append(_image((left, top, right, bottom), uri, smooth, kind))

    def beside(self, points: tuple[float, float, float, float], uri: str) -> None:
        """A picture, from a data URI, outside of the axes: its left, upper, right and lower edge in
        points of the figure.
        """
        self._over.append(_image(points, uri, smooth=True))

    def outline(self, corners: np.ndarray, colour: str, width: float) -> None:
        """A polygon (n, 2), with a dark rim that tells it from any ground."""
        shape = path(self.x(corners[:, 0]), self.y(corners[:, 1])) + "z"
        self._marks += [_stroke(shape, "#000", width + 1), _stroke(shape, colour, width)]

    def linked(self, shape: str, name: str, card: str, index: int, colour: str = "",
               width: float = 0) -> None:
        """A part of a picture that leads to the card of its surface, by the card's id and the
        surface's index among the page's numbers: an SVG path, with a rim where it has a colour.
        """
        rims = [_stroke(shape, "#000", width + 1), _stroke(shape, colour, width)] if colour else []
        self._marks.append(
            f'<a class="mark" href="#{card}" data-surface="{index}" '
            f'aria-label="{escape(name)}"><path class="area" d="{shape}"/>{"".join(rims)}</a>')
        self._role = "group"        # pictures hold nothing that is pressed

    def words(self, x: float, y: float, words: str, size: float = LETTERS, colour: str = plots.INK,
              anchor: str = "middle", rim: str = "", turned: bool = False) -> None:
        """Text whose foot is at a point, with a rim of a colour where it lies on a picture."""
        self._over.append(_text(float(self.x(x)), float(self.y(y)), words, anchor, size, colour,
                                rim, turned))

    def hatched(self, corners: Sequence[float], ground: str, line: str) -> None:
        """A hatched rectangle between (x0, y0) and (x1, y1)."""
        pattern = f"{self.name}-hatch"
        if not any(pattern in part for part in self._under):
            self._under.append(
                f'<defs><pattern id="{pattern}" width="5" height="5" '
                f'patternUnits="userSpaceOnUse"><rect width="5" height="5" fill="{ground}"/>'
                f'{_stroke("M-1 6L6 -1M-1 1L1 -1M4 6L6 4", line, 0.5)}</pattern></defs>')
        self.rectangle(corners, f"url(#{pattern})")

    def readout(self, x: np.ndarray, series: dict[str, np.ndarray], x_name: str, x_unit: str,
                digits: int = 3) -> None:
        """Let the pointer read off the value of every series at one x.

        Parameters
        ----------
        x : (P,) array
            Ascending.
        series : dict of (P,) arrays
            By label.
        x_name, x_unit : str
        digits : int
        """
        numbers = {
            "box": self.box, "limits": self.x_limits, "name": x_name, "unit": x_unit,
            "digits": digits, "x": np.round(x, 3),
            "series": [[label, np.round(np.asarray(y, dtype=float), digits + 1)]
                       for label, y in series.items()]}
        self._readout = Markup('<script type="application/json" class="readout">{}</script><output>'
                               'Point at the plot to read its values.</output>').format(
                                   json_for_script(numbers))

    def drawn(self, title: str, description: str) -> Drawing:
        """The figure as an HTML fragment, its legend above.

        Parameters
        ----------
        title, description : str
            What a screen reader says.
        """
        left, top, right, bottom = self.box
        legend, rows = self._laid_out()
        above = rows * LEGEND_ROW
        marks = (f'<clipPath id="{self.name}-clip"><rect x="{left:.2f}" y="{top:.2f}" '
                 f'width="{right - left:.2f}" height="{bottom - top:.2f}"/></clipPath>'
                 f'{"".join(self._under)}<g clip-path="url(#{self.name}-clip)">'
                 f'{"".join(self._marks)}</g>{"".join(self._over)}{legend}')
        svg = Markup('<svg class="plot" viewBox="0 {:g} {:g} {:g}" role="{}" '
                     'aria-labelledby="{}-title {}-desc"><title id="{}-title">{}</title>'
                     '<desc id="{}-desc">{}</desc>{}</svg>').format(
                         -above, self.width, self.height + above, self._role,
                         *[self.name] * 3, title, self.name, description, Markup(marks))
        # what scrolls is reached by keyboard: a plot with a read-out is so already
        wide = self.width > NARROW
        content = Markup('<div class="plot-box{}" id="{}"{}>{}{}</div>').format(
            " wide" if wide else "", self.name,
            Markup(' tabindex="0"') if wide and not self._readout else "", svg, self._readout)
        plotted = any(self._numbers[kind] for kind in ("lines", "bars", "curves"))
        return Drawing(content, self.name, title, [self._numbers] if plotted else [])

    def _explain(self, symbol: str, label: str) -> None:
        if label:
            self._legend.append((symbol, label))

    def _laid_out(self) -> tuple[str, int]:
        """The legend's rows above the figure, and how many they are."""
        rows, x = list[list[tuple[float, str, str]]](), np.inf
        for symbol, label in self._legend:
            wide = SYMBOL + 4 + LETTER_WIDTH * LETTERS * len(label)
            if x + wide > self.width - RIGHT:
                rows.append([])
                x = self.box[0] if self.box[0] + wide < self.width else 4.0
            rows[-1].append((x, symbol, label))
            x += wide + SPACE
        parts = [f'<g transform="translate({x:.2f} {(number - len(rows) + 1) * LEGEND_ROW - 4:g})">'
                 f'{symbol}{_text(SYMBOL + 4, 0, label, "start")}</g>'
                 for number, row in enumerate(rows) for x, symbol, label in row]
        return "".join(parts), len(rows)


def path(x: np.ndarray, y: np.ndarray) -> str:
    """An SVG path through points, interrupted where one is not a number."""
    pieces, pen = [], "M"
    for a, b in zip(x.tolist(), y.tolist(), strict=True):
        if a - a == b - b == 0:         # finite, both
            pieces.append(f"{pen}{a:.2f} {b:.2f}")
            pen = "L"
        else:
            pen = "M"
    return "".join(pieces)


def nice_ticks(low: float, high: float, most: int) -> np.ndarray:
    """Round numbers between two, at most so many and at equal distances."""
    least = (high - low) / max(most, 1)
    decade = 10.0 ** np.floor(np.log10(least))
    step = next(decade * each for each in NICE_STEPS if decade * each >= least * (1 - 1e-9))
    multiples = np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1)
    return np.asarray(multiples * step + 0.0)       # + 0: no "-0"


def tick_labels(values: Any) -> list[str]:
    """Numbers as short as they can be written."""
    return [f"{value:.4g}".replace("-", "−") for value in np.asarray(values, float).tolist()]


def plain_line(text: str, longest: int = 60) -> str:
    """``text`` on one line, without control characters, cut to ``longest`` characters with an
    ellipsis.
    """
    line = " ".join("".join(" " if unicodedata.category(c).startswith("C") else c
                            for c in text).split())
    return line if len(line) <= longest else line[:longest - 1] + "…"


def rounded(values: Any) -> np.ndarray:
    """Numbers to six significant digits."""
    array = np.asarray(values, dtype=float)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        scale = 10.0 ** (DIGITS - 1 - np.floor(np.log10(np.abs(array))))
        return np.where(np.isfinite(scale), np.round(array * scale) / scale, array)


def _image(points: tuple[float, float, float, float], uri: str, smooth: bool,
           kind: str = "") -> str:
    left, top, right, bottom = points
    named = f'class="{kind}" ' if kind else ""
    return (f'<image {named}x="{left:.2f}" y="{top:.2f}" width="{right - left:.2f}" '
            f'height="{bottom - top:.2f}" preserveAspectRatio="none" href="{uri}"'
            + ("" if smooth else ' style="image-rendering:pixelated"') + "/>")


def _stroke(shape: str, colour: str, width: float, dash: str = "") -> str:
    dashes = f' stroke-dasharray="{dash}"' if dash else ""
    return f'<path d="{shape}" fill="none" stroke="{colour}" stroke-width="{width:g}"{dashes}/>'


def _text(x: float, y: float, words: str, anchor: str = "middle", size: float = LETTERS,
          colour: str = plots.INK, rim: str = "", turned: bool = False) -> str:
    look = f' stroke="{rim}" stroke-width="2" paint-order="stroke"' if rim else ""
    turn = f' transform="rotate(-90 {x:.2f} {y:.2f})"' if turned else ""
    return (f'<text x="{x:.2f}" y="{y:.2f}" text-anchor="{anchor}" font-size="{size:g}" '
            f'fill="{colour}"{look}{turn}>{escape(words)}</text>')
