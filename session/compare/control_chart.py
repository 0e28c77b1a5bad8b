"""Which sessions lie outside what a quantity scatters: a control chart [Shewhart 1931; ISO 7870-2].

The middle is the median and the scatter the median absolute deviation, so that one session that is
off does not hide itself. The scatter is never taken to be less than what is known of it: a few
sessions that agree by chance would make an alarm of the next one.
"""
from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spectrabox.session.compare.quantities import (
    Quantity,
    SessionQuantities,
    series_by_setting,
)

LIMIT = 3.0             # standard deviations: one false alarm in 370 normal values
NORMAL = 1.4826         # standard deviation of a normal, in median absolute deviations
# Chance makes the deviation of few values small; with 4 and more it may widen the limits.
MIN_FOR_SCATTER = 4


@dataclass(frozen=True)
class Verdict:
    """One session's value of a quantity against the others of the same camera and light."""

    session: int                # index among those compared
    quantity: str
    value: float
    middle: float
    limit: float                # from the middle, above which it is out
    out: bool


def control_chart(sessions: Sequence[SessionQuantities]) -> list[Verdict]:
    """Every quantity of every session against its like, by camera and light.

    Parameters
    ----------
    sessions : sequence of SessionQuantities
        Two or more of one camera under one light are compared with each other.

    Returns
    -------
    list of Verdict
        Of quantities that two or more sessions of one setting have.
    """
    verdicts = []
    for name, having, values in series_by_setting(sessions):
        if len(having) > 1:
            verdicts += _judged(name, having, values)
    return verdicts


def _judged(name: str, indices: list[int], quantities: list[Quantity]) -> list[Verdict]:
    values = np.array([one.value for one in quantities])
    middle = float(np.median(values))
    count = len(values)
    many = count >= MIN_FOR_SCATTER
    scatter = NORMAL * float(np.median(np.abs(values - middle))) if many else 0.0
    # of two values each is half their difference from the middle
    shared = 1.0 if many else math.sqrt(1 - 1 / count)
    verdicts = []
    for index, one in zip(indices, quantities, strict=True):
        limit = LIMIT * shared * math.hypot(max(one.spread, scatter), one.standard_error)
        verdicts.append(Verdict(index, name, one.value, middle, limit,
                                abs(one.value - middle) > limit))
    return verdicts


def verdict_words(verdict: Verdict, name: str) -> str:
    """One session that is out, in a sentence."""
    off = verdict.value - verdict.middle
    return (f"{name}: {verdict.quantity} is off by {off:+.1%} of the others' middle "
            f"(limit {verdict.limit:.1%})")
