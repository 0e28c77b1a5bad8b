"""JETI specbos 1201 and 1211, and the CRS SpectroCAL, which is taken to be one of them.

Sources: Argyll's specbos driver, a Python driver for the 1211, CRS and JETI scripts; they agree.
Not checked on an instrument yet. ``*CONF`` settings cannot be read; they last until the instrument
is switched off, or until it is told to take its own again, which one source does (Argyll). Nothing
is saved in it.
"""
from __future__ import annotations

import re
from contextlib import suppress

import numpy as np

from spectrabox.capture.meter.instruments import jeti
from spectrabox.capture.meter.instruments.instrument_errors import LineFaultError, RefusedError
from spectrabox.capture.meter.instruments.interface import (
    HeldResult,
    Identity,
    Instrument,
    Measured,
    MeterSettings,
    numbers,
    refused,
)
from spectrabox.capture.meter.serial_line import LineSettings, ascii_text
from spectrabox.capture.meter.stated import Stated, stated_by_xyz
from spectrabox.radiometry.records import Quantity

SPEEDS = (921600, 115200, 38400)
MODELS = r"SB05|SB12|JETI_SB|SPECTROCAL"
FIRST_NM, LAST_NM, STEP_NM = 380, 780, 1
EXPOSURE_S = 60.0
SPECTRUM_S = 10.0
MAX_BLOCKS = 6              # header, unit label and values, each closed by an empty line
UNKNOWN_COMMAND = 4
DEFAULTS = b"*CONF:DEFAULT\r"


class Specbos1211(Instrument):
    """JETI specbos 1201 or 1211, CRS SpectroCAL."""

    name = "specbos1211"
    family = "JETI specbos 1211"
    line_settings = LineSettings(SPEEDS[0])
    averages = 1
    integration_ms: float | None = None

    def identify(self) -> Identity:
        model = jeti.identified(self, SPEEDS, MODELS)
        serial = jeti.ask(self, "*para:spnum?")
        firmware = jeti.ask(self, "*vers?")
        self.line.drain(0.1)  # old firmware says its version on two lines
        return Identity(model, serial.rpartition(":")[2].strip(), firmware)

    def settings(self, wanted: MeterSettings) -> None:
        self.integration_ms = wanted.integration_ms
        commands = [f"*CONF:WRAN {FIRST_NM} {LAST_NM} {STEP_NM}", "*CONF:FUNC 6", "*CONF:FORM 7"]
        commands += ["*CONF:EXPO 1"] if wanted.integration_ms is None else \
            [f"*CONF:TINT {wanted.integration_ms:g}", "*CONF:EXPO 2"]
        if wanted.averages is not None:
            self.averages = wanted.averages
            commands.append(f"*CONF:AVER {wanted.averages}")
        if wanted.sync_hz is not None:
            commands += ["*CONF:CYCMOD 1", f"*CONF:CYCTIM {round(1e6 / wanted.sync_hz)}"]
        with suppress(RefusedError):  # a 1201 has no laser
            jeti.set_to(self, "*CONTR:LASER 0")
        self.restore.append(DEFAULTS)
        for command in commands:
            jeti.set_to(self, command)

    def measure(self) -> Measured:
        return jeti.measure(self, "*INIT", self.longest_measurement_s())

    def read(self) -> HeldResult:
        head = jeti.ask(self, "*CONTR:MHEAD?")
        match = re.fullmatch(r"mhead:\s*([01])", head)
        if match is None:
            raise LineFaultError(f"{self.line.name}: {head!r} does not say which head is mounted; "
                                 "check the cable")
        nm, values, text = self._spectrum()
        irradiance = match[1] == "1"
        if irradiance != ("irradiance" in text.lower()):
            raise LineFaultError(f"{self.line.name}: the spectrum's header and the mounted head "
                                 "disagree on radiance or irradiance; measure again")
        stated, colour = self._stated()
        return HeldResult(nm, values, Quantity.IRRADIANCE if irradiance else Quantity.RADIANCE,
                          stated, self.integration_ms, (head, text, colour))

    def stop(self) -> None:
        jeti.cancel(self.line)

    def obeyed(self, command: bytes) -> bool:
        return jeti.obeyed(self.line, command)

    def leave(self) -> None:
        self.line.send(b"*CONTR:LASER 0\r")
        self.line.drain(0.1)

    def longest_measurement_s(self) -> float:
        return 20 + self.averages * 2 * EXPOSURE_S

    def _spectrum(self) -> tuple[np.ndarray, np.ndarray, str]:
        self.line.write(b"*FETCH:SPRAD\r")
        wanted = np.arange(FIRST_NM, LAST_NM + STEP_NM, STEP_NM, dtype=float)
        text = ""
        for _ in range(MAX_BLOCKS):
            reply = self.line.read_until((b"\r\r", jeti.NAK), SPECTRUM_S).lstrip(jeti.ENQ)
            if reply.endswith(jeti.NAK):
                raise refused(self, "*FETCH:SPRAD", jeti.error_number(self), jeti.ERRORS)
            block = ascii_text(reply, self.line.name).strip("\r\n ")
            text += block + "\n\n"
            rows = block.split("\r")
            if len(rows) == wanted.size:
                pairs = np.array([numbers(row, 2, self.line.name, "\t") for row in rows])
                if np.array_equal(pairs[:, 0], wanted):
                    return wanted, pairs[:, 1], text
                break
        raise LineFaultError(f"{self.line.name}: no block of {wanted.size} values from {FIRST_NM} "
                             f"to {LAST_NM} nm arrived; measure again, and check the cable")

    def _stated(self) -> tuple[Stated, str]:
        try:
            text = jeti.ask_labelled(self, "*FETCH:XYZ", "Z")
        except RefusedError as error:
            if f"error {UNKNOWN_COMMAND}:" not in str(error):
                raise
            luminance = jeti.ask(self, "*FETCH:PHOTO")  # old firmware
            chromaticity = jeti.ask_labelled(self, "*FETCH:CHROMXY", "_y")
            return (jeti.stated(luminance, chromaticity, self.line.name),
                    luminance + chromaticity)
        return stated_by_xyz([jeti.after(text, axis, self.line.name) for axis in "XYZ"]), text
