"""More measurements as they are written: options of the command line, and a small TOML file."""
from __future__ import annotations

import difflib
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.grid import visible_grid
from spectrabox.radiometry.records import Quantity, SpectralMeasurement
from spectrabox.radiometry.spectra import named_spectra
from spectrabox.radiometry.spectra.spectrum_files import (
    column_index,
    on_grid,
    read_table,
    spectrum_of,
)
from spectrabox.sampling.further.conditioning import Reading
from spectrabox.sampling.further.more_measurements import MoreMeasurement
from spectrabox.session.signals.signal_options import (
    GRID_NM,
    READING_ERROR,
    measurement_of_signal,
    parse_reading,
    per_band,
    reading_at,
    signal_and_noise,
)

SPOT_STEP_NM = 10.0
KEYS = {"reading": ("nm", "reflectance", "error", "fwhm_nm"),
        "band": ("curve", "column", "reflectance", "error"),
        "spot": ("file", "column", "error", "step_nm"),
        "photo": ("light", "signal", "noise", "white", "sensitivity"),
        "same": ("signal", "noise", "white")}
NEEDED = {"reading": ("nm", "reflectance"), "band": ("curve", "reflectance"), "spot": ("file",),
          "photo": ("light", "signal"), "same": ("signal",)}
TEXTS = ("curve", "column", "file", "light", "sensitivity")
LISTS = ("signal", "noise", "white")


