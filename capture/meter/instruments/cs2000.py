"""Konica Minolta CS-2000 and CS-2000A (radiance, 380-780 nm in 1 nm steps).

Sources: the public drivers colour-specio, KonicaMinolta-CS2000-MATLAB, EIEIO and others, which
agree. Not checked on an instrument yet. Nothing is written to the instrument's flash where its
firmware allows that (``RMTS,2``).
"""
from __future__ import annotations

import re

import numpy as np

from spectrabox.capture.meter import stated
from spectrabox.capture.meter.instruments import instrument_errors, interface
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.readings import ReadingOutcome

NM = np.arange(380.0, 781.0)
BLOCK_SIZES = (100, 100, 100, 101)
REPLY_S = 10.0
ANNOUNCE_S = 20.0           # the pre-measurement takes 1 to 10 s before the duration is announced
MARGIN_S = 15.0
LONG_S = 100  # announced durations from here mean little light: there is no "too dark" code
NOT_CALCULATED = -9.9999e9
ERRORS = {
    0: "the command is unknown, or the instrument is not in remote mode or is busy",
    2: "it is measuring",
    5: "it holds no compensation data; it needs service",
    10: "the light is over range, or flickers too strongly",
    17: "a parameter is out of range, or the command does not fit the present state",
    20: "it holds no measurement",
    30: "its memory failed; it needs service", 32: "its memory failed; it needs service",
    34: "its memory failed; it needs service",
    51: "its temperature is out of range; let it warm up or cool down",
    52: "its temperature is out of range; let it warm up or cool down",
    71: "the sync signal is outside 20-200 Hz",
    81: "its shutter failed", 82: "its ND filter failed",
    83: "the aperture dial was moved during the measurement",
    84: "its fan failed", 99: "its program failed; switch it off and on"}
OUTCOMES = {10: ReadingOutcome.TOO_BRIGHT, 71: ReadingOutcome.NO_SYNC}


