"""Is this session good? Each criterion with value, limit and sentence, and the verdict over all."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from spectrabox.measure.chart_check import poor_patches
from spectrabox.measure.white import FAR, LEVEL_DOUBTED
from spectrabox.radiometry.error_model import LAMP_AT_CHART, REPEATABILITY, SCENE_LEVEL
from spectrabox.radiometry.records import (
    Calibration,
    CalibrationDoubt,
    HeldOutPatches,
    Outcome,
    Reconstruction,
    SurfaceAgreement,
)
from spectrabox.radiometry.spectra.spectrum_files import spectrum_on_grid
from spectrabox.session.outputs.calibration_facts import left_out_sentence
from spectrabox.session.outputs.results import (
    VALID_OUTCOMES,
    CommonEvidence,
    FlatEvidence,
    SceneEvidence,
)
from spectrabox.session.report.words import deviation_words, listed, percent
from spectrabox.session.store.rehearsals import too_narrow, verdict_sentence

# |photo / rendering - 1|: pass up to the first, fail beyond the second
MEDIAN_LIMITS = (0.02, 0.05)
WORST_LIMITS = (0.05, 0.15)
CHART_LIMITS = (0.03, 0.10)           # rms of (photo - predicted) / photo
# clipped pixels are left out, so they cost coverage, not correctness
CLIPPED_LIMITS = (0.05, float("inf"))
# of wavelengths of patches left out, that the band should hold and does not: simulated charts of
# cameras and lamps outside the prior stay below it (benchmarks/bench_patch_errors.py)
LEFT_OUT_SHORT = 0.03
LIGHT_LIMITS = (FAR, 0.15)            # relative error of the light on a region of a flat sample
# Relative scatter of a region's pixels. One paint whose relief slopes by 20 degrees (rms) scatters
# by 0.25 in light from 45 degrees; halves of two paints of a ColorChecker by more in 93 % of pairs,
# three paints in 99 %.
ONE_PAINT = 0.25
# Standard deviations, rms over wavelengths, of a stated truth from the mean. Of 119 surfaces of
# published sets in a simulated camera's signals (1 %, D65) right truths reach 3.5, 1 in 100 exceeds
# 2.1; truths of another of these surfaces exceed 4 in more than nine of ten pairs.
ANOTHER_TRUTH = 4.0
SMALLEST_SPREAD = 0.002               # of white: what measured spectra repeat to
DOUBTS = {CalibrationDoubt.UNLIKE_CAMERAS: "Calibration like that of measured cameras",
          CalibrationDoubt.WRONG_LIGHT: "Stated light against the chart",
          CalibrationDoubt.COLOUR_MATRIX: "Curves against the colour matrix in the photo's file",
          CalibrationDoubt.TWO_LIGHTS: "Colour of the light over the chart",
          CalibrationDoubt.VEIL: "Veiling glare on the chart",
          CalibrationDoubt.BANDS: "Bands against the chart"}
MAX_NAMED = 3                         # surfaces that the verdict names
WITHIN = 2                            # standard errors within which a condition is said to hold
# what is assumed of the light on a scene: criterion, what repeats or agrees, what measures it
ASSUMED = {
    REPEATABILITY: ("Light and shutter from chart photo to object photo", "lamp and shutter repeat",
                    "A grey reference that both photos show ([drift])"),
    SCENE_LEVEL: ("Light on the scene against that on the chart", "the positions of lamp and chart "
                  "give the light on the scene", "A material of known spectrum ([scale] from = "
                  "\"material\")")}
# of sessions with a picture, whose surfaces may have as many spectra as pixels
PATTERNS = ("One spectrum for each material does not fit every surface. It cannot fit those with "
            "patterns, and the picture, with a spectrum for every pixel, does not rest on it; of "
            "plain surfaces check light, position and paint.")


class Status(Enum):
    """Outcome of one criterion, from harmless to worst; the value is the rank."""

    INFO = 0
    PASS = 1
    WARN = 2
    FAIL = 3


# how serious an outcome is: ill-posed is information, as the bands already carry what the data
# left open; what is not named here is a warning
GRADES = {Outcome.CONVERGED: Status.PASS, Outcome.ILL_POSED: Status.INFO,
          **dict.fromkeys(VALID_OUTCOMES, Status.PASS)}


@dataclass(frozen=True)
class Criterion:
    """One line of the verdict; ``value`` is None where it could not be measured.

    ``surfaces`` are the materials or regions that it speaks against.
    """

    name: str
    value: float | None
    shown: str
    limit: str
    status: Status
    sentence: str
    surfaces: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether nothing is to be done about it."""
        return self.status in (Status.PASS, Status.INFO)


