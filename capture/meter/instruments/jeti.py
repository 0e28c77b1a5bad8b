"""What all JETI instruments share: one-byte answers, error numbers, text answers to queries."""
from __future__ import annotations

import re

from spectrabox.capture.meter.instruments.instrument_errors import LineFaultError, NoReplyError
from spectrabox.capture.meter.instruments.interface import (
    NUMBER,
    RESTORE_S,
    Identity,
    Instrument,
    Measured,
)
from spectrabox.capture.meter.serial_line import ascii_text, shown
from spectrabox.capture.meter.stated import Stated, printed
from spectrabox.radiometry.spectra.readings import ReadingOutcome

ACK, NAK, BEL, ESC, ENQ, STX, ETX = b"\x06", b"\x15", b"\x07", b"\x1b", b"\x05", b"\x02", b"\x03"
REPLY_S = 5.0
IDENTIFY_S = 0.5            # at each speed in turn
EXPOSURE_S = 60.0           # the longest; the light, then the dark
SPECTRUM_S = 10.0
ERRORS = {
    4: "the command is unknown", 7: "a password is needed", 8: "a digit is wrong",
    10: "argument 1 is wrong", 11: "argument 2 is wrong", 12: "argument 3 is wrong",
    13: "argument 4 is wrong",
    20: "the parameter argument is wrong", 21: "the configuration argument is wrong",
    22: "the control argument is wrong",
    23: "the read argument is wrong", 24: "the fetch argument is wrong",
    25: "the measure argument is wrong",
    26: "the calculation argument is wrong", 27: "the calibration argument is wrong",
    101: "a checksum of its memory is wrong", 102: "a checksum of its memory is wrong",
    103: "a user file is wrong", 104: "a user file is wrong", 120: "the light is too strong",
    121: "the light is too weak",
    123: "the automatic exposure failed", 130: "it has no shutter", 131: "no dark result",
    132: "no reference result", 133: "no transmission result", 134: "no radiometric result",
    135: "no colour temperature",
    136: "no colour rendering",
    137: "no dark compensation", 138: "no light result", 139: "no peak result",
    140: "its calibration data are wrong", 141: "a wavelength is outside its calibration",
    147: "the scan was broken off", 160: "no flicker cycle was found", 161: "no trigger came",
    **dict.fromkeys((170, 171, 172, 225, 230, 231, 232), "its memory failed"),
    **dict.fromkeys(range(180, 188), "its calibration file is wrong"),
    **dict.fromkeys(range(190, 198), "its lamp file is wrong"),
    200: "its memory failed", 220: "its output failed", 251: "the wavelength range is wrong",
    280: "its battery is too low", 500: "the trigger failed", 501: "the trigger failed"}
OUTCOMES = {120: ReadingOutcome.TOO_BRIGHT, 121: ReadingOutcome.TOO_DARK,
            123: ReadingOutcome.UNSTEADY,
            160: ReadingOutcome.NO_SYNC, 161: ReadingOutcome.NO_SYNC}


