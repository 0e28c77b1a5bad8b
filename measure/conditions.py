"""What a result rests on: every condition measured, stated or assumed, with what its failing costs.

The one place where conditions are made: findings of the section CONDITIONS of ``measure.texts``.
Verdict, report, page, JSON and text read this list.
"""
from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from spectrabox.calibrate.chart_findings import edition_told, evidence_since
from spectrabox.measure import captured, tables, texts, words
from spectrabox.measure.results.facts import Fact, columns, known_facts
from spectrabox.radiometry import appearance, error_model, gloss
from spectrabox.radiometry.chart import COPIES_SINCE_2014, Chart
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records.photos import PatchSamples

if TYPE_CHECKING:
    from spectrabox.measure.results import capture_result, flat_result, scene_result
    from spectrabox.measure.results.surface_result import SurfaceResult

# causes of errors that a condition answers for
BETWEEN_PHOTOS = (error_model.REPEATABILITY, error_model.ROUNDED_EXPOSURES)
LIGHT_CAUSES = (error_model.WHITE, error_model.LIGHT_FIELD, error_model.LIGHT_SCALE,
                *BETWEEN_PHOTOS)
PLACE_CAUSES = (error_model.SCENE_LEVEL, error_model.LAMP_AT_CHART)
CAMERA_CAUSES = (error_model.SENSITIVITIES, error_model.LIGHT_SPECTRUM, error_model.FILTER)
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
INSTRUMENT_ERROR = 0.01     # relative, of a reflectance that somebody measured: more is a statement
# how a condition is known
MEASURED, STATED, ASSUMED = "measured", "stated", "assumed"
LIGHTNESS, B_STAR = 0, 2    # of L*a*b*
SURE = 2.5                  # standard errors of a fault that a moved lamp would show
TYPED = "known-typed"       # how the light is known by a card whose reflectance nobody measured


CONDITION_FACTS: tuple[Fact[Finding], ...] = (
    Fact("code", "of the condition", lambda one: one.code),
    Fact("name", "what it is called", texts.name, "condition"),
    Fact("standing", "measured, stated or assumed", lambda one: one.values["standing"], "is"),
    Fact("error", "standard error that the bands allow for, a share",
         lambda one: one.values["error"], "error allowed", words.percent),
    Fact("known_by", "how it is known", texts.sentence, "known by"),
    Fact("holds", "how a verdict names it after “if”", lambda one: texts.holds(one) or None),
    Fact("named", "whether the verdict names it", lambda one: one.values["named"]),
    Fact("fault", "a fault as it happens", lambda one: texts.fault(one) or None),
    Fact("lightness", "by how much that fault changes L* of the surface that it changes most",
         lambda one: one.values["lightness"]),
    Fact("b_star", "the same of b*, of a fault that changes the colour",
         lambda one: one.values["b_star"]),
    Fact("variance_share", "of the spectra's variance that the error allowed makes, mean over "
         "surfaces", lambda one: one.values["variance_share"]),
    Fact("cost", "both in words", lambda one: texts.shown(one) or None, "if it fails"),
    Fact("to_measure", "what would measure it; missing of what is measured",
         lambda one: None if one.values["standing"] == MEASURED else texts.remedy(one) or None))


def condition(code: str, standing: str, known_by: str, *, error: float | None = None,
              fault: str = "", fault_size: float | None = None, lightness: float | None = None,
              b_star: float | None = None, variance_share: float | None = None,
              **more: Any) -> Finding:
    """Something that a result rests on.

    Parameters
    ----------
    code : str
        Of ``texts.CONDITIONS``.
    standing : str
        ``MEASURED``, ``STATED`` or ``ASSUMED``.
    known_by : str
        How it is known, of ``texts.KNOWN_BY``.
    error : float, optional
        Standard, that the bands allow for, as a share; None: none.
    fault, fault_size : str, float
        A fault as it happens, of ``texts.FAULTS``.
    lightness, b_star : float, optional
        By how much that changes L* or b* of the surface that it changes most; None: not computed.
    variance_share : float, optional
        Of the spectra's variance, by the error allowed.
    **more
        Of the way in which it is known.
    """
    seen = max((abs(each) for each in (lightness, b_star) if each is not None), default=0.0)
    return Finding(code, Severity.INFO, values={
        "standing": standing, "known_by": known_by, "error": error, "fault": fault,
        "fault_size": fault_size, "lightness": lightness, "b_star": b_star,
        "variance_share": variance_share,
        "named": (standing == ASSUMED or known_by == TYPED) and seen >= NAMED_CHANGE, **more})


def named(conditions: Sequence[Finding]) -> tuple[Finding, ...]:
    """Those that a verdict names after its "if": assumed, or typed of a white card, and their
    failing would be seen.
    """
    return tuple(one for one in conditions if one.values["named"])