@dataclass(frozen=True)
class Verdict:
    """The worst status of all criteria, and the sentence that explains it."""

    status: Status
    sentence: str
    criteria: tuple[Criterion, ...]

    @property
    def headline(self) -> str:
        """The sentence; of several reasons the first."""
        reasons = dict.fromkeys(c.sentence for c in self.criteria if c.status is self.status)
        if self.status not in (Status.WARN, Status.FAIL) or len(reasons) < 2:
            return self.sentence
        more = len(reasons) - 1
        return f"{next(iter(reasons))} And {more} more reason{'s' if more > 1 else ''}, below."

    @property
    def doubts(self) -> dict[str, tuple[str, ...]]:
        """Names of the criteria that each surface does not pass; only surfaces that have any."""
        doubts: dict[str, tuple[str, ...]] = {}
        for criterion in self.criteria:
            for surface in () if criterion.passed else criterion.surfaces:
                name = criterion.name.partition(", worst")[0]
                doubts[surface] = (*doubts.get(surface, ()), name)
        return doubts


def judge(evidence: SceneEvidence | FlatEvidence) -> Verdict:
    """Verdict on a session: PASS, WARN or FAIL, the worst of its criteria."""
    if isinstance(evidence, FlatEvidence):
        own = [*_light(evidence), *_known_levels(evidence), *_uneven_regions(evidence)]
        good = "The chart fits, and the light on every region is known within the limits."
        conditions = _flat_conditions(evidence)
    else:
        own, good = _scene_criteria(evidence), \
            "Photo, rendering and calibration agree within the limits."
        conditions = _scene_conditions(evidence)
    fits = {"": evidence.calibration, **evidence.other_calibrations}
    criteria = (*_processed(evidence), *own, *calibration_doubts(evidence),
                *_chart_agreement(evidence), *held_out_patches(evidence), _clipped(evidence),
                *(_outcome(f"Sensitivity fit{where_of(view)}", fit.sensitivity.outcome)
                  for view, fit in fits.items()), *_samplers(evidence), _coverage(evidence),
                *_truths(evidence))
    status = max((criterion.status for criterion in criteria), key=lambda one: one.value)
    if status in (Status.WARN, Status.FAIL):
        reasons = dict.fromkeys(c.sentence for c in criteria if c.status is status)
        return Verdict(status, " ".join(reasons), criteria)
    return Verdict(status, f"{good} The bands hold if {conditions}.", criteria)


def _processed(evidence: CommonEvidence) -> list[Criterion]:
    """Whether a photo is not proportional to light, and was decoded as sRGB all the same."""
    return [Criterion("Photos proportional to light", None, "no", "yes", Status.WARN,
                      "A photo was processed by the camera and decoded as sRGB: its tone curve and "
                      "its colours remain in every spectrum, with errors that no band states. "
                      "Photograph raw.")] if evidence.processed else []


