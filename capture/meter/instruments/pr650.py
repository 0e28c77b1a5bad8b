"""Photo Research PR-650 (380-780 nm in 4 nm steps).

Sources: PsychoPy, the Brainard laboratory's PR650 code with its table of quality codes,
Mcalibrator2's notes from the manual; compared with Psychtoolbox's PR650Toolbox, as
docs/reference/meters.md says. Not checked on an instrument yet. It has no leave-remote
command and cannot report its settings: it returns to its own at the next power-on. ``E`` is never
sent: it cannot be undone.
"""
from __future__ import annotations

import re

from spectrabox.capture.meter.instruments import interface
from spectrabox.capture.meter.instruments.instrument_errors import LineFaultError, NoReplyError
from spectrabox.capture.meter.stated import printed, stated_by_xyz
from spectrabox.radiometry.spectra.readings import ReadingOutcome

REPLY_S = 10.0
RESET_S = 0.1               # RTS low for 50 ms or more
EXPOSURE_S = 6.0
POINTS = 101
MAX_EMPTY_LINES = 20
ERRORS = {
    -1: "the light is too weak", 1: "no end of scan at the start", 3: "no start signal",
    4: "no end of scan for the integration", 5: "its DMA failed",
    6: "no end of scan after sync", 7: "it cannot lock to the light", 8: "the sync was lost",
    10: "the light is too weak",
    12: "its hardware failed", 13: "its software failed", 14: "no sample for L*u*v* or L*a*b*",
    16: "the automatic exposure is too slow: the light is not stable", 17: "its battery is low",
    18: "the light is low", 19: "the light is too strong", 20: "there is no sync signal",
    21: "its memory failed", 29: "its data are corrupted", 30: "the signal is noisy"}
OUTCOMES = {-1: ReadingOutcome.TOO_DARK, 7: ReadingOutcome.NO_SYNC, 8: ReadingOutcome.NO_SYNC,
            10: ReadingOutcome.TOO_DARK,
            16: ReadingOutcome.UNSTEADY, 18: ReadingOutcome.LOW_LIGHT,
            19: ReadingOutcome.TOO_BRIGHT,
            20: ReadingOutcome.NO_SYNC}
LINE_ENDS = (b"\n", b"\r")  # some firmware ends a line with a bare CR


class Pr650(interface.Instrument):
    """Photo Research PR-650."""

    name = "pr650"
    family = "Photo Research PR-650"
    baud = 9600
    character_pause_s = 0.01
    errors = ERRORS

    def _identity(self) -> interface.Identity:
        reply = self._ask("d110")
        match = re.fullmatch(r"(?:0+\s*,)?\s*(\w[\w -]*)", reply)
        if match is None:
            raise self.wrong(reply)
        return interface.Identity("PR-650", match[1].strip(), None)

    def settings(self, wanted: interface.MeterSettings) -> None:
        sync = "" if wanted.sync_hz is None else f"{wanted.sync_hz:g}"
        integration = round(wanted.integration_ms or 0)
        self.averages = wanted.averages or 1
        code = self._code(f"s01,,,,{sync},{integration},{self.averages:02d},1", REPLY_S)
        if code:
            raise self.refused("S", code)

    def measure(self) -> interface.Ended:
        limit_s = 30 + self.averages * 2 * EXPOSURE_S
        with self.measuring(limit_s):
            self.line.write(b"m0\n")
        code = self._answer("m0", limit_s)
        self.measured()
        if code and code not in OUTCOMES:
            raise self.refused("m0", code)
        return OUTCOMES.get(code, ReadingOutcome.MEASURED), ()

    def read(self) -> interface.HeldResult:
        grid = self._ask("d120")
        points, _, first, last, step = self.numbers(grid, 5)
        nm = self.grid(points, first, last, step)
        if nm.size != POINTS:
            raise LineFaultError(f"{self.line.name}: {nm.size} points are stated; a PR-650 has "
                                 f"{POINTS}")
        header = self._ask("d5")
        integral = self._line(REPLY_S)
        rows = [self._line(REPLY_S) for _ in range(nm.size)]
        quality, unit = self.numbers(header, 2)
        if quality not in (0, 18):
            raise self.refused("d5", int(quality))
        values = self.values_at(nm, rows)
        self.numbers(integral, 1)
        colour = self._ask("d2")
        quantity = self.quantity_of(unit, "mount a calibrated accessory")
        colour_quality, colour_unit = self.numbers(colour, 5)[:2]
        if (colour_quality, colour_unit) != (quality, unit):
            raise self.no_reply(colour, "d2")
        stated = stated_by_xyz(self.xyz_cells(colour), printed(integral))
        return interface.HeldResult(nm, values, quantity, stated, None,
                          (grid, header, integral, *rows, colour))

    def stop(self) -> None:
        """Nothing to wait for: the reset on leaving ends a measurement too."""

    def leave(self) -> None:
        """Reset it, where the cable carries RTS: it has no command for leaving, and a reset brings
        its own settings back.
        """
        self.line.pulse_rts(RESET_S)

    def _enter(self) -> None:
        self.entered = True
        self.line.pulse_rts(RESET_S)
        self.line.pace.sleep(1.0)
        self.line.drain(0.1)
        try:
            code = self._code("b1", REPLY_S)
        except NoReplyError:
            raise NoReplyError(f"{self.line.name}: the PR-650 is silent; it listens only within 5 "
                               "s of being switched on: switch it off and on, then run this "
                               "command at once") from None
        if code:
            raise self.wrong(str(code))

    def _code(self, command: str, limit_s: float) -> int:
        self.line.write(command.encode() + b"\n")
        return self._answer(command, limit_s)

    def _answer(self, command: str, limit_s: float) -> int:
        reply = self._line(limit_s)
        if not re.fullmatch(r"\d{3}|-\d+", reply):
            if command == "b1":
                raise self.wrong(reply)
            raise self.no_reply(reply, command)
        return int(reply)

    def _ask(self, command: str) -> str:
        self.line.write(command.encode() + b"\n")
        reply = self._line(REPLY_S)
        if reply.lower().startswith(command):
            raise LineFaultError(f"{self.line.name}: the PR-650 echoes commands; switch it off and "
                                 "on to stop that")
        return reply

    def _line(self, limit_s: float) -> str:
        for _ in range(MAX_EMPTY_LINES):
            if text := self.line.read_line(limit_s, LINE_ENDS):
                return text
        raise LineFaultError(f"{self.line.name}: only line ends arrive; check speed and cable")
