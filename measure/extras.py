"""What is extra takes nothing away: advice, the edition of a chart, pictures are made after the
answer, and where one fails the answer stands and says so.

The one place where any error of ours or of a library is caught. Here it becomes a finding
"extra.failed": its subject is what is missing, its values are the error and, for who mends it, the
traceback; report, JSON and terminal show it. An interrupt is none of those errors. Running out of
memory is one: what the extra had taken is free again, and if the answer needs more than there is,
it says so itself.
"""
from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import TypeVar

from spectrabox.radiometry import errors, findings
from spectrabox.radiometry.system.words import message

Made = TypeVar("Made")
Instead = TypeVar("Instead")


def attempt(extra: str, make: Callable[[], Made],
            instead: Instead) -> tuple[Made | Instead, findings.Finding | None]:
    """What an extra is, or something in its place with the finding that it failed.

    Parameters
    ----------
    extra : str
        What it is, as a noun: "advice", "picture of the light".
    make : callable
        Makes it.
    instead
        What to go on with where it fails.

    Raises
    ------
    KeyboardInterrupt
        If the operator stopped it, also where a library wrapped that in an error of its own.
    """
    try:
        return make(), None
    except Exception as error:      # noqa: BLE001 - kept as a record, see above
        stop = errors.interrupt_behind(error)
        if stop is not None:
            raise stop from None
        return instead, findings.Finding("extra.failed", findings.Severity.NOTE, extra, {
            "error": _in_a_line(error), "traceback": traceback.format_exc()})


def different(failed: Iterable[findings.Finding]) -> tuple[findings.Finding, ...]:
    """Each failure once: what one fault does to many surfaces is said once."""
    return tuple({(one.subject, one.values["error"]): one for one in failed}.values())


def to_keep(failed: findings.Finding) -> findings.Finding:
    """The same without the traceback, as a record keeps it."""
    return replace(failed, values={"error": failed.values["error"]})


def facts(failed: findings.Finding) -> dict[str, str]:
    """For JSON."""
    return {"extra": failed.subject, "error": failed.values["error"]}


def _in_a_line(error: Exception) -> str:
    if isinstance(error, MemoryError):
        return "memory ran out"
    said = " ".join(message(str(error)).split())
    if isinstance(error, errors.SpectraboxError):
        return said
    return f"{type(error).__name__}: {said}" if said else type(error).__name__
