"""ASD FieldSpec files of every version, float32, int16 and float64 (ASD's "old" and "version 8"
format notes).

Little-endian, a 484-byte header, then the spectrum. Files from magic ``as2`` on also hold the
reference; from ``as7`` on the calibration, from which radiance is derived. What later versions
append (audit log, signature) is not needed here.
"""
from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.formats import measurement_table

HEADER_BYTES = 484
KIND_AT, SAMPLE_FORMAT_AT, INTEGRATION_AT = 186, 199, 390   # bytes of the header
TYPES = ("raw", "reflectance", "radiance", "no units", "irradiance", "quality index",
         "transmittance", "unknown", "absorbance")
SAMPLE_FORMATS = {0: "<f4", 1: "<i2", 2: "<f8"}
# an instrument with SWIR detectors: of the kinds with gains the only one handled
FULL_RANGE = 4
COSINE_RECEPTOR_DEGREES = 180           # fore-optic from here: irradiance
BASE, LAMP, FIBRE = 1, 2, 3             # kinds of calibration spectra
COUNTS = {"quantity": "raw", "unit": "counts"}

Columns = dict[str, tuple[np.ndarray, dict[str, str]]]      # values, and what is stated of them


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
    nm = _wavelengths(content, path.name)
    version, kind = content[:3].decode("ascii"), TYPES[content[KIND_AT]]
    sample_format = SAMPLE_FORMATS[content[SAMPLE_FORMAT_AT]]
    integration_ms, = struct.unpack_from("<I", content, INTEGRATION_AT)
    serial_number, = struct.unpack_from("<H", content, 400)
    saturated = content[422]
    spectrum, after = _samples(content, HEADER_BYTES, nm.size, sample_format, path.name)
    reference, taken = None, False
    notes: list[str] = []
    if version != "ASD":
        reference, taken, after = _reference(content, after, nm.size, sample_format, path.name)
    if kind not in ("radiance", "irradiance"):
        columns = _columns(version, kind, spectrum, reference, taken, notes)
    elif version == "ASD":
        columns = {kind: (spectrum, {"quantity": kind, "unit": measurement_table.UNITS[kind]})}
    else:
        calibrations = _calibrations(content, after, nm.size, notes) \
            if version in ("as7", "as8") else {}
        columns = _radiometric(_derived(content, nm, spectrum, calibrations, notes), spectrum,
                               reference)
    if saturated:
        notes.append("the instrument flagged saturation while this was recorded")
    facts = {"source": f"ASD instrument {serial_number}, {path.name}", "asd_version": version,
             "asd_type": kind, "integration_ms": str(integration_ms)}
    return measurement_table.SpectralTable(np.round(nm, 6), tuple(columns),
                                           np.array([values for values, _ in columns.values()]),
                                           facts, path.name, next(iter(columns)),
                                           {name: stated
                                            for name, (_, stated) in columns.items()}, tuple(notes))


def _wavelengths(content: bytes, name: str) -> np.ndarray:
    """Wavelengths (P,) in nm of a header that holds what can be."""
    if len(content) < HEADER_BYTES:
        raise InputError(f"{name} is cut: an ASD file has a header of {HEADER_BYTES} bytes, this "
                         f"has {len(content)}")
    first_nm, step_nm = struct.unpack_from("<ff", content, 191)
    channels, = struct.unpack_from("<H", content, 204)
    kind, sample_format = content[KIND_AT], content[SAMPLE_FORMAT_AT]
    if kind >= len(TYPES) or sample_format not in SAMPLE_FORMATS:
        raise InputError(f"{name}: data type {kind} in sample format {sample_format} is not known; "
                         "the header is damaged")
    if not (np.isfinite(first_nm) and 100 <= first_nm <= 3000 and 0 < step_nm <= 100
            and channels >= 2):
        raise InputError(f"{name}: {channels} channels from {first_nm:g} nm in steps of "
                         f"{step_nm:g} nm cannot be; the header is damaged: copy the file from the "
                         "instrument again")
    return np.asarray(first_nm + step_nm * np.arange(channels))


