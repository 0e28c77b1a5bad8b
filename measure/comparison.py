"""What changed between sessions: camera, light and chart over months, and surfaces of one name."""
from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spectrabox.radiometry.appearance import delta_e00
from spectrabox.radiometry.records import SpectrumSummary

CONTROL_LIMIT = 3.0     # standard deviations: one false alarm in 370 normal values
NORMAL = 1.4826         # standard deviation of a normal, in median absolute deviations
# Chance makes the deviation of few values small; with 4 and more it may widen the limits.
MIN_FOR_SCATTER = 4
MIN_PART = 2            # sessions on either side of a lasting shift
MIN_SESSIONS = 6
# of the best split: 2 to 4 in 1000 series of 12 to 24 sessions exceed it without a shift, where
# they scatter just as stated (benchmarks/bench_control_chart.py)
SHIFT_LIMIT = 3.5
CLIPPED = 2.0           # standard deviations from a part's median: one odd session is no shift
EXPECTED_OUT = 0.2      # share of wavelengths outside both errors beyond which two disagree
WIDTH = 1.96            # standard deviations


@dataclass(frozen=True)
class Quantity:
    """A number of one session."""

    value: float
    standard_error: float       # that the session's photos leave
    spread: float               # least scatter from session to session, in the unit of ``value``


@dataclass(frozen=True)
class SessionQuantities:
    """One session: camera and light, its numbers, and the spectra of its surfaces."""

    folder: Path
    name: str
    camera: str
    light: str
    finished: str                           # when its last stage ended, ISO 8601
    quantities: dict[str, Quantity]
    spectra: dict[str, SpectrumSummary]     # of surfaces that were estimated

    @property
    def setting(self) -> tuple[str, str]:
        """Brightness and colour balance are comparable within one camera and light."""
        return self.camera, self.light


def series_by_setting(sessions: Sequence[SessionQuantities]
                      ) -> Iterator[tuple[str, list[int], list[Quantity]]]:
    """Each quantity of each camera under each light: its name, the indices of the sessions that
    have it, in their order, and its values.
    """
    settings: dict[tuple[str, str], list[int]] = {}
    for index, session in enumerate(sessions):
        settings.setdefault(session.setting, []).append(index)
    for members in settings.values():
        names = dict.fromkeys(name for index in members for name in sessions[index].quantities)
        for name in names:
            having = [index for index in members if name in sessions[index].quantities]
            yield name, having, [sessions[index].quantities[name] for index in having]


@dataclass(frozen=True)
class ControlVerdict:
    """One session's value of a quantity against the others of the same camera and light."""

    session: int                # index among those compared
    quantity: str
    value: float
    middle: float
    limit: float                # from the middle, above which it is out
    out: bool


def control_chart(sessions: Sequence[SessionQuantities]) -> list[ControlVerdict]:
    """Shewhart control chart of every quantity, by camera and light [Shewhart 1931; ISO 7870-2].

    The middle is the median and the scatter the median absolute deviation, so that one outlying
    session does not hide itself. The scatter is never less than the stated spread: a few sessions
    that agree by chance would raise an alarm for the next one.

    Parameters
    ----------
    sessions : sequence of SessionQuantities
        Two or more of one camera under one light are compared with each other.

    Returns
    -------
    list of ControlVerdict
        Of quantities that two or more sessions of one setting have.
    """
    verdicts = []
    for name, having, values in series_by_setting(sessions):
        if len(having) > 1:
            verdicts += _judged(name, having, values)
    return verdicts


def _judged(name: str, indices: list[int], quantities: list[Quantity]) -> list[ControlVerdict]:
    values = np.array([one.value for one in quantities])
    middle = float(np.median(values))
    count = len(values)
    many = count >= MIN_FOR_SCATTER
    scatter = NORMAL * float(np.median(np.abs(values - middle))) if many else 0.0
    # of two values each is half their difference from the middle
    shared = 1.0 if many else math.sqrt(1 - 1 / count)
    verdicts = []
    for index, one in zip(indices, quantities, strict=True):
        limit = CONTROL_LIMIT * shared * math.hypot(max(one.spread, scatter), one.standard_error)
        verdicts.append(ControlVerdict(index, name, one.value, middle, limit,
                                abs(one.value - middle) > limit))
    return verdicts


