"""More measurements as they are written: options of the command line, and a small TOML file."""
from __future__ import annotations

from pathlib import Path

import numpy as np

from spectrabox.measure.signals import sample
from spectrabox.radiometry import checked_tables, files
from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import FINE_GRID
from spectrabox.radiometry.records.spectra import Quantity, SpectralMeasurement
from spectrabox.radiometry.spectra import named_spectra, spectrum_files
from spectrabox.sampling.further.more_measurements import MoreMeasurement, Reading
from spectrabox.sampling.summary import READING_ERROR
from spectrabox.session.commands.requests import MeasuredSignal
from spectrabox.session.signals import signal_options

SPOT_STEP_NM = 10.0
Numbers = checked_tables.ListOf[float]


class ReadingTable(checked_tables.Table):
    """[[reading]]: the reflectance at one wavelength."""

    nm: float
    reflectance: float
    error: float = READING_ERROR
    fwhm_nm: float = 0.0


class BandTable(checked_tables.Table):
    """[[band]]: the reflectance through a filter."""

    curve: str
    reflectance: float
    column: str | None = None
    error: float = READING_ERROR


class SpotTable(checked_tables.Table):
    """[[spot]]: a measured spectrum."""

    file: str
    column: str | None = None
    error: float | None = None      # None: as the file states, else that of a reading
    step_nm: float = SPOT_STEP_NM


class SignalTable(checked_tables.Table):
    """[[same]]: another patch of the same material."""

    signal: Numbers
    noise: Numbers | None = None
    white: Numbers | None = None


class PhotoTable(SignalTable):
    """[[photo]]: another photo, under another light or by another camera."""

    light: str
    sensitivity: str | None = None


class MeasurementsFile(checked_tables.Table):
    """A file of further measurements."""

    reading: checked_tables.ListOf[ReadingTable] = ()
    band: checked_tables.ListOf[BandTable] = ()
    spot: checked_tables.ListOf[SpotTable] = ()
    photo: checked_tables.ListOf[PhotoTable] = ()
    same: checked_tables.ListOf[SignalTable] = ()


def further_measurements(measured: MeasuredSignal, sensitivity: str, relative_response: np.ndarray,
                         white: np.ndarray | None) -> list[MoreMeasurement]:
    """All that the options --reading, --photo, --same and --more say of one surface.

    Parameters
    ----------
    measured : MeasuredSignal
    sensitivity : str
        Curves of the camera that took the first photo, by name or file.
    relative_response : (K, 301) array
        Of that photo.
    white : (K,) array or None
        What a perfect white reads in it.

    Raises
    ------
    InputError
    """
    readings = map(signal_options.parse_reading, measured.reading)
    measurements: list[MoreMeasurement] = [(reading.name, (reading,)) for reading in readings]
    measurements += [photo_of_text(text, sensitivity, len(relative_response))
                     for text in measured.signal_under]
    measurements += [patch_of_text(text, relative_response, white, number)
                     for number, text in enumerate(measured.same, 1)]
    if measured.more is not None:
        measurements += read_more(measured.more, sensitivity, relative_response)
    return measurements


def photo_of_text(text: str, sensitivity: str, bands: int) -> MoreMeasurement:
    """Another photo by the same camera, written LIGHT=v1,v2,v3[:e1,e2,e3].

    Raises
    ------
    InputError
    """
    light, equals, rest = text.partition("=")
    if not equals or not light:
        raise InputError(f"--signal-under {text!r} cannot be read; write LIGHT=v1,v2,v3 or "
                         "LIGHT=v1,v2,v3:e1,e2,e3")
    signal, noise = signal_options.signal_and_noise(rest, bands, "photo")
    relative_response = named_spectra.relative_response(sensitivity, light, FINE_GRID)
    return f"the photo under {light}", sample.measurement_of_signal(relative_response, signal, None,
                                                                    noise)


def patch_of_text(text: str, relative_response: np.ndarray, white: np.ndarray | None,
                  number: int) -> MoreMeasurement:
    """Another patch of the same material in the same photo, written v1,v2,v3[:e1,e2,e3].

    Raises
    ------
    InputError
    """
    signal, noise = signal_options.signal_and_noise(text, len(relative_response), "same")
    return _patch(number, sample.measurement_of_signal(relative_response, signal, white, noise))


