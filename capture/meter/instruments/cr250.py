"""Colorimetry Research CR-250 and CR-300 (radiance or irradiance, as the accessory makes it).

Sources: CR protocol manual 1.36, CR-250 user guide, the Brainard laboratory's driver and
colour-specio; reply sizes agree. Not checked on an instrument yet.
"""
from __future__ import annotations

import re

import numpy as np

from spectrabox.capture.meter.instruments import interface
from spectrabox.capture.meter.instruments.instrument_errors import LineFaultError
from spectrabox.capture.meter.stated import mean_wavelength, printed, stated_by_xyz
from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.spectra.readings import ReadingOutcome

REPLY_S = 5.0
BETWEEN_S = 0.05            # the manual asks for 50 ms between commands
AFTER_SPECTRUM_S = 0.2
MEASURE_S = 85.0            # slow speed takes up to 75 s
ECHO = b"E\r"               # a toggle without an answer
SPECTRORADIOMETER = "2"
ERRORS = {
    -300: "the sync mode does not fit", -301: "the sync period is out of range",
    -302: "it cannot lock to the light", -303: "the light fluctuates",
    -304: "the light is too weak for this range",
    -305: "the light is too weak to measure",
    -306: "the light is too strong", -331: "its hardware failed",
    -334: "a calibration table is missing",
    -335: "a calibration table is missing", -500: "the command is unknown",
    -505: "the filter is not known",
    **dict.fromkeys(range(-510, -505), "a filter or the accessory is not known"),
    -511: "the accessory is not known", -514: "the exposure multiplier is out of range",
    -515: "the aperture is not known",
    -518: "the exposure mode is out of range", -519: "the exposure is out of range",
    -521: "the sync mode is not offered",
    -522: "the sync frequency is out of range",
    **dict.fromkeys(range(-560, -551), "its calibration failed")}
WARNINGS = {100: "too dark for automatic sync", 101: "the light is steady: no sync was used",
            102: "the exposure limit was reached", 103: "the sync signal is weak"}
OUTCOMES = {-300: ReadingOutcome.NO_SYNC, -301: ReadingOutcome.NO_SYNC,
            -302: ReadingOutcome.NO_SYNC,
            -303: ReadingOutcome.UNSTEADY, -304: ReadingOutcome.TOO_DARK,
            -305: ReadingOutcome.TOO_DARK,
            -306: ReadingOutcome.TOO_BRIGHT}


class Cr250(interface.Instrument):
    """Colorimetry Research CR-250 or CR-300."""

    name = "cr250"
    family = "Colorimetry Research CR-250"
    baud = 115200
    errors = ERRORS

    def _identity(self) -> interface.Identity:
        model = self._ask("RC Model")
        if not model.startswith("CR-"):
            raise self.wrong(model)
        if self._ask("RC InstrumentType") != SPECTRORADIOMETER:
            raise self.wrong(f"{model}, which is no spectroradiometer")
        return interface.Identity(model, self._ask("RC ID"), self._ask("RC Firmware"))

    def settings(self, wanted: interface.MeterSettings) -> None:
        if wanted.integration_ms is not None:
            self._set("ExposureMode", "1")
            self._set("Exposure", f"{wanted.integration_ms:g}")
        if wanted.averages is not None:
            self._set("ExposureX", str(wanted.averages))
            self.averages = wanted.averages
        if wanted.sync_hz is not None:
            self._set("SyncMode", "2")
            self._set("SyncFreq", f"{wanted.sync_hz:g}")

    def measure(self) -> interface.Ended:
        limit_s = MEASURE_S * self.averages + 10
        self.line.pace.sleep(BETWEEN_S)
        with self.measuring(limit_s):
            self.line.write(b"M\r")
        code, _ = self._answer("M", limit_s)
        self.measured()
        if code in OUTCOMES:
            return OUTCOMES[code], ()
        if code < 0:
            raise self.refused("M", code)
        low = code in (100, 102)
        warnings = (Finding("meter.warning", Severity.NOTE, values={
            "number": code, "meaning": WARNINGS.get(code, "not in the protocol notes")}),
                    ) if code else ()
        return ReadingOutcome.LOW_LIGHT if low else ReadingOutcome.MEASURED, warnings

    def read(self) -> interface.HeldResult:
        header = self._ask("RM Spectrum")
        first, last, step, points = self.numbers(",".join(header.split(",")[:4]), 4)
        nm = self.grid(points, first, last, step)
        rows = [self.line.read_line(REPLY_S) for _ in range(nm.size)]
        self.line.pace.sleep(AFTER_SPECTRUM_S)
        values = np.array([self.numbers(row, 1)[0] for row in rows])
        xyz, radiometric, exposure = (self._ask(f"RM {key}")
                                      for key in ("XYZ", "Radiometric", "Exposure"))
        unit, *_ = self.numbers(",".join(radiometric.split(",")[:3]), 3)
        quantity = self.quantity_of(int(unit), "mount an accessory for one of them")
        milliseconds = self.numbers(exposure.removesuffix(" msec"), 1)[0]
        self.numbers(xyz, 3)
        power, photons = (printed(cell) for cell in radiometric.split(",")[1:3])
        stated = stated_by_xyz(xyz.split(","), power, mean_wavelength(power, photons))
        return interface.HeldResult(nm, values, quantity, stated, milliseconds,
                          (header, *rows, xyz, radiometric, exposure))

    def obeyed(self, command: bytes) -> bool:
        if command == ECHO:
            return super().obeyed(command)
        self.line.pace.sleep(BETWEEN_S)
        self.line.send(command)
        return self._answer(command.decode().rstrip(), interface.RESTORE_S)[0] >= 0

    def _enter(self) -> None:
        self.entered = True
        self.line.send(b"\r")
        if b">" in self.line.drain(0.3):
            with self.line.held():
                self.restore.append(ECHO)
                self.line.send(ECHO)
            self.line.drain(0.3)

    def _set(self, key: str, value: str) -> None:
        before = self.agreed(f"RS {key}").split(" ")[0]
        if before == value:
            return
        if not re.fullmatch(r"-?\d+(\.\d+)?", before):
            raise LineFaultError(f"{self.line.name}: {key} is set to {before!r}, which could not "
                                 f"be put back afterwards; set {key} on the instrument itself")
        self.restore.append(f"SM {key} {before}\r".encode())
        self._ask(f"SM {key} {value}")

    def _ask(self, command: str) -> str:
        self.line.pace.sleep(BETWEEN_S)
        self.line.write(command.encode() + b"\r")
        code, result = self._answer(command, REPLY_S)
        if code < 0:
            raise self.refused(command, code)
        return result

    def _answer(self, command: str, limit_s: float) -> tuple[int, str]:
        reply = self.line.read_line(limit_s)
        match = re.fullmatch(r"(OK|ER):(-?\d+):([^:]*):(.*)", reply)
        if match is None and command == "RC Model":
            raise self.wrong(reply)
        # Older firmware repeats the key of the command only, newer the whole command with or
        # without its value.
        words = command.split(" ")
        known = {command, " ".join(words[:2]), words[min(1, len(words) - 1)]}
        if match is None or match[3] not in known or (match[1] == "OK") == (int(match[2]) < 0):
            raise self.no_reply(reply, command)
        return int(match[2]), match[4].strip()
