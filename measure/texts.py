"""Every sentence about a result: from the code of a finding to what a person reads.

The only English about results. A code has one `Text`; terminal, report, page, JSON and ``repr``
show it through the functions at the end. Nothing reads a sentence to decide.

A text is a template of `str.format` over the finding's values, with ``{subject}``, and ``{where}``:
" in the photo “name”" of a further photo, which is the value "photo" or else the subject, and
nothing of the first. Further format specifications:
``percent`` (a share of 1, two significant digits; ``percent0`` without decimals), ``listed`` (names
as a phrase), ``quoted`` (the same in quotation marks), ``deviation`` (a ratio: "12 % brighter"),
``reasons`` (chart patches, each with what it is off by).
Where a template cannot say it, a function of the values does; among them is "beyond": whether the
finding is evidence of a fault.
"""
from __future__ import annotations

import string
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from spectrabox.capture.photo.processed_photos import RAW_INSTEAD
from spectrabox.measure import words
from spectrabox.radiometry.chart import BEFORE_2014, SINCE_2014
from spectrabox.radiometry.findings import Finding, Severity, faults

Template = str | Callable[[Mapping[str, Any]], str]


@dataclass(frozen=True)
class Text:
    """How one code reads."""

    name: Template              # of what was looked at: the heading of its row
    sentence: Template          # what was found, a whole sentence
    remedy: Template = ""       # what to do about it, a whole sentence; shown from NOTE on
    shown: Template = ""        # the value in a table
    limit: Template = ""        # up to where it passes, as a table shows it
    holds: Template = ""        # of a condition: how a verdict names it after "if"


OUTCOMES: dict[str, str] = {
    "converged": "Converged.",
    "step-limit": "Stopped at the step limit with the loss still falling: allow more iterations.",
    "ill-posed":
        "Solved, but the data leave some directions undetermined: trust the uncertainty, not "
        "the curve alone.",
    "exact": "Independent draws from the exact distribution.",
    "familiar":
        "Independent draws from the learnt prior; the signal is like those it was calibrated "
        "on.",
    "through-transport":
        "Weighted draws from the learnt prior of all materials at once, through the traced "
        "light transport, interreflection included.",
    "unreachable":
        "No spectrum of this class reproduces the signal exactly; the draws fit it within its"
        " stated noise only.",
    "moved":
        "No spectrum of {coefficients} coefficients between 0 and 1 gives the signal: it was "
        "moved by up to {moved:percent} of white to the nearest that can be reached.",
    "as-published": "As published: a box around one solution, which under-states the spread.",
    "ranked": "Ranked, not conditioned: draws need not agree with what was measured.",
    "unfamiliar":
        "This colour is unlike any in the training data: its band is as much wider as colours"
        " needed that were left out of the training.",
    "beyond-learnt":
        "The learnt prior reaches no spectrum that gives the signal: a wide band of smooth "
        "spectra, of untested coverage, is shown; check the calibration.",
    "too-rough":
        "Only spectra rougher than any that were measured give the signal: the draws are of "
        "the smoothness prior{reached}; check the calibration.",
    "out-of-reach":
        "No spectrum between 0 and 1 gives the signal, so that no surface has this colour: the "
        "draws are of the smoothness prior{reached}.",
    "unsaid":
        "The spectra found do not give this signal, by more than its stated errors allow: a "
        "wider band of untested coverage is shown; check the calibration.",
    "disagrees":
        "The picture agrees with no spectra that the prior knows through this light "
        "transport: the draws come as near as they can; check geometry, light and "
        "calibration, or state a larger surface error.",
}

# ---- chart photo ---------------------------------------------------------------------------------

def _chart_figures(values: Mapping[str, Any]) -> str:
    white = f"at {words.percent(values['white'], 0)} of full scale" \
        if values["white_8bit"] is None else f"{values['white_8bit']:.0f} of 255"
    return (f"White patch {white}, light even to {words.percent(values['uneven'], 0)}, glare "
            f"{words.percent(values['glare'], 1)}, tilt {values['tilt_deg']:.0f} degrees, edges "
            f"{words.percent(values['blur'], 0)} of a patch, {values['pixels']} pixels or more per "
            "patch.")


# Each cause of what is wrong with a chart photo (``chart_causes``): in words, and what tells it.
CAUSES: dict[str, tuple[str, str]] = {
    "veil": ("veiling glare over the whole chart", "shade the lens from the sky and from lamps, "
             "wipe it, and photograph again: a veil becomes less"),
    "reflection": ("a reflection on some patches", "turn the chart or the lamp: a reflection "
                   "moves"),
    "uneven-light": ("light that falls off over the chart", "turn the chart by 180 degrees: the "
                     "light stays as it is"),
    "two-lights": ("two kinds of light", "switch one lamp off or keep daylight out: the colours "
                   "no longer drift"),
    "tone-curve": ("a tone curve in the file", "take the camera's raw file: it has none"),
    "computed-colours": ("colours that a converter computed, with a matrix",
                         "take the camera's raw file: no matrix is in it"),
    "black-level": ("a wrong black level", "photograph with the lens covered: such a photo reads "
                    "the black level"),
    "colour-shading": ("a lens or sensor that shades each colour in its own way",
                       "photograph a white card all over the picture as flat field: it has the "
                       "same shading"),
    "shadow-edge": ("the edge of a shadow over the chart", "look for what throws a shadow, and "
                    "move it or the chart"),
    "stated-light": ("another light than the one that was stated or supposed", "measure the light, "
                     "or state it as \"unknown\""),
    "chart-itself": ("patches that are soiled, faded or of another edition", "clean the chart, or "
                     "measure its patches"),
    "chance": ("chance", "photograph again: chance does not repeat"),
}


def _causes(values: Mapping[str, Any]) -> str:
    """What the patches of a photo allow for, where a finding names no single cause."""
    patches = [name for doubt in values["doubts"].values() for name in (
        *doubt.get("names", ()), *(row["patch"] for row in doubt.get("patches", ())))]
    above_all = f", {words.listed([*dict.fromkeys(patches)])} above all" if patches else ""
    causes = [CAUSES[cause][0] for cause in values["causes"]]
    either = f"{causes[0]}; no other cause explains them as well" if not causes[1:] else \
        f"{', '.join(causes[:-1])}, or {causes[-1]}; this photo does not tell which"
    return (f"The patches of the chart{values['where']} are not as they should be{above_all}. The "
            f"cause is {either}.")


def _causes_told(values: Mapping[str, Any]) -> str:
    """What tells the causes apart, or mends the one that is left."""
    told = "; ".join(CAUSES[cause][1] for cause in values["causes"])
    return ("To tell: " if values["causes"][1:] else "To mend it: ") + f"{told}."


def _undecided(name: str) -> Text:
    return Text(f"{name}{{where}}", _causes, _causes_told,
                "doubtful", "no doubt")


CHART: dict[str, Text] = {
    # where it is
    "chart.found-in-photo": Text("Chart", "The chart was found in the whole photo at {side_px} "
                                 "px."),
    "chart.found-in-part": Text("Chart", "The chart was found in a part of the photo at {side_px} "
                                "px."),
    "chart.found-in-same-place": Text("Chart", "The chart was found in its position in another "
                                      "photo."),
    "chart.corners-given": Text("Chart", "The chart is at the corners given by hand."),
    "chart.mirrored": Text("Mirrored chart", "The chart is mirrored{where}.",
                           "Give the photo as the camera took it."),
    # its photo
    "chart.good": Text("Photo of the chart{where}", "The photo of the chart{where} is good.",
                       shown="good", limit="good"),
    "chart.figures": Text("Photo of the chart", _chart_figures),
    "chart.processed-photo": Text(
        "Kind of file", "The photo was processed by the camera: its values are not proportional "
        "to light. Position, light, glare and focus are judged here, noise is not, and nothing can "
        "be measured on it.", f"To measure, {RAW_INSTEAD}."),
    "chart.image-file": Text(
        "Kind of file", "The photo is an image file taken as linear: good for finding the chart.",
        "Calibrate with the camera's raw file."),
    "chart.clipped": Text(
        "Clipping", "{clipped} of {patches} patches are saturated ({names:listed}).",
        "Halve the exposure.", "{clipped} patches", "none"),
    "chart.dark": Text(
        "Exposure", "The white patch reaches only {white:percent} of full scale, and "
        "{least:percent0} is needed.", "Expose {times:.0f} times as long.", "{white:percent}",
        "at least {least:percent0}"),
    "chart.black-noisy": Text(
        "Noise of the black patch", "The mean of the black patch is known to only "
        "{relative_error:percent0}, and {limit:percent0} is needed.",
        "Expose longer, or bring the chart closer.", "{relative_error:percent0}",
        "{limit:percent0}"),
    "chart.uneven-light": Text(
        "Even light", "The light changes by {uneven:percent0} over the chart{where}; at most "
        "{limit:percent0} is accepted.", "Move the lamp away, use two lamps, or photograph a "
        "white card in the same place as flat field.", "{uneven:percent0}", "{limit:percent0}"),
    "chart.uneven-beyond-scene": Text(
        "Even light", "The light changes by {uneven:percent0} over the chart{where} beyond what "
        "the chart scene explains; at most {limit:percent0} is accepted.", "Move the lamp away, "
        "use two lamps, or photograph a white card in the same place as flat field, and shoot the "
        "chart again.", "{uneven:percent0}", "{limit:percent0}"),
    "chart.veiled": Text(
        "Veiling glare", "Veiling glare of {veil:percent0} of white lies over the whole chart; the "
        "fit subtracts it, but is less certain.", "Shade the lens from the sky and from lamps, "
        "wipe it, and avoid haze.", "{veil:percent}", "{limit:percent0}"),
    "chart.glare": Text(
        "Glare", "White light of up to {glare:percent} of the white patch lies on {names:listed}.",
        "Turn the chart or the lamp so that the chart does not mirror the lamp or a window.",
        "{glare:percent}", "{limit:percent0}"),
    "chart.cause": _undecided("Light and file of the chart photo"),
    "chart.glints": Text(
        "Dust and glints", "{excluded:percent0} of the samples of {patch} stand out, as dust or "
        "glints do; at most {limit:percent0} is accepted.",
        "Clean the chart and keep reflections off it.", "{excluded:percent0}", "{limit:percent0}"),
    "chart.tilted": Text(
        "Tilt", "The chart is turned away by {tilt_deg:.0f} degrees; at most {limit_deg:.0f} is "
        "accepted.", "Face it to the camera.", "{tilt_deg:.0f} degrees", "{limit_deg:.0f} degrees"),
    "chart.blurred": Text(
        "Focus", "Edges are {blur:percent0} of a patch wide; at most {limit:percent0} is accepted.",
        "Focus on the chart.", "{blur:percent0}", "{limit:percent0}"),
    "chart.moved": Text(
        "Movement", "Edges are {blur:percent0} of a patch wide along the {along} of the chart and "
        "{other:percent0} across them, as if camera or chart had moved; at most {limit:percent0} "
        "is accepted.", "Use a tripod and a remote release, hold the chart still, and photograph "
        "again.", "{blur:percent0}", "{limit:percent0}"),
    "chart.another": Text(
        "Other charts in view", lambda values: (
            f"Beside the chart that is measured the photo shows {values['charts']} more, or a card "
            "much like it, about " + words.listed([f"({x:.0f}, {y:.0f}) px"
                                                   for x, y in values["centres_px"]]) + "."),
        "See in the overlay which one is measured; to choose another give its corners "
        "(corners_px of [chart], --corners)."),
    "chart.bands-lost": Text(
        "Clipping", "{subject}: {clipped} of {patches} patches are saturated ({names:listed}) in "
        "{bands:listed}, left out of the measurement.", "Halve the exposure to have them."),
    "chart.small": Text(
        "Size of the chart", "The mean of {patch} is known to only {relative_error:percent}, from "
        "{pixels} pixels, and {limit:percent0} is needed.",
        "Bring the chart closer, or expose longer.", "{relative_error:percent}",
        "{limit:percent0}"),
}