class Cs2000(interface.Instrument):
    """Konica Minolta CS-2000 or CS-2000A."""

    name = "cs2000"
    family = "Konica Minolta CS-2000"
    baud = 115200
    rtscts = True
    errors = ERRORS
    announced = False                   # the duration of the measurement under way

    def _identity(self) -> interface.Identity:
        reply = self._ask("IDDR")
        fields = reply.split(",")
        if len(fields) < 3 or not fields[0].strip().startswith("CS-2000"):
            raise self.wrong(reply)
        model = "CS-2000A" if fields[1].strip() == "2" else "CS-2000"
        return interface.Identity(model, fields[2].strip(), None)

    def settings(self, wanted: interface.MeterSettings) -> None:
        if wanted.averages not in (None, 1):
            raise instrument_errors.RefusedError(
                f"{self.family} refused 'averages = {wanted.averages}' with error "
                "17: it has no averaging; use --repeat")
        if wanted.integration_ms is not None:
            before = self._remember("SPMS", "SPMR")
            self._ask(f"SPMS,3,{round(wanted.integration_ms * 1000)},{_filter_of(before)}")
        if wanted.sync_hz is not None:
            self._remember("SCMS", "SCMR")
            self._ask(f"SCMS,1,{round(wanted.sync_hz * 100)}")

    def measure(self) -> interface.Ended:
        with self.measuring(ANNOUNCE_S):
            self.announced = False
            self.line.write(b"MEAS,1\n")
        code, duration = self._reply("MEAS,1", ANNOUNCE_S)
        if code in OUTCOMES:
            self.measured()
            return OUTCOMES[code], ()
        self.announced = True
        announced = self.numbers(duration, 1)[0]
        if not 0 <= announced <= 300:
            raise instrument_errors.LineFaultError(
                f"{self.line.name}: a measurement of {announced:g} s is "
                "announced; at most 242 s can be")
        code, rest = self._reply("MEAS,1", announced + MARGIN_S)
        if rest:
            raise instrument_errors.LineFaultError(
                f"{self.line.name}: the end of the measurement should be a bare "
                "OK00; measure again")
        self.measured()
        if code in OUTCOMES:
            return OUTCOMES[code], ()
        return (ReadingOutcome.LOW_LIGHT if announced >= LONG_S else ReadingOutcome.MEASURED), ()

    def read(self) -> interface.HeldResult:
        conditions = self._ask("MEDR,0,0,1")
        blocks = [self._ask(f"MEDR,1,0,{block}") for block in (1, 2, 3, 4)]
        colours = self._ask("MEDR,2,0,00")
        values: list[float] = []
        for block, size in zip(blocks, BLOCK_SIZES, strict=True):
            values += self.numbers(block, size)
        colour = self.numbers(colours, 24)
        if NOT_CALCULATED in values or NOT_CALCULATED in colour[:5]:
            raise instrument_errors.UntrustedReadingError(
                f"{self.family} could not calculate part of the spectrum; "
                "measure again")
        exposure_us = re.match(r"[^,]*,[^,]*,\s*(\d+)\s*(?:,|$)", conditions)
        if exposure_us is None:
            raise instrument_errors.LineFaultError(
                f"{self.line.name}: {conditions!r} states no integration time; "
                "measure again")
        cells = colours.split(",")
        return interface.HeldResult(NM, np.array(values), Quantity.RADIANCE,
                          stated.stated_by_xyz(cells[2:5], power=stated.printed(cells[0])),
                          int(exposure_us[1]) / 1000, (conditions, *blocks, colours))

    def stop(self) -> None:
        """Cancel; before the duration is announced the instrument hears nothing, not even that."""
        if not self.announced:
            self.line.await_bytes(self.busy_for_s())
            self.line.drain(0.2)
        self.line.send(b"MEAS,0\n")
        self.line.await_bytes(interface.RESTORE_S)
        self.line.drain(0.5)

    def obeyed(self, command: bytes) -> bool:
        self.line.send(command)
        return self.line.read_line(interface.RESTORE_S) == "OK00"

    def _enter(self) -> None:
        self.line.drain(0.2)
        self.entered = True
        self.restore.append(b"RMTS,0\n")
        self.line.write(b"RMTS,2\n")
        reply = self.line.read_line(REPLY_S)
        if reply in ("ER00", "ER17"):  # firmware before 3.00 knows RMTS,1 only
            self.line.write(b"RMTS,1\n")
            reply = self.line.read_line(REPLY_S)
        if error := re.fullmatch(r"ER(\d\d)", reply):
            raise self.refused("RMTS", int(error[1]))
        if reply != "OK00":
            raise self.wrong(reply)
        self.restore.append(b"MSWE,1\n")
        self._ask("MSWE,0")  # with the body's button enabled, reading a result clears it

    def _remember(self, command: str, question: str) -> str:
        before = self.agreed(question)
        self.restore.append(f"{command},{before}\n".encode())
        return before

    def _ask(self, command: str) -> str:
        self.line.write(command.encode() + b"\n")
        return self._reply(command, REPLY_S)[1]

    def _reply(self, command: str, limit_s: float) -> tuple[int, str]:
        """0 and what follows OK00, or the code of a measurement that could not be taken."""
        reply = self.line.read_line(limit_s)
        match = re.fullmatch(r"(OK|ER)(\d\d)(,.*)?", reply)
        if match is None or (match[1] == "OK") != (match[2] == "00" and not reply.startswith("ER")):
            raise self.no_reply(reply, command)
        if match[1] == "ER":
            if command.startswith("MEAS") and int(match[2]) in OUTCOMES:
                return int(match[2]), ""
            self.measured()
            raise self.refused(command, int(match[2]))
        return 0, (match[3] or "")[1:]


def _filter_of(conditions: str) -> str:
    """The internal ND filter for a fixed exposure, which knows no automatic one: on where it is set
    on, else off. Old firmware states none, so that the count of fields tells.
    """
    speed, *rest = conditions.split(",")
    stated = len(rest) == (1 if speed in ("0", "1") else 2)
    return "1" if stated and rest[-1] == "1" else "0"
