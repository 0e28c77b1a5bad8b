"""Spectra that an instrument measures now, from Python."""
from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from spectrabox.capture.meter import measurement, measurement_series
from spectrabox.capture.meter.instruments import instrument_errors, interface
from spectrabox.measure import plots, texts
from spectrabox.radiometry import errors, files
from spectrabox.radiometry.findings import Finding, each_once
from spectrabox.radiometry.records.spectra import Spectrum
from spectrabox.radiometry.spectra.readings import ReadingOutcome, SpectralReading
from spectrabox.radiometry.spectra.spectrum_files import table_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PRESS_S = 600.0         # for which the button is waited for


@dataclass(frozen=True, eq=False)
class MeterReading:
    """A spectrum that an instrument measured: one reading, or the mean of several.

    Attributes
    ----------
    spectrum : Spectrum
        As functions take it for a light, a truth or a known reflectance.
    readings : tuple of SpectralReading
        Each as the instrument gave it.

    References
    ----------
    A CR30's L*a*b* is that of CIE 15:2018 for D65 and the 10 degree observer, summed over its 31
    bands.

    Examples
    --------
    >>> vase = sb.measure_spectrum("/dev/ttyUSB0", "cr30", calibrate=False)
    >>> vase.nm, vase.values, vase.lab, vase.flags
    >>> vase.to_csv("vase.csv")
    """

    spectrum: Spectrum
    readings: tuple[SpectralReading, ...]

    @property
    def nm(self) -> np.ndarray:
        """Wavelengths (P,) in nm."""
        return self.spectrum.grid.nm

    @property
    def values(self) -> np.ndarray:
        """Values (P,): reflectance, or W m-2 sr-1 nm-1 of a radiance, W m-2 nm-1 of an irradiance.
        """
        return self.spectrum.values

    @property
    def standard_error(self) -> np.ndarray | None:
        """Standard error (P,) of the mean; None of a single reading."""
        return self.spectrum.standard_error

    @property
    def quantity(self) -> str:
        """Reflectance, radiance or irradiance."""
        return self.spectrum.quantity.name.lower()

    @property
    def lab(self) -> tuple[float, float, float] | None:
        """L*, a*, b* of the last reading as the instrument's display shows it (D65, 10 degrees);
        None where it shows none.
        """
        return self.readings[-1].lab

    @property
    def calibration(self) -> str | None:
        """What the instrument was calibrated with before, and when; None where it needs none."""
        return self.readings[-1].calibration

    @property
    def flags(self) -> tuple[str, ...]:
        """Sentences: what to beware of."""
        return tuple(texts.says(finding) for finding in self.findings)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What to beware of, as codes and values: ``flags`` are its sentences."""
        return each_once(finding for reading in self.readings for finding in reading.findings)

    def to_csv(self, path: str | Path) -> None:
        """Write the spectrum with its quantity and who measured it.

        Parameters
        ----------
        path : str or Path
        """
        columns = {"value": self.values}
        if self.standard_error is not None:
            columns["standard_error"] = self.standard_error
        files.write_text_whole(files.in_folder(path), table_text(
            self.nm, columns, quantity=self.spectrum.quantity, source=self.spectrum.source))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the spectrum.

        Parameters
        ----------
        ax : Axes, optional
            Of Matplotlib; new ones by default.

        Returns
        -------
        Axes
        """
        axes = plots.axes_for(ax)
        axes.plot(self.nm, self.values, lw=1.2)
        axes.set(xlabel="wavelength (nm)", ylabel=self.quantity, title=self.spectrum.source)
        return axes


def measure_spectrum(port: str, instrument: str, *, readings: int = 1,
                     calibrate: bool | None = None, button: bool = False,
                     integration_ms: float | None = None, averages: int | None = None,
                     sync_hz: float | None = None) -> MeterReading:
    """Measure a spectrum with an instrument on a serial line, and leave it as it was.

    Parameters
    ----------
    port : str
        Such as "/dev/ttyUSB0" or "COM3"; ``spectrabox meter list`` lists them.
    instrument : str
        "cr30" for reflectance; "cs2000", "cr250", "pr655", "pr650", "specbos1211" or "specbos2501"
        for radiance or irradiance.
    readings : int
        Taken one after the other; their mean is returned, with its standard error.
    calibrate : bool
        Of a CR30, which wants a white and a black calibration: True asks for them on standard
        input, False measures with the calibration that it has and says so in ``flags``.
    button : bool
        Of a CR30: wait for its button for the first reading, up to ten minutes.
    integration_ms, averages, sync_hz : float, int, float, optional
        Fixed exposure, readings that the instrument averages, flicker frequency of the light; its
        own settings by default. A CR30 has none.

    Returns
    -------
    MeterReading

    Raises
    ------
    InputError
        If there is no such instrument, or it has not what was asked of it.
    CheckError
        If it gave no spectrum: too dark, too bright, unsteady.
    SpectraboxError
        If the line or the instrument fails; exit code 6.

    References
    ----------
    What each driver is known from, and what is checked of a reading: docs/reference/meters.md.

    Examples
    --------
    >>> vase = sb.measure_spectrum("/dev/ttyUSB0", "cr30", calibrate=True)
    >>> vase.lab, vase.flags
    >>> sb.flat("vase.dng", {"vase": (986, 462, 1073, 537)}, truth={"vase": vase.spectrum})
    """
    with measurement.open_instrument(instrument, port, lambda direction, passed: None) as meter:
        _require_known(meter, calibrate, button)
        identity = measurement.trusted_identity(meter)
        meter.settings(interface.MeterSettings(integration_ms, averages, sync_hz))
        if calibrate:
            for which, advice in meter.calibrations.items():
                input(f"{which} calibration of the {meter.family}: {advice}, then press Enter")
                meter.calibrate(which)
        if button and not meter.pressed(PRESS_S):
            raise instrument_errors.NoReplyError(
                f"the button of the {meter.family} was not pressed within "
                f"{PRESS_S:g} s")
        taken = []
        for number in range(readings):
            meter.by_button = button and number == 0
            taken.append(measurement.take_reading(meter, identity))
    series = measurement_series.series_of(taken, "the spectrum")
    last = taken[-1]
    stated = "" if last.calibration is None else f", calibration: {last.calibration}"
    source = f"{last.instrument} {last.serial_number}, {last.taken_at}{stated}"
    if any(reading.outcome is ReadingOutcome.LOW_LIGHT for reading in taken):
        warnings.warn(texts.says(ReadingOutcome.LOW_LIGHT.finding), stacklevel=2)
    return MeterReading(measurement_series.series_spectrum(series, source), tuple(taken))


def _require_known(meter: interface.Instrument, calibrate: bool | None, button: bool) -> None:
    if meter.calibrations and calibrate is None:
        raise errors.InputError(
            f"a {meter.family} is calibrated before it measures: say calibrate=True, "
            "or calibrate=False to measure with the calibration that it has")
    if calibrate and not meter.calibrations:
        raise errors.InputError(
            f"a {meter.family} has no calibration to be made: leave calibrate out")
    if button and not meter.has_button:
        raise errors.InputError(f"a {meter.family} takes no reading by a button: leave button out")
