"""Rows of the ledger: what is better in each kind of them, and how a value is judged beside the
recorded one.

A row is named ``group/block/kind`` or ``group/block/kind, of what``: ``simulated/faultless/RMSE``.
It holds a number for each case (a shoot, a photo, a surface), and its value is their mean. A later
run measures the same cases, so the two are compared by the differences of each case, whose error is
much smaller than that of either mean.
"""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

ERRORS = 2.0            # standard errors of the paired difference that a row may lose
FEWEST_DRAWN = 5        # cases below which they are no sample of anything: given photos, boxes


@dataclass(frozen=True)
class Kind:
    """What is better, and which change is nothing.

    Attributes
    ----------
    better : {"more", "less", "nearer zero", ""}
        Empty: printed, and never judged.
    floor : float
        Change of a mean over drawn cases that other processors, libraries and rounding may make.
    few : float
        The same of a row of fewer than ``FEWEST_DRAWN`` cases, whose differences tell no error: one
        spectrum or photo alone moves more when the product changes without getting worse.
    digits : int
        After the point, where it is printed.
    certain : bool
        Whether a case that gets worse is a fault by itself, so that ``floor`` alone judges.
    """

    better: str
    floor: float = 0.0
    few: float = 0.0
    digits: int = 3
    certain: bool = False


# Floors: on another machine rendering and small algebra end in other last digits, which draws and
# optimisers carry to about a tenth of what stands here. Of a share held within bands that are too
# wide, more is called better, too: the width beside it is printed and not judged, since wide bands
# are right where little is known, and RMSE says whether more could be known.
KINDS = {
    "held": Kind("more", 0.005, 0.03),              # share of wavelengths within the 95 % band
    "RMSE": Kind("less", 0.0003, 0.003, digits=4),  # of reflectance
    "width": Kind("", digits=3),                    # of the band, in reflectance
    "dE00": Kind("less", 0.03, 0.2, digits=2),
    "L* bias": Kind("nearer zero", 0.05, 0.3, digits=2),
    "bias": Kind("nearer zero", 0.0003, 0.003, digits=4),       # of mean reflectance
    "relative bias": Kind("nearer zero", 0.002, 0.01),          # of mean reflectance, as a share
    "PASS": Kind("more", 0.01, 0.01, digits=2),     # share of shoots
    "false PASS": Kind("less", 0.01, 0.01, digits=2),           # that hold less than .9
    "advice": Kind("more", certain=True),           # share of shoots of which there is any
    "read right": Kind("more", certain=True),       # share of files
    "times": Kind("", digits=1),                    # `import numpy, scipy.optimize`
    "MB": Kind("", digits=0),
    "lines": Kind("", digits=0)}


@dataclass(frozen=True)
class Judgement:
    """What a row came to beside the recorded one.

    Attributes
    ----------
    word : {"same", "better", "worse", "printed", "not recorded", "incomplete", "not measured"}
    loss : float
        By how much it is worse (negative: better), in its unit; nan where there is nothing to
        compare.
    error : float
        Standard error of that, by the cases; nan where they are too few.
    says : str
        What is wrong where it is not a matter of numbers.
    """

    word: str
    loss: float = np.nan
    error: float = np.nan
    says: str = ""

    @property
    def fails(self) -> bool:
        """Whether the ledger fails by this row."""
        return self.word in ("worse", "not recorded", "incomplete")


def kind_of(row: str) -> Kind:
    """The kind of a row, by the last part of its name up to a comma.

    Raises
    ------
    KeyError
        If there is no such kind.
    """
    return KINDS[row.rsplit("/", 1)[-1].split(",", 1)[0]]


def value_of(cases: Mapping[str, float]) -> tuple[float, float]:
    """Mean over cases and its standard error; nan where they are too few to tell one."""
    values = np.array(list(cases.values()))
    error = values.std(ddof=1) / np.sqrt(values.size) if values.size >= FEWEST_DRAWN else np.nan
    return float(values.mean()), float(error)


def judged(kind: Kind, found: Mapping[str, float] | None,
           recorded: Mapping[str, float] | None) -> Judgement:
    """What a row came to.

    Parameters
    ----------
    kind : Kind
    found, recorded : mapping or None
        Numbers by case; None where it was not measured, or never recorded.

    Returns
    -------
    Judgement
        "worse" where the mean over the cases lost more than ``ERRORS`` standard errors of the
        paired difference and more than the floor; "incomplete" where a recorded case is missing
        or a number is not finite.
    """
    if found is None:
        return Judgement("not measured")
    if not np.all(np.isfinite(list(found.values()))):
        return Judgement("incomplete", says="a value is not a number")
    if recorded is None:
        return Judgement("not recorded", says="record it: --record ROW --reason WORDS")
    if not found:
        return Judgement("incomplete", says="it was not measured")
    missing = sorted(set(recorded) - set(found))
    if missing:
        return Judgement("incomplete", says=f"no value of case {', '.join(missing)}")
    if set(found) - set(recorded):
        return Judgement("not recorded", says="it has cases that are not recorded")
    before, now = (np.array([each[name] for name in recorded]) for each in (recorded, found))
    loss, few = loss_of(kind, before.mean(), now.mean()), before.size < FEWEST_DRAWN
    error = np.nan if few else float((now - before).std(ddof=1) / np.sqrt(before.size))
    if not kind.better:
        return Judgement("printed", loss, error)
    floor = kind.few if few and not kind.certain else kind.floor
    limit = floor + 1e-12 if few or kind.certain else max(floor, ERRORS * error)
    word = "worse" if loss > limit else "better" if -loss > limit else "same"
    return Judgement(word, loss, error)


def loss_of(kind: Kind, before: float, now: float) -> float:
    """By how much a mean is worse than before."""
    if kind.better == "more":
        return float(before - now)
    if kind.better == "nearer zero":
        return float(abs(now) - abs(before))
    return float(now - before)
