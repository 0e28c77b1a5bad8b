"""One thing to do next, with its cost and what is to be expected of it; lists of them, best first.

The one place where actions are named and described. Report, page, JSON, command line and library
show these records.
"""
from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from spectrabox.measure.advice.forecast import Outlook

HOW_TO = "docs/how-to/next.md"
WHITE_CARD, CHART_NEARER, FLAT_FIELD = "white-card", "chart-nearer", "flat-field"
LAMP_MOVED, GEL, TWO_GELS = "lamp-moved", "gel", "two-gels"
SECOND_LAMP, READING, MATT = "second-lamp", "reading", "matt"
SMALL = 0.02                # of a band's width: what brings less is not listed
EACH_ITS_OWN = "a wavelength of its own"


@dataclass(frozen=True)
class Action:
    """What can be done, in words; {} stands for what it is done with."""

    says: str
    short: str
    cost: str
    times: int = 1              # photos or readings


ACTIONS = {
    WHITE_CARD: Action("Lay a white card of known reflectance beside the sample, in its plane, and "
                       "photograph again.", "a white card beside the sample", "one photo"),
    CHART_NEARER: Action("Put the chart right beside the sample and photograph again.",
                         "the chart right beside the sample", "one photo"),
    FLAT_FIELD: Action("Photograph an evenly lit white card in the sample's place as flat field.",
                       "a flat field", "one photo"),
    LAMP_MOVED: Action("Photograph once more with the lamp in another place.",
                       "a photo with the lamp moved", "one photo"),
    GEL: Action("Photograph once more through {}.", "a photo through {}", "one photo"),
    TWO_GELS: Action("Photograph twice more, through {}.", "a photo each through {}",
                     "two photos", 2),
    SECOND_LAMP: Action("Photograph once more under {}.", "a photo under {}", "one photo"),
    READING: Action("Read the sample's reflectance at {} with an instrument.", "a reading at {}",
                    "one reading"),
    MATT: Action("State that the sample is matt, if it is.", "stating that it is matt",
                 "no photo")}


@dataclass(frozen=True)
class Advice:
    """One thing to do next of a surface, or of all.

    ``width_before`` and ``width_after`` are of the band, mean over wavelength, in reflectance;
    ``colour_before`` and ``colour_after`` the root mean square error of the colour under D65,
    CIEDE2000.
    """

    action: str                 # of ACTIONS
    subject: str                # what it is done with: "a magenta gel", "450 nm"; mostly empty
    says: str                   # what to do, in a sentence
    cost: str                   # in words: one photo, one reading
    width_before: float
    width_after: float
    colour_before: float
    colour_after: float
    how_to: str                 # page of the documentation, with the place on it
    times: int = 1              # photos or readings that it takes

    @property
    def facts(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)

    @property
    def short(self) -> str:
        """What it is, in a few words."""
        return ACTIONS[self.action].short.format(self.subject)

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
    return Advised(tuple(Advice(**one) for one in facts["overall"]),
                   {name: tuple(Advice(**one) for one in each)
                    for name, each in facts["surfaces"].items()})


def advice(action: str, before: Outlook, after: Outlook, subject: str = "",
           more: str = "") -> Advice:
    """One thing to do next.

    Parameters
    ----------
    action : str
        Of ACTIONS.
    before, after : Outlook
    subject : str
        What it is done with.
    more : str
        That its sentence has to say besides.
    """
    known = ACTIONS[action]
    return Advice(action, subject, known.says.format(subject) + more, known.cost, before.width,
                  after.width, before.colour, after.colour, f"{HOW_TO}#{action}", known.times)


def ranked(each: Iterable[Advice]) -> tuple[Advice, ...]:
    """Those that bring something, what each photo or reading narrows the band most by first.

    Parameters
    ----------
    each : iterable of Advice
    """
    worth = [one for one in each if one.width_after < (1 - SMALL) * one.width_before]
    return tuple(sorted(worth, key=lambda one: (one.width_after / one.width_before) ** (
        1 / one.times)))


def advised(by_surface: Mapping[str, Sequence[Advice]], now: Mapping[str, Outlook]) -> Advised:
    """The lists of surfaces, and that of all of them: means over surfaces, where one that an action
    is not for stays as it is.

    Parameters
    ----------
    by_surface : mapping
        Of each surface all that was considered.
    now : mapping
        How well each is known.
    """
    width, colour = (float(np.mean([getattr(one, name) for one in now.values()]) if now else 0.0)
                     for name in ("width", "colour"))
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
            overall[-1] = replace(overall[-1], subject=EACH_ITS_OWN, cost=f"{len(now)} readings",
                                  times=len(now),
                                  says=ACTIONS[READING].says.format(EACH_ITS_OWN))
    return Advised(ranked(overall), {name: ranked(each) for name, each in by_surface.items()})
