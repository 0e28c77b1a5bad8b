"""What every driver offers: identify, settings, measure, read, close; and what drivers share.

All that reads a reply raises LineFaultError where the bytes cannot be that reply.
"""
from __future__ import annotations

import abc
import re
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from spectrabox.capture.meter import serial_line
from spectrabox.capture.meter.instruments import instrument_errors
from spectrabox.capture.meter.stated import Stated
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.findings import Finding
from spectrabox.radiometry.records.spectra import Quantity
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
RESTORE_TRIES = 3
RESTORE_S = 3.0             # for the answer to a command that puts a setting back
ANSWER_S = 10.0             # for the answer to a command after which the work was broken off
# how a measurement ended, and what to beware of
Ended = tuple[ReadingOutcome, tuple[Finding, ...]]
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


@dataclass(frozen=True, eq=False)
class HeldResult:
    """One reading of the held result; ``raw`` are the replies, to compare with a second reading."""

    nm: np.ndarray
    values: np.ndarray
    quantity: Quantity
    stated: Stated                          # what the instrument computed from it
    integration_ms: float | None
    raw: tuple[str, ...]
    lab: tuple[float, float, float] | None = None   # L*, a*, b* as the instrument shows it


class Instrument(abc.ABC):
    """One instrument on an open line."""

    name: str  # as the operator names it
    family: str  # as a sentence names it
    baud: int
    rtscts = False
    character_pause_s = 0.0  # after each that is sent
    errors: Mapping[int, str]  # sentences by the instrument's own codes
    quantities: tuple[Quantity, ...] = (Quantity.RADIANCE, Quantity.IRRADIANCE)
    checks_bytes = False  # its replies have a check byte: one reading is enough
    # What it must be calibrated with before it measures, and how to hold it for that.
    calibrations: Mapping[str, str] = MappingProxyType({})
    has_button = False  # that takes a reading when it is pressed
    by_button = False  # the next reading is the one taken with the button
    averages = 1

    def __init__(self, line: serial_line.SerialLine) -> None:
        self.line = line
        self.restore: list[bytes] = []  # commands that undo what was set, sent on leaving
        self.entered = False
        self.calibrated: dict[str, str] = {}  # when, by kind of calibration, since it was opened
        self.busy_until: float | None = None  # monotonic; None: no measurement is under way

    def identify(self) -> Identity:
        """Take the instrument under control, if that is still to do, and ask who it is."""
        if not self.entered:
            self._enter()
        return self._identity()

    @abc.abstractmethod
    def _enter(self) -> None:
        """Take the instrument under control; sets ``entered`` once it is."""

    @abc.abstractmethod
    def _identity(self) -> Identity:
        """Ask who it is."""

    @abc.abstractmethod
    def _ask(self, command: str) -> str:
        """The answer to a query, without what confirms it."""

    @abc.abstractmethod
    def settings(self, wanted: MeterSettings) -> None:
        """Change settings; those before are noted and put back by ``close``.

        Parameters
        ----------
        wanted : MeterSettings
        """

    @abc.abstractmethod
    def measure(self) -> Ended:
        """Measure once; blocks until the instrument reports the end, and holds the result."""

    @abc.abstractmethod
    def read(self) -> HeldResult:
        """Read the held result; may be called as often as wanted."""

    def calibrate(self, which: str) -> None:
        """Calibrate, once the instrument is held as ``calibrations`` says.

        Parameters
        ----------
        which : str
            One of ``calibrations``.

        Raises
        ------
        InputError
            If this instrument has no such calibration.
        """
        raise InputError(f"a {self.family} has no {which} calibration")

    def pressed(self, limit_s: float) -> bool:
        """Whether the instrument's button is pressed within a time.

        Parameters
        ----------
        limit_s : float
        """
        return False

    def leave(self) -> None:
        """Give the instrument back to its user, once it is idle and its settings are put back."""
        self.line.drain(0.05)

    def stop(self) -> None:
        """End a running measurement; one that cannot be cancelled is waited for."""
        self.line.await_bytes(self.busy_for_s())

    def obeyed(self, command: bytes) -> bool:
        """Send a command that puts a setting back; whether the instrument says that it has.

        Parameters
        ----------
        command : bytes

        Raises
        ------
        NoReplyError, LineFaultError, RefusedError
        """
        self.line.send(command)
        self.line.drain(0.1)
        return True

    def close(self) -> None:
        """Leave the instrument as it was and close the line, however the work ended.

        What could not be put back stays in ``restore``.
        """
        self.line.outlive_log()
        try:
            if self.entered:
                self._finish()
                self._put_back()
                self.leave()
        except instrument_errors.InstrumentError:
            pass  # the line is lost: the caller has the error, or all its readings
        finally:
            self.line.close()

    @contextmanager
    def measuring(self, limit_s: float) -> Iterator[None]:
        """Start a measurement in this block; ``measured`` notes its end.

        An interrupt waits for the end of the block: a measurement that was started is known to be
        under way, and one that is thought to be under way was started.

        Parameters
        ----------
        limit_s : float
            By when it must have ended.
        """
        with self.line.held():
            self.busy_until = time.monotonic() + self.line.pace.limit_s(limit_s)
            try:
                yield
            except instrument_errors.LineFaultError:  # bytes lay waiting: the command was not sent
                self.measured()
                raise

    def measured(self) -> None:
        """Note that no measurement is under way any more."""
        self.busy_until = None

    def busy_for_s(self) -> float:
        """Seconds, of the instrument, after which a measurement under way must have ended."""
        left = 0.0 if self.busy_until is None else self.busy_until - time.monotonic()
        return max(left, 0.0) / self.line.pace.scale

    def _finish(self) -> None:
        """Let the instrument end what it was asked to do before it is asked to undo it."""
        if self.busy_until is not None:
            self.stop()
            self.measured()
        elif self.line.unanswered:
            self.line.await_bytes(ANSWER_S)
        self.line.drain(0.3)

    def _put_back(self) -> None:
        """Send the commands that undo what was set, last first, until each is confirmed.

        An instrument that once kept silent is sent each command once: it may still receive.
        """
        tries = RESTORE_TRIES
        for command in reversed(self.restore[:]):
            outcomes: list[bool | None] = []
            while len(outcomes) < tries and True not in outcomes:
                outcomes.append(self._tried(command))
            if True in outcomes:
                self.restore.remove(command)
            if set(outcomes) == {None}:
                tries = 1

    def _tried(self, command: bytes) -> bool | None:
        """Whether a command is confirmed; None where nothing answers."""
        try:
            return self.obeyed(command)
        except instrument_errors.NoReplyError:
            return None
        except (instrument_errors.LineFaultError, instrument_errors.RefusedError):
            self.line.drain(0.2)
            return False

    def agreed(self, command: str) -> str:
        """The answer to a query sent twice, for facts that are recorded or put back afterwards.

        Raises
        ------
        UntrustedReadingError
            If the two answers differ.
        """
        first, second = self._ask(command), self._ask(command)
        if first != second:
            raise instrument_errors.UntrustedReadingError(
                f"asked {command!r} twice, the instrument answered "
                f"{first!r} and {second!r}; check the cable")
        return first

    def numbers(self, text: str, count: int, separator: str = ",") -> list[float]:
        """Exactly ``count`` numbers of a reply.

        Parameters
        ----------
        text : str
        count : int
        separator : str

        Raises
        ------
        LineFaultError
            If there are fewer or more, or one is not a number.
        """
        cells = [cell.strip() for cell in text.split(separator)]
        if len(cells) != count or not all(re.fullmatch(NUMBER, cell) for cell in cells):
            raise instrument_errors.LineFaultError(
                f"{self.line.name}: {serial_line.shown(text.encode())} arrived where {count} "
                f"number{'s' if count > 1 else ''} should stand; measure again, "
                "and check the cable")
        return [float(cell) for cell in cells]

    def xyz_cells(self, text: str) -> list[str]:
        """The last three of a reply's cells, X, Y and Z, each known to be a number."""
        cells = text.split(",")[-3:]
        self.numbers(",".join(cells), 3)
        return cells

    def grid(self, points: float, first: float, last: float, step: float) -> np.ndarray:
        """Wavelengths (P,) in nm that the instrument states it uses.

        Parameters
        ----------
        points : float
            P.
        first, last, step : float, nm

        Raises
        ------
        LineFaultError
            If the four numbers contradict each other or are no spectrum's.
        """
        possible = 2 <= points <= MAX_POINTS and points == int(points) and step > 0
        if not (possible and RANGE_NM[0] <= first < last <= RANGE_NM[1]
                and abs(first + (points - 1) * step - last) <= 0.01 * step):
            raise instrument_errors.LineFaultError(
                f"{self.line.name}: the instrument states {points:g} points from "
                f"{first:g} to {last:g} nm in steps of {step:g} nm, which cannot "
                "be; measure again, and check the cable")
        return first + step * np.arange(int(points))

    def values_at(self, nm: np.ndarray, rows: Sequence[str], separator: str = ",") -> np.ndarray:
        """Values (P,) of rows of wavelength and value, at the wavelengths that were stated.

        Parameters
        ----------
        nm : (P,) array
        rows : P of str
        separator : str

        Raises
        ------
        UntrustedReadingError
            If the rows are of other wavelengths.
        """
        pairs = np.array([self.numbers(row, 2, separator) for row in rows])
        if not np.array_equal(pairs[:, 0], nm):
            raise instrument_errors.UntrustedReadingError(
                f"{self.line.name}: the spectrum's wavelengths are not "
                f"those that the instrument states ({nm[0]:g}-{nm[-1]:g} "
                f"nm, {nm.size} points); measure again, and check the "
                "cable")
        return np.asarray(pairs[:, 1])

    def quantity_of(self, unit: float, remedy: str) -> Quantity:
        """Radiance or irradiance, from the code 0 or 1 that the instrument states.

        Parameters
        ----------
        unit : float
        remedy : str
            What to mount instead, for the sentence.

        Raises
        ------
        LineFaultError
            At any other code.
        """
        if unit not in UNITS:
            raise instrument_errors.LineFaultError(
                f"{self.line.name}: unit code {unit:g} is neither radiance (0) "
                f"nor irradiance (1); {remedy}")
        return UNITS[int(unit)]

    def refused(self, command: str, code: int) -> instrument_errors.RefusedError:
        """The error for an instrument's own error code, in the words of its table."""
        sentence = self.errors.get(
            code, "an error that its protocol notes do not list; see the "
            "instrument's manual")
        return instrument_errors.RefusedError(
            f"{self.family} refused {command!r} with error {code}: {sentence}", code)

    def no_reply(self, reply: str, command: str) -> instrument_errors.LineFaultError:
        """The error for bytes that cannot be the answer to ``command``."""
        return instrument_errors.LineFaultError(
            f"{self.line.name}: {reply[:60]!r} is no reply to {command!r}; "
            "measure again, and check the cable")

    def wrong(self, reply: str) -> instrument_errors.WrongInstrumentError:
        """The error for a reply in another instrument's language."""
        other = next((name for pattern, name in LANGUAGES if re.search(pattern, reply)), None)
        hint = (f"this looks like {other}: name it with --instrument"
                if other else "name the instrument that is on this port, or choose its port from "
                "'spectrabox meter list'")
        return instrument_errors.WrongInstrumentError(
            f"{self.line.name}: {self.family} was asked for, but "
            f"{serial_line.shown(reply.encode())} answers; {hint}")
