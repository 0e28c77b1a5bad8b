"""Two spectra that the photo cannot tell apart, as numbers and as a drawing."""


from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from spectrabox.measure import texts
from spectrabox.measure.advice.advice import Advice, Advised
from spectrabox.measure.results.surface_result import SurfaceResult
from spectrabox.measure.surfaces.colour_comparison import LIGHTS, apart_nm, under_lights
from spectrabox.radiometry.findings import Finding
from spectrabox.radiometry.records.spectra import SpectrumSamples
from spectrabox.sampling.prior import family_coverage
from spectrabox.session.report import figures, spectra, svg

WIDTH, HEIGHT = 300, 90         # of the drawing, in its own unit
COLOURS = ("#1f4e8c", "#b3261e")


def metamer_facts(pair: SpectrumSamples) -> dict[str, Any]:
    """The pair as numbers for the page's data."""
    _, differences = under_lights(pair)
    return {"nm": pair.grid.nm, "spectra": pair.spectra, "apart_nm": apart_nm(pair),
            "delta_e00": dict(zip(LIGHTS, differences.tolist(), strict=True))}


@svg.figure("spectra that look alike")
def metamer_drawing(pair: SpectrumSamples) -> Markup:
    """Both spectra as a small drawing: 0 to 1 upwards, the wavelengths of their grid across."""
    nm, widest = pair.grid.nm, apart_nm(pair)
    across = (nm - nm[0]) / (nm[-1] - nm[0]) * WIDTH
    lines = "".join(
        f'<polyline fill="none" stroke="{colour}" stroke-width="1.6" points="'
        + " ".join(f"{x:.1f},{HEIGHT * (1 - y):.1f}" for x, y in zip(across, values, strict=True))
        + '"/>' for colour, values in zip(COLOURS, pair.spectra, strict=True))
    apart = (widest - nm[0]) / (nm[-1] - nm[0]) * WIDTH
    label = (f"Two spectra between {nm[0]:.0f} and {nm[-1]:.0f} nm that give one signal, furthest "
             f"apart at {widest:.0f} nm")
    return Markup(f'<svg class="metamers" role="img" aria-label="{label}" viewBox="-1 -1 '
                  f'{WIDTH + 2} {HEIGHT + 2}"><rect width="{WIDTH}" height="{HEIGHT}" fill="none" '
                  f'stroke="#8a8a85" stroke-width=".6"/><line x1="{apart:.1f}" x2="{apart:.1f}" '
                  f'y1="0" y2="{HEIGHT}" stroke="#8a8a85" stroke-width=".8" '
                  f'stroke-dasharray="3 2"/>{lines}</svg>')


# ---- one card a surface --------------------------------------------------------------------------

MAX_CAUSES, SMALL_SHARE = 3, 0.01     # of the spectrum's variance, named on a card


@dataclass(frozen=True, eq=False)
class Card:
    """What the report shows of one surface."""

    id: str                         # on the page
    index: int                      # among the surfaces of the page's numbers
    surface: SurfaceResult
    doubts: tuple[str, ...]         # in few words; empty where nothing speaks against the estimate
    figure: Markup
    budget: Markup | None
    metamers: Markup | None         # two spectra that the photo cannot tell apart
    columns: tuple[str, ...]
    rows: list[list[float]]         # every 10 nm: the wavelength, then the columns
    advice: tuple[Advice, ...]      # what to do next, the best first
    assumes: tuple[Finding, ...]    # what its band rests on, and not those of all surfaces

    @property
    def css(self) -> str:
        """The colour as CSS writes it."""
        return spectra.css_colour(self.surface.srgb)

    @property
    def hex(self) -> str:
        """The colour as web pages write it."""
        return spectra.hex_colour(self.surface.srgb)

    @property
    def lights_on_metamers(self) -> list[tuple[str, str, str, float]]:
        """Of each light its name, the colours of both metamers as CSS writes them, and their
        CIEDE2000.
        """
        pair = self.surface.metamers
        assert pair is not None
        return [(name, spectra.css_colour(one), spectra.css_colour(other), float(difference))
                for name, (one, other), difference
                in zip(LIGHTS, *under_lights(pair), strict=True)]

    @property
    def largest_causes(self) -> list[tuple[str, float]]:
        """Causes of the spectrum's variance with their shares."""
        causes = sorted(self.surface.causes.items(), key=lambda cause: -cause[1])
        return [cause for cause in causes[:MAX_CAUSES] if cause[1] >= SMALL_SHARE]


def answer_cards(surfaces: Sequence[SurfaceResult], doubts: Mapping[str, tuple[str, ...]],
                 advised: Advised) -> list[Card]:
    """A card for each surface, those whose spectrum was given last.

    Parameters
    ----------
    surfaces : sequence of SurfaceResult
    doubts : mapping
        From the name of a surface to the criteria that it does not pass.
    advised : Advised
        What to do next of each.
    """
    common = assumed_of_all(surfaces)
    ordered = sorted(enumerate(surfaces), key=lambda each: each[1].known)
    return [_card(number, index, surface, doubts.get(surface.name, ()), common,
                  advised.by_surface.get(surface.name, ()))
            for number, (index, surface) in enumerate(ordered, start=1)]


def _card(number: int, index: int, surface: SurfaceResult, doubts: tuple[str, ...],
          common: Sequence[Finding], advice: tuple[Advice, ...]) -> Card:
    curves, pair = spectra.surface_curves(surface), surface.metamers
    of_draws = () if surface.samples is None else surface.samples.findings  # where it is doubtful
    return Card(
        f"material-{number}", index, surface, doubts,
        spectra.spectrum_figure(f"spectrum-{number}", surface),
        figures.error_budget_bars(f"budget-{number}", surface),
        None if pair is None else metamer_drawing(pair), tuple(curves),
        spectra.every_10_nm(surface.nm, curves), advice,
        tuple(one for one in _assumptions(surface) if one not in common and one not in of_draws))


def assumed_of_all(surfaces: Sequence[SurfaceResult]) -> list[Finding]:
    """What the bands of all estimated surfaces rest on."""
    of_each = [_assumptions(surface) for surface in surfaces if not surface.known]
    return [one for one in of_each[0] if all(one in others for others in of_each[1:])] \
        if of_each else []


def tested_families(surfaces: Sequence[SurfaceResult]) -> str:
    """What 95 % bands held of all families that any surface may be of."""
    return texts.paragraph(family_coverage.certified([
        family for surface in surfaces for family in surface.families]))


def _assumptions(surface: SurfaceResult) -> tuple[Finding, ...]:
    return () if surface.summary is None else surface.summary.conditional_on
