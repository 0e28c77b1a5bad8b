"""What a result rests on: every condition measured, stated or assumed, with what its failing costs.

The one place where conditions are made. Verdict, report, page, JSON and text read this list.
"""
from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any

import numpy as np

from spectrabox.calibrate.chart_findings import edition_told, evidence_since
from spectrabox.measure.captured import Capture
from spectrabox.measure.results.facts import Fact, columns, known_facts
from spectrabox.measure.tables import text_table
from spectrabox.measure.words import listed, percent
from spectrabox.radiometry.appearance import reflectance_to_lab
from spectrabox.radiometry.error_model import (
    FILTER,
    KNOWN_SURFACES,
    LAMP_AT_CHART,
    LIGHT_FIELD,
    LIGHT_SCALE,
    LIGHT_SPECTRUM,
    REPEATABILITY,
    ROUNDED_EXPOSURES,
    SAMPLE_PLANE,
    SCENE_LEVEL,
    SENSITIVITIES,
    SURFACE_REFLECTION,
    WHITE,
)
from spectrabox.radiometry.gloss import SURFACE_WORDS, USUAL
from spectrabox.radiometry.records.calibration import ChartCopy

if TYPE_CHECKING:
    from spectrabox.measure.results.capture_result import CaptureResult, ChartResult
    from spectrabox.measure.results.flat_result import FlatResult
    from spectrabox.measure.results.scene_result import SceneResult
    from spectrabox.measure.results.surface_result import SurfaceResult

# causes of errors that a condition answers for
BETWEEN_PHOTOS = (REPEATABILITY, ROUNDED_EXPOSURES)
LIGHT_CAUSES = (WHITE, LIGHT_FIELD, LIGHT_SCALE, *BETWEEN_PHOTOS)
PLACE_CAUSES = (SCENE_LEVEL, LAMP_AT_CHART)
CAMERA_CAUSES = (SENSITIVITIES, LIGHT_SPECTRUM, FILTER)
# Faults as they happen, by which the cost of a condition is computed.
GLOSS_FAULT = 0.03          # of the light, mirrored by a glossy surface
DARKER_FAULT = 0.10         # of the light: soft shadow, a sample some centimetres nearer, a tilt
DIMMER_FAULT = 0.05         # of the light: a lamp that warms up, clouds, a place off by 2 cm
COPY_FAULT = 0.03           # of the level: one measured copy of a ColorChecker against another
BENT_FAULT = 0.02           # of the exponent of the light: an error of the black level
# of white at 440 nm, emitted by a brightener of paper or textiles where they have any UV to absorb
EMITTED_FAULT, EMITTED_NM, EMITTED_WIDTH_NM = 0.15, 440.0, 28.0
NAMED_CHANGE = 1.0          # of L* or b* beyond which a verdict names a condition: it can be seen
FEWEST_GREYS = 4            # patches by which linearity is measured
MOVED_LAMP = "one more photo with the lamp moved"
LIGHTNESS, B_STAR = 0, 2    # of L*a*b*


class Standing(Enum):
    """How a condition is known; the value is the word."""

    MEASURED = "measured"
    STATED = "stated"
    ASSUMED = "assumed"


@dataclass(frozen=True)
class Condition:
    """Something that a result rests on."""

    name: str
    standing: Standing
    error: float | None         # standard, that the bands allow for, as a share; None: none
    known_by: str               # how it is known, in a short phrase
    holds: str = ""             # how a verdict names it after "if"; empty of what it never names
    fault: str = ""             # a fault as it happens
    # by how much that changes L* of the surface that it changes most; None: not computed
    lightness: float | None = None
    variance_share: float | None = None     # of the spectra's variance by the error allowed
    to_measure: str = ""        # what would measure it, in a phrase; empty where nothing is needed
    b_star: float | None = None     # as ``lightness`` of b*, of a fault that changes the colour

    @property
    def named(self) -> bool:
        """Whether a verdict names it: assumed, and its failing would be seen."""
        changes = [abs(each) for each in (self.lightness, self.b_star) if each is not None]
        return self.standing is Standing.ASSUMED and max(changes, default=0.0) >= NAMED_CHANGE

    @property
    def cost(self) -> str:
        """What the answer loses if it fails, in a phrase."""
        parts = []
        if self.lightness is not None:
            parts.append(f"{self.fault}: L* {self.lightness:+.1f}".replace("-", "−"))
        if self.b_star is not None:
            parts.append(f"{self.fault}: b* {self.b_star:+.1f}".replace("-", "−"))
        if self.variance_share is not None:
            parts.append(f"{percent(self.variance_share, 0)} of the variance")
        return "; ".join(parts)

    @property
    def facts(self) -> dict[str, Any]:
        """For JSON: `CONDITION_FACTS` that are known of it."""
        return known_facts(CONDITION_FACTS, self)