def _samples(content: bytes, at: int, channels: int, sample_format: str,
             name: str) -> tuple[np.ndarray, int]:
    size = np.dtype(sample_format).itemsize * channels
    if at + size > len(content) or channels > measurement_table.MAX_VALUES:
        raise InputError(f"{name} is cut: {at + size} bytes are stated, {len(content)} are there; "
                         "copy the file from the instrument again")
    values = np.frombuffer(content, sample_format, channels, at).astype(float)
    if not np.all(np.isfinite(values)):
        raise InputError(f"{name}: {int(np.sum(~np.isfinite(values)))} samples are not numbers; "
                         "the file is damaged, or its sample format is misstated")
    return values, at + size


def _reference(content: bytes, at: int, channels: int, sample_format: str,
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
    values, after = _samples(content, at + 20 + note_bytes, channels, sample_format, name)
    return (values if np.any(values != 0) else None), bool(taken), after


def _columns(version: str, kind: str, spectrum: np.ndarray, reference: np.ndarray | None,
             taken: bool, notes: list[str]) -> Columns:
    """Of all kinds but radiance and irradiance."""
    if kind in ("raw", "reflectance", "transmittance") and reference is not None and taken:
        quantity = "transmittance" if kind == "transmittance" else "reflectance"
        ratio = np.full(spectrum.shape, np.nan)
        np.divide(spectrum, reference, out=ratio, where=reference > 0)
        stated = {"quantity": quantity, "unit": "1"}
        both = {"target": (spectrum, COUNTS), "reference": (reference, COUNTS)}
        return ({**both, quantity: (ratio, stated)} if kind == "raw"
                else {quantity: (ratio, stated), **both})
    if kind == "reflectance" and version != "ASD":
        notes.append("the file holds no reference: its spectrum is taken as reflectance, as its "
                     "header states")
    if reference is not None:
        notes.append("the reference was not taken for this spectrum, as the file states: no ratio "
                     "is formed")
    stated = {"quantity": kind, "unit": "counts" if kind == "raw" else "1"}
    columns = {"target" if kind == "raw" else kind: (spectrum, stated)}
    return columns | ({} if reference is None else {"reference": (reference, COUNTS)})


def _radiometric(derived: tuple[str, np.ndarray] | None, spectrum: np.ndarray,
                 reference: np.ndarray | None) -> Columns:
    """Radiance or irradiance, if it could be derived, and the counts that it comes from."""
    columns = {}
    if derived is not None:
        quantity, values = derived
        columns[quantity] = (values,
                             {"quantity": quantity, "unit": measurement_table.UNITS[quantity]})
    columns["target"] = (spectrum, COUNTS)
    return columns | ({} if reference is None else {"reference": (reference, COUNTS)})


def _derived(content: bytes, nm: np.ndarray, spectrum: np.ndarray,
             calibrations: dict[int, tuple[np.ndarray, int, int, int]],
             notes: list[str]) -> tuple[str, np.ndarray] | None:
    """Radiance or irradiance from counts: lamp x counts / fibre, scaled by integration time and
    gains.
    """
    own_ms, fore_optic = struct.unpack_from("<Ih", content, INTEGRATION_AT)
    irradiance = fore_optic >= COSINE_RECEPTOR_DEGREES
    needed = {LAMP, FIBRE} if irradiance else {BASE, LAMP, FIBRE}
    if not needed <= set(calibrations) or not own_ms:
        notes.append(f"the {TYPES[content[KIND_AT]]} cannot be derived: the file lacks its "
                     "calibration; only counts are given")
        return None
    fibre, integration_ms, gain1, gain2 = calibrations[FIBRE]
    factor = np.full(nm.shape, integration_ms / own_ms)
    if content[431] == FULL_RANGE:
        own1, own2, _, _, splice1, splice2 = struct.unpack_from("<HHhhff", content, 436)
        if not all((own1, own2, gain1, gain2)):
            notes.append("the gains of the file are zero; only counts are given")
            return None
        factor[nm > splice1] = own1 / gain1
        factor[nm > splice2] = own2 / gain2
    counts = np.full(nm.shape, np.nan)
    np.divide(spectrum, fibre, out=counts, where=fibre != 0)
    values = calibrations[LAMP][0] * counts * factor
    if irradiance:
        return "irradiance", values
    return "radiance", values * calibrations[BASE][0] / np.pi


def _calibrations(content: bytes, at: int, channels: int,
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
            values, at = _samples(content, at, channels, "<f8", "calibration")
            targets[kind] = (values, integration_ms, gain1, gain2)
    except (struct.error, IndexError, InputError):
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