def _scene_criteria(evidence: SceneEvidence) -> list[Criterion]:
    """Photo against rendering, misfits, the fit, changes between the photos, rehearsal."""
    photos = [("", evidence.reconstruction, evidence.bands)]
    photos += [(where_of(view.name), view.reconstruction, view.bands)
               for view in evidence.views]
    agreement = [*(_median_surface(photo.agreement, where) for where, photo, _ in photos),
                 *(_worst_surface(photo.agreement, bands, where) for where, photo, bands in photos)]
    misfits = [_misfits(photo, bands, where) for where, photo, bands in photos]
    if evidence.picture is not None:
        agreement = [replace(each, status=Status.INFO) for each in agreement]
        misfits = [each if each.status is Status.PASS else
                   replace(each, status=Status.WARN, sentence=PATTERNS) for each in misfits]
    return [*agreement, *misfits, _outcome("Inverse rendering", evidence.reconstruction.outcome),
            *_between_photos(evidence), *_rehearsal(evidence)]


def _light(evidence: FlatEvidence) -> list[Criterion]:
    """How well the light on the worst region is known, and how much it changes."""
    light = {(photo.name, name): level_and_error for photo in evidence.photos
             for name, level_and_error in photo.light.items()}
    (_, worst), (_, error) = max(light.items(), key=lambda item: item[1][1])
    levels = np.array([level for level, _ in light.values()] + [1.0])
    change = float(levels.max() / levels.min() - 1)
    known = _graded("Error of the light on the regions, worst region", error, LIGHT_LIMITS,
                    f"The light on “{worst}” is known to {percent(error)}"
                    + ("." if error <= LIGHT_LIMITS[0] else ": it lies far from the chart, or the "
                       "light is uneven; put the chart or a white card next to it, or photograph "
                       "a white card in the samples' place as flat field."),
                    tuple(name for (_, name), (_, own) in light.items()
                          if own > LIGHT_LIMITS[0]))
    return [known, Criterion("Change of the light from the chart to the regions", change,
                             percent(change), "corrected", Status.INFO,
                             f"The light changes by {percent(change)} between chart and regions, "
                             "which is corrected within its error.")]


def _flat_conditions(evidence: FlatEvidence) -> str:
    """What no photo shows and the estimates rest on: how the samples must lie."""
    matt = [] if evidence.surfaces_stated else ["matt"]
    card = all(photo.level_misfits for photo in evidence.photos if photo.light)
    return "the samples are " + listed([*matt, "flat", *(
        ["in the white card's plane"] if card else ["in the chart's plane", "in no shadow"])])


def _scene_conditions(evidence: SceneEvidence) -> str:
    """The same of a scene: what of the light only the chart photo tells, geometry, surfaces."""
    scales = [evidence.light_scale, *(view.reconstruction.light_scale for view in evidence.views)]

    def within(*causes: str) -> str:
        errors = [np.hypot.reduce([0.0, *(error.relative for error in scale.common_errors
                                          if error.cause in causes)]) for scale in scales]
        return percent(WITHIN * max(errors), 0) if max(errors) else ""

    repeat, light = within(REPEATABILITY), within(SCENE_LEVEL, LAMP_AT_CHART)
    known = [f"“{material.name}”" for material in evidence.materials if material.summary is None]
    return listed([
        *([f"lamp and shutter repeated within {repeat} between chart photo and object photo"]
          if repeat else []),
        f"the geometry gives the light on the scene within {light}" if light else
        "the geometry is right",
        *([f"the spectrum of {listed(known)} is right"] if known else []),
        *([] if evidence.surfaces_stated else ["the surfaces are as matt as the scene says"])])


def _known_levels(evidence: FlatEvidence) -> list[Criterion]:
    """How far the stated levels of known regions are from what the chart's light gives."""
    misfits = {name: misfit for photo in evidence.photos
               for name, misfit in photo.level_misfits.items()}
    if not misfits:
        return []
    worst = max(misfits, key=lambda name: abs(misfits[name]))
    size = abs(misfits[worst])
    status = Status.PASS if size <= LEVEL_DOUBTED else Status.WARN
    return [Criterion("Level of known regions against the chart's light, worst region", size,
                      f"{size:.1f} standard errors", f"pass up to {LEVEL_DOUBTED:.0f}", status,
                      f"The level of “{worst}”, of known spectrum, is {size:.1f} standard errors "
                      "from what the chart's light gives" + ("." if status is Status.PASS else
                      ": check its stated reflectance, and for a shadow on it or on the chart."),
                      tuple(name for name, misfit in misfits.items()
                            if abs(misfit) > LEVEL_DOUBTED))]


