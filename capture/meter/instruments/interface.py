"""What every driver offers: identify, settings, measure, read, close; and what drivers share."""
from __future__ import annotations

import abc
import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from spectrabox.capture.meter.instruments.errors import (
    InstrumentError,
    LineFaultError,
    RefusedError,
    UntrustedReadingError,
    WrongInstrumentError,
)
from spectrabox.capture.meter.serial_line import LineSettings, SerialLine, shown
from spectrabox.radiometry.records import Quantity
from spectrabox.radiometry.spectra.readings import ReadingOutcome

NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
LANGUAGES = (  # what a reply of each family looks like, to name the instrument that is really there
    (r"^(OK|ER):-?\d+:", "a Colorimetry Research CR-250 or CR-300 (cr250)"),
    (r"^(OK|ER)\d\d(,|$)", "a Konica Minolta CS-2000 (cs2000)"),
    (r"REMOTE MODE|^\d{5},", "a Photo Research PR-655 or PR-670 (pr655)"),
    (r"SDCM3|DCM3_JETI|PECFIRM", "a JETI spectraval or specbos 2501 (specbos2501)"),
    (r"JETI|SB05|^[\x06\x15]", "a JETI specbos 1211 (specbos1211)"))
MAX_POINTS = 5000
RANGE_NM = (100, 3000)
UNITS = {0: Quantity.RADIANCE, 1: Quantity.IRRADIANCE}


@dataclass(frozen=True)
class Identity:
    """Who answers. ``firmware`` is None where the instrument does not state it."""

    model: str
    serial_number: str
    firmware: str | None


@dataclass(frozen=True)
class MeterSettings:
    """What the operator wants changed; None leaves the instrument as it is set."""

    integration_ms: float | None = None
    averages: int | None = None
    sync_hz: float | None = None


@dataclass(frozen=True)
class Measured:
    """How a measurement ended; the instrument holds the result to be read."""

    outcome: ReadingOutcome
    flags: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class HeldResult:
    """One reading of the held result; ``raw`` are the replies, to compare with a second reading."""

    nm: np.ndarray
    values: np.ndarray
    quantity: Quantity
    luminance: float | None                 # cd m-2 or lx
    integration_ms: float | None
    raw: tuple[str, ...]
    flags: tuple[str, ...] = ()


class Instrument(abc.ABC):
    """One spectroradiometer on an open line."""

    name: str                               # as the operator names it
    family: str                             # as a sentence names it
    line_settings: LineSettings

    def __init__(self, line: SerialLine) -> None:
        self.line = line
        self.restore: list[bytes] = []      # commands that undo what was set, sent on leaving
        self.entered = False
        self.busy = False                   # a measurement has started and not been seen to end

    @abc.abstractmethod
    def identify(self) -> Identity:
        """Take the instrument under control, if that is still to do, and ask who it is."""

    @abc.abstractmethod
    def settings(self, wanted: MeterSettings) -> None:
        """Change settings; those before are noted and put back by ``close``.

        Parameters
        ----------
        wanted : MeterSettings
        """

    @abc.abstractmethod
    def measure(self) -> Measured:
        """Measure once; blocks until the instrument reports the end."""

    @abc.abstractmethod
    def read(self) -> HeldResult:
        """Read the held result; may be called as often as wanted."""

    @abc.abstractmethod
    def leave(self) -> None:
        """Stop a running measurement, put settings back, give the instrument back to its user."""

    def close(self) -> None:
        """Leave the instrument as it was and close the line, however the work ended."""
        try:
            if self.entered:
                self.leave()
        except InstrumentError:
            pass    # the line is lost or mute: the caller has the error, or all its readings
        finally:
            self.line.close()

    def longest_measurement_s(self) -> float:
        """Seconds after which a measurement has failed."""
        return 240.0

    def put_back(self, quiet_s: float) -> None:
        """Send the commands that undo what was set, last first.

        Parameters
        ----------
        quiet_s : float
            For which the line must be quiet after each.
        """
        for command in reversed(self.restore):
            self.line.send(command)
            self.line.drain(quiet_s)

    def no_reply(self, reply: str, command: str) -> LineFaultError:
        """The error for bytes that cannot be the answer to ``command``.

        Parameters
        ----------
        reply, command : str
        """
        return LineFaultError(f"{self.line.name}: {reply[:60]!r} is no reply to {command!r}; "
                              "measure again, and check the cable")

    def quantity_of(self, unit: float, remedy: str) -> Quantity:
        """Radiance or irradiance, from the code 0 or 1 that the instrument states.

        Parameters
        ----------
        unit : float
        remedy : str
            What the operator should mount instead, for the error.

        Raises
        ------
        LineFaultError
            At any other code.
        """
        if unit not in UNITS:
            raise LineFaultError(f"{self.line.name}: unit code {unit:g} is neither radiance (0) "
                                 f"nor irradiance (1); {remedy}")
        return UNITS[int(unit)]

    def wrong(self, reply: str) -> WrongInstrumentError:
        """The error for a reply in another instrument's language.

        Parameters
        ----------
        reply : str
        """
        other = next((name for pattern, name in LANGUAGES if re.search(pattern, reply)), None)
        hint = (f"this looks like {other}: name it with --instrument" if other
                else "name the instrument that is on this port, or choose its port from "
                     "'spectrabox meter list'")
        return WrongInstrumentError(f"{self.line.name}: {self.family} was asked for, but "
                                    f"{shown(reply.encode())} answers; {hint}")


