"""A fact of a result: declared once, laid out by JSON, tables, pages and notebooks."""
from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

Of = TypeVar("Of")


@dataclass(frozen=True)
class Fact(Generic[Of]):
    """One thing that is known of a result: what it is called, what it means, how it is computed."""

    name: str                           # in JSON
    meaning: str                        # with its unit, for whoever reads the number alone
    of: Callable[[Of], Any]             # its value; None where it is not known
    heading: str = ""                   # of a column for a person; empty where none is shown
    shown: Callable[[Any], str] = str   # the value as that column shows it


def known_facts(facts: Iterable[Fact[Of]], of: Of) -> dict[str, Any]:
    """The values of facts that are known of a result, by name, for JSON."""
    values = ((fact.name, fact.of(of)) for fact in facts)
    return {name: value for name, value in values if value is not None}


def columns(facts: Iterable[Fact[Of]], rows: Sequence[Of]) -> tuple[list[str], list[list[str]]]:
    """Headings and cells of the facts that have a heading and are known of any row.

    Parameters
    ----------
    facts : iterable of Fact
    rows : sequence
        What the facts are of.
    """
    headings: list[str] = []
    cells: list[list[str]] = [[] for _ in rows]
    for fact in facts:
        values = [fact.of(row) for row in rows] if fact.heading else []
        if any(value is not None for value in values):
            headings.append(fact.heading)
            for row, value in zip(cells, values, strict=True):
                row.append("" if value is None else fact.shown(value))
    return headings, cells
