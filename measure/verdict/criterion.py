"""What a criterion and a verdict are."""
from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from spectrabox.measure import texts
from spectrabox.measure.results.surface_result import VALID_OUTCOMES
from spectrabox.measure.words import percent
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records.spectra import Outcome

# of a photo, share of its pixels: they are left out, so they cost coverage, not correctness
CLIPPED_LIMITS = (0.05, float("inf"))


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
    condition: str = ""         # what a PASS rests on, as the end of "if ..."

    @property
    def word(self) -> str:
        """"pass", "warn" or "fail"."""
        return self.status.name.lower()

    @property
    def line(self) -> str:
        """For a terminal."""
        return f"verdict: {self.title}. {self.sentence}"

    @property
    def title(self) -> str:
        """PASS, WARN or FAIL, with what it rests on: "PASS if matt"."""
        return f"{self.status.name} if {self.condition}" if self.condition else self.status.name

    @property
    def says(self) -> str:
        """The sentence, with what it rests on."""
        if not self.condition:
            return self.sentence
        return f"If {self.condition}: {self.sentence[0].lower()}{self.sentence[1:]}"

    @property
    def headline(self) -> str:
        """The sentence; of several reasons the first."""
        reasons = dict.fromkeys(c.sentence for c in self.criteria if c.status is self.status)
        if self.status not in (Status.WARN, Status.FAIL) or len(reasons) < 2:
            return self.sentence
        more = len(reasons) - 1
        return f"{next(iter(reasons))} And {more} more reason{'s' if more > 1 else ''}, below."

    @property
    def reasons(self) -> list[str]:
        """Why the verdict is no PASS, in sentences; its one sentence otherwise."""
        if self.status not in (Status.WARN, Status.FAIL):
            return [self.says]
        return [criterion.sentence for criterion in self.criteria
                if criterion.status is self.status]

    @property
    def doubts(self) -> dict[str, tuple[str, ...]]:
        """Names of the criteria that each surface does not pass; only surfaces that have any."""
        doubts: dict[str, tuple[str, ...]] = {}
        for criterion in self.criteria:
            for surface in () if criterion.passed else criterion.surfaces:
                name = criterion.name.partition(", worst")[0]
                doubts[surface] = (*doubts.get(surface, ()), name)
        return doubts


def criterion_of(finding: Finding) -> Criterion:
    """The criterion of what a rule found: a PASS where it was held against a limit."""
    limit = texts.limit(finding)
    status = {Severity.WARN: Status.WARN, Severity.FAIL: Status.FAIL}.get(
        finding.severity, Status.PASS if limit else Status.INFO)
    return Criterion(texts.name(finding), finding.values.get("value"), texts.shown(finding),
                     limit, status, texts.says(finding))


def outcome_criterion(name: str, outcome: Outcome) -> Criterion:
    return Criterion(name, None, outcome.name.replace("_", " ").lower(), "converged",
                     GRADES.get(outcome, Status.WARN), f"{name}: {outcome.value}")


def graded(name: str, value: float, limits: tuple[float, float], sentence: str,
           surfaces: tuple[str, ...] = ()) -> Criterion:
    """The criterion of a value that passes up to the first limit and fails beyond the second."""
    passes, warns = limits
    status = Status.PASS if value <= passes else Status.WARN if value <= warns else Status.FAIL
    return Criterion(name, value, percent(value), limit_words(limits), status, sentence, surfaces)


def limit_words(limits: tuple[float, float]) -> str:
    passes = f"pass up to {percent(limits[0], 0)}"
    return passes if np.isinf(limits[1]) else f"{passes}, fail beyond {percent(limits[1], 0)}"


def where_of(view: str) -> str:
    """Which photo a sentence is about, after a name; nothing of the first."""
    return view and f" in the photo “{view}”"
