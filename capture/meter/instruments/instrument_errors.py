"""What can go wrong between this computer and an instrument; all end a command with exit code 6."""
from __future__ import annotations

from spectrabox.radiometry.errors import SpectraboxError


class InstrumentError(SpectraboxError):
    """An instrument or its line did not do what was needed."""

    exit_code = 6


class PortError(InstrumentError):
    """The port is missing, in use or not permitted."""


class NoReplyError(InstrumentError):
    """The reply did not come, or did not end, within its limit."""


class LineFaultError(InstrumentError):
    """Bytes arrived that cannot be a reply: noise, an echo, a wrong speed, a reply out of turn."""


class LineLostError(InstrumentError):
    """The line broke: a cable was pulled or the instrument switched off."""


class WrongInstrumentError(InstrumentError):
    """Another instrument than the one asked for answers."""


class RefusedError(InstrumentError):
    """The instrument reported an error of its own, given as its table of codes says it.

    Attributes
    ----------
    code : int or None
        The instrument's number of the error; None where it gave none.
    """

    def __init__(self, message: str, code: int | None = None) -> None:
        super().__init__(message)
        self.code = code


class UntrustedReadingError(InstrumentError):
    """Replies that arrived whole do not agree with each other."""
