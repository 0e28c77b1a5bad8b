"""From which session on a quantity stays at another level, which single sessions do not show.

Sessions in their order are split at every place; the means of both parts are compared by how far
sessions scatter, which is taken from successive differences [von Neumann 1941], so that the shift
itself does not hide it. The most telling split counts [likelihood ratio of a change point; Hawkins
1977]. A drift of the lamp by a few per cent lies within what light and shutter repeat from session
to session, but not within what the mean of several sessions does.
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

MIN_PART = 2            # sessions on either side
MIN_SESSIONS = 6
# of the best split: 2 to 4 in 1000 series of 12 to 24 sessions exceed it without a shift, where
# they scatter just as stated (benchmarks/bench_control_chart.py)
LIMIT = 3.5
CLIPPED = 2.0           # standard deviations from a part's median: one odd session is no shift


@dataclass(frozen=True)
class LastingShift:
    """A quantity that has changed for good."""

    quantity: str
    first: int              # index of the first session after the change, among those compared
    last_before: int
    size: float             # mean after minus mean before
    standard_error: float
    before: int             # sessions
    after: int


def lasting_shifts(sessions: Sequence[SessionQuantities]) -> list[LastingShift]:
    """The quantities whose level changed for good, of each camera under each light.

    Parameters
    ----------
    sessions : sequence of SessionQuantities
        In the order in which they were taken.
    """
    found = [_shift(*series) for series in series_by_setting(sessions)]
    return [shift for shift in found if shift is not None]


def _shift(name: str, indices: list[int], quantities: list[Quantity]) -> LastingShift | None:
    values = np.array([one.value for one in quantities])
    count = len(values)
    if count < MIN_SESSIONS:
        return None
    errors = np.array([one.standard_error for one in quantities])
    stated = math.hypot(max(one.spread for one in quantities), float(np.sqrt(np.mean(errors**2))))
    scatter = max(stated, float(np.sqrt(np.mean(np.diff(values) ** 2) / 2)))
    splits = []
    for before in range(MIN_PART, count - MIN_PART + 1):
        means = [_mean(part, scatter) for part in (values[:before], values[before:])]
        error = scatter * math.sqrt(1 / before + 1 / (count - before))
        splits.append((abs(means[1] - means[0]) / error, before, means[1] - means[0], error))
    strength, before, size, error = max(splits)
    if strength <= LIMIT:
        return None
    return LastingShift(name, indices[before], indices[before - 1], float(size), error, before,
                        count - before)


def _mean(values: np.ndarray, scatter: float) -> float:
    middle = np.median(values)
    return float(np.clip(values, middle - CLIPPED * scatter, middle + CLIPPED * scatter).mean())


def shift_words(shift: LastingShift, first: str) -> str:
    """A lasting shift in a sentence.

    Parameters
    ----------
    first : str
        Name of the first session after the change.
    """
    return (f"from {first} on, {shift.quantity} differs by {shift.size:+.1%} ± "
            f"{shift.standard_error:.1%} from before ({shift.before} sessions before, "
            f"{shift.after} after)")