CONDITION_FACTS: tuple[Fact[Condition], ...] = (
    Fact("name", "of the condition", lambda one: one.name, "condition"),
    Fact("standing", "measured, stated or assumed", lambda one: one.standing.value, "is"),
    Fact("error", "standard error that the bands allow for, a share", lambda one: one.error,
         "error allowed", percent),
    Fact("known_by", "how it is known", lambda one: one.known_by, "known by"),
    Fact("holds", "how a verdict names it after “if”", lambda one: one.holds or None),
    Fact("named", "whether the verdict names it", lambda one: one.named),
    Fact("fault", "a fault as it happens", lambda one: one.fault or None),
    Fact("lightness", "by how much that fault changes L* of the surface that it changes most",
         lambda one: one.lightness),
    Fact("b_star", "the same of b*, of a fault that changes the colour", lambda one: one.b_star),
    Fact("variance_share", "of the spectra's variance that the error allowed makes, mean over "
         "surfaces", lambda one: one.variance_share),
    Fact("cost", "both in words", lambda one: one.cost or None, "if it fails"),
    Fact("to_measure", "what would measure it; missing of what is measured",
         lambda one: None if one.standing is Standing.MEASURED else one.to_measure or None))


@dataclass(frozen=True)
class Statements:
    """What of the conditions a capture states, or measures by the photos that it has."""

    surfaces: tuple[str, ...] = ()      # matt, satin, glossy; none unless stated of every surface
    chart_stated: bool = True           # somebody said which reflectances the chart has
    chart_measured: bool = False        # they are those of this very copy
    curves: str = ""                    # where measured curves of the camera come from
    chart_in_photo: bool = False        # every photo shows its chart
    lamp_moved: bool = False            # a further photo shows them with the lamp moved
    dark_frames: bool = False
    bracket: bool = False               # of several exposures


def statements_of(capture: Capture) -> Statements:
    """What a capture states of its conditions.

    Parameters
    ----------
    capture : Capture
    """
    words = {surface.surface for surface in capture.surfaces.values()
             if surface.given is None and surface.surface is not None}
    views = capture.views
    return Statements(
        surfaces=tuple(sorted(words)) if capture.surfaces_stated else (),
        chart_stated=capture.chart is None or capture.chart.stated,
        chart_measured=capture.chart is not None and capture.chart.measured,
        curves="" if capture.sensitivity.curves is None else capture.sensitivity.source,
        chart_in_photo=all(view.shows_chart for view in views),
        lamp_moved=capture.lamp_moved, dark_frames=bool(capture.development.dark_frames),
        bracket=any(len(files) > 1 for view in views for files in view.photo.values()))


def flat_conditions(found: FlatResult) -> tuple[Condition, ...]:
    """Conditions of flat samples."""
    return (_flat_light(found), _gloss(found, "matt"), _plane(found), _shadow(found),
            _fluorescence(found), _linearity(found), *_chart_copy(found), _camera(found))


def scene_conditions(found: SceneResult) -> tuple[Condition, ...]:
    """Conditions of scenes, in which plane and shadow are the geometry's."""
    return (_scene_light(found), _light_place(found), _geometry(found),
            _gloss(found, "the surfaces are as matt as the scene says"), _fluorescence(found),
            _linearity(found), *_chart_copy(found), _camera(found))


def condition_words(conditions: Sequence[Condition]) -> str:
    """The named ones, as the end of "PASS if ..."; empty where there is none."""
    named = [condition.holds for condition in conditions if condition.named]
    return listed(named) if named else ""


def conditions_text(conditions: Sequence[Condition], title: str = "") -> str:
    """A row for each, for a person.

    Parameters
    ----------
    conditions : sequence of Condition
    title : str
        Of the table.
    """
    headings, cells = columns(CONDITION_FACTS, conditions)
    return text_table(headings, cells, text=headings, title=title)


# ---- the conditions ------------------------------------------------------------------------------