# ---- calibration ---------------------------------------------------------------------------------

CLEAR_KIND, SECOND_KIND = 0.9, 0.25     # probability: one kind of light is named, or two
KIND_WORDS = {"led": "LED light", "halogen": "halogen light", "fluorescent": "fluorescent light"}
AGAINST_COPIES = "Chart against copies of its edition{where}"
CHECK_LIGHT = "Check that the light spectrum is that of the photo."
CHECK_CHART = ("Measure the chart and give that file as its reference, replace it, or leave these "
               "patches out (chart.leave_out).")
RESIDUAL_LIMITS = "pass up to {passes:percent0}, fail beyond {fails:percent0}"


def _fit(name: str) -> Text:
    """How a fit ended, by the value "outcome"."""
    return Text(f"{name}{{where}}", lambda values:
                f"{name}{values['where']}: {continued(OUTCOMES[values['outcome']])}",
                shown=lambda values: "solved, partly left open" if values["outcome"] == "ill-posed"
                else values["outcome"].replace("-", " "), limit="solved")


def _doubt(name: str, sentence: Template, remedy: str) -> Text:
    """What makes a calibration doubtful."""
    return Text(f"{name}{{where}}", sentence, remedy, "doubtful", "no doubt")


def _no_doubt(name: str, sentence: Template) -> Text:
    return Text(f"{name}{{where}}", sentence, shown="no doubt", limit="no doubt")


def _photo(values: Mapping[str, Any]) -> str:
    """Which of several photos a sentence is about."""
    number = values["photo_number"]
    return values["where"] if number is None else f" in photo {number}{values['where']}"


def _kinds(values: Mapping[str, Any]) -> str:
    """The likeliest kinds of light with their probabilities."""
    ranked = sorted(values["kinds"].items(), key=lambda kind: -kind[1])[:2]
    named = [f"{KIND_WORDS.get(kind, kind)} ({words.percent(share, 0)})" for kind, share in ranked]
    if len(named) == 1 or ranked[0][1] >= CLEAR_KIND:
        return named[0]
    return f"either {named[0]} or {named[1]}" if ranked[1][1] >= SECOND_KIND \
        else f"likely {named[0]}, else {named[1]}"


def _light_by_chart(values: Mapping[str, Any]) -> str:
    return f"By itself, the chart makes the light {_kinds(values)}."


def _better_lamps(values: Mapping[str, Any]) -> str:
    return (f"other lamps explain the chart better than {values['stated']}, by "
            f"{values['against']:.1f} nats, and right statements stay below "
            f"{values['limit']:.0f}. {_light_by_chart(values)}")


def _departed_patches(values: Mapping[str, Any]) -> str:
    return "; ".join(
        f"{row['patch']} is {words.percent(abs(row['size']), 0)} ± "
        f"{words.percent(row['error'], 0)} " + (
            ("darker", "lighter") if row["reading"] == "level" else ("yellower", "bluer")
        )[row["size"] > 0] + f" (copies differ by {words.percent(row['spread'], 0)})"
        for row in values["patches"])


def _edition_evidence(values: Mapping[str, Any]) -> str:
    nats = values["nats"]
    if values["told"] is not None:
        return (f"The photo says that it was made {values['told']}, by {abs(nats):.1f} nats (from "
                f"{values['needed']:g} on, 19 of 20 charts are of the edition named)")
    return (f"The photo speaks for {SINCE_2014 if nats > 0 else BEFORE_2014} by {abs(nats):.1f} "
            f"nats, too little to tell its edition: {values['needed']:g} are needed for 19 of 20 "
            "charts to be right")


def _edition(values: Mapping[str, Any]) -> str:
    taken = (f"The chart is taken for one of the {values['reference']}, each patch within what "
             "copies differ by.")
    if values["nats"] is None:
        return taken
    other = values["told"] is not None and values["told"] != values["made"]
    return f"{taken} {_edition_evidence(values)}" + (
        ", too little against 19 of 20 charts in use being of the other." if other else ".")


def patch_reason(row: Mapping[str, Any]) -> str:
    """Why a chart patch is not as it is expected, as ``chart_findings.patch_reason`` found it."""
    brighter = row["brighter"]
    level = "" if brighter is None else (
        f"reads {words.percent(abs(brighter), 0)} ± {words.percent(row['error'], 0)} "
        f"{'brighter' if brighter > 0 else 'darker'}")
    if row["reason"] == "level":
        cause = "a reflection lies on it, or it is lighter than its reference" \
            if brighter > 0 else "a shadow lies across it, or it is soiled"
        if row["dark"]:
            cause += ", or glare is not the same all over the chart"
        return f"{level} in all bands than the others make it ({cause})"
    if row["reason"] == "colour":
        return ("its colour is not that of the reference (soiled, faded, of another generation of "
                "the chart, or lit by a coloured reflection)")
    where = f"its spectrum is unusual for its signals at {row['low_nm']:g} to {row['high_nm']:g} nm"
    return f"{level} than the others make it, within chance; {where}" if level \
        else f"its signals agree with the reference; {where}"


def _patch_reasons(patches: Sequence[Mapping[str, Any]]) -> str:
    return "; ".join(f"{row['patch']}: {patch_reason(row)}" for row in patches)


def _held_out(values: Mapping[str, Any]) -> str:
    poor = "".join(f" Patch {row['patch']}: {patch_reason(row)}." for row in values["poor"])
    return (f"Each patch from the others{values['where']}: reflectance within "
            f"{values['rmse']:.3f} (rms), {words.percent(values['value'])} of it inside the "
            f"{words.percent(values['level'], 0)} band ({words.percent(values['expected'])} "
            f"expected for chart colours).{poor}")


def _camera_fitted(values: Mapping[str, Any]) -> str:
    bands = ", ".join(values["bands"])
    photos = "one photo" if values["photos"] == 1 else f"{values['photos']} photos"
    if values["products"]:
        fitted = f"Products of {bands} with the light, from {photos} under {values['light']}"
    else:
        curves = "Measured curves" if values["half_width"] is None else "Curves"
        fitted = f"{curves} of {bands}, from {photos} under {values['light']}"
    if values["half_width"] is None:
        return f"{fitted}, chart patches within CIEDE2000 {values['delta_e00']:.1f}"
    noise = " of noise alone" if values["noise_alone"] else ""
    return (f"{fitted}, known within {words.percent(values['half_width'], 0)} of the highest peak "
            f"({words.percent(values['level'], 0)} band{noise}), chart patches left out within "
            f"CIEDE2000 {values['delta_e00']:.1f}")


PATCH_COLOURS = ("These spectra against the chart's reference{where}: CIEDE2000 {mean:.1f} on "
                 "average, {median:.1f} in the median, up to {percentile_90:.1f} for 90 % of the "
                 "patches, {largest:.1f} at most.")

# why nothing could be fitted to a chart, by the error that said so
REFUSALS = {"": "the attempt failed",
            "CheckError": "no camera under any lamp explains the chart's patches",
            "CalibrationError": "its patches do not determine a camera",
            "InputError": "the photo has too few bands",
            "ConvergenceError": "the fit did not converge"}

