"""Records of spectroradiometer readings: what was measured, by what, and how far it can be
trusted.
"""
from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Annotated

import numpy as np

from spectrabox.radiometry.findings import Finding, Severity
from spectrabox.radiometry.records import spectra
from spectrabox.radiometry.shaped import Record


class ReadingOutcome(Enum):
    """How a reading ended; the value is the code of its finding."""

    MEASURED = "meter.measured"
    LOW_LIGHT = "meter.low-light"           # by what the instrument says: expect noise
    TOO_DARK = "meter.too-dark"             # not a spectrum of zeros
    TOO_BRIGHT = "meter.too-bright"
    NO_SYNC = "meter.no-sync"               # not locked to the light's flicker
    UNSTEADY = "meter.unsteady"             # the light changed meanwhile

    @property
    def has_spectrum(self) -> bool:
        """Whether a reading with this outcome holds a spectrum."""
        return self in (ReadingOutcome.MEASURED, ReadingOutcome.LOW_LIGHT)

    @property
    def finding(self) -> Finding:
        """How the reading ended."""
        ended = {ReadingOutcome.MEASURED: Severity.INFO, ReadingOutcome.LOW_LIGHT: Severity.NOTE}
        return Finding(self.value, ended.get(self, Severity.FAIL))


@dataclass(frozen=True, eq=False)
class SpectralReading(Record):
    """One reading of a spectroradiometer. ``spectrum`` is None where the instrument gave none;
    ``outcome`` says why.
    """

    spectrum: spectra.Spectrum | None
    outcome: ReadingOutcome
    quantity: spectra.Quantity | None  # as the instrument states it; None without a spectrum
    instrument: str                                 # model as the instrument names itself
    serial_number: str
    firmware: str | None                            # None where the instrument does not state it
    integration_ms: float | None                    # None where the instrument does not state it
    luminance: float | None  # cd m-2 (radiance) or lx (irradiance), as the instrument states it
    taken_at: str                                   # ISO 8601 with time zone
    transcript: str  # file of the bytes that passed, "" where none was kept
    findings: tuple[Finding, ...]                   # what to beware of
    # L*, a*, b* under D65 for the 10 degree observer, as the instrument shows it; None of a light
    lab: tuple[float, float, float] | None = None
    # Of the instrument before the reading: what and when; None where it needs none
    calibration: str | None = None


@dataclass(frozen=True, eq=False)
class ReadingSeries(Record):
    """Repeats of one reading: the mean, how far the repeats differ, and whether they run away."""

    grid: spectra.WavelengthGrid
    mean: Annotated[np.ndarray, "P"]
    spread: Annotated[np.ndarray, "P"]  # standard deviation of one reading; NaN for a single one
    relative_drift: float                           # of the integral, over the whole series
    relative_drift_error: float                     # its standard error; NaN below three readings
    readings: int
    quantity: spectra.Quantity
    findings: tuple[Finding, ...]
    calibration_error: Annotated[np.ndarray, "P"]   # of the mean; 0 where no calibration was given

    @property
    def relative_spread(self) -> float:
        """Standard deviation of one reading over the mean, over all wavelengths; NaN for a single
        one.
        """
        weights = self.grid.weights_nm
        return float((self.spread @ weights) / (self.mean @ weights))
