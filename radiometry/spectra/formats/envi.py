"""ENVI files: a text header (.hdr) beside a binary file, of spectral libraries and of images."""
from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import whole_file, write_text_whole
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.formats import delimited, measurement_table, units

DATA_TYPES = {1: "u1", 2: "i2", 3: "i4", 4: "f4", 5: "f8", 12: "u2", 13: "u4", 14: "i8", 15: "u8"}
ITEM = re.compile(r"^[ \t]*([A-Za-z][\w \t()-]*?)[ \t]*=[ \t]*(?:\{([^}]*)\}|(.*))$", re.MULTILINE)


def is_envi_header(content: bytes) -> bool:
    """Whether content is an ENVI header."""
    return content[:200].lstrip(b"\xef\xbb\xbf").startswith(b"ENVI") and b"=" in content


def read_envi(content: bytes, path: Path,
              axis: str | None = None) -> measurement_table.SpectralTable:
    """Every spectrum of a library, given its header or its binary file.

    Parameters
    ----------
    content : bytes
        Of the header or of the binary.
    path : Path
        Its name, and that of the other file.

    Raises
    ------
    InputError
    """
    header_path, data, data_name = _both_files(content, path)
    header = measurement_table.text_of(
        content if header_path == path else measurement_table.file_content(header_path),
        header_path.name)
    keys = {match[1].strip().lower(): (match[2] if match[2] is not None else match[3]).strip()
            for match in ITEM.finditer(header.replace("\r\n", "\n"))}
    bands, count, offset, data_type = (_integer(keys, key, header_path.name)
                                       for key in ("samples", "lines", "header offset",
                                                   "data type"))
    if data_type not in DATA_TYPES:
        raise InputError(f"{header_path.name}: data type {data_type} is not one of real numbers; "
                         "export the library as float")
    kind = np.dtype((">" if keys.get("byte order", "0").strip() == "1" else "<")
                    + DATA_TYPES[data_type])
    size = bands * count
    if not 0 < size <= measurement_table.MAX_VALUES or offset < 0 \
            or offset + size * kind.itemsize > len(
            data):
        raise InputError(f"{data_name} is cut: {count} spectra of {bands} bands are stated, "
                         f"{max(len(data) - offset, 0)} bytes of values are there")
    with np.errstate(invalid="ignore", over="ignore"):
        values = np.frombuffer(data, kind, bands * count,
                               offset).astype(float).reshape(count, bands)
    values = np.where(np.isfinite(values), values, np.nan)
    ignored = measurement_table.number(keys.get("data ignore value", ""))
    scale = measurement_table.number(keys.get("reflectance scale factor", "1"))
    if not scale > 0:
        raise InputError(f"{header_path.name}: the reflectance scale factor {scale:g} cannot be")
    values = np.where(values == ignored, np.nan, values) / scale
    gain, offset_of = (_per_band(keys, key, bands, header_path.name)
                       for key in ("data gain values", "data offset values"))
    values = values * (1.0 if gain is None else gain) + (0.0 if offset_of is None else offset_of)
    good = _per_band(keys, "bbl", bands, header_path.name)
    notes = []
    if good is not None and np.any(good == 0):
        values = np.where(good == 0, np.nan, values)
        notes.append(f"the bad band list (bbl) leaves out {int(np.sum(good == 0))} of {bands} "
                     "bands")
    for key, numbers in (("gains", gain), ("offsets", offset_of)):
        if numbers is not None:
            notes.append(f"the header's {key} of the bands, {numbers.min():g} to "
                         f"{numbers.max():g}, were applied")
    return replace(_table(keys, values, header_path.name, axis), notes=tuple(notes))


def _per_band(keys: dict[str, str], key: str, bands: int, name: str) -> np.ndarray | None:
    """The numbers (P,) that a header lists for its bands; None where it lists none.

    Raises
    ------
    InputError
        If there are not as many as bands, or one is no number.
    """
    if key not in keys:
        return None
    cells = [cell for cell in re.split(r"[\s,]+", keys[key]) if cell]
    numbers = np.array([measurement_table.number(cell) for cell in cells])
    if numbers.size != bands or not np.all(np.isfinite(numbers)):
        raise InputError(f"{name} lists {numbers.size} numbers as {key!r} for {bands} bands, or "
                         "one that is none; correct the header")
    return numbers


def envi_files(nm: np.ndarray, columns: dict[str, np.ndarray], *, quantity: Quantity,
               source: str) -> tuple[str, bytes]:
    """Header text and float64 binary of a library of spectra (P,): the values come back exactly.

    Parameters
    ----------
    nm : (P,) array
    columns : dict of (P,) arrays
        By name.
    quantity : Quantity
    source : str
        Stored in the file.
    """
    names = ", ".join(re.sub(r"[{},]", " ", " ".join(name.split())) for name in columns)
    lines = ["ENVI", f"description = {{{re.sub('[{}]', ' ', ' '.join(source.split()))}}}",
             f"samples = {nm.size}", f"lines = {len(columns)}", "bands = 1", "header offset = 0",
             "file type = ENVI Spectral Library",
             "data type = 5", "interleave = bsq", "byte order = 0", "wavelength units = nm",
             f"quantity = {quantity.name.lower()}", f"data units = {quantity.value}",
             f"spectra names = {{{names}}}", "wavelength = "
             f"{{{', '.join(repr(float(wavelength)) for wavelength in nm)}}}"]
    return "\n".join(lines) + "\n", np.array(list(columns.values()), dtype="<f8").tobytes()


