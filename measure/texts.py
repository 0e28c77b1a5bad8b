"""Every sentence about a result: from the code of a finding to what a person reads.

The only English about results. A code has one `Text`; terminal, report, page, JSON and ``repr``
show it through the functions at the end. Nothing reads a sentence to decide.

A text is a template of `str.format` over the finding's values, with ``{subject}``, and ``{where}``:
" in the photo “name”" of a further photo, and nothing of the first. Further format specifications:
``percent`` (a share of 1, two significant digits; ``percent0`` without decimals), ``listed`` (names
as a phrase), ``quoted`` (the same in quotation marks), ``deviation`` (a ratio: "12 % brighter"),
``reasons`` (chart patches, each with what it is off by).
Where a template cannot say it, a function of the values does.
"""
from __future__ import annotations

import string
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from spectrabox.capture.photo.processed_photos import RAW_INSTEAD
from spectrabox.measure import words
from spectrabox.radiometry.chart import BEFORE_2014, SINCE_2014
from spectrabox.radiometry.findings import Finding, faults
from spectrabox.radiometry.records.spectra import Outcome

Template = str | Callable[[Mapping[str, Any]], str]


@dataclass(frozen=True)
class Text:
    """How one code reads."""

    name: str                   # of what was looked at: the heading of its row
    sentence: Template          # what was found, a whole sentence
    remedy: Template = ""       # what to do about it, a whole sentence; shown from NOTE on
    shown: Template = ""        # the value in a table
    limit: Template = ""        # up to where it passes, as a table shows it


# ---- chart photo ---------------------------------------------------------------------------------

def _chart_figures(values: Mapping[str, Any]) -> str:
    white = f"at {words.percent(values['white'], 0)} of full scale" \
        if values["white_8bit"] is None else f"{values['white_8bit']:.0f} of 255"
    return (f"White patch {white}, light even to {words.percent(values['uneven'], 0)}, glare "
            f"{words.percent(values['glare'], 1)}, tilt {values['tilt_deg']:.0f} degrees, edges "
            f"{words.percent(values['blur'], 0)} of a patch, {values['pixels']} pixels or more per "
            "patch.")


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

OUTCOMES: dict[str, str] = {outcome.name: outcome.value for outcome in Outcome}
CLEAR_KIND, SECOND_KIND = 0.9, 0.25     # probability: one kind of light is named, or two
AGAINST_COPIES = "Chart against copies of its edition{where}"
CHECK_LIGHT = "Check that the light spectrum is that of the photo."
CHECK_CHART = ("Measure the chart and give that file as its reference, replace it, or leave these "
               "patches out (chart.leave_out).")
RESIDUAL_LIMITS = "pass up to {passes:percent0}, fail beyond {fails:percent0}"


def _fit(name: str) -> Text:
    """How a fit ended, by the value "outcome"."""
    return Text(f"{name}{{where}}", lambda values:
                f"{name}{values['where']}: {OUTCOMES[values['outcome']]}",
                shown=lambda values: values["outcome"].replace("_", " ").lower(),
                limit="converged")


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
    named = [f"{kind} ({words.percent(share, 0)})" for kind, share in ranked]
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
        f"{row['patch']} reads {words.percent(abs(row['size']), 0)} ± "
        f"{words.percent(row['error'], 0)} " + (
            ("low", "high") if row["reading"] == "level" else
            ("low in the blue against the red (yellower)",
             "high in the blue against the red (bluer)"))[row["size"] > 0]
        + f", and copies differ by {words.percent(row['spread'], 0)}"
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
        cause = "a reflection lies on it" if brighter > 0 else \
            "a shadow lies across it, or it is soiled"
        if row["dark"]:
            cause += ", or glare is not the same all over the chart"
        return f"{level} in all bands than the others make it: {cause}"
    if row["reason"] == "colour":
        return ("its colour is not that of the reference: soiled, faded, of another generation of "
                "the chart, or lit by a coloured reflection")
    where = f"its spectrum is unusual for its signals at {row['low_nm']:g} to {row['high_nm']:g} nm"
    return f"{level} than the others make it, within chance; {where}" if level \
        else f"its signals agree with the reference; {where}"


def _patch_reasons(patches: Sequence[Mapping[str, Any]]) -> str:
    return "; ".join(f"{row['patch']} {patch_reason(row)}" for row in patches)


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
            f"Glare or a wrong black level{_photo(values)} of {words.percent(values['glare'], 0)} "
            "of the brightest patch was estimated and subtracted."),
        "Shade the lens and check the dark frame."),
    "calibration.veil": _doubt(
        "Veiling glare on the chart", "Haze or glare of {veil:percent0} of the brightest patch "
        "veils the chart{where}: it was estimated and taken off, but a veil is seldom the same all "
        "over a photo.", "Shade the lens, wipe it, and photograph again."),
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
    "edition.not-fitted": Text(
        "Edition of the chart", "The edition cannot be told, since nothing could be fitted to the "
        "chart: {error}"),
    "patches.off-level": Text(
        "Level of chart patches", "Chart patches are off in level{where}: {patches:reasons}.",
        "Photograph the chart again without, or leave these patches out (chart.leave_out).",
        lambda values: ", ".join(row["patch"] for row in values["patches"]), "within chance"),
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
        "Colours of chart patches left out", "These spectra against the chart's reference: "
        "CIEDE2000 {mean:.1f} on average, {median:.1f} in the median, up to {percentile_90:.1f} "
        "for 90 % of the patches, {largest:.1f} at most."),
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


PHOTOS: dict[str, Text] = {
    "extra.failed": Text("Extras", "No {subject}: {error}."),
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

FLAT: dict[str, Text] = {}

# ---- scenes --------------------------------------------------------------------------------------

SCENES: dict[str, Text] = {}

# ---- surfaces and their draws --------------------------------------------------------------------

SURFACES: dict[str, Text] = {}

# ---- conditions: what a result rests on ----------------------------------------------------------

CONDITIONS: dict[str, Text] = {}

# ---- what to do next -----------------------------------------------------------------------------

ADVICE: dict[str, Text] = {}

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


def shown(finding: Finding) -> str:
    """Its value as a table shows it."""
    return _filled(TEXTS[finding.code].shown, finding)


def limit(finding: Finding) -> str:
    """Up to where it passes, as a table shows it."""
    return _filled(TEXTS[finding.code].limit, finding)


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
        if format_spec == "quoted":
            return words.listed([f"“{item}”" for item in value])
        if format_spec == "reasons":
            return _patch_reasons(value)
        if format_spec == "deviation":
            return words.deviation_words(value)
        return str(super().format_field(value, format_spec))


def _filled(template: Template, finding: Finding) -> str:
    subject = finding.subject
    values = {"subject": subject, "where": subject and f" in the photo “{subject}”",
              **finding.values}
    if callable(template):
        return template(values)
    return _Formatter().vformat(template, (), values)