CALIBRATION: dict[str, Text] = {
    # the light
    "light.agrees": _no_doubt("Stated light against the chart", lambda values: (
        f"The chart agrees with the stated light{values['where']}: {values['stated']} explains it "
        f"better than other lamps do, by {-values['against']:.1f} nats. "
        f"{_light_by_chart(values)}")),
    "light.hardly-tested": _no_doubt("Stated light against the chart", lambda values: (
        f"The chart says little for or against the stated light{values['where']}, "
        f"{values['stated']}. {_light_by_chart(values)}")),
    "light.leans": _no_doubt("Stated light against the chart", lambda values: (
        f"The chart leans against the stated light{values['where']} without contradicting it: "
        f"{_better_lamps(values)}")),
    "light.contradicted": _doubt("Stated light against the chart", lambda values: (
        f"The chart contradicts the stated light{values['where']}: {_better_lamps(values)}"),
        "Correct the light, or state it as \"unknown\"."),
    "light.departs": Text(
        "Stated light", "Light {stated} was taken to be right within {expected:percent0} (rms over "
        "wavelengths); the chart makes it {size:percent0} ± {size_error:percent0} off, about "
        "{kelvin:.0f} K."),
    "light.kind": Text("Kind of light", lambda values: f"The chart's light is {_kinds(values)}."),
    "light.width": Text(
        "Light by itself", "The light's spectrum by itself is known within {width:percent0} of its "
        "mean ({level:percent0} band); your spectra do not need the lamp alone, so they are far "
        "better."),
    "light.open": Text(
        "Light by itself", "The chart says little of the light by itself.", "Relighting from under "
        "it, or another camera under it, needs its measured spectrum."),
    "light.unlit": Text(
        "Power of the light", "The light has no power (below {below:percent} of its largest) over "
        "{low_nm:g}-{high_nm:g} nm: the photo says nothing of the curves there."),
    "light.lines-smoothed": Text(
        "Lines of the light", "No measured camera has {bands} bands: products of sensitivity and "
        "light were fitted with smoothness alone, so narrow lines of the lamp are smoothed over "
        "and the light by itself is not known."),
    "light.two-kinds": _doubt("Colour of the light over the chart", lambda values: (
        f"Two kinds of light fall on the chart{_photo(values)}: the colour of the light drifts by "
        f"{words.percent(values['drift'])} over it (probability by chance "
        f"{values['chance']:.0e})."),
        "Use lamps of one kind, keep out daylight and other lamps, and photograph again."),
    "light.one-kind": _no_doubt("Colour of the light over the chart", lambda values: (
        f"No sign of two kinds of light on the chart{_photo(values)}.")),
    "light.same-in-photos": Text(
        "Light of the photos", "{names:quoted} show the same light: their bands are averaged "
        "against noise and add nothing new.", "Take one under another kind of lamp, or through a "
        "filter."),
    # the fit
    "calibration.chart-colours": Text(
        "Chart colours", lambda values: (
            f"Chart colour difference{values['where']} {values['mean']:.2f} CIEDE2000" + (
                "." if values["left_out"] is None else
                f", {values['left_out']:.2f} for patches left out of the fit."))),
    "calibration.signal-error": Text(
        "Error of predicted signals", lambda values: (
            f"Relative error of predicted signals {words.percent(values['error'])} in the worst "
            f"band, from patches{' left out of the fit' if values['left_out'] else ''}.")),
    "calibration.condition-number": Text("Condition number", "Condition number {value:.4g}."),
    "calibration.white": Text(
        "White", "The signal of a perfect reflector (light scale times curves) is known to "
        "{error:percent} in each band."),
    "calibration.patch-clipped": Text(
        "Saturated chart patch", lambda values: (
            f"Patch {values['patch']} is saturated"
            + (f" in {', '.join(values['bands'])} and was left out there" if values["bands"]
               else " and was left out")
            + f": its signal is predicted within {words.percent(values['error'])}, and would be "
            f"within {words.percent(values['error_if_used'])} had it been used.")),
    "calibration.model-error": Text(
        "Patches and model", "Patches and model agree within {error:percent} (chi-square "
        "{chi_square:.2f} per signal)."),
    "calibration.nearest-cameras": Text("Measured cameras", lambda values: "Most like " + "; ".join(
        f"{members} ({words.percent(share, 0)})" for members, share in values["cameras"]) + "."),
    "calibration.rests-on-prior": Text(
        "Share of the prior", lambda values: f"Band {values['band']} rests on the prior over "
        + ", ".join(f"{low:g}-{high:g} nm" for low, high in values["ranges_nm"]) + "."),
    "calibration.field": Text("Light over the chart", lambda values: (
        f"Illumination over the chart{_photo(values)} runs from {values['low']:.2f} to "
        f"{values['high']:.2f} of its mean.")),
    "calibration.glare": Text(
        "Glare on the chart", lambda values: (
            f"{words.percent(values['glare'], 0)} of the brightest patch{_photo(values)}, as glare "
            "or a wrong black level adds, was estimated and subtracted.")),
    "calibration.veil": _doubt(
        "Veiling glare on the chart", "Haze or glare of {veil:percent0} of the brightest patch "
        "veils the chart{where}: it was estimated and taken off, but a veil is seldom the same all "
        "over a photo.", "Shade the lens, wipe it, and photograph again."),
    "calibration.cause": _undecided("Cause of what is wrong with the chart photo"),
    "calibration.like-cameras": _no_doubt(
        "Calibration like that of measured cameras",
        "The curves{where} are like those of measured cameras."),
    "calibration.unlike-cameras": _doubt(
        "Calibration like that of measured cameras",
        "The curves{where} are like those of no measured camera.", CHECK_LIGHT),
    "calibration.matrix-agrees": _no_doubt(
        "Curves against the colour matrix in the photo's file",
        "The colour matrix in the photo's file does not contradict the curves{where}."),
    "calibration.matrix-contradicts": _doubt(
        "Curves against the colour matrix in the photo's file",
        "The colour matrix in the photo's file contradicts the curves{where}.", CHECK_LIGHT),
    "calibration.bands-disagree": _doubt("Bands against the chart", lambda values: (
        f"The chart's patches disagree with any smooth response of the bands{values['where']}: "
        "what the others predict of a patch is off by " + ", ".join(
            f"{words.percent(off, 0)} in {band}" for band, off in values["bands"].items())
        + f", in half of the bands by less than {words.percent(values['median'], 0)}."),
        "Leave out the photos that disagree most, and check that lamps and filters did not move."),
    "calibration.noise-band": Text(
        "Band of the curves", "The band holds the noise of the patches only, not what ten splines "
        "cannot draw: it is too narrow."),
    "calibration.smooth-band": Text(
        "Band of the curves", "The band is that of smooth curves of which nothing else is known."),
    "calibration.curves-agree": _no_doubt(
        "Measured curves against the chart", "Measured curves and photo agree within "
        "{error:percent} (chi-square {chi_square:.2f} per signal)."),
    "calibration.curves-disagree": _doubt(
        "Measured curves against the chart", "The measured curves do not explain the chart photo "
        "(chi-square {chi_square:.1f} per signal).", "Check that they are of this camera and their "
        "columns in the photo's order, and light, chart and glare."),
    "calibration.curves-given": Text(
        "Sensitivities", "Sensitivities were taken as given; predicted signals are assumed right "
        "within {error:percent} a band."),
    "calibration.chart-residual": Text(
        "Chart residual, rms over patches and bands{where}",
        "The calibration{where} reproduces the chart within {value:percent} rms.",
        shown="{value:percent}", limit=RESIDUAL_LIMITS),
    "calibration.no-chart": Text(
        "Chart residual, rms over patches and bands",
        "Sensitivities were read from a file; no chart photo tests them.", shown="no chart",
        limit=RESIDUAL_LIMITS),
    "fit.of-camera": _fit("Sensitivity fit"),
    "camera.of-file": Text(
        "Sensitivities", "The sensitivities were taken from a file and not checked against a chart "
        "photo."),
    "camera.fitted": Text("Camera", _camera_fitted, lambda values: (
        "For photos under this light, and for no other." if values["products"]
        else "For photos under any light.")),
    # the chart
    "copy.edition": Text("Edition of the chart", _edition),
    "copy.departs": Text(
        AGAINST_COPIES, lambda values: (
            f"This copy of the chart{values['where']} departs from the mean of its edition, within "
            f"what copies do, and the calibration allows for it: {_departed_patches(values)}."),
        shown="within copies", limit="within copies"),
    "copy.unlike": Text(
        AGAINST_COPIES, lambda values: (
            f"This chart{values['where']} is not as copies of its edition are: "
            f"{_departed_patches(values)}. " + (
                f"The light may not be the stated one ({values['light']}), or the chart is of "
                "another edition, worn or dirty." if values["light"] else
                "It is of another edition, worn or dirty.")),
        "Measure it (chart.reference) or replace it.", "departs", "within copies"),
    "edition.told": Text("Edition of the chart", lambda values: f"{_edition_evidence(values)}."),
    "edition.by-date": Text(
        "Edition of the chart", "The chart was made {told}: the photo itself is older, taken on "
        "{date} by the camera's clock."),
    "edition.unpublished": Text(
        "Edition of the chart", lambda values: "The edition cannot be told: " + (
            f"of the {values['chart']} no two editions are published." if values["any"] else
            f"nothing is published of the reflectances of the {values['chart']}.")),
    "edition.processed": Text(
        "Edition of the chart", "The edition cannot be told: the camera processed the photo.",
        "A raw photo tells."),
    "edition.converted": Text(
        "Edition of the chart", "The edition cannot be told: the file holds a converted colour "
        "space, not camera signal."),
    "edition.not-fitted": Text(
        "Edition of the chart", lambda values: "The edition cannot be told, since "
        f"{REFUSALS.get(values['refusal'], REFUSALS[''])}."),
    "patches.held-out": Text(
        "Chart patches left out, inside the band{where}", _held_out, shown="{value:percent}",
        limit="{expected:percent} expected"),
    "patches.held-out-short": Text(
        "Chart patches left out, inside the band{where}", lambda values: (
            f"{_held_out(values)} Less than expected means that signals or their errors are off: "
            "the chart is not that of its reference or soiled, light glares on it, or the light is "
            "not the stated one."), shown="{value:percent}", limit="{expected:percent} expected"),
    "patches.saturated": Text(
        "Saturated chart patches{where}", "Saturated and left out of the fit{where}: "
        "{names:listed}. The light is known less well without; the calibration's findings say by "
        "how much.", "Expose less.", "{names:listed}", "none"),
    "patches.colours": Text(
        "Colours of chart patches left out{where}", PATCH_COLOURS, shown="ΔE00 {value:.1f}",
        limit="pass up to {passes:.0f}"),
    "patches.colours-off": Text(
        "Colours of chart patches left out{where}", f"{PATCH_COLOURS} The photo is not "
        "proportional to light, light glares on the chart, a stated light or filter is another, or "
        "the chart is not that of its reference.",
        "Photograph raw, and check what was stated of light, filters and chart.",
        "ΔE00 {value:.1f}", "pass up to {passes:.0f}"),
    "patches.errors-assumed": Text(
        "Errors of the patches", "{subject} states no errors of its signals: {error:percent} is "
        "assumed, as charts and photos have it.",
        "State others: columns named standard_error, or patch_errors=."),
    "patches.unusual": Text(
        "Chart patches", lambda values: f"Patches of the chart{values['where']} are not quite what "
        "the others make of them, as happens on faultless charts." + "".join(
            f" Patch {row['patch']}: {patch_reason(row)}." for row in values["patches"]),
        "Look at them, and leave out what is soiled or faded (chart.leave_out)."),
    "patches.glare": Text(
        "Chart patches", "Glare lies on the chart{where}: {patches:reasons}.",
        "Turn the chart or the lamp."),
    "patches.unlike-reference": Text(
        "Chart patches", "The chart{where} is not as its reference says: {patches:reasons}. It is "
        "of another edition, worn or soiled, or light glares on it.", CHECK_CHART),
    "patches.unlike-reference-or-light": Text(
        "Chart patches", "The chart{where} does not agree with its reference under the stated "
        "light, {light}: {patches:reasons}. Either the light is another, or the chart is of "
        "another edition, worn or soiled, or light glares on it.",
        f"Measure the light, or state it as unknown. {CHECK_CHART}"),
}

