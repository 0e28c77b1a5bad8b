"""ASD FieldSpec files of every version, float32, int16 and float64 (ASD's "old" and "version 8"
format notes).

Little-endian, a 484-byte header, then the spectrum. Files from magic ``as2`` on also hold the
reference; from ``as7`` on the calibration, from which radiance is derived. What later versions
append (audit log, signature) is not needed here.
"""
from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.formats import measurement_table

HEADER_BYTES = 484
TYPES = ("raw", "reflectance", "radiance", "no units", "irradiance", "quality index",
         "transmittance", "unknown", "absorbance")
SAMPLE_FORMATS = {0: "<f4", 1: "<i2", 2: "<f8"}
# an instrument with SWIR detectors: of the kinds with gains the only one handled
FULL_RANGE = 4
COSINE_RECEPTOR_DEGREES = 180           # fore-optic from here: irradiance
BASE, LAMP, FIBRE = 1, 2, 3             # kinds of calibration spectra


@dataclass(frozen=True)
class AsdHeader:
    """The part of the header that is used."""

    version: str
    kind: str
    first_nm: float
    step_nm: float
    channels: int
    sample_format: str
    integration_ms: int
    fore_optic: int
    serial_number: int
    saturated: int
    instrument: int
    gains: tuple[int, int]
    splices_nm: tuple[float, float]


def is_asd(content: bytes) -> bool:
    """Whether content begins as an ASD file does."""
    return (content[:3] in (b"ASD", *(b"as%d" % version for version in range(2, 9)))
            and b"\x00" in content[:HEADER_BYTES])


def read_asd(content: bytes, path: Path) -> measurement_table.SpectralTable:
    """Reflectance, radiance, irradiance or raw counts, with target and reference as further
    columns.

    Parameters
    ----------
    content : bytes
    path : Path
        Its name, for errors.

    Raises
    ------
    InputError
        If the file is cut, or states what cannot be.
    """
    header = _header(content, path.name)
    spectrum, after = _samples(content, HEADER_BYTES, header, path.name)
    reference, taken, calibrations = None, False, {}
    notes: list[str] = []
    if header.version != "ASD":
        reference, taken, after = _reference(content, after, header, path.name)
        if header.version in ("as7", "as8"):
            calibrations = _calibrations(content, after, header, notes)
    nm = np.round(header.first_nm + header.step_nm * np.arange(header.channels), 6)
    columns = _columns(header, spectrum, reference, taken, calibrations, notes)
    if header.saturated:
        notes.append("the instrument flagged saturation while this was recorded")
    facts = {"source": f"ASD instrument {header.serial_number}, {path.name}",
             "asd_version": header.version,
             "asd_type": header.kind, "integration_ms": str(header.integration_ms)}
    return measurement_table.SpectralTable(nm, tuple(columns),
                                           np.array([values for values, _ in columns.values()]),
                                           facts, path.name, next(iter(columns)),
                                           {name: stated
                                            for name, (_, stated) in columns.items()}, tuple(notes))


def _header(content: bytes, name: str) -> AsdHeader:
    if len(content) < HEADER_BYTES:
        raise InputError(f"{name} is cut: an ASD file has a header of {HEADER_BYTES} bytes, this "
                         f"has {len(content)}")
    first_nm, step_nm = struct.unpack_from("<ff", content, 191)
    channels, = struct.unpack_from("<H", content, 204)
    kind, sample_format = content[186], content[199]
    if kind >= len(TYPES) or sample_format not in SAMPLE_FORMATS:
        raise InputError(f"{name}: data type {kind} in sample format {sample_format} is not known; "
                         "the header is damaged")
    if not (np.isfinite(first_nm) and 100 <= first_nm <= 3000 and 0 < step_nm <= 100
            and channels >= 2):
        raise InputError(f"{name}: {channels} channels from {first_nm:g} nm in steps of "
                         f"{step_nm:g} nm cannot be; the header is damaged: copy the file from the "
                         "instrument again")
    integration_ms, fore_optic = struct.unpack_from("<Ih", content, 390)
    serial_number, = struct.unpack_from("<H", content, 400)
    gain1, gain2, _, _, splice1, splice2 = struct.unpack_from("<HHhhff", content, 436)
    return AsdHeader(content[:3].decode("ascii"), TYPES[kind], first_nm, step_nm, channels,
                     SAMPLE_FORMATS[sample_format],
                     integration_ms, fore_optic, serial_number, content[422], content[431],
                     (gain1, gain2),
                     (splice1, splice2))


def _samples(content: bytes, at: int, header: AsdHeader, name: str,
             kind: str | None = None) -> tuple[np.ndarray, int]:
    kind = kind or header.sample_format
    size = np.dtype(kind).itemsize * header.channels
    if at + size > len(content) or header.channels > measurement_table.MAX_VALUES:
        raise InputError(f"{name} is cut: {at + size} bytes are stated, {len(content)} are there; "
                         "copy the file from the instrument again")
    values = np.frombuffer(content, kind, header.channels, at).astype(float)
    if not np.all(np.isfinite(values)):
        raise InputError(f"{name}: {int(np.sum(~np.isfinite(values)))} samples are not numbers; "
                         "the file is damaged, or its sample format is misstated")
    return values, at + size