def _flat_light(found: FlatResult) -> Condition:
    cards = list(dict.fromkeys(name for photo in found.photos for name in photo.level_misfits))
    every = all(photo.level_misfits for photo in found.photos if photo.light)
    between = not found.stated.chart_in_photo
    if cards and every:
        standing, known_by = Standing.MEASURED, f"known regions: {listed(cards)}"
    elif between:
        standing, known_by = Standing.ASSUMED, "the chart in a photo of its own"
    elif found.by_flat_field:
        standing, known_by = Standing.MEASURED, "the chart and a flat field"
    else:
        standing, known_by = Standing.MEASURED, "the chart's patches, carried on to the regions"
    fault = f"{percent(DIMMER_FAULT)} less light"
    lightness = darker_by(found.surfaces, DIMMER_FAULT)
    if standing is Standing.MEASURED:
        fault = "less light by twice that error"
        changes = [darker_by([surface], 2 * (error_by(surface, LIGHT_CAUSES) or 0.0))
                   for surface in found.surfaces]
        lightness = max((each for each in changes if each is not None), key=abs, default=None)
    return Condition("light on the sample", standing, allowed_error(found.surfaces, LIGHT_CAUSES),
                     known_by, "lamp and shutter repeated", fault, lightness,
                     allowed_share(found.surfaces, LIGHT_CAUSES),
                     "a white card beside the samples")


def _plane(found: FlatResult) -> Condition:
    cards = all(photo.level_misfits for photo in found.photos if photo.light)
    standing, known_by = Standing.ASSUMED, "no photo shows it"
    if found.stated.lamp_moved:
        standing, known_by = Standing.MEASURED, "the photo with the lamp moved"
    elif cards:
        standing, known_by = Standing.MEASURED, "known regions beside the samples"
    return Condition("plane", standing, allowed_error(found.surfaces, (SAMPLE_PLANE,)), known_by,
                     "in the chart's plane", f"{percent(DARKER_FAULT)} less light",
                     darker_by(found.surfaces, DARKER_FAULT),
                     allowed_share(found.surfaces, (SAMPLE_PLANE,)),
                     f"a white card in the samples' plane, or {MOVED_LAMP}")


def _gloss(found: CaptureResult, holds: str) -> Condition:
    stated, surfaces = found.stated, found.surfaces
    # what is assumed is what the estimate is of: the band reaches to what gloss would make of it
    standing, known_by = Standing.ASSUMED, \
        f"nothing stated: taken as matt to {percent(USUAL[SURFACE_WORDS[0]], 0)}"
    if stated.lamp_moved:
        standing, known_by = Standing.MEASURED, "the photo with the lamp moved"
    elif stated.surfaces:
        standing, known_by = Standing.STATED, listed(list(stated.surfaces))
    return Condition("gloss", standing, _mirrored(surfaces), known_by, holds,
                     f"{percent(GLOSS_FAULT)} of the light mirrored",
                     largest_change(surfaces, lambda nm, mean: mean + GLOSS_FAULT),
                     allowed_share(surfaces, (SURFACE_REFLECTION,)), MOVED_LAMP)


def _shadow(found: FlatResult) -> Condition:
    standing, known_by = Standing.ASSUMED, "no photo shows it"
    if found.stated.lamp_moved:
        standing, known_by = Standing.MEASURED, "the photo with the lamp moved"
    return Condition("shadow", standing, None, known_by, "in no shadow",
                     f"{percent(DARKER_FAULT)} less light",
                     darker_by(found.surfaces, DARKER_FAULT), to_measure=MOVED_LAMP)


def _fluorescence(found: CaptureResult) -> Condition:
    """Brighteners and other emission, which no photo tells from reflectance.

    Exciting light is absorbed on its way in as emitted light is on its way out, so that little
    comes of what is dark there.
    """
    return Condition("fluorescence", Standing.ASSUMED, None, "no photo shows it",
                     "without brighteners",
                     f"{percent(EMITTED_FAULT)} of white emitted at {EMITTED_NM:.0f} nm",
                     b_star=largest_change(found.surfaces, emitted, B_STAR),
                     to_measure="an instrument that reads without UV")


def _linearity(found: CaptureResult) -> Condition:
    greys = None if found.chart is None else exponent_of_greys(found.chart)
    ways = [words for held, words in ((found.stated.bracket, "several exposures"),
                                      (found.stated.dark_frames, "dark frames")) if held]
    error = None
    if greys is not None:
        exponent, spread = greys
        error = max(spread, abs(exponent - 1))
        ways.insert(0, f"the chart's greys: exponent {exponent:.3f} ± {spread:.3f}")
    measured = bool(ways) and not found.processed
    known_by = "a tone curve undone as sRGB" if found.processed else \
        listed(ways) if ways else "nothing"
    fault = BENT_FAULT if error is None else 2 * error
    return Condition("linearity", Standing.MEASURED if measured else Standing.ASSUMED, error,
                     known_by, "with signals in proportion to light",
                     f"exponent off by {fault:.3f}",
                     largest_change(found.surfaces, lambda nm, mean: np.maximum(mean, 0) ** (
                         1 + fault)), to_measure="a raw photo" if found.processed
                     else "further exposures of the samples, or a chart with grey patches")