# ---- photos and files ----------------------------------------------------------------------------

def _not_registered(values: Mapping[str, Any]) -> str:
    chart = "" if values["chart_px"] is None else \
        f" The chart lies within {values['chart_px']:.1f} pixels of where it lay."
    return (f"{values['subject']} and {values['first']} have too few edges in common to tell "
            "whether the camera moved: regions are taken where the first photo shows them." + chart)


def _photo_of_regions(values: Mapping[str, Any]) -> str:
    """Of one of several photos: its light, its chart, how it was registered, what it lacks."""
    lamp = values["light"] if values["lamp_of"] == values["subject"] \
        else f"the lamp of “{values['lamp_of']}”"
    if values["moved"]:
        lamp += " in another place" if values["moved"] == values["subject"] \
            else f" as in “{values['moved']}”"
    parts = [f"light: {lamp}" + (f" through {values['filter']}" if values["filter"] else "")]
    if values["chart_held"] is not None:
        parts.append("bands of its chart's left-out patches hold "
                     f"{words.percent(values['chart_held'], 0)}")
    if values["shift_px"] is not None:
        left = "" if values["residual_px"] is None else f", within {values['residual_px']:.1f}"
        parts.append(f"shifted by {values['shift_px']:.1f} pixels against the first photo{left}")
    if values["left_out_bands"]:
        parts.append(f"too dark or saturated and left out: {', '.join(values['left_out_bands'])}")
    return f"Photo “{values['subject']}”: {'; '.join(parts)}."


PHOTOS: dict[str, Text] = {
    # developing
    "dark.hot-pixels": Text("Dark frame", "Dark frame {subject}: {hot} hot pixels.",
                            shown="{hot} hot pixels"),
    "bracket.ratio": Text(
        "Exposures", "{shorter} ({shorter_s:g} s) and {longer} ({longer_s:g} s): ratio "
        "{measured:.4f} measured, {stated:.4f} stated, {curvature:+.2%} from dark to bright."),
    "bracket.ratio-unknown": Text(
        "Exposures", "{shorter} and {longer} share too few well-exposed pixels to measure their "
        "ratio: the stated exposures are used."),
    "bracket.left-out": Text(
        "Exposures", "{subject} is left out: saturated over more than {limit:percent0} of the "
        "picture."),
    # corrections that a file states
    "file.levels": Text(
        "Levels of the file", "The file states black at {black:levels} and white at {white:levels} "
        "of its values: both are applied."),
    "file.further-pictures": Text(
        "Pictures in the file", "The first picture of the file was read, of {width} x {height} "
        "pixels; it holds {count} more, of up to {largest_width} x {largest_height}.",
        "Where another one is meant, write it as a file of its own."),
    "file.black-delta": Text(
        "Levels of the file", "The file states a black level of its own for each row or column "
        "(BlackLevelDelta): applied."),
    "file.linear-limit": Text(
        "Levels of the file", "The file states that it is linear up to {limit:percent0} of its "
        "range (LinearResponseLimit): what lies above counts as clipped."),
    "file.gains-applied": Text(
        "Shading of the lens", "The file states gains against the shading of the lens ({opcode}, "
        "{smallest:.2f} to {largest:.2f}): applied to the signal."),
    "file.baseline-exposure": Text(
        "Exposure of the file", "The file is to be shown {stops:+.2f} stops brighter "
        "(BaselineExposure): not applied, since values stay as the sensor gave them.",
        "See that all photos of a measurement state the same, as those of a camera at one setting "
        "do: programs that merge several exposures change it from photo to photo."),
    "file.geometry-left": Text(
        "Corrections of the file", "The file states corrections of geometry that are not applied "
        "({names:listed}): the photo is as the lens drew it.",
        "Flat samples and charts need none; for a scene state the lens's distortion, or develop "
        "the photo elsewhere to a linear TIFF with the correction."),
    "file.bad-pixels-left": Text(
        "Corrections of the file", "The file states pixels to be mended ({names:listed}), which "
        "is not done.", "Pixels that stand out of a patch are left out all the same; dark frames "
        "mend hot ones."),
    "file.values-left": Text(
        "Corrections of the file", "The file states corrections of its values that are not applied "
        "({names:listed}).", "Develop it with the software of its maker, or with Adobe DNG "
        "Converter, to a linear DNG or 16-bit TIFF, and give that."),
    "file.rolled-off": Text(
        "Highlights", "Highlights were rolled off from {levels:levels} of full scale on "
        "({bands:listed}): the noise there is pressed together. What lies above counts as clipped.",
        "Develop the photo without highlight compression, filmic or recovery, or expose shorter."),
    "file.converted-colours": Text(
        "Negative colours", "{share:percent} of the picture are negative in {band}, down to "
        "{lowest:.1%} of white: the file holds a converted colour space, not camera signal.",
        "Give the camera's raw file, or develop it without conversion to a colour space (colour "
        "space raw or camera, no matrix)."),
    "photo.not-linear": Text(
        "Kind of file", "The photo is not linear: it was decoded as sRGB, and colour matrix and "
        "tone curve of the camera remain.", f"To measure, {RAW_INSTEAD}."),
    # regions
    "photo.not-registered": Text("Position of the camera", _not_registered),
    "region.uneven": Text(
        "Scatter of pixels", "Region “{subject}” is uneven: its pixels scatter by "
        "{scatter:percent0} beyond noise and even light, and its spectrum is the mean of what lies "
        "in it.", "Outline a smaller part for one paint.", "{scatter:percent0}",
        "{limit:percent0}"),
    "photo.of-regions": Text("Photo", lambda values: _photo_of_regions(values)),
    # the picture of spectra
    "picture.without-photo": Text(
        "Photos of the picture", "Photo “{subject}” shows no region of the first photo: the "
        "picture does without it."),
    "picture.photos": Text(
        "Photos of the picture", lambda values: "The signals of a pixel are those of "
        f"{len(values['names'])} photos, {', '.join(values['names'])}, in {values['bands']} "
        "bands."),
    "picture.fewer-photos": Text(
        "Photos of the picture", "{share:.1%} of the pixels have spectra from fewer photos: others "
        "are clipped or without signal there, do not show them, or show an edge whose position is "
        "not known as well."),
    "picture.light-converged": Text(
        "Light from other surfaces", "The picture's light from other surfaces has converged: of "
        "{rounds} rounds the last changed it by {last:.2%} at most."),
    "picture.light-not-converged": Text(
        "Light from other surfaces", "The picture's light from other surfaces has not converged: "
        "after {rounds} rounds it still changes by {last:.1%} in places; near strongly coloured "
        "surfaces its spectra are less certain than they say."),
    "picture.no-texture": Text(
        "Textures", lambda values: f"No texture of {', '.join(values['names'])}: several of their "
        "parts in the photo share texture coordinates."),
    # the table of a picture of spectra without a session, and its colours
    "uplift.table": Text(
        "Table of spectra", "Spectra of the table ({side} points a side) differ from those "
        "computed one by one by {median:.2f} CIEDE2000 in the median and {largest:.2f} at most; "
        "beyond {limit:g} are {beyond:percent} of the pixels.",
        "Take a larger table: --side {larger_side}.", "{largest:.2f}", "{limit:g}"),
    "uplift.colours-off": Text(
        "Colours of the pixels", "{pixels} of {of_pixels} pixels have spectra whose colour is more "
        "than {limit:g} CIEDE2000 from theirs.",
        "See which in delta_e00: no reflectance that was found has their colour.", "{pixels}"),
    # white and camera of a picture without a session
    "white.camera-explains-chart": Text(
        "Camera and light against the chart", "The chart's patches agree with camera and light "
        "within {value:percent} rms.", shown="{value:percent}", limit=RESIDUAL_LIMITS),
    "white.camera-unlike-chart": Text(
        "Camera and light against the chart", "The chart's patches are off by {value:percent0} rms "
        "from what this camera and light predict ({passes:percent0} is good, beyond "
        "{fails:percent0} is refused): the spectra err by more than their standard deviation "
        "says.", "Fit the camera to this chart (spectrabox camera fit) and give those curves, or "
        "measure the photo with spectrabox flat.", "{value:percent}", RESIDUAL_LIMITS),
    # exposure
    "photo.clipped": Text(
        "Clipping", "{clipped:percent} of the pixels are clipped.", "Expose 1.0 stops shorter.",
        "{clipped:percent}", "{limit:percent}"),
    "photo.dark": Text(
        "Exposure", "The brightest parts reach only {brightest:percent0} of saturation.",
        "Expose {stops:.1f} stops longer.", "{brightest:percent0}", "at least {least:percent0}"),
}

# ---- readings of instruments ---------------------------------------------------------------------