def _uneven_regions(evidence: FlatEvidence) -> list[Criterion]:
    """Whether each region can be one paint, by what its pixels scatter."""
    scatter = {name: value for photo in evidence.photos for name, value in photo.scatter.items()}
    if not scatter:
        return []
    worst = max(scatter, key=lambda name: scatter[name])
    several = scatter[worst] > ONE_PAINT
    return [Criterion(
        "Scatter of pixels beyond noise and light, worst region", scatter[worst],
        percent(scatter[worst]), f"pass up to {percent(ONE_PAINT, 0)}",
        Status.WARN if several else Status.PASS,
        f"The pixels of “{worst}” scatter by {percent(scatter[worst])} beyond noise and even light"
        + (", more than one paint does: its spectrum is the mean of several; outline a part of one "
           "paint." if several else "."),
        tuple(name for name, value in scatter.items() if value > ONE_PAINT))]


def chart_residuals(evidence: CommonEvidence) -> np.ndarray | None:
    """(photo - predicted) / photo of the patches (I, K), or None where no chart was used."""
    residuals = evidence.calibration.sensitivity.residuals
    if residuals is None and evidence.chart is not None:
        measured = evidence.chart.samples.mean
        return (measured - evidence.chart.predicted) / measured
    return residuals


def root_mean_square(values: np.ndarray | None) -> float | None:
    """Root mean square of the finite values, None where there are none."""
    finite = np.empty(0) if values is None else values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite ** 2))) if finite.size else None


def worst_entry(agreement: SurfaceAgreement) -> tuple[int, int] | None:
    """Surface and band of the largest |ratio - 1|, None where no surface was compared.

    Returns
    -------
    tuple of int or None
        Its row and column in ``agreement.ratio``.
    """
    deviation = np.abs(agreement.ratio - 1)
    if not np.isfinite(deviation).any():
        return None
    surface, band = np.unravel_index(np.nanargmax(deviation), deviation.shape)
    return int(surface), int(band)


def median_surface_error(agreement: SurfaceAgreement) -> float | None:
    """Median over surfaces of |ratio - 1| in the worst band, None where no surface was compared."""
    worst = np.abs(agreement.ratio - 1).max(axis=1, initial=0)
    finite = worst[np.isfinite(worst)]
    return float(np.median(finite)) if finite.size else None


def _median_surface(agreement: SurfaceAgreement, where: str) -> Criterion:
    name = f"Photo against rendering, |ratio − 1| of the worst band, median over surfaces{where}"
    value = median_surface_error(agreement)
    if value is None:
        return Criterion(name, None, "not measured", _limit(MEDIAN_LIMITS), Status.WARN,
                         f"No surface could be compared with the photo{where}.")
    return _graded(name, value, MEDIAN_LIMITS,
                   f"Half of the surfaces agree with the photo within {percent(value)} in every "
                   f"band{where}.")


def _worst_surface(agreement: SurfaceAgreement, bands: tuple[str, ...], where: str) -> Criterion:
    name = f"Photo against rendering, worst surface{where}"
    worst = worst_entry(agreement)
    if worst is None:
        return Criterion(name, None, "not measured", _limit(WORST_LIMITS), Status.WARN,
                         f"The worst surface{where} is unknown.")
    surface, band = worst
    ratio = float(agreement.ratio[worst])
    fits = "fits least" if abs(ratio - 1) <= WORST_LIMITS[0] else "does not fit"
    return _graded(name, abs(ratio - 1), WORST_LIMITS,
                   f"The surface “{agreement.names[surface]}”{where} {fits}: in band {bands[band]} "
                   f"the photo is {deviation_words(ratio)} than the rendering.",
                   (agreement.materials[surface],))


