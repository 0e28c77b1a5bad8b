"""Photo Research PR-655 and PR-670 (PR-6xx and PR-7xx speak the same language).

Sources: PR-655/670 manual pages on reports and codes, and five public drivers; compared with
Psychtoolbox's PR655Toolbox and PR670Toolbox, as docs/reference/meters.md says. Not checked on an
instrument yet.
"""
from __future__ import annotations

import re

from spectrabox.capture.meter.instruments import interface
from spectrabox.capture.meter.instruments.instrument_errors import LineFaultError
from spectrabox.capture.meter.stated import printed, stated_by_xyz
from spectrabox.radiometry.spectra.readings import ReadingOutcome

REPLY_S = 10.0
SETTLE_S = 1.0              # between Q and PHOTO
MAX_EXPOSURE_S = 30.0
EXPOSURES = 3               # a trial for the automatic exposure, the light, the dark
# A report's code has five digits and its fields follow; a setting's stands alone, of four digits
# in the manual. Errors are signed, of any width.
REPORT_REPLY, SETTING_REPLY = r"(\d{5}|-\d+)(?:,(.*))?", r"(\d{4,5}|-\d+)()"
ECHO = b"E\r"               # a toggle without an answer
ERRORS = {
    -1: "the light is not constant", -2: "the light is too strong",
    -3: "it cannot lock: below 20 Hz, above 400 Hz or weak",
    -4: "the automatic exposure failed", -8: "the light is too weak", -9: "the sync failed",
    -10: "it cannot find the light's frequency", -12: "the automatic exposure took too long"}
OUTCOMES = {-1: ReadingOutcome.UNSTEADY, -2: ReadingOutcome.TOO_BRIGHT, -3: ReadingOutcome.NO_SYNC,
            -8: ReadingOutcome.TOO_DARK, -9: ReadingOutcome.NO_SYNC, -10: ReadingOutcome.NO_SYNC}


class Pr655(interface.Instrument):
    """Photo Research PR-655, PR-670 and relatives."""

    name = "pr655"
    family = "Photo Research PR-655"
    baud = 9600
    character_pause_s = 0.05
    errors = ERRORS

    def _identity(self) -> interface.Identity:
        model = self._ask("D111").strip()
        if not model.startswith("PR-"):
            raise self.wrong(model)
        return interface.Identity(model, self._ask("D110").strip(), self._ask("D114").strip())

    def settings(self, wanted: interface.MeterSettings) -> None:
        before = self.agreed("D602").split(",")
        if len(before) < 10:
            raise LineFaultError(f"{self.line.name}: {','.join(before)!r} is not a list of "
                                 "settings; check the cable")
        if before[5].strip().lower() == "english":
            self._set("SU1", "SU0")
        if wanted.integration_ms is not None:
            exposure_ms = (0 if before[6].strip().lower() == "adaptive"
                           else _leading_integer(before[7], self.line.name))
            self._set(f"SE{round(wanted.integration_ms):05d}", f"SE{exposure_ms:05d}")
        if wanted.averages is not None:
            self._set(f"SN{wanted.averages:02d}",
                      f"SN{_leading_integer(before[9], self.line.name):02d}")
            self.averages = wanted.averages
        if wanted.sync_hz is not None:
            if len(before) < 13 or before[12].strip().lower() != "no sync":
                raise LineFaultError(f"{self.line.name}: its sync setting could not be put back; "
                                     "set it on the instrument")
            frequency = re.fullmatch(r"\s*(\d+(?:\.\d+)?) Hertz\s*", before[-1])
            if frequency is None:
                raise LineFaultError(f"{self.line.name}: the sync frequency {before[-1]!r} could "
                                     "not be put back; set it on the instrument")
            self._set("SS3", "SS0")
            self._set(_sync_frequency(wanted.sync_hz), _sync_frequency(float(frequency[1])))

    def measure(self) -> interface.Ended:
        limit_s = 10 + self.averages * EXPOSURES * MAX_EXPOSURE_S
        with self.measuring(limit_s):
            self.line.write(b"M1\r")
        code, _ = self._code("M1", limit_s)
        self.measured()
        if code in OUTCOMES:
            self.line.send(b"C\r")  # clears the error state; whether it is answered is not known
            self.line.drain(0.3)
            return OUTCOMES[code], ()
        if code:
            raise self.refused("M1", code)
        return ReadingOutcome.MEASURED, ()

    def read(self) -> interface.HeldResult:
        grid = self._ask("D120")
        points, _, first, last, step = self.numbers(",".join(grid.split(",")[:5]), 5)
        nm = self.grid(points, first, last, step)
        header = self._ask("D5")
        rows = [self.line.read_line(REPLY_S) for _ in range(nm.size)]
        unit = self.numbers(header, 4)[0]
        values = self.values_at(nm, rows)
        colour, exposure = self._ask("D2"), self._ask("D13")
        exposures = re.findall(interface.NUMBER, exposure)
        milliseconds = float(exposures[-1]) if exposures else None
        quantity = self.quantity_of(unit, "mount an accessory for one of them")
        if self.numbers(colour, 4)[0] != unit:
            raise self.no_reply(colour, "D2")
        stated = stated_by_xyz(self.xyz_cells(colour), printed(header.split(",")[2]))
        return interface.HeldResult(nm, values, quantity, stated, milliseconds,
                          (grid, header, *rows, colour, exposure))

    def obeyed(self, command: bytes) -> bool:
        if command == ECHO:
            return super().obeyed(command)
        self.line.send(command)
        return self._code(command.decode().rstrip(), interface.RESTORE_S, SETTING_REPLY)[0] == 0

    def leave(self) -> None:
        self.line.send(b"Q")

    def _enter(self) -> None:
        self.entered = True
        self.line.send(b"Q")  # the instrument answers PHOTO only when it is not in remote mode yet
        self.line.pace.sleep(SETTLE_S)
        self.line.drain(0.2)
        self.line.write(b"PHOTO")
        self.line.read_until((b"REMOTE MODE",), REPLY_S)
        self.line.drain(0.2)
        self.line.write(b"D111\r")
        reply = self.line.read_line(REPLY_S)
        if "D111" in reply:  # echo was left on: a toggle; put back when the instrument is left
            self.line.drain(0.5)
            with self.line.held():
                self.restore.append(ECHO)
                self.line.send(ECHO)
            self.line.drain(0.5)

    def _set(self, command: str, back: str) -> None:
        self.restore.append(back.encode() + b"\r")
        self._ask(command, SETTING_REPLY)

    def _ask(self, command: str, form: str = REPORT_REPLY) -> str:
        self.line.write(command.encode() + b"\r")
        code, result = self._code(command, REPLY_S, form)
        if code:
            raise self.refused(command, code)
        return result

    def _code(self, command: str, limit_s: float, form: str = REPORT_REPLY) -> tuple[int, str]:
        """The code that a reply begins with, and the rest of the reply."""
        reply = self.line.read_line(limit_s)
        match = re.fullmatch(form, reply)
        if match is None and command == "D111":
            raise self.wrong(reply)
        if match is None:
            raise self.no_reply(reply, command)
        return int(match[1]), match[2] or ""


def _sync_frequency(hz: float) -> str:
    """The command for a frequency in whole hertz, as drivers in use send it."""
    return f"SK{round(hz):03d}"


def _leading_integer(text: str, line_name: str) -> int:
    match = re.match(r"\s*(\d+)", text)
    if match is None:
        raise LineFaultError(f"{line_name}: the setting {text!r} could not be put back; change it "
                             "on the instrument")
    return int(match[1])
