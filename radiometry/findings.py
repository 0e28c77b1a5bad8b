"""What was found of a photo, a patch, a surface or a file: plain data, made where it is measured.

A finding has no sentence. Its code is looked up in ``measure.texts``, the one module with English
about results; terminal, report, page and JSON show the same list. Logic reads code and values.
"""
from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from spectrabox.radiometry.shaped import Record


class Severity(Enum):
    """How bad a finding is; the value is the rank.

    INFO: looked at, and nothing is wrong. NOTE: worth knowing, and no evidence of a fault. WARN:
    evidence of a fault. FAIL: the answer is not to be used.
    """

    INFO = 0
    NOTE = 1
    WARN = 2
    FAIL = 3


@dataclass(frozen=True, eq=False)
class Finding(Record):
    """One thing that was found.

    Attributes
    ----------
    code : str
        Key of ``measure.texts.TEXTS``: the topic and what was found, "chart.clipped".
    severity : Severity
    subject : str
        Name of the photo, patch, surface or file that it is about; empty of the whole, and of the
        first photo.
    values : mapping
        Numbers, strings, and lists of these, as JSON holds them; each key has its unit in its name
        or in the text of the code. Shares are fractions of 1.
    """

    code: str
    severity: Severity
    subject: str = ""
    values: Mapping[str, Any] = field(default_factory=dict)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Finding) and self._content == other._content

    __hash__ = None  # type: ignore[assignment]

    @property
    def _content(self) -> tuple[Any, ...]:
        return self.code, self.severity, self.subject, dict(self.values)


def graded(value: float, passes: float, fails: float = float("inf")) -> Severity:
    """INFO up to the first limit, FAIL beyond the second, WARN between them."""
    if value <= passes:
        return Severity.INFO
    return Severity.WARN if value <= fails else Severity.FAIL


def worst(findings: Iterable[Finding]) -> Severity:
    """The worst severity of all; INFO of none."""
    return max((one.severity for one in findings), key=lambda severity: severity.value,
               default=Severity.INFO)


def at_least(findings: Iterable[Finding], severity: Severity) -> tuple[Finding, ...]:
    """Findings of this severity and of worse ones, in their order."""
    return tuple(one for one in findings if one.severity.value >= severity.value)


def faults(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Findings with evidence of a fault, in their order: from WARN on."""
    return at_least(findings, Severity.WARN)


def each_once(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Findings in their order, equal ones once."""
    kept: list[Finding] = []
    for one in findings:
        if one not in kept:
            kept.append(one)
    return tuple(kept)