def _reference(content: bytes, at: int, header: AsdHeader,
               name: str) -> tuple[np.ndarray | None, bool, int]:
    """The reference after its flag, two dates and a note; None where all of it is zero. Was it
    taken for this spectrum?
    """
    if at == len(content):
        return None, False, at  # some writers leave the block out
    if at + 20 > len(content):
        raise InputError(f"{name} is cut in the header of its reference; copy the file from the "
                         "instrument again")
    taken, = struct.unpack_from("<H", content, at)
    note_bytes, = struct.unpack_from("<H", content, at + 18)
    values, after = _samples(content, at + 20 + note_bytes, header, name)
    return (values if np.any(values != 0) else None), bool(taken), after


def _columns(header: AsdHeader, spectrum: np.ndarray, reference: np.ndarray | None, taken: bool,
             calibrations: dict[int, tuple[np.ndarray, int, int, int]],
             notes: list[str]) -> dict[str, tuple[np.ndarray, dict[str, str]]]:
    counts = {"quantity": "raw", "unit": "counts"}
    if header.kind in ("radiance", "irradiance"):
        if header.version == "ASD":
            return {
                header.kind:
                (spectrum, {"quantity": header.kind, "unit": measurement_table.UNITS[header.kind]})
            }
        columns = {}
        derived = _derived(header, spectrum, calibrations, notes)
        if derived is not None:
            quantity, values = derived
            columns[quantity] = (values,
                                 {"quantity": quantity, "unit": measurement_table.UNITS[quantity]})
        columns["target"] = (spectrum, counts)
        return columns | ({} if reference is None else {"reference": (reference, counts)})
    if header.kind in ("raw", "reflectance", "transmittance") and reference is not None and taken:
        quantity = "transmittance" if header.kind == "transmittance" else "reflectance"
        ratio = np.full(spectrum.shape, np.nan)
        np.divide(spectrum, reference, out=ratio, where=reference > 0)
        stated = {"quantity": quantity, "unit": "1"}
        both = {"target": (spectrum, counts), "reference": (reference, counts)}
        return ({**both, quantity: (ratio, stated)} if header.kind == "raw"
                else {quantity: (ratio, stated), **both})
    if header.kind == "reflectance" and header.version != "ASD":
        notes.append("the file holds no reference: its spectrum is taken as reflectance, as its "
                     "header states")
    if reference is not None:
        notes.append("the reference was not taken for this spectrum, as the file states: no ratio "
                     "is formed")
    stated = {"quantity": header.kind, "unit": "counts" if header.kind == "raw" else "1"}
    columns = {"target" if header.kind == "raw" else header.kind: (spectrum, stated)}
    return columns | ({} if reference is None else {"reference": (reference, counts)})


def _derived(header: AsdHeader, spectrum: np.ndarray,
             calibrations: dict[int, tuple[np.ndarray, int, int, int]],
             notes: list[str]) -> tuple[str, np.ndarray] | None:
    """Radiance or irradiance from counts: lamp x counts / fibre, scaled by integration time and
    gains.
    """
    irradiance = header.fore_optic >= COSINE_RECEPTOR_DEGREES
    needed = {LAMP, FIBRE} if irradiance else {BASE, LAMP, FIBRE}
    if not needed <= set(calibrations) or not header.integration_ms:
        notes.append(f"the {header.kind} cannot be derived: the file lacks its calibration; only "
                     "counts are given")
        return None
    fibre, integration_ms, gain1, gain2 = calibrations[FIBRE]
    nm = header.first_nm + header.step_nm * np.arange(header.channels)
    factor = np.full(nm.shape, integration_ms / header.integration_ms)
    if header.instrument == FULL_RANGE:
        if not all((*header.gains, gain1, gain2)):
            notes.append("the gains of the file are zero; only counts are given")
            return None
        factor[nm > header.splices_nm[0]] = header.gains[0] / gain1
        factor[nm > header.splices_nm[1]] = header.gains[1] / gain2
    counts = np.full(nm.shape, np.nan)
    np.divide(spectrum, fibre, out=counts, where=fibre != 0)
    values = calibrations[LAMP][0] * counts * factor
    if irradiance:
        return "irradiance", values
    return "radiance", values * calibrations[BASE][0] / np.pi


def _calibrations(content: bytes, at: int, header: AsdHeader,
                  notes: list[str]) -> dict[int, tuple[np.ndarray, int, int, int]]:
    """Calibration spectra by kind with integration time and gains; empty where the file holds
    none.
    """
    try:
        at = _after_dependents(content, _after_classifier(content, at))
        count = content[at]
        entries = [struct.unpack_from("<b20siHH", content, at + 1 + 29 * index)
                   for index in range(count)]
        targets = {}
        at += 1 + 29 * count
        for kind, _, integration_ms, gain1, gain2 in entries:
            values, at = _samples(content, at, header, "calibration", "<f8")
            targets[kind] = (values, integration_ms, gain1, gain2)
    except (struct.error, IndexError, InputError):
        if header.kind in ("radiance", "irradiance"):
            notes.append("what follows the reference could not be read: no calibration is used")
        return {}
    return targets


def _after_classifier(content: bytes, at: int) -> int:
    at += 2
    for _ in range(20):
        at = _after_text(content, at)
    count, = struct.unpack_from("<H", content, at)
    if not count:
        return at + 4
    at += 12
    for _ in range(count):
        at = _after_text(content, _after_text(content, at)) + 92
    return at


def _after_dependents(content: bytes, at: int) -> int:
    count, = struct.unpack_from("<H", content, at + 2)
    if not count:
        return at + 8
    at += 14
    for _ in range(count):
        at = _after_text(content, at)
    return at + 10 + 4 * count


def _after_text(content: bytes, at: int) -> int:
    length, = struct.unpack_from("<H", content, at)
    return at + 2 + length