def _misfits(made: Reconstruction, bands: tuple[str, ...], where: str) -> Criterion:
    """Surfaces whose deviation neither chance nor the stated errors explain."""
    # here: a flat sample needs nothing of it
    from spectrabox.reconstruct.misfit import FALSE_ALARM, common_cause
    name = f"Surfaces beyond chance and stated errors (p < {FALSE_ALARM:g}){where}"
    limit = f"none; fail beyond {percent(WORST_LIMITS[1], 0)}"
    if not made.misfits:
        return Criterion(name, 0.0, "none", limit, Status.PASS,
                         f"No surface{where} is off by more than chance and stated errors explain.")
    worst = max(abs(misfit.deviation) for misfit in made.misfits)
    status = Status.WARN if worst <= WORST_LIMITS[1] else Status.FAIL
    sentence = common_cause(made.agreement, made.misfits, bands)
    if sentence is None:
        named = [misfit.sentence for misfit in made.misfits[:MAX_NAMED]]
        if (more := len(made.misfits) - MAX_NAMED) > 0:
            named.append(f"{more} more do not fit")
        sentence = f"{'. '.join(named)}."
    materials = dict(zip(made.agreement.names, made.agreement.materials, strict=True))
    return Criterion(name, worst, f"{len(made.misfits)}, off by up to {percent(worst)}", limit,
                     status, f"In{where[3:]}: {sentence}" if where else sentence,
                     tuple(dict.fromkeys(materials[misfit.surface] for misfit in made.misfits
                                         if misfit.surface in materials)))


def calibration_doubts(evidence: CommonEvidence) -> list[Criterion]:
    """Whether the calibrations were made with doubts, each a criterion of its own; of further
    photos those alone that are doubtful.

    Nothing is known to contradict products of an unknown light with a camera, and where the light
    on each patch is given no drift over the chart is looked for. A veil and bands that disagree are
    named where they are.
    """
    calibration, rows = evidence.calibration, []
    for doubt, name in DOUBTS.items():
        given = (calibration.light_scale is not None if doubt is CalibrationDoubt.TWO_LIGHTS
                 else calibration.products)
        if doubt not in calibration.doubts and not given \
                and doubt not in (CalibrationDoubt.VEIL, CalibrationDoubt.BANDS):
            rows.append(Criterion(name, None, "no doubt", "no doubt", Status.PASS,
                                  "No sign of two kinds of light." if doubt
                                  is CalibrationDoubt.TWO_LIGHTS
                                  else "No sign of a wrong light spectrum."))
    return rows + [
        Criterion(DOUBTS[doubt] + where_of(view), None, "doubtful", "no doubt", Status.WARN,
                  sentence)
        for view, made in {"": calibration, **evidence.other_calibrations}.items()
        for doubt, sentence in zip(made.doubts, doubt_sentences(made, view), strict=True)]


def doubt_sentences(calibration: Calibration, view: str) -> list[str]:
    """What makes a calibration doubtful, a sentence each.

    Parameters
    ----------
    calibration : Calibration
    view : str
        Name of the first photo that it is of; "" the first of the session.
    """
    return [f"Calibration{where_of(view)}: "
            + next((check for check in calibration.checks if check.startswith(doubt.value)),
                   doubt.value) + "." for doubt in calibration.doubts]


def where_of(view: str) -> str:
    """Which photo a sentence is about, after a name; nothing of the first."""
    return view and f" in the photo “{view}”"