def read_more(path: Path, sensitivity: str, relative_response: np.ndarray) -> list[MoreMeasurement]:
    """All measurements of a TOML file of [[reading]], [[band]], [[spot]], [[photo]] and [[same]]
    tables.

    Raises
    ------
    InputError
        Naming the table and key, with the nearest that is known.
    """
    written = checked_tables.read_toml(path, "write [[reading]], nm = 700, reflectance = 0.35")
    tables, folder = checked_tables.checked(MeasurementsFile, written, path.name), path.parent
    by_kind = {
        "reading": [_reading(table) for table in tables.reading],
        "band": [_band(table, folder) for table in tables.band],
        "spot": [_spot(table, folder) for table in tables.spot],
        "photo": [_photo(table, sensitivity, folder) for table in tables.photo],
        "same": [_patch(number, _measurement(table, relative_response, "same"))
                 for number, table in enumerate(tables.same, 1)]}
    return [measurement for kind in written for measurement in by_kind[kind]]


def _reading(table: ReadingTable) -> MoreMeasurement:
    reading = sample.reading_at(table.nm, table.reflectance, table.error, table.fwhm_nm)
    return reading.name, (reading,)


def _band(table: BandTable, folder: Path) -> MoreMeasurement:
    curves, grid = spectrum_files.read_table(folder / table.curve), FINE_GRID
    column = spectrum_files.column_index(curves, table.column)
    curve = spectrum_files.on_grid(curves.nm, np.maximum(curves.values[column], 0), grid,
                                   curves.file)
    name = f"the band {curves.names[column]} of {curves.file}"
    return name, (Reading(name, grid.nm, curve, table.reflectance, table.error),)


def _photo(table: PhotoTable, sensitivity: str, folder: Path) -> MoreMeasurement:
    name = f"the photo under {table.light}"
    if table.sensitivity is not None:
        name += f" by {table.sensitivity}"
    relative_response = named_spectra.relative_response(
        _file_or_name(table.sensitivity or sensitivity, folder), _file_or_name(table.light, folder),
        FINE_GRID)
    return name, _measurement(table, relative_response, "photo")


def _patch(number: int, measurement: SpectralMeasurement) -> MoreMeasurement:
    return f"patch {number} said to be the same material", measurement


def _measurement(table: SignalTable, relative_response: np.ndarray,
                 name: str) -> SpectralMeasurement:
    def by_band(numbers: tuple[float, ...], option: str) -> np.ndarray:
        return signal_options.per_band(np.array(numbers), len(relative_response), option)

    return sample.measurement_of_signal(relative_response, by_band(table.signal, name),
                                 None if table.white is None else by_band(table.white, "white"),
                                 None if table.noise is None else by_band(table.noise, "noise"))


def _spot(table: SpotTable, folder: Path) -> MoreMeasurement:
    spectrum = spectrum_files.spectrum_of(spectrum_files.read_table(folder / table.file),
                                          role=Quantity.REFLECTANCE, column=table.column)
    step = max(table.step_nm, SPOT_STEP_NM)
    nm = np.arange(400, 701, step)
    nm = nm[(nm >= spectrum.grid.nm[0]) & (nm <= spectrum.grid.nm[-1])]
    if not nm.size:
        raise InputError(f"{table.file} holds nothing of 400-700 nm; leave the spot out")
    values = np.interp(nm, spectrum.grid.nm, spectrum.values)
    errors = np.full(nm.size, READING_ERROR if table.error is None else table.error)
    if spectrum.standard_error is not None and table.error is None:
        errors = np.interp(nm, spectrum.grid.nm, spectrum.standard_error)
    readings = [sample.reading_at(float(at_nm), float(value), float(error))
                for at_nm, value, error in zip(nm, values, errors, strict=True)]
    return f"the spot of {table.file}", tuple(readings)


def _file_or_name(name: str, folder: Path) -> str:
    path = folder / name
    return str(path) if files.is_there(path) and path.is_file() else name
