"""JETI specbos 1201 and 1211, and the CRS SpectroCAL, which is taken to be one of them.

Sources: Argyll's specbos driver, a Python driver for the 1211, CRS and JETI scripts; they agree.
Not checked on an instrument yet. ``*CONF`` settings cannot be read; they last until the instrument
is switched off, or until it is asked to take its own again, which one source does (Argyll). Nothing
is saved in it.
"""
from __future__ import annotations

import re
from contextlib import suppress

import numpy as np

from spectrabox.capture.meter.instruments.instrument_errors import LineFaultError, RefusedError
from spectrabox.capture.meter.instruments.interface import (
    HeldResult,
    Identity,
    Measured,
    MeterSettings,
)
from spectrabox.capture.meter.instruments.jeti import SPECTRUM_S, Jeti
from spectrabox.capture.meter.serial_line import LineSettings, ascii_text
from spectrabox.capture.meter.stated import Stated, stated_by_xyz
from spectrabox.radiometry.records import Quantity

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
    line_settings = LineSettings(speeds[0])

    def _identity(self) -> Identity:
        identity = super()._identity()
        self.line.drain(0.1)  # old firmware states its version on two lines
        return identity

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
            self._set_to("*CONTR:LASER 0")
        self.restore.append(DEFAULTS)
        for command in commands:
            self._set_to(command)

    def measure(self) -> Measured:
        return self._measure("*INIT")

    def read(self) -> HeldResult:
        head = self._ask("*CONTR:MHEAD?")
        match = re.fullmatch(r"mhead:\s*([01])", head)
        if match is None:
            raise LineFaultError(f"{self.line.name}: {head!r} does not say which head is mounted; "
                                 "check the cable")
        nm, values, text = self._spectrum()
        irradiance = match[1] == "1"
        if irradiance != ("irradiance" in text.lower()):
            raise LineFaultError(f"{self.line.name}: the spectrum's header and the mounted head "
                                 "disagree on radiance or irradiance; measure again")
        stated, colour = self._figures()
        return HeldResult(nm, values, Quantity.IRRADIANCE if irradiance else Quantity.RADIANCE,
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
            block = ascii_text(reply, self.line.name).strip("\r\n ")
            text += block + "\n\n"
            rows = block.split("\r")
            if len(rows) == nm.size:
                return nm, self.values_at(nm, rows, "\t"), text
        raise LineFaultError(f"{self.line.name}: no block of {nm.size} values from {FIRST_NM} "
                             f"to {LAST_NM} nm arrived; measure again, and check the cable")

    def _figures(self) -> tuple[Stated, str]:
        """What the instrument computed from the spectrum, and its replies."""
        try:
            text = self._ask_labelled("*FETCH:XYZ", "Z")
        except RefusedError as error:
            if f"error {UNKNOWN_COMMAND}:" not in str(error):
                raise
            luminance = self._ask("*FETCH:PHOTO")  # old firmware
            chromaticity = self._ask_labelled("*FETCH:CHROMXY", "_y")
            return self._stated(luminance, chromaticity), luminance + chromaticity
        return stated_by_xyz([self._after(text, axis) for axis in "XYZ"]), text
