"""JETI instruments: what all share (one-byte answers, error numbers, text answers to queries), and
the drivers of specbos 1211 and specbos 2501 with their kin.
"""
from __future__ import annotations

import re
from contextlib import suppress

import numpy as np

from spectrabox.capture.meter import serial_line
from spectrabox.capture.meter.instruments import instrument_errors, interface
from spectrabox.capture.meter.stated import Stated, printed, stated_by_xyz
from spectrabox.radiometry.records.spectra import Quantity
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


class Jeti(interface.Instrument):
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
            except (instrument_errors.NoReplyError, instrument_errors.LineFaultError):
                continue
            if reply:
                self.line.drain(0.05)
                self._require_model(reply)
                self.entered = True
                return
        raise instrument_errors.NoReplyError(
            f"{self.line.name}: no answer at {', '.join(map(str, self.speeds))} "
            "baud; check that the instrument is on and that this is its port")

    def _identity(self) -> interface.Identity:
        model = self._ask("*idn?")
        self._require_model(model)
        serial_number = self._ask("*para:spnum?").rpartition(":")[2].strip()
        return interface.Identity(model, serial_number, self._ask("*vers?"))

    def stop(self) -> None:
        self.line.send(ESC)
        self.line.drain(0.5)

    def obeyed(self, command: bytes) -> bool:
        self.line.send(command)
        return self.line.read_byte(ACK + NAK, interface.RESTORE_S, skip=ENQ) == ACK

    def _require_model(self, reply: str) -> None:
        if not re.search(self.models, reply, re.IGNORECASE):
            raise self.wrong(reply)

    def _measure(self, command: str) -> interface.Ended:
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
        return OUTCOMES.get(code, ReadingOutcome.MEASURED), ()

    def _text(self, reply: bytes) -> str:
        return serial_line.ascii_text(reply, self.line.name).strip()

    def _ask(self, command: str) -> str:
        """The text answer to a query, without its line end."""
        self.line.write(command.encode() + b"\r")
        text = self._text(self._until(b"\r", command, REPLY_S))
        if text.lower().startswith(command.lower()):
            raise instrument_errors.LineFaultError(
                f"{self.line.name}: the command {command!r} came back instead of "
                "an answer; switch the instrument off and on, and check the "
                "adapter")
        return text

    def _ask_labelled(self, command: str, last: str) -> str:
        """The answer to a query that comes in several lines, of which the last holds ``last``."""
        text = self._ask(command)
        while last.upper() not in text.upper():
            text += " " + self._text(self.line.read_until((b"\r",), REPLY_S))
            if len(text) > 200:
                raise instrument_errors.LineFaultError(
                    f"{self.line.name}: {text[:60]!r} holds no {last}; check the "
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
        reply = serial_line.ascii_text(
            self.line.read_until((b"\r", ), REPLY_S).lstrip(ENQ), self.line.name)
        match = re.fullmatch(r"\s*(?:Error Code:)?\s*(\d+)\b.*", reply.strip())
        if match is None:
            raise instrument_errors.LineFaultError(
                f"{self.line.name}: {serial_line.shown(reply.encode())} states no error "
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
        match = re.search(rf"{re.escape(label)}\s*:?\s*({interface.NUMBER})(?=\s|$)", text,
                          re.IGNORECASE)
        if match is None:
            raise instrument_errors.LineFaultError(
                f"{self.line.name}: {serial_line.shown(text.encode())} states no {label}; "
                "measure again, and check the cable")
        return match[1]


# ---- specbos 1211 --------------------------------------------------------------------------------
# JETI specbos 1201 and 1211, and the CRS SpectroCAL, which is taken to be one of them.
#
# Sources: Argyll's specbos driver, a Python driver for the 1211, CRS and JETI scripts; they agree.
# Not checked on an instrument yet. ``*CONF`` settings cannot be read; they last until the
# instrument is switched off, or until it is asked to take its own again, which one source does
# (Argyll). Nothing is saved in it.

FIRST_NM, LAST_NM, STEP_NM = 380, 780, 1
MAX_BLOCKS = 6              # header, unit label and values, each closed by an empty line
UNKNOWN_COMMAND = 4
DEFAULTS = b"*CONF:DEFAULT\r"


class Specbos1211(Jeti):
    """JETI specbos 1201 or 1211, CRS SpectroCAL."""

    name = "specbos1211"
    family = "JETI specbos 1211"
    speeds = (921600, 115200, 38400)
    models = r"SB05|SB12|JETI_SB|SPECTROCAL"
    baud = speeds[0]

    def _identity(self) -> interface.Identity:
        identity = super()._identity()
        self.line.drain(0.1)  # old firmware states its version on two lines
        return identity

    def settings(self, wanted: interface.MeterSettings) -> None:
        self.integration_ms = wanted.integration_ms
        commands = [f"*CONF:WRAN {FIRST_NM} {LAST_NM} {STEP_NM}", "*CONF:FUNC 6", "*CONF:FORM 7"]
        commands += ["*CONF:EXPO 1"] if wanted.integration_ms is None else \
            [f"*CONF:TINT {wanted.integration_ms:g}", "*CONF:EXPO 2"]
        if wanted.averages is not None:
            self.averages = wanted.averages
            commands.append(f"*CONF:AVER {wanted.averages}")
        if wanted.sync_hz is not None:
            commands += ["*CONF:CYCMOD 1", f"*CONF:CYCTIM {round(1e6 / wanted.sync_hz)}"]
        with suppress(instrument_errors.RefusedError):  # a 1201 has no laser
            self._set_to("*CONTR:LASER 0")
        self.restore.append(DEFAULTS)
        for command in commands:
            self._set_to(command)

    def measure(self) -> interface.Ended:
        return self._measure("*INIT")

    def read(self) -> interface.HeldResult:
        head = self._ask("*CONTR:MHEAD?")
        match = re.fullmatch(r"mhead:\s*([01])", head)
        if match is None:
            raise instrument_errors.LineFaultError(
                f"{self.line.name}: {head!r} does not say which head is mounted; "
                "check the cable")
        nm, values, text = self._spectrum()
        irradiance = match[1] == "1"
        if irradiance != ("irradiance" in text.lower()):
            raise instrument_errors.LineFaultError(
                f"{self.line.name}: the spectrum's header and the mounted head "
                "disagree on radiance or irradiance; measure again")
        stated, colour = self._figures()
        return interface.HeldResult(nm, values,
                                    Quantity.IRRADIANCE if irradiance else Quantity.RADIANCE,
                                    stated, self.integration_ms, (head, text, colour))

    def leave(self) -> None:
        self.line.send(b"*CONTR:LASER 0\r")
        self.line.drain(0.1)

    def _spectrum(self) -> tuple[np.ndarray, np.ndarray, str]:
        self.line.write(b"*FETCH:SPRAD\r")
        nm = np.arange(FIRST_NM, LAST_NM + STEP_NM, STEP_NM, dtype=float)
        text = ""
        for _ in range(MAX_BLOCKS):
            reply = self._until(b"\r\r", "*FETCH:SPRAD", SPECTRUM_S)
            block = serial_line.ascii_text(reply, self.line.name).strip("\r\n ")
            text += block + "\n\n"
            rows = block.split("\r")
            if len(rows) == nm.size:
                return nm, self.values_at(nm, rows, "\t"), text
        raise instrument_errors.LineFaultError(
            f"{self.line.name}: no block of {nm.size} values from {FIRST_NM} "
            f"to {LAST_NM} nm arrived; measure again, and check the cable")

    def _figures(self) -> tuple[Stated, str]:
        """What the instrument computed from the spectrum, and its replies."""
        try:
            text = self._ask_labelled("*FETCH:XYZ", "Z")
        except instrument_errors.RefusedError as error:
            if error.code != UNKNOWN_COMMAND:
                raise
            luminance = self._ask("*FETCH:PHOTO")  # old firmware
            chromaticity = self._ask_labelled("*FETCH:CHROMXY", "_y")
            return self._stated(luminance, chromaticity), luminance + chromaticity
        return stated_by_xyz([self._after(text, axis) for axis in "XYZ"]), text


# ---- specbos 2501 --------------------------------------------------------------------------------
# JETI spectraval 1501 and 1511, and specbos 2501 (radiance, 380-780 nm in 1 nm steps).
#
# Sources: Argyll's specbos driver, Specbos2501DataAcquisition, pyplr. The least certain of the
# drivers: how a held result is sent again is taken from one source. Not checked on an instrument
# yet. Nothing is saved in the instrument.

TEXT_FORM = "2"


class Specbos2501(Jeti):
    """JETI spectraval 1501 or 1511, specbos 2501."""

    name = "specbos2501"
    family = "JETI specbos 2501"
    speeds = (921600, 115200)
    models = r"SDCM3|DCM3_JETI|PECFIRM_JETI|SB25"  # the first letter of SPECFIRM is sometimes lost
    baud = speeds[0]

    def settings(self, wanted: interface.MeterSettings) -> None:
        self.integration_ms = wanted.integration_ms
        self.averages = wanted.averages or 1
        self._set("form", TEXT_FORM)
        if wanted.sync_hz is not None:
            self._set("syncmod", "1")
            self._set("syncfreq", f"{wanted.sync_hz:g}")

    def measure(self) -> interface.Ended:
        return self._measure(f"*MEAS:LIGHT {self.integration_ms or 0:g} {self.averages} 0")

    def read(self) -> interface.HeldResult:
        grid = self._ask("*para:wran?")
        first, last, step = self.numbers(re.sub(r"\s+", " ", grid.rpartition(":")[2].strip()), 3,
                                         " ")
        if step <= 0 or not 100 <= first < last <= 3000 or (last - first) / step > 5000:
            raise instrument_errors.LineFaultError(
                f"{self.line.name}: {grid!r} is no wavelength range; check the "
                "cable")
        nm = np.arange(first, last + step / 2, step)
        self.line.write(b"*CALC:SPRAD\r")
        reply = self._until(ETX, "*CALC:SPRAD", SPECTRUM_S).lstrip(ENQ + ACK + BEL)
        if not reply.startswith(STX):
            raise instrument_errors.LineFaultError(
                f"{self.line.name}: the spectrum does not begin with STX; measure "
                "again")
        rows = serial_line.ascii_text(reply[1:-1], self.line.name).strip("\r\n").split("\r")
        values = self.values_at(nm, [row.strip("\n") for row in rows], "\t")
        luminance = self._ask("*calc:PHOTOmetric")
        chromaticity = self._ask_labelled("*calc:CHROMXY", "_y")
        return interface.HeldResult(nm, values, Quantity.RADIANCE,
                                    self._stated(luminance, chromaticity), self.integration_ms,
                                    (grid, *rows, luminance, chromaticity))

    def _set(self, key: str, value: str) -> None:
        before = self.agreed(f"*para:{key}?").rpartition(":")[2].strip()
        if not re.fullmatch(r"\d+(\.\d+)?", before):
            raise instrument_errors.LineFaultError(
                f"{self.line.name}: {key} is {before!r}, which could not be put "
                "back afterwards")
        self.restore.append(f"*para:{key} {before}\r".encode())
        self._set_to(f"*para:{key} {value}")