def held_out_patches(evidence: CommonEvidence) -> list[Criterion]:
    """How well each chart patch is predicted by a calibration without it; nothing without a chart.

    Parameters
    ----------
    evidence : CommonEvidence
    """
    chart = evidence.chart
    if chart is None or chart.left_out is None:
        return []
    return [row for view, patches in {"": chart.left_out, **chart.others}.items()
            for row in _one_chart(patches, chart.layout.names, where_of(view))]


def _one_chart(patches: HeldOutPatches, names: Sequence[str], where: str) -> list[Criterion]:
    _, held, expected = patches.means
    short = expected - held > LEFT_OUT_SHORT
    sentence = f"{left_out_sentence(patches).capitalize()}."
    for name, reason in poor_patches(patches, names).items():
        sentence += f" Patch {name}: {reason}."
    if short:
        sentence += (" Less means that signals or their errors are off: the chart is not that of "
                     "its reference or soiled, light glares on it, or the light is not the stated "
                     "one.")
    rows = [Criterion(f"Chart patches left out, inside the band{where}", held, percent(held),
                      f"{percent(expected)} expected", Status.WARN if short else Status.INFO,
                      sentence)]
    saturated = [names[patch] for patch in np.flatnonzero(~patches.judged).tolist()]
    if saturated:
        rows.append(Criterion(
            f"Saturated chart patches{where}", float(len(saturated)), ", ".join(saturated), "none",
            Status.WARN, f"Saturated and left out of the fit: {', '.join(saturated)}. The light is "
            "known less well without; the calibration's checks say by how much. Expose less."))
    return rows


def _chart_agreement(evidence: CommonEvidence) -> list[Criterion]:
    """How well each calibration reproduces the first chart that it was fitted to."""
    name, chart = "Chart residual, rms over patches and bands", evidence.chart
    residuals = chart_residuals(evidence)
    if residuals is not None and chart is not None:
        residuals = residuals[~chart.samples.clipped]
    each = {"": root_mean_square(residuals)}
    if each[""] is None:
        return [Criterion(name, None, "no chart", _limit(CHART_LIMITS), Status.INFO,
                          "Sensitivities were read from a file; no chart photo tests them.")]
    for view, made in evidence.other_calibrations.items():
        assert chart is not None and made.sensitivity.residuals is not None
        each[view] = root_mean_square(made.sensitivity.residuals[chart.others[view].judged])
    return [_graded(name + where_of(view), value, CHART_LIMITS, "The calibration"
                    f"{where_of(view)} reproduces the chart within {percent(value)} rms.")
            for view, value in each.items() if value is not None]


def _clipped(evidence: CommonEvidence) -> Criterion:
    share = float(evidence.photo.saturated.any(axis=2).mean())
    if isinstance(evidence, FlatEvidence):
        return _graded("Clipped parts of the photo", share, CLIPPED_LIMITS,
                       f"{percent(share)} of the photo is clipped, none of it in a region.")
    return _graded("Clipped pixels, left out of the fit", share, CLIPPED_LIMITS,
                   f"{percent(share)} of the object photo is clipped and was left out.")


def _outcome(name: str, outcome: Outcome) -> Criterion:
    return Criterion(name, None, outcome.name.replace("_", " ").lower(), "converged",
                     GRADES.get(outcome, Status.WARN), f"{name}: {outcome.value}")


def _samplers(evidence: CommonEvidence) -> list[Criterion]:
    """Whether the draws of every estimated surface are as intended."""
    drawn = [(m.name, m.samples) for m in evidence.materials if m.samples is not None]
    if not drawn:
        return []
    doubtful = [(m.name, m.samples.sentence) for m in evidence.materials
                if m.doubtful and m.samples is not None]
    if not doubtful:
        return [Criterion("Samplers", None, "as intended", "as intended", Status.PASS,
                          "Sampler of every estimated material: "
                          f"{drawn[0][1].outcome.value}")]
    reservations = "; ".join(f"“{name}”: {sentence}" for name, sentence in doubtful)
    return [Criterion("Samplers", None, "see words", "as intended", Status.WARN,
                      f"Sampler of {reservations}", tuple(name for name, _ in doubtful))]