METERS: dict[str, Text] = {
    # how a reading ended
    "meter.measured": Text("Reading", "Measured."),
    "meter.low-light": Text(
        "Reading", "Measured, but the instrument says that the light is low: expect noise.",
        "Repeat, or use a wider aperture."),
    "meter.too-dark": Text(
        "Reading", "No reading: the light is too weak for this instrument; this is not a spectrum "
        "of zeros.", "Bring more light, a longer exposure or a wider aperture."),
    "meter.too-bright": Text(
        "Reading", "No reading: the light is too strong.",
        "Use a shorter exposure, a smaller aperture or a filter."),
    "meter.no-sync": Text(
        "Reading", "No reading: the instrument could not lock to the light's flicker.",
        "State its frequency, or switch sync off."),
    "meter.unsteady": Text(
        "Reading", "No reading: the light changed during the measurement.",
        "Let it warm up, then repeat."),
    # what to beware of
    "meter.warning": Text("Warning of the instrument", "Warning {number}: {meaning}."),
    "meter.negative-values": Text(
        "Noise", "{negative} of {values} values between 400 and 700 nm are negative: the light is "
        "near the instrument's noise."),
    "meter.no-luminance": Text(
        "Luminance", "The instrument reports no luminance: the spectrum was not checked against "
        "it."),
    "meter.not-calibrated": Text(
        "Calibration of the instrument", lambda values: "No " + " and ".join(values["missing"])
        + " calibration was made before this reading: it rests on the one that the instrument "
        "had."),
    "meter.noted": Text("Note", "{note}"),
    # of a series
    "meter.drift": Text(
        "Drift", "The light drifts by {drift:+.1%} ± {error:.1%} over the series.",
        "Let it warm up, then start again.", "{drift:+.1%}", "{limit:percent}"),
    "meter.readings-empty": Text(
        "Readings without a spectrum", lambda values: f"{values['empty']} of {values['readings']} "
        f"readings gave no spectrum. {METERS[values['outcome']].sentence}",
        lambda values: str(METERS[values["outcome"]].remedy)),
}

# ---- flat samples --------------------------------------------------------------------------------

def _left_out(sentence: Template, remedy: str, shown: str = "") -> Text:
    """Of a known region that contradicts the photo."""
    return Text("Known region left out of the calculation", lambda values:
                f"{_filled_with(sentence, values)}: it was left out of the calculation, and says "
                "nothing of the light.", remedy, shown, "none")


FLAT: dict[str, Text] = {
    "flat.right": Text("", lambda values: "Chart, light and regions show no fault."
                       + _weak_words(values)),
    "flat.light-change": Text(
        "Change of the light from the chart to the regions", "The light changes by {value:percent} "
        "between chart and regions, which is corrected within its error.", shown="{value:percent}",
        limit="corrected"),
    "flat.known-level": Text(
        "Level of known regions against the chart's light", "The level of “{subject}”, of known "
        "spectrum, is {value:.1f} standard errors from what the chart's light gives.",
        lambda values: "Check its stated reflectance, and for a shadow on it or on the chart."
        if values["beyond"] else "", "{value:.1f} standard errors", "pass up to {passes:.0f}"),
    "flat.known-other-level": _left_out(
        "“{subject}” is stated to reflect {stated:.2f} and reads {read:.2f} in the chart's "
        "light{where}, {errors:.0f} standard errors away",
        "State the right reflectance, or take chart and samples under one light, without a shadow "
        "on either.", "{errors:.0f} standard errors"),
    "flat.known-other-colour": _left_out(
        lambda values: f"“{values['subject']}” reads {words.percent(abs(values['off']), 0)} "
        f"{'less' if values['off'] < 0 else 'more'} in band {values['band']} than its stated "
        f"spectrum gives in the chart's light{values['where']}: that is another's, or chart and "
        "samples were photographed under different light",
        "Correct the stated spectrum, or take both under one light.", "{off:+.0%}"),
    "flat.known-clipped": _left_out(
        "“{subject}” is saturated in every band",
        "Expose less, or outline a part of it without reflections."),
    "flat.known-on-chart": _left_out(
        "“{subject}” lies on the chart, whose patches are used already and say nothing of the "
        "light on the samples",
        "Outline a white card beside the samples, or remove this one."),
    "flat.scatter": Text(
        "Scatter of pixels beyond noise and light", lambda values:
        f"The pixels of “{values['subject']}” scatter by {words.percent(values['value'])} beyond "
        "noise and even light" + (", more than one paint does: its spectrum is the mean of several."
                                  if values["beyond"] else "."),
        lambda values: "Outline a part of one paint." if values["beyond"] else "",
        "{value:percent}", "pass up to {passes:percent0}"),
    "flat.no-edge": Text("Edges inside regions", "No region holds an edge.", shown="none",
                         limit="none"),
    "flat.edge": Text(
        "Edge inside a region", lambda values: _edge_sentence(values),
        lambda values: "Outline one side of it." if values["larger_part_px"] is None else
        f"Outline its larger part, rect {values['larger_part_px']}.", "{value:percent0}", "none"),
    # of a sample in photos with the lamp in two places
    "lamp.image-mirrored": Text(
        "Gloss", lambda values: f"“{values['subject']}” mirrors {100 * values['share']:.0f} % of "
        f"white more in “{values['more']}” than in “{values['less']}”, as the image of a lamp or a "
        "window does.", "Leave it out of “{more}” (regions.NAME.photo), or move the lamp."),
    "lamp.unexplained": Text(
        "Photos that disagree", "“{subject}” is {off:+.0%} in {band} of “{one}” against “{other}”, "
        "which neither gloss nor level explains: it moved between the photos, a shadow's edge lies "
        "on it, or something coloured is mirrored in it."),
    "lamp.gloss": Text(
        "Gloss", lambda values: f"“{values['subject']}” mirrors {100 * values['share']:.1f} ± "
        f"{100 * values['error']:.1f} % of white more in “{values['more']}” than in "
        f"“{values['less']}”: gloss."),
    "lamp.darker": Text(
        "Shadow or plane", lambda values: f"“{values['subject']}” is {100 * values['share']:.0f} ± "
        f"{100 * values['error']:.0f} % darker beside the chart in “{values['dark']}” than in "
        f"“{values['right']}”: a shadow on it there, or it does not lie in the chart's plane."),
    "flat.clipped": Text(
        "Clipped parts of the photo", lambda values: f"{words.percent(values['value'])} of "
        f"{_the_photo(values, 'photo')} is clipped, none of it in a region.",
        shown="{value:percent}", limit="pass up to {passes:percent0}"),
}

EDGES = {"SHADOW": "in all bands alike: a shadow's edge or a fold, or two greys",
         "PAINTS": "in each band by its own ratio: two paints",
         "ONE_BAND": "a shadow's edge, a fold or two paints"}


def _weak_words(values: Mapping[str, Any]) -> str:
    """Of how many surfaces the colour is known weakly, after the sentence of a PASS."""
    weak = len(values.get("weak", ()))
    return f" The colours of {weak} of {values['surfaces']} are known weakly." if weak else ""


def _the_photo(values: Mapping[str, Any], first: str) -> str:
    return f"the photo “{values['photo']}”" if values["photo"] else f"the {first}"


def _edge_sentence(values: Mapping[str, Any]) -> str:
    (x0, y0), (x1, y1) = values["line_px"]
    low, high = (words.percent(values[key], 0) for key in ("smallest_step", "value"))
    photo = values["photo"] and f", photo {values['photo']}"
    return (f"An edge runs across “{values['subject']}”{photo}, from ({x0:.0f}, {y0:.0f}) to "
            f"({x1:.0f}, {y1:.0f}), by {high if low == high else f'{low} to {high}'}, "
            f"{EDGES[values['kind']]}.")


# ---- scenes --------------------------------------------------------------------------------------

BEYOND_CHANCE = "Surfaces beyond chance and stated errors (p < {chance:g}){where}"
NONE_BEYOND = "none; fail beyond {fails:percent0}"
PASS_AND_FAIL = "pass up to {passes:percent0}, fail beyond {fails:percent0}"

LINEARITY = "Power to which the photo raises ratios of light at edges of one paint{where}"
MAX_EDGES = 3           # that a sentence names


def _part(part: dict[str, Any]) -> str:
    """What was estimated of a scene, in words."""
    size, error = part["size"], part["error"]
    if part["what"] == "lamp":
        return f"the lamp is {size:.2g} ± {error:.1g} (scene's unit) from where it is stated"
    if part["what"] == "camera":
        return f"the camera is turned by {size:.2f} ± {error:.2f} degrees"
    if part["what"] == "beam":
        return (f"the lamp's beam varies by {words.percent(size)} ± {words.percent(error)} over "
                "the scene")
    return (f"the lens darkens the corners of the photo by {words.percent(size)} ± "
            f"{words.percent(error)}")


def _edges(edges: list[dict[str, Any]]) -> str:
    """The edges that tell of a photo's linearity, in words."""
    return "; ".join(f"{' / '.join(edge['surfaces'])} {edge['photo']:.2f} in the photo, "
                     f"{edge['rendering']:.2f} in the rendering" for edge in edges[:MAX_EDGES])


