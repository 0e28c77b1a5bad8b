"""What is extra takes nothing away: advice, the edition of a chart, pictures are made after the
answer, and where one fails the answer stands and says so.

The one place where any error of ours or of a library is caught: here it becomes a record, which
report, JSON and terminal show. An interrupt is none of those errors. Running out of memory is one:
what the extra had taken is free again, and if the answer needs more than there is, it says so
itself.
"""
from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

from spectrabox.radiometry.errors import SpectraboxError, interrupt_behind
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.system.words import message

Made = TypeVar("Made")
Instead = TypeVar("Instead")


@dataclass(frozen=True)
class FailedExtra:
    """An extra that could not be made, and why.

    Attributes
    ----------
    extra : str
        What it is, as a noun: "advice", "picture of the light".
    error : str
        The kind of the error and its message, in a line; of our own errors the message.
    traceback : str
        Where it failed, for who mends it.
    """

    extra: str
    error: str
    traceback: str = ""

    @property
    def facts(self) -> dict[str, Any]:
        """For JSON."""
        return {"extra": self.extra, "error": self.error}

    @property
    def finding(self) -> Finding:
        """That it is missing."""
        return Finding("extra.failed", Severity.NOTE, self.extra, {"error": self.error})

    @property
    def why(self) -> str:
        """That it is missing, and why."""
        return f"no {self.extra}: {self.error}"

    @property
    def sentence(self) -> str:
        """The same for a person at a terminal."""
        return f"{self.why}; everything else stands, and --debug shows where it failed"


def attempt(extra: str, make: Callable[[], Made],
            instead: Instead) -> tuple[Made | Instead, FailedExtra | None]:
    """What an extra is, or something in its place with the record of its failure.

    Parameters
    ----------
    extra : str
        As of `FailedExtra`.
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
        stop = interrupt_behind(error)
        if stop is not None:
            raise stop from None
        return instead, FailedExtra(extra, _in_a_line(error), traceback.format_exc())


def different(failed: Iterable[FailedExtra]) -> tuple[FailedExtra, ...]:
    """Each failure once: what one fault does to many surfaces is said once."""
    return tuple({(one.extra, one.error): one for one in failed}.values())


def _in_a_line(error: Exception) -> str:
    if isinstance(error, MemoryError):
        return "memory ran out"
    said = " ".join(message(str(error)).split())
    if isinstance(error, SpectraboxError):
        return said
    return f"{type(error).__name__}: {said}" if said else type(error).__name__