def _chart_copy(found: CaptureResult) -> tuple[Condition, ...]:
    """Whether the chart is as its reference says; nothing without a chart."""
    if found.chart is None:
        return ()
    standing, known_by, error = Standing.ASSUMED, "published reflectances, not of this copy", None
    if found.stated.chart_measured:
        standing, known_by = Standing.MEASURED, "a file of its own reflectances"
    elif found.chart.copy is not None:
        copy = found.chart.copy
        lightest = int(copy.reflectances.mean(axis=1).argmax())
        standing, error = Standing.MEASURED, float(copy.level_error[lightest])
        known_by = (f"the photo: {copy.edition}{_how_told(copy)}, white "
                    f"{copy.level[lightest]:+.0%} against its copies")
    elif found.stated.chart_stated:
        standing, known_by = Standing.STATED, "the reference stated, published, not of this copy"
    return (Condition("chart", standing, error, known_by, "with a chart like its reference",
                      f"its level off by {percent(COPY_FAULT)}",
                      darker_by(found.surfaces, COPY_FAULT),
                      to_measure="the reflectances of this very chart, from a meter"),)


def _how_told(copy: ChartCopy) -> str:
    """Whether the photo tells the edition that its chart is taken to be of, in brackets."""
    nats, told = evidence_since(copy), edition_told(copy)
    if nats is None:
        return ""
    if told is None:
        return " (as most are: the photo tells too little)"
    return f" (told by {abs(nats):.1f} nats)" if told == copy.made else \
        f" (as most are, though the photo says {told}, by {abs(nats):.1f} nats)"


def _camera(found: CaptureResult) -> Condition:
    standing, known_by = Standing.MEASURED, "fitted to the chart"
    if found.stated.curves:
        standing, known_by = Standing.STATED, found.stated.curves
    elif found.chart is None:
        standing, known_by = Standing.STATED, "curves of a file"
    return Condition("camera", standing, allowed_error(found.surfaces, CAMERA_CAUSES), known_by,
                     variance_share=allowed_share(found.surfaces, CAMERA_CAUSES))


def _scene_light(found: SceneResult) -> Condition:
    causes = (*BETWEEN_PHOTOS, KNOWN_SURFACES)
    error = _common_error(found, causes)
    standing, known_by = Standing.ASSUMED, "stated errors of lamp and shutter"
    if _tied_to_known(found) or not found.scale_from_chart:
        standing, known_by = Standing.MEASURED, _known_materials(found)
    elif found.stated.chart_in_photo:
        standing, known_by = Standing.MEASURED, "the chart in the photo itself"
    return Condition("light on the scene", standing, error, known_by, "lamp and shutter repeated",
                     f"{percent(DIMMER_FAULT)} less light",
                     darker_by(found.surfaces, DIMMER_FAULT),
                     allowed_share(found.surfaces, causes),
                     "a grey card in the photo of the scene")


def _light_place(found: SceneResult) -> Condition:
    standing, known_by = Standing.ASSUMED, "lamp and chart stand as stated"
    if _tied_to_known(found) or not found.scale_from_chart:
        standing, known_by = Standing.MEASURED, _known_materials(found)
    return Condition("light place", standing, _common_error(found, PLACE_CAUSES), known_by,
                     "lamp and chart stand as stated", f"{percent(DIMMER_FAULT)} less light",
                     darker_by(found.surfaces, DIMMER_FAULT),
                     allowed_share(found.surfaces, PLACE_CAUSES),
                     "a grey card in the photo of the scene")


def _geometry(found: SceneResult) -> Condition:
    if found.geometry is None:
        return Condition("geometry", Standing.STATED, None, "the scene's measures")
    placements = listed([placement.what for placement in found.geometry.placements])
    return Condition("geometry", Standing.MEASURED, None, f"estimated: {placements}")


def _tied_to_known(found: SceneResult) -> bool:
    """Whether surfaces of known spectrum in every photo tie its light."""
    return all(made.known_light is not None for made in
               (found.reconstruction, *(view.reconstruction for view in found.views)))


def _known_materials(found: SceneResult) -> str:
    known = [f"“{surface.name}”" for surface in found.surfaces if surface.known]
    return f"the spectrum given for {listed(known)}" if known else "a material of known spectrum"


# ---- what they cost ------------------------------------------------------------------------------