def facts(one: Finding) -> dict[str, Any]:
    """For JSON: `CONDITION_FACTS` that are known of a condition."""
    return known_facts(CONDITION_FACTS, one)


def flat_conditions(result: flat_result.FlatResult) -> tuple[Finding, ...]:
    """Conditions of flat samples."""
    return (_flat_light(result), _gloss(result, "condition.gloss"), _plane(result), _shadow(result),
            _fluorescence(result), _linearity(result), *_chart_copy(result), _camera(result))


def scene_conditions(result: scene_result.SceneResult) -> tuple[Finding, ...]:
    """Conditions of scenes, in which plane and shadow are the geometry's."""
    return (_scene_light(result), _light_place(result), _geometry(result),
            _gloss(result, "condition.scene-gloss"), _fluorescence(result),
            _linearity(result), *_chart_copy(result), _camera(result))


def conditions_text(conditions: Sequence[Finding], title: str = "") -> str:
    """A row for each, for a person.

    Parameters
    ----------
    conditions : sequence of Finding
    title : str
        Of the table.
    """
    headings, cells = columns(CONDITION_FACTS, conditions)
    return tables.text_table(headings, cells, text=headings, title=title)


# ---- the conditions ------------------------------------------------------------------------------

def _flat_light(result: flat_result.FlatResult) -> Finding:
    cards, every = _cards(result)
    between = not result.stated.chart_in_photo
    common: dict[str, Any] = {"error": allowed_error(result.surfaces, LIGHT_CAUSES),
                              "variance_share": allowed_share(result.surfaces, LIGHT_CAUSES),
                              "names": cards}
    if between and not (cards and every):
        return condition("condition.light", ASSUMED, "chart-apart", fault="dimmer",
                         fault_size=DIMMER_FAULT,
                         lightness=darker_by(result.surfaces, DIMMER_FAULT), **common)
    changes = [darker_by([surface], 2 * (error_by(surface, LIGHT_CAUSES) or 0.0))
               for surface in result.surfaces]
    if cards and every:
        standing = _by_cards(result)
        known_by = "known-regions" if standing is MEASURED else TYPED
    else:
        standing, known_by = MEASURED, (
            "flat-field" if result.stated.flat_fields else "chart-carried-on")
    return condition(
        "condition.light", standing, known_by, fault="dimmer-by-error",
        lightness=max((each for each in changes if each is not None), key=abs, default=None),
        **common)


def _cards(result: flat_result.FlatResult) -> tuple[list[str], bool]:
    """Known regions, and whether every photo of samples shows one."""
    return (list(dict.fromkeys(name for photo in result.photos for name in photo.level_misfits)),
            all(photo.level_misfits for photo in result.photos if photo.light))


def _by_cards(result: flat_result.FlatResult) -> str:
    """Standing of what known regions tell: that of their own reflectances."""
    worst = max(result.stated.known_errors.values(), default=0.0)
    return MEASURED if worst <= INSTRUMENT_ERROR else STATED


def _by_moved_lamp(result: capture_result.CaptureResult, fault: float,
                   error_in_place: str) -> tuple[str, str, float | None]:
    """Whether photos with the lamp moved would show a fault, as their errors of every sample say:
    standing, how it is known, and the error of the worst sample in its worst place.

    A shadow of 10 % in one of two photos raises that error from .03 to .05, though it is not named.
    """
    errors = [max((place[error_in_place] for place in surface.places), default=np.inf)
              for surface in result.surfaces if not surface.known]
    error = max(errors, default=np.inf) if result.stated.lamp_moved else np.inf
    if not np.isfinite(error):
        return ASSUMED, "no-photo", None
    return MEASURED if SURE * error <= fault else ASSUMED, "lamp-moved", error


def _plane(result: flat_result.FlatResult) -> Finding:
    standing, known_by, error = _by_moved_lamp(result, DARKER_FAULT, "level_error")
    if standing is ASSUMED and _cards(result)[1]:
        standing, known_by = _by_cards(result), "known-beside"
    if error is None:
        error = allowed_error(result.surfaces, (error_model.SAMPLE_PLANE,))
    return condition("condition.plane", standing, known_by, error=error, fault="dimmer",
                     fault_size=DARKER_FAULT, lightness=darker_by(result.surfaces, DARKER_FAULT),
                     variance_share=allowed_share(result.surfaces, (error_model.SAMPLE_PLANE,)))


