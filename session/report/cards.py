"""The answer at a glance: one card a surface, with its colour, its spectrum and its doubts."""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from spectrabox.measure.results.surface_result import SurfaceResult
from spectrabox.session.report.patch_colours import css_colour, hex_colour

LEFT, TOP, WIDTH, HEIGHT = 24.0, 6.0, 220.0, 104.0     # of the plotted area, in SVG units
TICKS_NM, LEVELS = (400, 500, 600, 700), (0.0, 0.5, 1.0)
UNTESTED = "band of untested coverage"


@dataclass(frozen=True, eq=False)
class Card:
    """What a reader who stops here should know of one surface."""

    id: str                     # of its section on the page
    surface: SurfaceResult
    spectrum: Markup            # small SVG
    doubts: tuple[str, ...]     # in few words; empty where nothing speaks against the estimate

    @property
    def css(self) -> str:
        """The colour as CSS writes it."""
        return css_colour(self.surface.srgb)

    @property
    def hex(self) -> str:
        """The colour as web pages write it."""
        return hex_colour(self.surface.srgb)


def answer_card(number: int, surface: SurfaceResult, doubts: tuple[str, ...]) -> Card:
    """The card of one surface.

    Parameters
    ----------
    number : int
        On the page.
    surface : SurfaceResult
    doubts : tuple of str
        Names of the criteria that it does not pass.
    """
    if surface.untested:
        doubts += (UNTESTED,)
    return Card(f"material-{number}", surface, small_spectrum(surface), doubts)


def small_spectrum(surface: SurfaceResult) -> Markup:
    """Mean and band of a surface, and its measured truth where there is one, as a small drawing.

    Parameters
    ----------
    surface : SurfaceResult
    """
    summary, truth, nm, mean = surface.summary, surface.truth, surface.nm, surface.mean
    tops = [mean, *([] if summary is None else [summary.upper]),
            *([] if truth is None else [truth.values])]
    top = max(1.0, *(float(np.nanmax(values)) for values in tops))

    def points(x: np.ndarray, values: np.ndarray) -> str:
        across = LEFT + (x - nm[0]) / (nm[-1] - nm[0]) * WIDTH
        up = TOP + HEIGHT * (1 - np.clip(values, 0, top) / top)
        return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(across, up, strict=True))

    foot, parts = TOP + HEIGHT, []
    for value in LEVELS:
        y = TOP + HEIGHT * (1 - value / top)
        parts.append(f'<path class="grid" d="M{LEFT} {y:.1f}h{WIDTH}"/><text x="{LEFT - 4}" '
                     f'y="{y + 3.5:.1f}" text-anchor="end">{value:g}</text>')
    for at in TICKS_NM:
        if nm[0] <= at <= nm[-1]:
            x = LEFT + (at - nm[0]) / (nm[-1] - nm[0]) * WIDTH
            parts.append(f'<path class="grid" d="M{x:.1f} {TOP}V{foot}"/><text x="{x:.1f}" '
                         f'y="{foot + 13}" text-anchor="middle">{at}</text>')
    if summary is not None:
        around = f"{points(nm, summary.lower)} {points(nm[::-1], summary.upper[::-1])}"
        parts.append(f'<polygon class="band" points="{around}"/>')
    parts.append(f'<polyline class="mean" points="{points(nm, mean)}"/>')
    if truth is not None:
        inside = (truth.grid.nm >= nm[0]) & (truth.grid.nm <= nm[-1]) & np.isfinite(truth.values)
        drawn = points(truth.grid.nm[inside], truth.values[inside])
        parts.append(f'<polyline class="truth" points="{drawn}"/>')
    name = f"Reflectance of {surface.name} over wavelength in nm"
    return Markup('<svg class="small" role="img" aria-label="{}" viewBox="0 0 {} {}">{}</svg>'
                  ).format(name, LEFT + WIDTH + 12, foot + 17, Markup("".join(parts)))
