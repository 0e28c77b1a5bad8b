"""Measurements of colour-specio (.csmf): protocol buffers after its ``measurements.proto``.

Only what a spectrum needs is decoded, field by field as the encoding has it
(https://protobuf.dev/programming-guides/encoding): a number of field and type, then the value.
"""
from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.formats.measurement_table import (
    MAX_VALUES,
    SpectralTable,
    distinct,
)

# Numbers of fields. A file holds spectral measurements, since version 1 also inside measurements.
SPD_MEASUREMENTS, MEASUREMENTS, SPD = 1, 4, 1
FILE_FIELDS = {1, 2, 3, 4, 16, 17, 18, 19, 20}
SHAPE, VALUES, SINGLES, NAME, INSTRUMENT = 1, 2, 4, 3, 8
VARINT, EIGHT_BYTES, LENGTH, FOUR_BYTES = 0, 1, 2, 5      # wire types
MAX_VARINT_BYTES = 10
UNNAMED = re.compile(r"SpectralDistribution \(\d+\)")     # by its address in memory
Fields = dict[int, list[bytes]]


def is_csmf(content: bytes) -> bool:
    """Whether content is wholly fields of such a file, with at least one spectrum."""
    try:
        return bool(_spectra(content))
    except (ValueError, struct.error):
        return False


def read_csmf(content: bytes, path: Path) -> SpectralTable:
    """Every spectrum of a file, by name or as "measurement 1" and so on.

    The file states neither quantity nor unit.

    Parameters
    ----------
    content : bytes
    path : Path
        Its name, for errors.

    Raises
    ------
    InputError
        If it is damaged, or its spectra have not the same wavelengths.
    """
    try:
        spectra = _spectra(content)
        rows = [_numbers(fields) for fields, _ in spectra]
        stated = [_text(fields, NAME) for fields, _ in spectra]
        instruments = {_text(measurement, INSTRUMENT) for _, measurement in spectra} - {""}
    except (ValueError, struct.error):
        raise InputError(f"{path.name} is cut or damaged as a file of colour-specio; copy it "
                         "again") from None
    if not rows:
        raise InputError(f"{path.name} holds no spectrum, only colours; measure with a "
                         "spectroradiometer")
    nm = rows[0][0]
    if any(not np.array_equal(nm, each) for each, _ in rows):
        raise InputError(f"{path.name} holds spectra of different wavelengths; save them in "
                         "files of their own")
    names = [f"measurement {number}" if not name or UNNAMED.match(name) else name
             for number, name in enumerate(stated, 1)]
    return SpectralTable(nm, distinct(names), np.array([values for _, values in rows]),
                         {"source": ", ".join([*sorted(instruments), path.name])}, path.name)


def _spectra(content: bytes) -> list[tuple[Fields, Fields]]:
    """Fields of each spectrum and of the measurement that it is part of."""
    file = _fields(content)
    if not file.keys() <= FILE_FIELDS:
        raise ValueError("no field of such a file")
    measured = file.get(SPD_MEASUREMENTS, []) + [
        spd for each in file.get(MEASUREMENTS, []) for spd in _fields(each).get(SPD, [])]
    measurements = [_fields(each) for each in measured]
    return [(_fields(spd), each) for each in measurements for spd in each.get(SPD, [])]


def _numbers(spectrum: Fields) -> tuple[np.ndarray, np.ndarray]:
    """Wavelengths (P,) in nm and values (P,) of a spectrum."""
    shape = _fields(b"".join(spectrum.get(SHAPE, [])))
    start, end, step = (struct.unpack("<d", shape[field][-1])[0] for field in (1, 2, 3)
                        if field in shape)
    if not 0 < step <= end - start <= MAX_VALUES * step:
        raise ValueError("no range of wavelengths")
    values = np.frombuffer(b"".join(spectrum.get(VALUES, [])), "<f8")
    if not values.size:
        values = np.frombuffer(b"".join(spectrum.get(SINGLES, [])), "<f4").astype(float)
    count = round((end - start) / step) + 1
    if values.size != count:
        raise ValueError(f"{values.size} values at {count} wavelengths")
    return start + step * np.arange(count), values


def _text(fields: Fields, field: int) -> str:
    return b"".join(fields.get(field, [])[-1:]).decode("utf-8")


def _fields(content: bytes) -> Fields:
    """Values of each field of a message, as they are encoded."""
    fields: Fields = {}
    for field, value in _each_field(content):
        fields.setdefault(field, []).append(value)
    return fields


def _each_field(content: bytes) -> Iterator[tuple[int, bytes]]:
    at = 0
    while at < len(content):
        key, at = _varint(content, at)
        start, kind = at, key & 7
        if kind == VARINT:
            _, at = _varint(content, at)
        elif kind == LENGTH:
            length, start = _varint(content, at)
            at = start + length
        elif kind in (EIGHT_BYTES, FOUR_BYTES):
            at += 8 if kind == EIGHT_BYTES else 4
        else:
            raise ValueError("no type of a field")
        if at > len(content) or not key >> 3:
            raise ValueError("cut")
        yield key >> 3, content[start:at]


def _varint(content: bytes, at: int) -> tuple[int, int]:
    """The number that begins at a position, seven bits a byte, and the position after it."""
    number = 0
    for index, byte in enumerate(content[at:at + MAX_VARINT_BYTES]):
        number |= (byte & 0x7F) << (7 * index)
        if byte < 0x80:
            return number, at + index + 1
    raise ValueError("cut")