def _gloss(result: capture_result.CaptureResult, code: str) -> Finding:
    words, surfaces = _surface_words(result.stated), result.surfaces
    standing, known_by, error = _by_moved_lamp(result, GLOSS_FAULT, "gloss_error")
    if standing is ASSUMED and words:
        standing, known_by = STATED, "surfaces-stated"
    elif error is None:
        # what is assumed is what the estimate is of: the band reaches to what gloss makes of it
        known_by = "taken-as-matt"
    return condition(
        code, standing, known_by, error=_mirrored(surfaces) if error is None else error,
        fault="mirrored",
        fault_size=GLOSS_FAULT,
        lightness=largest_change(surfaces, lambda nm, mean: mean + GLOSS_FAULT),
        variance_share=allowed_share(surfaces, (error_model.SURFACE_REFLECTION,)),
        names=words, usual=float(gloss.USUAL[gloss.SURFACE_WORDS[0]]))


def _surface_words(stated: captured.Capture) -> list[str]:
    """matt, satin, glossy; none unless one of them is stated of every surface."""
    words = {surface.surface for surface in stated.surfaces.values()
             if surface.known is None and surface.surface is not None}
    return sorted(words) if stated.surfaces_stated else []


def _shadow(result: flat_result.FlatResult) -> Finding:
    standing, known_by, error = _by_moved_lamp(result, DARKER_FAULT, "level_error")
    return condition("condition.shadow", standing, known_by, error=error, fault="dimmer",
                     fault_size=DARKER_FAULT, lightness=darker_by(result.surfaces, DARKER_FAULT))


def _fluorescence(result: capture_result.CaptureResult) -> Finding:
    """Brighteners and other emission, which no photo tells from reflectance.

    Exciting light is absorbed on its way in as emitted light is on its way out, so that little
    comes of what is dark there.
    """
    return condition("condition.fluorescence", ASSUMED, "no-photo", fault="emitted",
                     fault_size=EMITTED_FAULT, fault_nm=EMITTED_NM,
                     b_star=largest_change(result.surfaces, emitted, B_STAR))


def _linearity(result: capture_result.CaptureResult) -> Finding:
    fit, chart = result.chart, result.measured_chart
    greys = None if fit is None or chart is None else exponent_of_greys(
        chart.samples, fit.predicted, result.layout)
    bracket = any(len(files) > 1 for view in result.stated.views for files in view.photo.values())
    ways = [way for held, way in ((greys is not None, "greys"), (bracket, "exposures"),
                                  (result.stated.dark_frames, "dark-frames")) if held]
    exponent, spread = greys or (None, None)
    error = None if exponent is None or spread is None else max(spread, abs(exponent - 1))
    measured = bool(ways) and not result.processed
    fault = BENT_FAULT if error is None else 2 * error
    return condition(
        "condition.linearity", MEASURED if measured else ASSUMED,
        "tone-curve" if result.processed else "exponent" if ways else "nothing", error=error,
        fault="bent", fault_size=fault, lightness=largest_change(
            result.surfaces, lambda nm, mean: np.maximum(mean, 0) ** (1 + fault)),
        ways=ways, exponent=exponent, exponent_error=spread)


def _chart_copy(result: capture_result.CaptureResult) -> tuple[Finding, ...]:
    """Whether the chart is as its reference says; nothing without a chart."""
    if result.chart is None:
        return ()
    copy, error = result.chart.copy, None
    more: dict[str, Any] = {}
    if result.stated.chart is not None and result.stated.chart.measured:
        standing, known_by = MEASURED, "own-reflectances"
    elif copy is not None:
        lightest = int(copy.reflectances.mean(axis=1).argmax())
        nats = evidence_since(copy)
        standing, known_by, error = MEASURED, "copies", float(copy.level_error[lightest])
        more = {"edition": copy.edition, "white": float(copy.level[lightest]), "nats": nats,
                "told": edition_told(copy), "as_told": nats is not None and (nats > 0) == (
                    copy.edition == COPIES_SINCE_2014)}
    elif result.stated.chart_stated:
        standing, known_by = STATED, "reference"
    else:
        standing, known_by = ASSUMED, "published"
    return (condition("condition.chart", standing, known_by, error=error, fault="other-copy",
                      fault_size=COPY_FAULT, lightness=darker_by(result.surfaces, COPY_FAULT),
                      **more),)


def _camera(result: capture_result.CaptureResult) -> Finding:
    sensitivity = result.stated.sensitivity
    source = "" if sensitivity.curves is None else sensitivity.source
    standing, known_by = (STATED, "curves") if source else \
        (STATED, "curves-of-file") if result.chart is None else (MEASURED, "fitted")
    return condition("condition.camera", standing, known_by,
                     error=allowed_error(result.surfaces, CAMERA_CAUSES),
                     variance_share=allowed_share(result.surfaces, CAMERA_CAUSES),
                     source=source)


