"""One thing to do next, with its cost and what is to be expected of it; lists of them, best first.

Report, page, JSON, command line and library show these records by the texts of their actions.
"""
from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

import numpy as np

from spectrabox.measure import texts
from spectrabox.radiometry.findings import Finding, Severity

HOW_TO = "docs/how-to/next.md"
WHITE_CARD, CHART_NEARER, FLAT_FIELD = "white-card", "chart-nearer", "flat-field"
LAMP_MOVED, GEL, TWO_GELS = "lamp-moved", "gel", "two-gels"
SECOND_LAMP, READING, MATT = "second-lamp", "reading", "matt"
# photos or readings that each takes
TIMES = {WHITE_CARD: 1, CHART_NEARER: 1, FLAT_FIELD: 1, LAMP_MOVED: 1, GEL: 1, TWO_GELS: 2,
         SECOND_LAMP: 1, READING: 1, MATT: 1}
SMALL = 0.02                # of a band's width: what brings less is not listed
TOPIC = "advice."           # of the codes of actions among the texts


@dataclass(frozen=True)
class Advice:
    """One thing to do next of a surface, or of all; its words are in ``measure.texts``.

    ``width_before`` and ``width_after`` are of the band, mean over wavelength, in reflectance;
    ``colour_before`` and ``colour_after`` the root mean square error of the colour under D65,
    CIEDE2000.
    """

    action: str                 # of TIMES
    subject: str                # what it is done with: "a magenta gel", "450 nm"; mostly empty
    width_before: float
    width_after: float
    colour_before: float
    colour_after: float
    times: int = 1              # photos or readings that it takes
    stops: tuple[float, ...] = ()       # of exposure to add to each further photo
    dark: tuple[int, ...] = ()          # bands that further photos leave dark, counted from 1

    @property
    def finding(self) -> Finding:
        """It as the texts know it."""
        return Finding(TOPIC + self.action, Severity.INFO, self.subject, {
            "times": self.times, "stops": list(self.stops), "dark": list(self.dark)})

    @property
    def says(self) -> str:
        """What to do, in a sentence."""
        return texts.sentence(self.finding)

    @property
    def short(self) -> str:
        """What it is, in a few words."""
        return texts.name(self.finding)

    @property
    def cost(self) -> str:
        """What it takes, in words: one photo, one reading."""
        return texts.shown(self.finding)

    @property
    def how_to(self) -> str:
        """Page of the documentation, with the place on it."""
        return f"{HOW_TO}#{self.action}"

    @property
    def facts(self) -> dict[str, Any]:
        """For JSON."""
        return {**asdict(self), "says": self.says, "cost": self.cost, "how_to": self.how_to}

    @property
    def text(self) -> str:
        """For a person, in a line."""
        return (f"{self.short} ({self.cost}): band {self.width_before:.3f} -> "
                f"{self.width_after:.3f} wide, colour within dE00 {self.colour_before:.1f} -> "
                f"{self.colour_after:.1f}")


@dataclass(frozen=True)
class Advised:
    """What to do next: of all surfaces together, and of each; the best first."""

    overall: tuple[Advice, ...] = ()
    by_surface: Mapping[str, tuple[Advice, ...]] = field(default_factory=dict)

    @property
    def facts(self) -> dict[str, Any]:
        """For JSON."""
        return {"overall": [one.facts for one in self.overall],
                "surfaces": {name: [one.facts for one in each]
                             for name, each in self.by_surface.items()}}

    @property
    def line(self) -> str:
        """The best of all, in a line for a person; empty where nothing brings much."""
        if not self.overall:
            return ""
        count = len(self.by_surface)
        return f"next: {self.overall[0].text}" + (f" (means of {count})" if count > 1 else "")


def advised_of_facts(facts: Mapping[str, Any]) -> Advised:
    """The lists that were kept as `Advised.facts`."""
    def kept(one: Mapping[str, Any]) -> Advice:
        values = {each.name: one[each.name] for each in fields(Advice)}
        return Advice(**values | {"stops": tuple(one["stops"]), "dark": tuple(one["dark"])})

    return Advised(tuple(map(kept, facts["overall"])),
                   {name: tuple(map(kept, each)) for name, each in facts["surfaces"].items()})


def advice(action: str, before: np.ndarray, after: np.ndarray, subject: str = "",
           stops: Sequence[float] = (), dark: Sequence[int] = ()) -> Advice:
    """One thing to do next.

    Parameters
    ----------
    action : str
        Of TIMES.
    before, after : (2,) arrays
        Outlooks, as of ``forecast``.
    subject : str
        What it is done with.
    stops, dark : sequences
        As of `Advice`.
    """
    (width, narrower), (colour, closer) = zip(before.tolist(), after.tolist(), strict=True)
    return Advice(action, subject, width, narrower, colour, closer, TIMES[action], tuple(stops),
                  tuple(dark))


def ranked(each: Iterable[Advice]) -> tuple[Advice, ...]:
    """Those that bring something, what each photo or reading narrows the band most by first.

    Parameters
    ----------
    each : iterable of Advice
    """
    worth = [one for one in each if one.width_after < (1 - SMALL) * one.width_before]
    return tuple(sorted(worth, key=lambda one: (one.width_after / one.width_before) ** (
        1 / one.times)))


def advised(by_surface: Mapping[str, Sequence[Advice]], now: Mapping[str, np.ndarray]) -> Advised:
    """The lists of surfaces, and that of all of them: means over surfaces, where one that an action
    is not for stays as it is.

    Parameters
    ----------
    by_surface : mapping
        Of each surface all that was considered.
    now : mapping
        Outlook (2,) of each.
    """
    width, colour = (float(np.mean(each)) for each in zip(*now.values(), strict=True)) \
        if now else (0.0, 0.0)
    first: dict[tuple[str, str], Advice] = {}
    fall: dict[tuple[str, str], np.ndarray] = {}
    for considered in by_surface.values():
        for one in considered:
            key = (one.action, "" if one.action == READING else one.subject)
            first.setdefault(key, one)
            fall[key] = fall.get(key, 0.0) + np.array([one.width_before - one.width_after,
                                                       one.colour_before - one.colour_after])
    overall = []
    for key, one in first.items():
        narrower, closer = (fall[key] / len(now)).tolist()
        overall.append(replace(one, width_before=width, width_after=width - narrower,
                               colour_before=colour, colour_after=colour - closer))
        if one.action == READING and len(now) > 1:
            overall[-1] = replace(overall[-1], subject="", times=len(now))
    return Advised(ranked(overall), {name: ranked(each) for name, each in by_surface.items()})