def _table(keys: dict[str, str], values: np.ndarray, name: str,
           axis: str | None) -> measurement_table.SpectralTable:
    stated = keys.get("wavelength units", "").strip()
    unit = units.axis_unit(stated)
    wavelengths = np.array(
        [measurement_table.number(cell) for cell in keys.get("wavelength", "").split(",")])
    if wavelengths.size != values.shape[1] or not np.all(np.isfinite(wavelengths)):
        raise InputError(f"{name} lists {wavelengths.size} wavelengths for {values.shape[1]} "
                         "bands; correct the header")
    if unit is None and axis is None:
        raise InputError(f"{name}: the wavelength unit {stated or 'nothing'!r} is not known; state "
                         f"one of {', '.join(units.TO_NM)}, as 'wavelength units = nm', or say it: "
                         f"{units.remedy('nm')}")
    names = [cell.strip() for cell in keys.get("spectra names", "").split(",")]
    if len(names) != values.shape[0]:
        names = [f"spectrum {index}" for index in range(1, values.shape[0] + 1)]
    facts = {"source": " ".join(keys.get("description", name).split())}
    facts.update({key: keys[other].strip()
                  for key, other in (("quantity", "quantity"), ("unit", "data units"))
                  if other in keys})
    if "reflectance scale factor" in keys and "quantity" not in facts:
        facts.update(quantity="reflectance", unit="1")
    return measurement_table.SpectralTable(units.axis_in_nm(wavelengths, unit, axis, name),
                                           measurement_table.distinct(names), values, facts, name)


def _both_files(content: bytes, path: Path) -> tuple[Path, bytes, str]:
    if not is_envi_header(content):
        header = delimited.envi_header_of(path)
        if header is None:
            raise InputError(f"{path.name} is the binary half of an ENVI library; put its header "
                             f"{path.stem}.hdr beside it")
        return header, content, path.name
    if (data := delimited.envi_values_of(path)) is None:
        raise InputError(f"{path.name} is the header of an ENVI library; put its values "
                         f"{path.stem}.sli beside it")
    return path, measurement_table.file_content(data), data.name


def _integer(keys: dict[str, str], key: str, name: str) -> int:
    text = keys.get(key, "0" if key == "header offset" else "")
    if not re.fullmatch(r"\d{1,12}", text.strip()):
        raise InputError(f"{name} states {key} = {text!r}; a whole number is needed")
    return int(text)


# ---- images --------------------------------------------------------------------------------------
# ENVI images written some rows at a time: a text header (.hdr) beside float32 values (.img).

VALUES = ".img"


@contextlib.contextmanager
def envi_rows(header: Path, height: int, width: int, nm: np.ndarray, quantity: str,
              description: str, fwhm_nm: float) -> Iterator[Callable[[int, np.ndarray], None]]:
    """A function of (first row, pixels (n, W, P)) that writes the next rows of an ENVI image; both
    its files are there once all of them are written.

    Parameters
    ----------
    header : Path
        Ends in .hdr; the values go beside it, to .img, by pixel (BIP).
    height, width : int
    nm : (P,) array
    quantity : str
        What the values are, such as reflectance.
    description : str
    fwhm_nm : float
        Full width at half maximum that the value at each wavelength stands for.

    Raises
    ------
    EnvironmentProblem
        If the folder cannot be written.
    """
    with whole_file(header.with_suffix(VALUES)) as unfinished, unfinished.open("wb") as file:
        yield lambda first, pixels: pixels.astype("<f4").tofile(file)
    write_text_whole(header, _header(height, width, nm, quantity, description, fwhm_nm))


def _header(height: int, width: int, nm: np.ndarray, quantity: str, description: str,
            fwhm_nm: float) -> str:
    words = re.sub("[{}]", " ", " ".join(description.split()))
    return "\n".join([
        "ENVI", f"description = {{{words}}}", f"samples = {width}", f"lines = {height}",
        f"bands = {nm.size}", "header offset = 0", "file type = ENVI Standard", "data type = 4",
        "interleave = bip", "byte order = 0", "wavelength units = Nanometers",
        f"quantity = {quantity}",
        f"wavelength = {{{', '.join(f'{wavelength:g}' for wavelength in nm)}}}",
        f"fwhm = {{{', '.join([f'{fwhm_nm:g}'] * nm.size)}}}"]) + "\n"
