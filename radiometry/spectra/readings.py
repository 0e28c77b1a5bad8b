"""Records of spectroradiometer readings: what was measured, by what, and how far it can be
trusted.
"""
from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Annotated

import numpy as np

from spectrabox.radiometry.records.spectra import Quantity, Spectrum, WavelengthGrid
from spectrabox.radiometry.shaped import Record


class ReadingOutcome(Enum):
    """How a reading ended, as a sentence the operator can act on."""

    MEASURED = "Measured."
    LOW_LIGHT = ("Measured, but the instrument says the light is low: expect noise; repeat, or use "
                 "a wider aperture.")
    TOO_DARK = ("No reading: the light is too weak for this instrument; bring more light, a longer "
                "exposure or a wider aperture. This is not a spectrum of zeros.")
    TOO_BRIGHT = ("No reading: the light is too strong; use a shorter exposure, a smaller aperture "
                  "or a filter.")
    NO_SYNC = ("No reading: the instrument could not lock to the light's flicker; state its "
               "frequency, or switch sync off.")
    UNSTEADY = "No reading: the light changed during the measurement; let it warm up, then repeat."

    @property
    def has_spectrum(self) -> bool:
        """Whether a reading with this outcome holds a spectrum."""
        return self in (ReadingOutcome.MEASURED, ReadingOutcome.LOW_LIGHT)


@dataclass(frozen=True, eq=False)
class SpectralReading(Record):
    """One reading of a spectroradiometer. ``spectrum`` is None where the instrument gave none;
    ``outcome`` says why.
    """

    spectrum: Spectrum | None
    outcome: ReadingOutcome
    quantity: Quantity | None  # as the instrument states it; None without a spectrum
    instrument: str                                 # model as the instrument names itself
    serial_number: str
    firmware: str | None                            # None where the instrument does not state it
    integration_ms: float | None                    # None where the instrument does not state it
    luminance: float | None  # cd m-2 (radiance) or lx (irradiance), as the instrument states it
    taken_at: str                                   # ISO 8601 with time zone
    transcript: str  # file of the bytes that passed, "" where none was kept
    flags: tuple[str, ...]                          # sentences: what to beware of
    # L*, a*, b* under D65 for the 10 degree observer, as the instrument shows it; None of a light
    lab: tuple[float, float, float] | None = None
    # Of the instrument before the reading: what and when; None where it needs none
    calibration: str | None = None


@dataclass(frozen=True, eq=False)
class ReadingSeries(Record):
    """Repeats of one reading: the mean, how far the repeats differ, and whether they run away."""

    grid: WavelengthGrid
    mean: Annotated[np.ndarray, "P"]
    spread: Annotated[np.ndarray, "P"]  # standard deviation of one reading; NaN for a single one
    relative_drift: float                           # of the integral, over the whole series
    relative_drift_error: float                     # its standard error; NaN below three readings
    readings: int
    quantity: Quantity
    flags: tuple[str, ...]
    calibration_error: Annotated[np.ndarray, "P"]   # of the mean; 0 where no calibration was given
