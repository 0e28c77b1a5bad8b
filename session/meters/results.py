"""What readings come to: a mean, a reflectance or a table, in the session's folder of spectra."""
from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from spectrabox.capture.meter.measurement_files import (
    chart_and_patch,
    readings_folder,
    result_file,
    stored_readings,
)
from spectrabox.capture.meter.measurement_series import (
    SeriesSummary,
    reflectance_from,
    series_of,
    series_spectrum,
    series_summary,
)
from spectrabox.capture.meter.meter_calibration import (
    MeterCalibration,
    makers_of,
    named,
    require_comparable,
)
from spectrabox.radiometry.files import write_text_whole
from spectrabox.radiometry.records.spectra import Quantity, Spectrum
from spectrabox.radiometry.spectra.readings import SpectralReading
from spectrabox.radiometry.spectra.spectrum_files import table_text
from spectrabox.session.meters.measuring import Task, require_measured, white_readings

USES = {"light": "name it in session.toml, or give it with --light",
        "white": "surfaces that are measured now are divided by it",
        "paint": "give it with --truth NAME=FILE, or name it in session.toml",
        "chart": "give it with --reference FILE, or name it in session.toml"}


def write_result(task: Task, white_reflectance: float,
                 calibrations: Sequence[MeterCalibration]) -> tuple[Path, Spectrum]:
    """Write the mean, or the reflectance where a white standard was measured; gives the file and
    one spectrum.

    Parameters
    ----------
    task : Task
    white_reflectance : float
        Of the white standard.
    calibrations : sequence of MeterCalibration

    Raises
    ------
    CheckError, InputError
    """
    stored = {name: stored_readings(readings_folder(task.spectra, name)) for name in task.names}
    readings = [reading for name in task.names for reading in stored[name]]
    reflects = any(reading.quantity is Quantity.REFLECTANCE for reading in readings)
    white = [] if reflects else white_readings(task.spectra, task.role)
    makers = makers_of([*readings, *white])
    require_comparable(makers, calibrations, task.title)
    if white and len(makers) == 1:
        calibrations = ()       # one instrument's factor divides out, and so does its error

    def mean(name: str, readings: Sequence[SpectralReading]) -> Spectrum:
        instruments = named(makers_of(readings)) + (", each by its calibration" if calibrations
                                                    else "")
        return series_spectrum(series_of(readings, name, calibrations),
                               f"{instruments}, {name}, mean of {len(readings)}")

    require_measured(task)
    results = [mean(name, stored[name]) for name in task.names]
    if white:
        divisor = mean("white", white)
        results = [reflectance_from(result, divisor, white_reflectance, result.source)
                   for result in results]
    path = result_file(task.spectra, task.role, task.names[0], results[0].quantity)
    if task.role == "chart":
        columns = {chart_and_patch(name)[1]: result.values
                   for name, result in zip(task.names, results, strict=True)}
    else:
        columns = {"value": results[0].values}
        if results[0].standard_error is not None:
            columns["standard_error"] = results[0].standard_error
    write_text_whole(path, table_text(results[0].grid.nm, columns, quantity=results[0].quantity,
                                      source=results[0].source + _calibration_words(readings)))
    return path, results[0]


def series_of_all(task: Task, calibrations: Sequence[MeterCalibration]) -> list[SeriesSummary]:
    """Spread, drift and findings of each thing's readings.

    Parameters
    ----------
    task : Task
    calibrations : sequence of MeterCalibration
    """
    return [series_summary(series_of(stored_readings(readings_folder(task.spectra, name)), name,
                                     calibrations), name) for name in task.names]


def _calibration_words(readings: Sequence[SpectralReading]) -> str:
    stated = dict.fromkeys(reading.calibration for reading in readings if reading.calibration)
    return f"; calibration of the instrument: {'; '.join(stated)}" if stated else ""
