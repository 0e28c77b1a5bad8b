"""Two spectra that the photo cannot tell apart, as numbers and as a drawing."""
from __future__ import annotations

from typing import Any

from markupsafe import Markup

from spectrabox.measure.surfaces.metamers import LIGHTS, MetamerPair
from spectrabox.session.report.svg import figure

WIDTH, HEIGHT = 300, 90         # of the drawing, in its own unit
COLOURS = ("#1f4e8c", "#b3261e")


def metamer_facts(pair: MetamerPair) -> dict[str, Any]:
    """The pair as numbers for the page's data."""
    return {"nm": pair.grid.nm, "spectra": pair.spectra, "apart_nm": pair.apart_nm,
            "delta_e00": dict(zip(LIGHTS, pair.delta_e00.tolist(), strict=True))}


@figure("spectra that look alike")
def metamer_drawing(pair: MetamerPair) -> Markup:
    """Both spectra as a small drawing: 0 to 1 upwards, the wavelengths of their grid across."""
    nm = pair.grid.nm
    across = (nm - nm[0]) / (nm[-1] - nm[0]) * WIDTH
    lines = "".join(
        f'<polyline fill="none" stroke="{colour}" stroke-width="1.6" points="'
        + " ".join(f"{x:.1f},{HEIGHT * (1 - y):.1f}" for x, y in zip(across, values, strict=True))
        + '"/>' for colour, values in zip(COLOURS, pair.spectra, strict=True))
    apart = (pair.apart_nm - nm[0]) / (nm[-1] - nm[0]) * WIDTH
    label = (f"Two spectra between {nm[0]:.0f} and {nm[-1]:.0f} nm that give one signal, furthest "
             f"apart at {pair.apart_nm:.0f} nm")
    return Markup(f'<svg class="metamers" role="img" aria-label="{label}" viewBox="-1 -1 '
                  f'{WIDTH + 2} {HEIGHT + 2}"><rect width="{WIDTH}" height="{HEIGHT}" fill="none" '
                  f'stroke="#8a8a85" stroke-width=".6"/><line x1="{apart:.1f}" x2="{apart:.1f}" '
                  f'y1="0" y2="{HEIGHT}" stroke="#8a8a85" stroke-width=".8" '
                  f'stroke-dasharray="3 2"/>{lines}</svg>')
