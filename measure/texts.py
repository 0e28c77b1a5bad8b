"""Every sentence about a result: from the code of a finding to what a person reads.

The only English about results. A code has one `Text`; terminal, report, page, JSON and ``repr``
show it through the functions at the end. Nothing reads a sentence to decide.

A text is a template of `str.format` over the finding's values, with ``{subject}``, and ``{where}``:
" in the photo “name”" of a further photo, and nothing of the first. Further format specifications:
``percent`` (a share of 1, two significant digits; ``percent0`` without decimals), ``listed`` (names
as a phrase), ``quoted`` (the same in quotation marks), ``deviation`` (a ratio: "12 % brighter").
Where a template cannot say it, a function of the values does.
"""
from __future__ import annotations

import string
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from spectrabox.capture.photo.processed_photos import RAW_INSTEAD
from spectrabox.measure import words
from spectrabox.radiometry.findings import Finding, faults

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

CALIBRATION: dict[str, Text] = {}

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