class Jeti(Instrument):
    """A JETI instrument, whatever its model."""

    speeds: tuple[int, ...]                 # baud, tried in turn
    models: str                             # pattern of the models it may be, whatever the case
    errors = ERRORS
    integration_ms: float | None = None

    def _enter(self) -> None:
        """Find the speed of the line: the question changes nothing on an instrument."""
        for speed in self.speeds:
            self.line.set_baud(speed)
            self.line.drain(0.05)
            self.line.send(b"*idn?\r")
            try:
                reply = self._text(self.line.read_until((b"\r",), IDENTIFY_S))
            except (NoReplyError, LineFaultError):
                continue
            if reply:
                self.line.drain(0.05)
                self._require_model(reply)
                self.entered = True
                return
        raise NoReplyError(f"{self.line.name}: no answer at {', '.join(map(str, self.speeds))} "
                           "baud; check that the instrument is on and that this is its port")

    def _identity(self) -> Identity:
        model = self._ask("*idn?")
        self._require_model(model)
        serial_number = self._ask("*para:spnum?").rpartition(":")[2].strip()
        return Identity(model, serial_number, self._ask("*vers?"))

    def stop(self) -> None:
        self.line.send(ESC)
        self.line.drain(0.5)

    def obeyed(self, command: bytes) -> bool:
        self.line.send(command)
        return self.line.read_byte(ACK + NAK, RESTORE_S, skip=ENQ) == ACK

    def _require_model(self, reply: str) -> None:
        if not re.search(self.models, reply, re.IGNORECASE):
            raise self.wrong(reply)

    def _measure(self, command: str) -> Measured:
        """How a measurement ended, once it has: acknowledged, then a bell."""
        limit_s = 20 + self.averages * 2 * EXPOSURE_S
        with self.measuring(limit_s):
            self.line.write(command.encode() + b"\r")
        code = 0
        for expected, limit in ((ACK, REPLY_S), (BEL, limit_s)):
            if self.line.read_byte(expected + NAK, limit, skip=ENQ) == NAK:
                self.measured()
                code = self._error_number()
                break
        self.measured()
        if code and code not in OUTCOMES:
            raise self.refused(command, code)
        return Measured(OUTCOMES.get(code, ReadingOutcome.MEASURED))

    def _text(self, reply: bytes) -> str:
        return ascii_text(reply, self.line.name).strip()

    def _ask(self, command: str) -> str:
        """The text answer to a query, without its line end."""
        self.line.write(command.encode() + b"\r")
        text = self._text(self._until(b"\r", command, REPLY_S))
        if text.lower().startswith(command.lower()):
            raise LineFaultError(f"{self.line.name}: the command {command!r} came back instead of "
                                 "an answer; switch the instrument off and on, and check the "
                                 "adapter")
        return text

    def _ask_labelled(self, command: str, last: str) -> str:
        """The answer to a query that comes in several lines, of which the last holds ``last``."""
        text = self._ask(command)
        while last.upper() not in text.upper():
            text += " " + self._text(self.line.read_until((b"\r",), REPLY_S))
            if len(text) > 200:
                raise LineFaultError(f"{self.line.name}: {text[:60]!r} holds no {last}; check the "
                                     "cable")
        return text

    def _until(self, end: bytes, command: str, limit_s: float) -> bytes:
        """The reply to a command up to its end; a refusal is raised with its error number."""
        reply = self.line.read_until((end, NAK), limit_s).lstrip(ENQ + b"\n")
        if reply.endswith(NAK):
            raise self.refused(command, self._error_number())
        return reply

    def _set_to(self, command: str) -> None:
        """Send a command that is answered with one byte."""
        self.line.write(command.encode() + b"\r")
        if self.line.read_byte(ACK + NAK, REPLY_S, skip=ENQ) == NAK:
            raise self.refused(command, self._error_number())

    def _error_number(self) -> int:
        self.line.write(b"*stat:err?\r")
        reply = ascii_text(self.line.read_until((b"\r",), REPLY_S).lstrip(ENQ), self.line.name)
        match = re.fullmatch(r"\s*(?:Error Code:)?\s*(\d+)\b.*", reply.strip())
        if match is None:
            raise LineFaultError(f"{self.line.name}: {shown(reply.encode())} states no error "
                                 "number; check the cable")
        return int(match[1])

    def _stated(self, luminance: str, chromaticity: str) -> Stated:
        """Luminance and chromaticity from the answers to the queries for them."""
        number = luminance.rpartition(":")[2]
        self.numbers(number, 1)
        return Stated(printed(number), printed(self._after(chromaticity, "Chrom_x")),
                      printed(self._after(chromaticity, "Chrom_y")))

    def _after(self, text: str, label: str) -> str:
        """The number after ``label`` in ``X: 1 Y: 2``, as it is printed."""
        match = re.search(rf"{re.escape(label)}\s*:?\s*({NUMBER})(?=\s|$)", text, re.IGNORECASE)
        if match is None:
            raise LineFaultError(f"{self.line.name}: {shown(text.encode())} states no {label}; "
                                 "measure again, and check the cable")
        return match[1]