def _scene_light(result: scene_result.SceneResult) -> Finding:
    causes = (*BETWEEN_PHOTOS, error_model.KNOWN_SURFACES, error_model.LEVEL_BY_PRIOR)
    standing, known_by = ASSUMED, "stated-errors"
    if result.level_error is not None:
        return condition("condition.scene-light", MEASURED, "expected-surfaces",
                         error=_common_error(result, causes),
                         variance_share=allowed_share(result.surfaces, causes))
    if _tied_to_known(result) or not result.stated.scale_from_chart:
        standing, known_by = MEASURED, "known-materials"
    elif result.stated.chart_in_photo:
        standing, known_by = MEASURED, "chart-in-photo"
    return condition("condition.scene-light", standing, known_by,
                     error=_common_error(result, causes), fault="dimmer", fault_size=DIMMER_FAULT,
                     lightness=darker_by(result.surfaces, DIMMER_FAULT),
                     variance_share=allowed_share(result.surfaces, causes),
                     names=_known_materials(result))


def _light_place(result: scene_result.SceneResult) -> Finding:
    if result.level_error is not None:       # no chart, whose light would be that of another place
        return condition("condition.light-place", STATED, "scene")
    tied = _tied_to_known(result) or not result.stated.scale_from_chart
    return condition("condition.light-place", MEASURED if tied else ASSUMED,
                     "known-materials" if tied else "as-stated",
                     error=_common_error(result, PLACE_CAUSES), fault="dimmer",
                     fault_size=DIMMER_FAULT, lightness=darker_by(result.surfaces, DIMMER_FAULT),
                     variance_share=allowed_share(result.surfaces, PLACE_CAUSES),
                     names=_known_materials(result))


def _geometry(result: scene_result.SceneResult) -> Finding:
    if not result.placements:
        return condition("condition.geometry", STATED, "scene")
    return condition("condition.geometry", MEASURED, "estimated",
                     names=[placement.what for placement in result.placements])


def _tied_to_known(result: scene_result.SceneResult) -> bool:
    """Whether surfaces of known spectrum in every photo tie its light."""
    return all(made.known_light is not None for made in
               (result.reconstruction, *(view for _, view in result.views.values())))


def _known_materials(result: scene_result.SceneResult) -> list[str]:
    return [surface.name for surface in result.surfaces if surface.known]


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
    return float(sum(surface.causes.get(cause, 0.0) for cause in causes))


def allowed_share(surfaces: Sequence[SurfaceResult], causes: Sequence[str]) -> float | None:
    """Share of the variance of the spectra by these causes, mean over surfaces; None without any.
    """
    shares = [share_by(surface, causes) for surface in surfaces
              if any(cause in surface.causes for cause in causes)]
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
    changes = [float(appearance.reflectance_to_lab(surface.nm, faulty(surface.nm, surface.mean))[of]
                     - surface.lab().value[of]) for surface in surfaces if not surface.known]
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
    shares = [float(np.max(surface.error_budget[error_model.SURFACE_REFLECTION]
                           * surface.signal[np.isfinite(surface.signal)]))
              for surface in surfaces if error_model.SURFACE_REFLECTION in surface.error_budget
              and np.isfinite(surface.signal).any()]
    return max(shares, default=None)


def _common_error(result: scene_result.SceneResult, causes: Sequence[str]) -> float | None:
    """Standard error of the light scale by these causes, in the photo where it is largest."""
    scales = [result.light_scale, *(made.light_scale for _, made in result.views.values())]
    errors = [float(np.hypot.reduce([0.0, *(error for cause, error in scale.common_errors.items()
                                            if cause in causes)])) for scale in scales]
    return max(errors) or None


def exponent_of_greys(samples: PatchSamples, predicted: np.ndarray,
                      layout: Chart) -> tuple[float, float] | None:
    """The power of the light that the signals of a chart's grey patches follow, and its standard
    error; None with too few of them.

    Their logarithms are fitted by a line against those that the calibration predicts, with a level
    of its own in every band. 1 is linear.

    Parameters
    ----------
    samples : PatchSamples
    predicted : (I, K) array
        Their signals by the calibration.
    layout : Chart
        Of them.
    """
    greys = [patch for patch in layout.neutrals if not samples.clipped[patch].any()]
    if len(greys) < FEWEST_GREYS:
        return None
    measured, predicted = samples.mean[greys], predicted[greys]
    if not (np.isfinite(measured) & (measured > 0) & (predicted > 0)).all():
        return None
    x, y = np.log(predicted), np.log(measured)
    x, y = x - x.mean(axis=0), y - y.mean(axis=0)
    exponent = float((x * y).sum() / (x * x).sum())
    # patches err in all bands alike: they count, and not the bands
    scatter = ((y - exponent * x).mean(axis=1) ** 2).sum() / (len(greys) - 2)
    return exponent, float(np.sqrt(scatter / (x.mean(axis=1) ** 2).sum()))