def agreed(ask: Callable[[str], str], command: str) -> str:
    """The answer to a question asked twice, for facts that are recorded or put back afterwards.

    Parameters
    ----------
    ask : function of a command
        Sends it and gives the answer.
    command : str

    Raises
    ------
    UntrustedReadingError
        If the two answers differ.
    """
    first, second = ask(command), ask(command)
    if first != second:
        raise UntrustedReadingError(f"asked {command!r} twice, the instrument answered {first!r} "
                                    f"and {second!r}; check the cable")
    return first


def refused(instrument: Instrument, command: str, code: int, table: dict[int, str]) -> RefusedError:
    """The error for an instrument's own error code, in the words of its table.

    Parameters
    ----------
    instrument : Instrument
    command : str
    code : int
        The instrument's own.
    table : dict
        Sentences by code.
    """
    sentence = table.get(code, "an error that its protocol notes do not list; see the instrument's "
                         "manual")
    return RefusedError(f"{instrument.family} refused {command!r} with error {code}: {sentence}")


def numbers(text: str, count: int, line_name: str, separator: str = ",") -> list[float]:
    """Exactly ``count`` numbers of a reply.

    Parameters
    ----------
    text : str
    count : int
    line_name : str
        For errors.
    separator : str

    Raises
    ------
    LineFaultError
        If there are fewer or more, or one is not a number.
    """
    cells = [cell.strip() for cell in text.split(separator)]
    if len(cells) != count or not all(re.fullmatch(NUMBER, cell) for cell in cells):
        raise LineFaultError(f"{line_name}: {shown(text.encode())} arrived where {count} "
                             f"number{'s' if count > 1 else ''} should stand; measure again, and "
                             "check the cable")
    return [float(cell) for cell in cells]


def stated_grid(points: float, first: float, last: float, step: float,
                line_name: str) -> np.ndarray:
    """Wavelengths (P,) in nm that the instrument states it uses.

    Parameters
    ----------
    points, first, last, step : float
        As the instrument states them, nm.
    line_name : str
        For errors.

    Raises
    ------
    LineFaultError
        If the four numbers contradict each other or are no spectrum's.
    """
    possible = 2 <= points <= MAX_POINTS and points == int(points) and step > 0
    if not (possible and RANGE_NM[0] <= first < last <= RANGE_NM[1]
            and abs(first + (points - 1) * step - last) <= 0.01 * step):
        raise LineFaultError(f"{line_name}: the instrument states {points:g} points from {first:g} "
                             f"to {last:g} nm in steps of {step:g} nm, which cannot be; measure "
                             "again, and check the cable")
    return first + step * np.arange(int(points))
