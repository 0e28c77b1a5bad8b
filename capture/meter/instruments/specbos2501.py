"""JETI spectraval 1501 and 1511, and specbos 2501 (radiance, 380-780 nm in 1 nm steps).

Sources: Argyll's specbos driver, Specbos2501DataAcquisition, pyplr. The least certain of the
drivers: how a held result is sent again is taken from one source. Not checked on an instrument yet.
Nothing is saved in the instrument.
"""
from __future__ import annotations

import re
from functools import partial

import numpy as np

from spectrabox.capture.meter.instruments import jeti
from spectrabox.capture.meter.instruments.instrument_errors import LineFaultError
from spectrabox.capture.meter.instruments.interface import (
    HeldResult,
    Identity,
    Instrument,
    Measured,
    MeterSettings,
    agreed,
    numbers,
    refused,
)
from spectrabox.capture.meter.serial_line import LineSettings, ascii_text
from spectrabox.radiometry.records import Quantity

SPEEDS = (921600, 115200)
EXPOSURE_S = 60.0
SPECTRUM_S = 10.0
TEXT_FORM = "2"
MODELS = r"SDCM3|DCM3_JETI|PECFIRM_JETI|SB25"  # the first letter of SPECFIRM is sometimes lost


class Specbos2501(Instrument):
    """JETI spectraval 1501 or 1511, specbos 2501."""

    name = "specbos2501"
    family = "JETI specbos 2501"
    line_settings = LineSettings(SPEEDS[0])
    averages = 1
    integration_ms: float | None = None

    def identify(self) -> Identity:
        model = jeti.identified(self, SPEEDS, MODELS)
        return Identity(model, jeti.ask(self, "*para:spnum?").rpartition(":")[2].strip(),
                        jeti.ask(self, "*vers?"))

    def settings(self, wanted: MeterSettings) -> None:
        self.integration_ms = wanted.integration_ms
        self.averages = wanted.averages or 1
        self._set("form", TEXT_FORM)
        if wanted.sync_hz is not None:
            self._set("syncmod", "1")
            self._set("syncfreq", f"{wanted.sync_hz:g}")

    def measure(self) -> Measured:
        command = f"*MEAS:LIGHT {self.integration_ms or 0:g} {self.averages} 0"
        return jeti.measure(self, command, self.longest_measurement_s())

    def read(self) -> HeldResult:
        grid = jeti.ask(self, "*para:wran?")
        first, last, step = numbers(re.sub(r"\s+", " ", grid.rpartition(":")[2].strip()), 3,
                                    self.line.name, " ")
        if step <= 0 or not 100 <= first < last <= 3000 or (last - first) / step > 5000:
            raise LineFaultError(f"{self.line.name}: {grid!r} is no wavelength range; check the "
                                 "cable")
        wanted = np.arange(first, last + step / 2, step)
        self.line.write(b"*CALC:SPRAD\r")
        reply = self.line.read_until((jeti.ETX, jeti.NAK),
                                     SPECTRUM_S).lstrip(jeti.ENQ + jeti.ACK + jeti.BEL)
        if reply.endswith(jeti.NAK):
            raise refused(self, "*CALC:SPRAD", jeti.error_number(self), jeti.ERRORS)
        if not reply.startswith(jeti.STX):
            raise LineFaultError(f"{self.line.name}: the spectrum does not begin with STX; measure "
                                 "again")
        rows = ascii_text(reply[1:-1], self.line.name).strip("\r\n").split("\r")
        pairs = np.array([numbers(row.strip("\n"), 2, self.line.name, "\t") for row in rows])
        if not np.array_equal(pairs[:, 0], wanted):
            raise LineFaultError(f"{self.line.name}: {pairs.shape[0]} wavelengths arrived that are "
                                 f"not the stated {first:g}-{last:g} nm in steps of {step:g} nm; "
                                 "measure again")
        luminance = jeti.ask(self, "*calc:PHOTOmetric")
        chromaticity = jeti.ask_labelled(self, "*calc:CHROMXY", "_y")
        return HeldResult(wanted, pairs[:, 1], Quantity.RADIANCE,
                          jeti.stated(luminance, chromaticity, self.line.name),
                          self.integration_ms, (grid, *rows, luminance, chromaticity))

    def stop(self) -> None:
        jeti.cancel(self.line)

    def obeyed(self, command: bytes) -> bool:
        return jeti.obeyed(self.line, command)

    def longest_measurement_s(self) -> float:
        return 20 + self.averages * 2 * EXPOSURE_S

    def _set(self, key: str, value: str) -> None:
        before = agreed(partial(jeti.ask, self), f"*para:{key}?").rpartition(":")[2].strip()
        if not re.fullmatch(r"\d+(\.\d+)?", before):
            raise LineFaultError(f"{self.line.name}: {key} is {before!r}, which could not be put "
                                 "back afterwards")
        self.restore.append(f"*para:{key} {before}\r".encode())
        jeti.set_to(self, f"*para:{key} {value}")