def allowed_error(surfaces: Sequence[SurfaceResult], causes: Sequence[str]) -> float | None:
    """Relative standard error of the signal by these causes, rms over bands, of the surface where
    it is largest; None where no surface has any.
    """
    errors = [each for each in (error_by(surface, causes) for surface in surfaces)
              if each is not None]
    return max(errors, default=None)


def error_by(surface: SurfaceResult, causes: Sequence[str]) -> float | None:
    """The same of one surface; None where none of these causes is in its budget."""
    parts = [surface.error_budget[cause] for cause in causes if cause in surface.error_budget]
    if not parts:
        return None
    squares = np.sum(np.square(parts), axis=0)
    shown = squares[np.isfinite(squares)]
    return float(np.sqrt(shown.mean())) if shown.size else None


def share_by(surface: SurfaceResult, causes: Sequence[str]) -> float:
    """Share of a surface's variance by these causes."""
    return float(sum(surface.variance_shares.get(cause, 0.0) for cause in causes))


def allowed_share(surfaces: Sequence[SurfaceResult], causes: Sequence[str]) -> float | None:
    """Share of the variance of the spectra by these causes, mean over surfaces; None without any.
    """
    shares = [share_by(surface, causes) for surface in surfaces
              if any(cause in surface.variance_shares for cause in causes)]
    return float(np.mean(shares)) if shares else None


def largest_change(surfaces: Sequence[SurfaceResult],
                   faulty: Callable[[np.ndarray, np.ndarray], np.ndarray],
                   of: int = LIGHTNESS) -> float | None:
    """Change of L* of the estimated surface that a fault changes most; None where all are given.

    Parameters
    ----------
    surfaces : sequence of SurfaceResult
    faulty : callable
        What the fault makes, at wavelengths (P,), of a mean reflectance (P,).
    of : int
        ``LIGHTNESS``, or ``B_STAR`` for the change of b*.
    """
    changes = [float(reflectance_to_lab(surface.nm, faulty(surface.nm, surface.mean))[of]
                     - surface.lab[of]) for surface in surfaces if not surface.known]
    return max(changes, key=abs, default=None)


def darker_by(surfaces: Sequence[SurfaceResult], share: float) -> float | None:
    """Change of L*, as `largest_change`, by so much less light."""
    return largest_change(surfaces, lambda nm, mean: max(1 - share, 0.0) * mean)


def emitted(nm: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """Radiance factor (P,) of a surface of mean reflectance (P,) with a usual brightener."""
    peak = np.exp(-0.5 * ((nm - EMITTED_NM) / EMITTED_WIDTH_NM) ** 2)
    return np.asarray(mean + EMITTED_FAULT * peak * np.maximum(mean, 0) ** 2)


def _mirrored(surfaces: Sequence[SurfaceResult]) -> float | None:
    """Standard error of the share of light that surfaces mirror, of that where it is largest."""
    # the budget is of the bands that show the surface
    shares = [float(np.max(surface.error_budget[SURFACE_REFLECTION]
                           * surface.signal[np.isfinite(surface.signal)]))
              for surface in surfaces if SURFACE_REFLECTION in surface.error_budget
              and np.isfinite(surface.signal).any()]
    return max(shares, default=None)


def _common_error(found: SceneResult, causes: Sequence[str]) -> float | None:
    """Standard error of the light scale by these causes, in the photo where it is largest."""
    scales = [found.light_scale, *(view.reconstruction.light_scale for view in found.views)]
    errors = [float(np.hypot.reduce([0.0, *(error.relative for error in scale.common_errors
                                            if error.cause in causes)])) for scale in scales]
    return max(errors) or None


def exponent_of_greys(chart: ChartResult) -> tuple[float, float] | None:
    """The power of the light that the signals of a chart's grey patches follow, and its standard
    error; None with too few of them.

    Their logarithms are fitted by a line against those that the calibration predicts, with a level
    of its own in every band. 1 is linear.

    Parameters
    ----------
    chart : ChartResult
    """
    greys = [patch for patch in chart.layout.neutrals if not chart.samples.clipped[patch].any()]
    if len(greys) < FEWEST_GREYS:
        return None
    measured, predicted = chart.samples.mean[greys], chart.predicted[greys]
    if not (np.isfinite(measured) & (measured > 0) & (predicted > 0)).all():
        return None
    x, y = np.log(predicted), np.log(measured)
    x, y = x - x.mean(axis=0), y - y.mean(axis=0)
    exponent = float((x * y).sum() / (x * x).sum())
    # patches err in all bands alike: they count, and not the bands
    scatter = ((y - exponent * x).mean(axis=1) ** 2).sum() / (len(greys) - 2)
    return exponent, float(np.sqrt(scatter / (x.mean(axis=1) ** 2).sum()))