SCENES: dict[str, Text] = {
    "scene.right": Text("", lambda values: "Photo, rendering and calibration agree within the "
                        "limits." + _weak_words(values)),
    "fit.of-scene": _fit("Inverse rendering"),
    "fit.determined": Text(
        "What the photo decides", "Of the {coefficients} coefficients of “{subject}” the photo "
        "decides {by_photo}: {by_colour} by the surface's own colour, {by_interreflection} only by "
        "interreflection. {by_prior} are left to the prior."),
    "fit.lights-corrected": Text(
        "Brightness of the lights{where}", lambda values: "The fit makes the lights"
        f"{values['where']} brighter or darker than the scene says, by the factors "
        + ", ".join(f"{light} {factor:.3g}" for light, factor in values["factors"].items()) + "."),
    "fit.bands-mixed": Text(
        "Mixing of the bands{where}", lambda values: "The fit mixes the bands"
        f"{values['where']}, as colour processing does, from {' '.join(values['bands'])}: "
        + "; ".join(f"{band} = {' '.join(f'{share:+.2f}' for share in row)}"
                    for band, row in zip(values["bands"], values["mixing"], strict=True)) + "."),
    "fit.gradient-engine": Text(
        "Engine", lambda values: f"The gradient engine was chosen, since {_quoted(values['names'])}"
        f" {'is' if len(values['names']) == 1 else 'are'} coated or glossy: such light is no plain "
        "product of reflectances, as the transport engine needs."),
    "fit.descent-ended": Text(
        "Steps of the descent", "The descent stopped after {steps} of at most {limit} steps: its "
        "error no longer fell by more than its noise."),
    "scene.shifted": Text(
        "Position of the photo{where}", "The photo{where} is shifted against the scene by "
        "{right_px:+.1f} pixels to the right and {down_px:+.1f} down, of {width_px} across: its "
        "edges then agree with a correlation of {correlation:.2f}, unmoved {unmoved:.2f}.",
        "Check the camera's pose, and whether the photo was cropped."),
    "scene.agreement": Text("Photo against rendering{where}",
                            lambda values: _agreement_sentence(values)),
    "scene.not-linear": Text(
        LINEARITY, lambda values: f"The photo is not linear{values['where']}: "
        + (f"where surfaces of one paint meet, it shows ratios of light to the power "
           f"{values['value']:.2f} ± {values['error']:.2f} ({_edges(values['edges'])}). A tone "
           "curve does that, and no lamp." if values["edges"] else
           f"it shows ratios of light over the scene to the power {values['value']:.2f} ± "
           f"{values['error']:.2f}, with lamp, beam and lens left free. A tone curve does that."),
        f"To measure, {RAW_INSTEAD}.",
        "{value:.2f} ± {error:.2f}", "1 of a linear photo"),
    "scene.linear": Text(
        LINEARITY, "Where surfaces of one paint meet{where}, the photo shows ratios of light to "
        "the power {value:.2f} ± {error:.2f}.", shown="{value:.2f} ± {error:.2f}",
        limit="1 of a linear photo"),
    "scene.estimated": Text(
        "Lamp, lens and camera, estimated from the photo", lambda values:
        f"Photo and scene disagreed{values['where']}, so the scene was estimated with the "
        "surfaces: "
        + ("; ".join(_part(part) for part in values["parts"] if part["named"])
           or "no single part of it is certainly off") + ".",
        "To measure them: 'spectrabox geometry light', 'geometry beam', 'geometry pose', a flat "
        "field.", lambda values: "; ".join(map(_part, values["parts"]))),
    "scene.median": Text(
        "Photo against rendering, |ratio − 1| of the worst band, median over surfaces{where}",
        "Half of the surfaces agree with the photo within {value:percent} in every band{where}.",
        shown="{value:percent}", limit=PASS_AND_FAIL),
    "scene.median-unknown": Text(
        "Photo against rendering, |ratio − 1| of the worst band, median over surfaces{where}",
        "No surface could be compared with the photo{where}.", shown="not measured",
        limit=PASS_AND_FAIL),
    "scene.worst": Text(
        "Photo against rendering, worst surface{where}", lambda values:
        f"The surface “{values['subject']}”{values['where']} "
        f"{'does not fit' if values['beyond'] else 'fits least'}: in band {values['band']} the "
        f"photo is {words.deviation_words(values['ratio'])} than the rendering.",
        shown="{value:percent}", limit=PASS_AND_FAIL),
    "scene.worst-unknown": Text(
        "Photo against rendering, worst surface{where}", "The worst surface{where} is unknown.",
        shown="not measured", limit=PASS_AND_FAIL),
    "scene.fits": Text(
        BEYOND_CHANCE, "No surface{where} is off by more than chance and stated errors explain.",
        shown="none", limit=NONE_BEYOND),
    "scene.misfit": Text(
        BEYOND_CHANCE, lambda values: _misfit_sentence(values),
        "Check its light, position and paint, and for gloss.", "{value:percent}", NONE_BEYOND),
    "scene.more-misfits": Text(
        BEYOND_CHANCE, lambda values: f"{len(values['names'])} more do not fit"
        f"{values['where']}: {words.listed(values['names'])}.", shown="{value:percent}",
        limit=NONE_BEYOND),
    "scene.each-by-its-own": Text(
        BEYOND_CHANCE, "{count} of {compared} surfaces do not fit{where}, each by another factor.",
        "Check the pose of the camera, the lamp's position and the sizes of the scene before the "
        "surfaces.", "{value:percent}", NONE_BEYOND),
    "scene.one-factor": Text(
        BEYOND_CHANCE, lambda values: _count_of_misfits(values) + "all are off by one factor (the "
        f"photo is {words.deviation_words(values['ratio'])}).",
        "Check exposure, the lamp's strength and the known reflectance.", "{value:percent}",
        NONE_BEYOND),
    "scene.factor-of-bands": Text(
        BEYOND_CHANCE, lambda values: _count_of_misfits(values) + "all are off by the same factor "
        "in each band (" + ", ".join(f"{band} {words.signed_percent(ratio - 1)}"
                                     for band, ratio in values["ratios"].items()) + ").",
        "Check the spectrum of the light and the camera's curves.", "{value:percent}", NONE_BEYOND),
    "scene.patterns": Text(
        "Surfaces beyond chance and stated errors (p < {chance:g})",
        "One spectrum for each material does not fit {names:listed}. It cannot fit those with "
        "patterns, and the picture, with a spectrum for every pixel, does not rest on it.",
        "Of plain surfaces check light, position and paint.", "{value:percent}", "none"),
    "scene.known-level": Text(
        "Level of the light on known surfaces against the chart's{where}", lambda values:
        f"On {_quoted(values['names'])}, of known spectrum, the light is "
        f"{words.deviation_words(values['ratio'])} than chart, positions and exposures give"
        f"{_doubted(values)}.", lambda values: KNOWN_REMEDY if values["beyond"] else "",
        "{size:percent}, {value:.1f} standard errors", "pass up to {passes:.0f} standard errors"),
    "scene.known-colour": Text(
        "Colour of the light on known surfaces against the chart's{where}", lambda values:
        f"On {_quoted(values['names'])} the light of a band is up to "
        f"{words.percent(values['size'])} off the colour that the chart's photo gives"
        f"{_doubted(values)}.", lambda values: KNOWN_REMEDY if values["beyond"] else "",
        "{size:percent}, {value:.1f} standard errors", "pass up to {passes:.0f} standard errors"),
    "scene.rehearsed": Text(
        "Known truth inside the band, rehearsed; worst material", lambda values:
        f"Rehearsed {values['times']} times with known truths, the {values['intended']:.0%} band "
        f"of the worst material ({values['subject']}) holds {values['value']:.1%}: "
        + ("too narrow for this session." if values["beyond"] else "as stated."),
        shown="{value:percent}", limit="{intended:percent} intended"),
    "scene.clipped": Text(
        "Clipped pixels, left out of the fit", lambda values: f"{words.percent(values['value'])} "
        f"of {_the_photo(values, 'object photo')} is clipped and was left out.",
        shown="{value:percent}", limit="pass up to {passes:percent0}"),
    "scene.surface-off": Text(
        "Photo against rendering", "Photo and rendering disagree on {subject} by {value:+.0%} in "
        "band {band}: geometry, light or material of this surface is not as the scene says."),
    "scene.left-out": Text(
        "Left out of the scene", "The <{element}> “{subject}” of the scene states "
        "{parameters:listed}, which is not kept.",
        "Where it changes the picture, take it out of the photo or of the scene."),
    "scene.lights": Text("Lights of the scene", lambda values: _lights_sentence(values)),
    "scene.no-flat-field": Text(
        "Vignetting", "No flat-field photo: vignetting is not corrected and counts as "
        "reflectance."),
    "scene.level-by-prior": Text(
        "Level of the light, by what is expected of surfaces", "Neither a chart nor a known "
        "material tells the level of the light; what is expected of surfaces, and the light "
        "between them, tell it within {value:percent}. Every spectrum may be brighter or darker by "
        "that much, all of them together.",
        "Give one material its spectrum, or photograph a grey card or a chart in the scene.",
        "{value:percent}", "pass up to {passes:percent0}"),
    "scene.scale-of-known": Text(
        "Light scale", "The light scale rests on the spectrum given for a known material."),
}

KNOWN_REMEDY = ("Check its stated spectrum, its place in the scene, and lamp and exposure of both "
                "photos.")


def _lights_sentence(values: Mapping[str, Any]) -> str:
    stated = [f"{name} {strength:.3g}" for name, strength
              in zip(values["names"], values["strengths"], strict=True)
              if name not in values["given"]]
    said = []
    if stated:
        said.append("relative strengths as the scene states them: " + ", ".join(stated)
                    + "; one common scale is estimated")
    if values["coloured"]:
        said.append(f"{words.listed(values['coloured'])} in the colour that the scene states "
                    "beside the strongest")
    if values["given"]:
        said.append(f"spectrum given of {words.listed(values['given'])}")
    return f"The scene has {len(values['names'])} lights; " + "; ".join(said) + "."


def _quoted(names: list[str]) -> str:
    return words.listed([f"“{name}”" for name in names])


def _agreement_sentence(values: Mapping[str, Any]) -> str:
    """Where photo and rendering disagree and by how much."""
    compared, off = values["compared"], values["off"]
    if not compared:
        return (f"No surface could be compared{values['where']}, so nothing is known of how well "
                "the rendering fits the photo.")
    missing = values["not_compared"]
    unknown = f" Not compared in every band: {words.listed(missing)}." if missing else ""
    if not off:
        return (f"On all {compared} compared surfaces photo and rendering agree within "
                f"{words.percent(values['largest'])} in every band{values['where']}.{unknown}")
    named = words.listed([f"“{row['surface']}” (photo {words.deviation_words(row['ratio'])} in "
                          f"{row['band']})" for row in off])
    suspects = ("all bands are off by the same factor: geometry, light position or shadow is the "
                "first suspect, not the spectrum." if values["all_bands_alike"] else
                "the bands differ: the spectrum of this surface, or of the light it gets, is the "
                "first suspect.")
    return (f"On {compared - len(off)} of {compared} compared surfaces photo and rendering agree "
            f"within {words.percent(values['limit'], 0)} in every band{values['where']}. They "
            f"disagree on {named}. On “{off[0]['surface']}” {suspects}{unknown}")


def _doubted(values: Mapping[str, Any]) -> str:
    return f", {values['value']:.1f} standard errors" if values["beyond"] \
        else ", which is corrected"