def control_sentence(verdict: ControlVerdict, name: str) -> str:
    """A sentence for one session that is outside the limits."""
    off = verdict.value - verdict.middle
    return (f"{name}: {verdict.quantity} is {off:+.1%} from the median of the sessions "
            f"(limit {verdict.limit:.1%})")


@dataclass(frozen=True)
class LastingShift:
    """A quantity whose level changed from one session on."""

    quantity: str
    first: int              # index of the first session after the change, among those compared
    last_before: int
    size: float             # mean after minus mean before
    standard_error: float
    before: int             # sessions
    after: int


def lasting_shifts(sessions: Sequence[SessionQuantities]) -> list[LastingShift]:
    """Quantities whose level changed for good, of each camera under each light.

    Sessions in their order are split at every position; the means of both parts are compared with
    the scatter of sessions, estimated from successive differences [von Neumann 1941], so that the
    shift itself does not hide it. The split with the largest likelihood ratio counts [Hawkins
    1977]. A drift of the lamp by a few per cent is within the scatter from session to session, but
    not within that of the mean of several sessions.

    Parameters
    ----------
    sessions : sequence of SessionQuantities
        In the order in which they were taken.
    """
    shifts = (_shift(*series) for series in series_by_setting(sessions))
    return [shift for shift in shifts if shift is not None]


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
    if strength <= SHIFT_LIMIT:
        return None
    return LastingShift(name, indices[before], indices[before - 1], float(size), error, before,
                        count - before)


def _mean(values: np.ndarray, scatter: float) -> float:
    middle = np.median(values)
    return float(np.clip(values, middle - CLIPPED * scatter, middle + CLIPPED * scatter).mean())


def shift_sentence(shift: LastingShift, first: str) -> str:
    """A lasting shift in a sentence.

    Parameters
    ----------
    first : str
        Name of the first session after the change.
    """
    return (f"from {first} on, {shift.quantity} differs by {shift.size:+.1%} ± "
            f"{shift.standard_error:.1%} from before ({shift.before} sessions before, "
            f"{shift.after} after)")


@dataclass(frozen=True)
class SurfacePair:
    """One surface in two sessions."""

    surface: str
    first: int                  # indices of the sessions
    second: int
    delta_e00: float            # of the means under D65
    rms: float                  # of the means' difference
    share_out: float            # of wavelengths at which they differ by more than both errors
    disagree: bool


def surface_pairs(sessions: Sequence[SessionQuantities]) -> list[SurfacePair]:
    """Every surface that two sessions call by one name, whatever camera and light they had.

    Parameters
    ----------
    sessions : sequence of SessionQuantities
    """
    pairs = []
    for (first, one), (second, other) in itertools.combinations(enumerate(sessions), 2):
        for name in one.spectra:
            if name in other.spectra:
                pairs.append(_pair(name, first, second, one.spectra[name], other.spectra[name]))
    return pairs


def _pair(name: str, first: int, second: int, one: SpectrumSummary,
          other: SpectrumSummary) -> SurfacePair:
    nm = one.grid.nm
    mean = np.interp(nm, other.grid.nm, other.mean)
    deviation = np.interp(nm, other.grid.nm, other.standard_deviation)
    off = one.mean - mean
    out = float(np.mean(np.abs(off) > WIDTH * np.hypot(one.standard_deviation, deviation)))
    return SurfacePair(name, first, second, float(delta_e00(nm, one.mean, mean)),
                       float(np.sqrt(np.mean(off**2))), out, out > EXPECTED_OUT)