def _between_photos(evidence: SceneEvidence) -> list[Criterion]:
    """What it costs that nobody measured the light on the scene itself."""
    rows = []
    for cause, (name, assumed, measured_by) in ASSUMED.items():
        stated = [error.relative for error in evidence.light_scale.common_errors
                  if error.cause == cause]
        if not stated:
            continue
        shares = [material.variance_shares[cause] for material in evidence.materials
                  if cause in material.variance_shares]
        cost = (f", which makes {percent(float(np.mean(shares)))} of the variance of the spectra "
                f"(up to {percent(max(shares))} of a material's)" if shares else "")
        rows.append(Criterion(name, stated[0], percent(stated[0]), "stated, not measured",
                              Status.INFO, f"We assume {assumed} to {percent(stated[0])}{cost}. "
                              f"{measured_by} measures it instead and narrows every band."))
    return rows


def _coverage(evidence: CommonEvidence) -> Criterion:
    name = "Measured truth inside the band"
    tested = [(m.scores.coverage, m.summary.level) for m in evidence.materials
              if m.scores is not None and m.summary is not None]
    if not tested:
        return Criterion(name, None, "no truth given", "its level", Status.INFO,
                         "No measured spectrum was given to compare with.")
    share, level = np.mean(tested, axis=0)
    return Criterion(name, float(share), percent(share), f"{percent(level)} intended",
                     Status.INFO,
                     f"Over {len(tested)} materials with a measured spectrum, the band holds it at "
                     f"{percent(share)} of wavelengths; {percent(level)} is intended.")


def _truths(evidence: CommonEvidence) -> list[Criterion]:
    """Whether each stated truth can be that of its surface."""
    far = {}
    for surface in evidence.materials:
        if surface.truth is not None and surface.summary is not None:
            off = spectrum_on_grid(surface.truth, surface.summary.grid) - surface.summary.mean
            spread = np.maximum(surface.summary.standard_deviation, SMALLEST_SPREAD)
            far[surface.name] = float(np.sqrt(np.mean((off / spread) ** 2)))
    if not far:
        return []
    worst = max(far, key=lambda name: far[name])
    another = far[worst] > ANOTHER_TRUTH
    return [Criterion(
        "Measured truth from the mean, worst surface", far[worst],
        f"{far[worst]:.1f} standard deviations", f"pass up to {ANOTHER_TRUTH:.0f}",
        Status.WARN if another else Status.PASS,
        f"The stated truth disagrees with every band of “{worst}”: it lies {far[worst]:.1f} "
        "standard deviations from the mean (rms over wavelengths); check that it is of this "
        "surface." if another else "Every stated truth can be that of its surface.",
        tuple(name for name, off in far.items() if off > ANOTHER_TRUTH))]


def _rehearsal(evidence: SceneEvidence) -> list[Criterion]:
    facts = evidence.rehearsal
    if facts is None:
        return []
    worst = min(float(each["coverage"]) for each in facts["materials"])
    status = Status.WARN if too_narrow(facts) else Status.PASS
    return [Criterion("Known truth inside the band, rehearsed; worst material", worst,
                      percent(worst), f"{percent(facts['level'])} intended", status,
                      f"R{verdict_sentence(facts)[1:]}.")]


def _graded(name: str, value: float, limits: tuple[float, float], sentence: str,
            surfaces: tuple[str, ...] = ()) -> Criterion:
    status = Status.PASS if value <= limits[0] else Status.WARN if value <= limits[
        1] else Status.FAIL
    return Criterion(name, value, percent(value), _limit(limits), status, sentence, surfaces)


def _limit(limits: tuple[float, float]) -> str:
    passes = f"pass up to {percent(limits[0], 0)}"
    return passes if np.isinf(limits[1]) else f"{passes}, fail beyond {percent(limits[1], 0)}"