def _misfit_sentence(values: Mapping[str, Any]) -> str:
    level = ", ".join(f"{words.deviation_words(1 + off)} in {band}"
                      for band, off in values["level"].items())
    said = [f"the photo is {level} than the rendering"] if level else []
    if values["scatter"]:
        said.append(f"its parts differ among themselves by {words.percent(values['scatter'], 0)}")
    if values["part"]:
        said.append(f"a part of it is {words.deviation_words(1 + values['part'])}")
    p = f"p = {values['p']:.1g}" if values["p"] > 1e-6 else "p < 1e-6"
    return (f"{values['subject']} does not fit{values['where']}: {'; '.join(said)} ({p} after "
            "Holm's correction).")


def _count_of_misfits(values: Mapping[str, Any]) -> str:
    return (f"{values['count']} of {values['compared']} surfaces do not fit{values['where']}, and ")


# ---- surfaces and their draws --------------------------------------------------------------------


def _distance(values: Mapping[str, Any]) -> str:
    """How near spectra come to a signal that they do not give."""
    if "distance" not in values:        # of what was stored before it was measured
        return " and come as near to it as they can"
    nearest = ", ".join(f"{value:.3f}" for value in values["nearest"])
    return (f". The nearest that can be reached is {nearest} of white, up to "
            f"{values['distance']:.3f} off, and the signal is taken to err by as much")


def _of_sampler(said: str, surface: str) -> str:
    return f"Sampler of “{surface}”: {continued(said)}" if surface else said


def _ended(said: str) -> Text:
    """How draws ended, of the surface that is the subject, or of one that need not be named."""
    return Text("Sampler", lambda values: _of_sampler(
        _filled_with(said, {"reached": _distance(values), **values}), values["subject"]),
                shown="with a reservation", limit="as intended")


TESTED_ON = {"libraries": "measured libraries", "models": "models, no measured library",
             "own-model": "its own model, not left out, no measured library"}


def _tested_family(row: Mapping[str, Any]) -> str:
    """What bands held of one family."""
    if row["on"] is None:
        return f"{row['name']} was not tested"
    return (f"{row['name']} {100 * row['coverage']:.1f} % at a mean width of {row['width']:.3f} "
            f"({TESTED_ON[row['on']]})")


def _doubtful_camera(values: Mapping[str, Any]) -> str:
    code = values["code"]
    return ("The camera's fit is doubtful: "
            + says(Finding(code, Severity.WARN, values["subject"], values["doubt"])))


def _capital(said: str) -> str:
    return said[:1].upper() + said[1:]


def _families(values: Mapping[str, Any]) -> str:
    allowed = ", ".join(f"{name} {100 * share:.0f} %" for name, share in values["shares"].items())
    if not values["stated"]:
        return f"No family of surfaces was stated; the signal allows {allowed}."
    given = f"Conditional on the surface being {' or '.join(values['stated'])}, as stated"
    return f"{given}: {allowed}." if len(values["stated"]) > 1 else f"{given}."


LIGHT_REMEDY = ("Put the chart or a white card next to it, or photograph a white card in the "
                "samples' place as flat field.")

SURFACES: dict[str, Text] = {
    "draws.intended": Text(
        "Samplers", lambda values: f"Sampler of every estimated surface: "
        f"{continued(OUTCOMES[values['outcome']])}", shown="as intended", limit="as intended"),
    **{f"draws.{outcome}": _ended(said) for outcome, said in OUTCOMES.items()},
    # of a signal by itself
    "signal.no-white": Text(
        "White of the signal", "No white was stated (--white, white=): the signal is taken as "
        "relative to a perfect white, which values of a raw photo are not."),
    "signal.no-noise": Text(
        "Noise of the signal", "No noise was stated (--noise, noise=): the signal is taken as "
        "exact, and the band is narrower than a photo's."),
    "signal.of-srgb": Text(
        "Kind of signal", "An sRGB colour is what a camera's processing or a designer made: these "
        "are spectra of surfaces that would look so in daylight, not of what was photographed."),
    "signal.srgb-nearly-black": Text(
        "Scale of the signal", "R, G, B are taken with 255 for white, so that this colour is "
        "nearly black.", "Multiply them by 255 where white is 1."),
    "signal.xyz-nearly-black": Text(
        "Scale of the signal", "X, Y, Z are taken with Y = 100 for white, so that this colour is "
        "nearly black.", "Multiply them by 100 where white has Y = 1."),
    "camera.errors-not-used": Text(
        "Errors of the camera's curves", lambda values: "The camera's curves have standard errors "
        f"({100 * values['error']:.2g} % of the highest peak, root mean square), which are not "
        "used here: the band is narrower than they make it.", "State an error of each curve "
        "(--sensitivity-error, sensitivity_error=), or measure by the chart of the photo itself "
        "(spectrabox flat)."),
    "camera.doubtful": Text("Fit of the camera", lambda values: _doubtful_camera(values)),
    "reading.hard-to-believe": Text(
        "Further measurement", lambda values: f"{_capital(values['subject'])} is hard to believe "
        f"beside the others: {values['value']:.3g} was measured and {values['expected']:.3g} ± "
        f"{values['error']:.2g} expected."),
    "families.tested": Text("Tested on unseen surfaces", lambda values: (
        "Tested on unseen surfaces, the 95 % bands held the true spectrum at this share of "
        "wavelengths: " + "; ".join(map(_tested_family, values["families"])) + ".")),
    "families.none-alike": Text(
        "Tested on unseen surfaces",
        "No certificate of a family: no library that was judged has colours like this one."),
    "families.smoothness": Text(
        "Tested on unseen surfaces",
        "No certificate: bands of the smoothness prior were never judged."),
    "draws.of-families": Text("Families of surfaces", lambda values: _families(values)),
    "band.gaussian-errors": Text(
        "Signal errors", lambda values: "Assumes Gaussian signal errors of "
        + ", ".join(f"{100 * error:.2g}" for error in values["errors"]) + " % of white."),
    "band.sampler": Text(
        "Prior and sampler", "Prior and sampler: {method}; exact bounds: of splines of "
        "{coefficients} coefficients between 0 and 1."),
    "band.prior-and-sampler": Text(
        "Prior and sampler", "Conditional on the prior and sampler {method}."),
    "band.closed-form": Text(
        "Prior", "Conditional on the prior {method}, computed in closed form."),
    "surface.known-to": Text(
        "How well it is known", lambda values: f"“{values['subject']}”: colour within ΔE00 "
        f"{values['colour']:.1f}, spectrum within {values['spectrum']:.2f} (rms), with a "
        f"probability of {words.percent(values['level'], 0)}" + (
            f". The colour is known weakly; {values['cause']} makes "
            f"{words.percent(values['share'], 0)} of the spectrum's variance."
            if values["weak"] else "."),
        lambda values: LIGHT_REMEDY if values["weak"] and values["by_light"] >= values["share"]
        else "", "ΔE00 {colour:.1f}, {spectrum:.3f}"),
    "colours.distinct": Text(
        "Two colours", "The camera tells these colours apart: their signals differ by {value:.1f} "
        "standard errors ({needed:.1f} are needed)."),
    "colours.alike": Text(
        "Two colours", "The camera cannot tell these colours apart: their signals differ by "
        "{value:.1f} standard errors, and {needed:.1f} are needed. Under another light they may "
        "still look different."),
    "match.none": Text(
        "Match", "None of {spectra} spectra fits: the nearest, {nearest}, misses the signal by "
        "{misfit:.1f} standard errors. It is another material, a mixture, or varies more than "
        "stated (variation)."),
    "match.another-likelier": Text(
        "Match", "{fits} of {spectra} spectra would pass, but another surface is more likely "
        "(probability {probability:.3f} at even odds)."),
    "match.one": Text("Match", "Of {spectra} spectra only {nearest} gives this signal."),
    "match.several": Text(
        "Match", "{fits} of {spectra} spectra give this signal and cannot be told apart.",
        "A photo under another light may part them (spectrabox advise)."),
    "surface.untested": Text(
        "band of untested coverage", "The band of “{subject}” is of untested coverage: most of "
        "what it may be ({families:listed}) was judged on models alone, held too seldom, or not "
        "judged."),
    "truth.not-given": Text(
        "Measured truth inside the band", "No measured spectrum was given to compare with.",
        shown="no truth given", limit="its level"),
    "truth.held": Text(
        "Measured truth inside the band", "Over {tested} surfaces with a measured spectrum, the "
        "band holds it at {value:percent} of wavelengths; {intended:percent} is intended.",
        shown="{value:percent}", limit="{intended:percent} intended"),
    "truth.possible": Text(
        "Measured truth from the mean", "Every stated truth can be that of its surface.",
        shown="{value:.1f} standard deviations", limit="pass up to {passes:.0f}"),
    "truth.of-another": Text(
        "Measured truth from the mean", "The stated truth disagrees with every band of "
        "“{subject}”: it lies {value:.1f} standard deviations from the mean (rms over "
        "wavelengths).", "Check that it is of this surface.", "{value:.1f} standard deviations",
        "pass up to {passes:.0f}"),
}



# ---- conditions: what a result rests on ----------------------------------------------------------

# name of the condition; how it is known; what would measure it; what its failing costs
MOVED_LAMP = "one more photo with the lamp moved"


def _condition(name: str, to_measure: Template = "", holds: Template = "") -> Text:
    return Text(name, lambda values: _filled_with(KNOWN_BY[values["known_by"]], values), to_measure,
                lambda values: _cost(values), holds=holds)


