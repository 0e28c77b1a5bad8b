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
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from spectrabox.measure import words
from spectrabox.radiometry.findings import Finding

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

CHART: dict[str, Text] = {}

# ---- calibration ---------------------------------------------------------------------------------

CALIBRATION: dict[str, Text] = {}

# ---- photos and files ----------------------------------------------------------------------------

PHOTOS: dict[str, Text] = {}

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

TEXTS: dict[str, Text] = {**CHART, **CALIBRATION, **PHOTOS, **FLAT, **SCENES, **SURFACES,
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
