"""JETI spectraval 1501 and 1511, and specbos 2501 (radiance, 380-780 nm in 1 nm steps).

Sources: Argyll's specbos driver, Specbos2501DataAcquisition, pyplr. The least certain of the
drivers: how a held result is sent again is taken from one source. Not checked on an instrument yet.
Nothing is saved in the instrument.
"""
from __future__ import annotations

import re

import numpy as np

from spectrabox.capture.meter.instruments.instrument_errors import LineFaultError
from spectrabox.capture.meter.instruments.interface import HeldResult, Measured, MeterSettings
from spectrabox.capture.meter.instruments.jeti import ACK, BEL, ENQ, ETX, SPECTRUM_S, STX, Jeti
from spectrabox.capture.meter.serial_line import LineSettings, ascii_text
from spectrabox.radiometry.records import Quantity

TEXT_FORM = "2"


class Specbos2501(Jeti):
    """JETI spectraval 1501 or 1511, specbos 2501."""

    name = "specbos2501"
    family = "JETI specbos 2501"
    speeds = (921600, 115200)
    models = r"SDCM3|DCM3_JETI|PECFIRM_JETI|SB25"  # the first letter of SPECFIRM is sometimes lost
    line_settings = LineSettings(speeds[0])

    def settings(self, wanted: MeterSettings) -> None:
        self.integration_ms = wanted.integration_ms
        self.averages = wanted.averages or 1
        self._set("form", TEXT_FORM)
        if wanted.sync_hz is not None:
            self._set("syncmod", "1")
            self._set("syncfreq", f"{wanted.sync_hz:g}")

    def measure(self) -> Measured:
        return self._measure(f"*MEAS:LIGHT {self.integration_ms or 0:g} {self.averages} 0")

    def read(self) -> HeldResult:
        grid = self._ask("*para:wran?")
        first, last, step = self.numbers(re.sub(r"\s+", " ", grid.rpartition(":")[2].strip()), 3,
                                         " ")
        if step <= 0 or not 100 <= first < last <= 3000 or (last - first) / step > 5000:
            raise LineFaultError(f"{self.line.name}: {grid!r} is no wavelength range; check the "
                                 "cable")
        nm = np.arange(first, last + step / 2, step)
        self.line.write(b"*CALC:SPRAD\r")
        reply = self._until(ETX, "*CALC:SPRAD", SPECTRUM_S).lstrip(ENQ + ACK + BEL)
        if not reply.startswith(STX):
            raise LineFaultError(f"{self.line.name}: the spectrum does not begin with STX; measure "
                                 "again")
        rows = ascii_text(reply[1:-1], self.line.name).strip("\r\n").split("\r")
        values = self.values_at(nm, [row.strip("\n") for row in rows], "\t")
        luminance = self._ask("*calc:PHOTOmetric")
        chromaticity = self._ask_labelled("*calc:CHROMXY", "_y")
        return HeldResult(nm, values, Quantity.RADIANCE, self._stated(luminance, chromaticity),
                          self.integration_ms, (grid, *rows, luminance, chromaticity))

    def _set(self, key: str, value: str) -> None:
        before = self.agreed(f"*para:{key}?").rpartition(":")[2].strip()
        if not re.fullmatch(r"\d+(\.\d+)?", before):
            raise LineFaultError(f"{self.line.name}: {key} is {before!r}, which could not be put "
                                 "back afterwards")
        self.restore.append(f"*para:{key} {before}\r".encode())
        self._set_to(f"*para:{key} {value}")