CONDITIONS: dict[str, Text] = {
    "condition.light": _condition(
        "light on the sample", "a white card beside the samples, with its measured reflectance",
        lambda values: f"{_quoted(values['names'])} as bright as stated"
        if values["known_by"] == "known-typed" else "lamp and shutter repeated"),
    "condition.plane": _condition(
        "plane", f"a white card in the samples' plane, or {MOVED_LAMP}", "in the chart's plane"),
    "condition.gloss": _condition("gloss", MOVED_LAMP, "matt"),
    "condition.scene-gloss": _condition("gloss", MOVED_LAMP,
                                        "the surfaces are as matt as the scene says"),
    "condition.shadow": _condition("shadow", MOVED_LAMP, "in no shadow"),
    "condition.fluorescence": _condition("fluorescence", "an instrument that reads without UV",
                                         "without brighteners"),
    "condition.linearity": _condition(
        "linearity", lambda values: "a raw photo" if values["known_by"] == "tone-curve" else
        "further exposures of the samples, or a chart with grey patches",
        "with signals in proportion to light"),
    "condition.chart": _condition("chart", "the reflectances of this very chart, from a meter",
                                  "with a chart like its reference"),
    "condition.camera": _condition("camera"),
    "condition.scene-light": _condition(
        "light on the scene", "a grey card in the photo of the scene", "lamp and shutter repeated"),
    "condition.light-place": _condition("light place", "a grey card in the photo of the scene",
                                        "lamp and chart stand as stated"),
    "condition.geometry": _condition("geometry"),
}

KNOWN_BY: dict[str, Template] = {
    "known-regions": "known regions: {names:listed}",
    "known-beside": "known regions beside the samples",
    "known-typed": "{names:listed}, of a reflectance that was stated and not measured",
    "chart-apart": "the chart in a photo of its own",
    "flat-field": "the chart and a flat field",
    "chart-carried-on": "the chart's patches, carried on to the regions",
    "no-photo": "no photo shows it",
    "lamp-moved": "the photo with the lamp moved",
    "surfaces-stated": "{names:listed}",
    "taken-as-matt": "nothing stated: taken as matt to {usual:percent0}",
    "tone-curve": "a tone curve undone as sRGB",
    "exponent": lambda values: words.listed([
        _filled_with(WAYS[way], values) for way in values["ways"]]),
    "nothing": "nothing",
    "own-reflectances": "a file of its own reflectances",
    "copies": lambda values: f"the photo: {values['edition']}{_how_told(values)}, white "
                             f"{100 * values['white']:+.0f} % against its copies",
    "reference": "the reference stated, published, not of this copy",
    "published": "published reflectances, not of this copy",
    "curves": "{source}",
    "curves-of-file": "curves of a file",
    "fitted": "fitted to the chart",
    "known-materials": lambda values: f"the spectrum given for {_quoted(values['names'])}"
                       if values["names"] else "a material of known spectrum",
    "chart-in-photo": "the chart in the photo itself",
    "expected-surfaces": "what is expected of surfaces, and the light between them",
    "stated-errors": "stated errors of lamp and shutter",
    "as-stated": "lamp and chart stand as stated",
    "scene": "the scene's measures",
    "estimated": "estimated: {names:listed}",
}
WAYS: dict[str, Template] = {
    "greys": "the chart's greys: exponent {exponent:.3f} ± {exponent_error:.3f}",
    "exposures": "several exposures", "dark-frames": "dark frames"}
FAULTS: dict[str, Template] = {
    "": "",
    "dimmer": "{fault_size:percent} less light",
    "dimmer-by-error": "less light by twice that error",
    "mirrored": "{fault_size:percent} of the light mirrored",
    "emitted": "{fault_size:percent} of white emitted at {fault_nm:.0f} nm",
    "bent": "exponent off by {fault_size:.3f}",
    "other-copy": "its level off by {fault_size:percent}",
}


def _how_told(values: Mapping[str, Any]) -> str:
    """Whether the photo tells the edition that its chart is taken to be of, in brackets."""
    if values["nats"] is None:
        return ""
    if values["told"] is None:
        return " (as most are: the photo tells too little)"
    nats = f"by {abs(values['nats']):.1f} nats"
    return f" (told {nats})" if values["as_told"] else \
        f" (as most are, though the photo says {values['told']}, {nats})"


def _cost(values: Mapping[str, Any]) -> str:
    """What the answer loses if a condition fails."""
    happens = _filled_with(FAULTS[values["fault"]], values)
    parts = [f"{happens}: {of} {values[key]:+.1f}".replace("-", "−")
             for key, of in (("lightness", "L*"), ("b_star", "b*")) if values[key] is not None]
    if values["variance_share"] is not None:
        parts.append(f"{words.percent(values['variance_share'], 0)} of the variance")
    return "; ".join(parts)


# ---- what to do next -----------------------------------------------------------------------------

def _action(short: str, says: str, cost: str = "one photo") -> Text:
    """What can be done: in a few words, in a sentence, and what it takes."""
    return Text(short, lambda values: _filled_with(says, values) + _exposed(values), shown=cost)


def _exposed(values: Mapping[str, Any]) -> str:
    """Exposure to add to further photos, and the bands that they leave dark."""
    stops, dark = values.get("stops", ()), values.get("dark", ())
    longer = " and ".join(f"{each:+.1f}" for each in stops)
    return (f" It lets less light through: expose {longer} stops." if stops else "") + (
        f" Dark: band {', '.join(map(str, dark))} of the further bands." if dark else "")


def _reading_at(values: Mapping[str, Any]) -> str:
    return str(values["subject"]) or "the wavelength that tells most of it"


ADVICE: dict[str, Text] = {
    "advice.white-card": _action(
        "a white card beside the sample", "Lay a white card of known reflectance beside the "
        "sample, in its plane, and photograph again."),
    "advice.chart-nearer": _action("the chart right beside the sample", "Put the chart right "
                                   "beside the sample and photograph again."),
    "advice.flat-field": _action("a flat field", "Photograph an evenly lit white card in the "
                                 "sample's place as flat field."),
    "advice.lamp-moved": _action("a photo with the lamp moved", "Photograph once more with the "
                                 "lamp in another place."),
    "advice.gel": _action("a photo through {subject}", "Photograph once more through {subject}."),
    "advice.two-gels": _action("a photo each through {subject}",
                               "Photograph twice more, through {subject}.", "two photos"),
    "advice.second-lamp": _action("a photo under {subject}",
                                  "Photograph once more under {subject}."),
    "advice.reading": Text(
        lambda values: f"{'a reading' if values['subject'] else 'a reading of each'} at "
        f"{_reading_at(values)}", lambda values:
        f"Read {'the sample' if values['subject'] else 'each surface'} at {_reading_at(values)} "
        "with an instrument.",
        shown=lambda values: "one reading" if values["times"] == 1
        else f"{values['times']} readings"),
    "advice.matt": _action("stating that it is matt", "State that the sample is matt, if it is.",
                           "no photo"),
    "extra.failed": Text("{subject}", "No {subject}: {error}.",
                         "Everything else stands, and --debug shows where it failed."),
}

TEXTS: dict[str, Text] = {**CHART, **CALIBRATION, **PHOTOS, **METERS, **FLAT, **SCENES, **SURFACES,
                          **CONDITIONS, **ADVICE}


# ---- how a finding is shown ----------------------------------------------------------------------

def name(finding: Finding) -> str:
    """What was looked at, as the heading of a row."""
    return _filled(TEXTS[finding.code].name, finding)


def sentence(finding: Finding) -> str:
    """What was found."""
    return _filled(TEXTS[finding.code].sentence, finding)


def remedy(finding: Finding) -> str:
    """What to do about it; empty where nothing is."""
    return _filled(TEXTS[finding.code].remedy, finding)


def says(finding: Finding) -> str:
    """What was found and what to do about it."""
    return " ".join(filter(None, [sentence(finding), remedy(finding)]))


def reasons(findings: Iterable[Finding]) -> list[str]:
    """What each fault says, in their order."""
    return [says(one) for one in faults(findings)]


def paragraph(findings: Iterable[Finding]) -> str:
    """The sentences of several."""
    return " ".join(map(sentence, findings))


def shown(finding: Finding) -> str:
    """Its value as a table shows it."""
    return _filled(TEXTS[finding.code].shown, finding)


def limit(finding: Finding) -> str:
    """Up to where it passes, as a table shows it."""
    return _filled(TEXTS[finding.code].limit, finding)


def is_tested(finding: Finding) -> bool:
    """Whether it is a row of a table of what was tested: a value with a limit."""
    return bool(TEXTS[finding.code].limit)


def holds(condition: Finding) -> str:
    """How a verdict names a condition after "if"."""
    return _filled(TEXTS[condition.code].holds, condition)


def fault(condition: Finding) -> str:
    """A fault of a condition as it happens."""
    return _filled(FAULTS[condition.values["fault"]], condition)


def conditions(named: Sequence[Finding]) -> str:
    """Conditions as the end of "PASS if ..."; empty without any."""
    return words.listed([holds(one) for one in named]) if named else ""


def continued(said: str) -> str:
    """A sentence of ours after a colon."""
    return said[0].lower() + said[1:]


def facts(finding: Finding) -> dict[str, Any]:
    """For JSON: code and values beside the sentences (docs/reference/json.md)."""
    return {"code": finding.code, "severity": finding.severity.name.lower(),
            "subject": finding.subject, "values": dict(finding.values), "name": name(finding),
            "sentence": sentence(finding), "remedy": remedy(finding), "shown": shown(finding),
            "limit": limit(finding)}


class _Formatter(string.Formatter):
    """`str.format` with the specifications of this module."""

    def format_field(self, value: Any, format_spec: str) -> str:
        if format_spec == "percent":
            return words.percent(value)
        if format_spec.startswith("percent"):
            return words.percent(value, int(format_spec.removeprefix("percent")))
        if format_spec == "listed":
            return words.listed(list(value))
        if format_spec == "levels":
            return " / ".join(f"{one:g}" for one in dict.fromkeys(value))
        if format_spec == "quoted":
            return words.listed([f"“{item}”" for item in value])
        if format_spec == "reasons":
            return _patch_reasons(value)
        if format_spec == "deviation":
            return words.deviation_words(value)
        return str(super().format_field(value, format_spec))


def _filled(template: Template, finding: Finding) -> str:
    photo = finding.values.get("photo", finding.subject)
    return _filled_with(template, {
        "subject": finding.subject, "where": photo and f" in the photo “{photo}”",
        "beyond": finding.severity in (Severity.WARN, Severity.FAIL), **finding.values})


def _filled_with(template: Template, values: Mapping[str, Any]) -> str:
    if callable(template):
        return template(values)
    return _Formatter().vformat(template, (), values)