def further_measurements(readings: tuple[str, ...], photos: tuple[str, ...], same: tuple[str, ...],
                         more: Path | None, sensitivity: str, relative_response: np.ndarray,
                         white: np.ndarray | None) -> list[MoreMeasurement]:
    """All that the options --reading, --photo, --same and --more say of one surface.

    Parameters
    ----------
    readings, photos, same : tuple of str
        As `signal_options.parse_reading`, `photo_of_text` and `patch_of_text` read them.
    more : Path or None
        A file for `read_more`.
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
    measurements = [MoreMeasurement(reading.name, (reading,))
                    for reading in map(parse_reading, readings)]
    measurements += [photo_of_text(text, sensitivity, len(relative_response)) for text in photos]
    measurements += [patch_of_text(text, relative_response, white, number)
                     for number, text in enumerate(same, 1)]
    if more is not None:
        measurements += read_more(more, sensitivity, relative_response)
    return measurements


def photo_of_text(text: str, sensitivity: str, bands: int) -> MoreMeasurement:
    """Another photo by the same camera, written LIGHT=v1,v2,v3[:e1,e2,e3].

    Raises
    ------
    InputError
    """
    light, equals, rest = text.partition("=")
    if not equals or not light:
        raise InputError(f"--photo {text!r} cannot be read; write LIGHT=v1,v2,v3 or "
                         "LIGHT=v1,v2,v3:e1,e2,e3")
    signal, noise = signal_and_noise(rest, bands, "photo")
    relative_response = named_spectra.relative_response(sensitivity, light, visible_grid(GRID_NM))
    return MoreMeasurement(f"the photo under {light}",
                           measurement=measurement_of_signal(relative_response, signal, None,
                                                             noise))


def patch_of_text(text: str, relative_response: np.ndarray, white: np.ndarray | None,
                  number: int) -> MoreMeasurement:
    """Another patch of the same material in the same photo, written v1,v2,v3[:e1,e2,e3].

    Raises
    ------
    InputError
    """
    signal, noise = signal_and_noise(text, len(relative_response), "same")
    return _patch(number, measurement_of_signal(relative_response, signal, white, noise))


def read_more(path: Path, sensitivity: str, relative_response: np.ndarray) -> list[MoreMeasurement]:
    """All measurements of a TOML file of [[reading]], [[band]], [[spot]], [[photo]] and [[same]]
    tables.

    Raises
    ------
    InputError
        Naming the table and key, with the nearest that is known.
    """
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); give a TOML file of "
                         "measurements") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path.name} is no TOML file ({error}); write [[reading]], nm = 700, "
                         "reflectance = 0.35") from None
    measurements = []
    for kind, entries in tables.items():
        if kind not in KEYS:
            raise InputError(f"{path.name} holds [[{kind}]]; the nearest that is known is "
                             f"[[{_nearest(kind, KEYS)}]]")
        if not isinstance(entries, list):
            raise InputError(f"{path.name}: write [[{kind}]] with two brackets, once for every "
                             "measurement")
        for number, entry in enumerate(entries, 1):
            checked = _checked(kind, number, entry, path)
            if kind == "reading":
                measurements.append(_reading(checked))
            elif kind == "band":
                measurements.append(_band(checked, path.parent))
            elif kind == "spot":
                measurements.append(_spot(checked, path.parent))
            elif kind == "same":
                measured = _measurement(checked, relative_response, "same")
                measurements.append(_patch(number, measured))
            else:
                measurements.append(_photo(checked, sensitivity, path.parent))
    return measurements


def _reading(entry: dict[str, Any]) -> MoreMeasurement:
    reading = reading_at(float(entry["nm"]), float(entry["reflectance"]),
                         float(entry.get("error", READING_ERROR)), float(entry.get("fwhm_nm", 0)))
    return MoreMeasurement(reading.name, (reading,))


def _band(entry: dict[str, Any], folder: Path) -> MoreMeasurement:
    table, grid = read_table(folder / entry["curve"]), visible_grid(GRID_NM)
    column = column_index(table, entry.get("column"))
    curve = on_grid(table.nm, np.maximum(table.values[column], 0), grid, table.file)
    name = f"the band {table.names[column]} of {table.file}"
    return MoreMeasurement(name, (Reading(name, grid.nm, curve, float(entry["reflectance"]),
                                          float(entry.get("error", READING_ERROR))),))


def _photo(entry: dict[str, Any], sensitivity: str, folder: Path) -> MoreMeasurement:
    camera, light = str(entry.get("sensitivity", sensitivity)), str(entry["light"])
    name = f"the photo under {light}" + (f" by {camera}" if "sensitivity" in entry else "")
    relative_response = named_spectra.relative_response(
        _beside(camera, folder), _beside(light, folder), visible_grid(GRID_NM))
    return MoreMeasurement(name, measurement=_measurement(entry, relative_response, "photo"))


def _patch(number: int, measurement: SpectralMeasurement) -> MoreMeasurement:
    return MoreMeasurement(f"patch {number} said to be the same material", measurement=measurement)


def _measurement(entry: dict[str, Any], relative_response: np.ndarray,
                 name: str) -> SpectralMeasurement:
    signal, white, noise = (
        per_band(np.array(entry[key], dtype=float), len(relative_response), option)
        if key in entry else None
        for key, option in (("signal", name), ("white", "white"), ("noise", "noise")))
    assert signal is not None       # checked with the other keys of the table
    return measurement_of_signal(relative_response, signal, white, noise)


def _spot(entry: dict[str, Any], folder: Path) -> MoreMeasurement:
    spectrum = spectrum_of(read_table(folder / entry["file"]), role=Quantity.REFLECTANCE,
                           column=entry.get("column"))
    step = max(float(entry.get("step_nm", SPOT_STEP_NM)), SPOT_STEP_NM)
    nm = np.arange(400, 701, step)
    nm = nm[(nm >= spectrum.grid.nm[0]) & (nm <= spectrum.grid.nm[-1])]
    if not nm.size:
        raise InputError(f"{entry['file']} holds nothing of 400-700 nm; leave the spot out")
    values = np.interp(nm, spectrum.grid.nm, spectrum.values)
    errors = np.full(nm.size, float(entry.get("error", READING_ERROR)))
    if spectrum.standard_error is not None and "error" not in entry:
        errors = np.interp(nm, spectrum.grid.nm, spectrum.standard_error)
    readings = [reading_at(float(at_nm), float(value), float(error))
                for at_nm, value, error in zip(nm, values, errors, strict=True)]
    return MoreMeasurement(f"the spot of {entry['file']}", tuple(readings))


def _checked(kind: str, number: int, entry: Any, path: Path) -> dict[str, Any]:
    where = f"{path.name}: [[{kind}]] number {number}"
    if not isinstance(entry, dict):
        raise InputError(f"{where} is no table; write its keys below it")
    for key, value in entry.items():
        if key not in KEYS[kind]:
            raise InputError(f"{where} has the unknown key {key!r}; the nearest is "
                             f"{_nearest(key, KEYS[kind])!r}")
        wanted = "a list of numbers" if key in LISTS else "a text" if key in TEXTS else "a number"
        if not _fits(key, value):
            raise InputError(f"{where}: {key} = {value!r}; {wanted} is needed")
    missing = [key for key in NEEDED[kind] if key not in entry]
    if missing:
        raise InputError(f"{where} lacks {' and '.join(missing)}")
    return entry


def _fits(key: str, value: Any) -> bool:
    if key in LISTS:
        return isinstance(value, list) and all(_is_number(part) for part in value)
    return isinstance(value, str) if key in TEXTS else _is_number(value)


def _is_number(value: Any) -> bool:
    return (isinstance(value, int | float) and not isinstance(value, bool)
            and bool(np.isfinite(value)))


def _beside(name: str, folder: Path) -> str:
    return str(folder / name) if (folder / name).is_file() else name


def _nearest(key: str, known: Iterable[str]) -> str:
    return (difflib.get_close_matches(key, list(known), n=1, cutoff=0) or list(known))[0]
