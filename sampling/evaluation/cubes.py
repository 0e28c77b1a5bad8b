"""A hyperspectral picture made elsewhere, as something that is read row by row, and its
wavelengths.
"""
from __future__ import annotations

import re
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.spectra.formats.csvw import envi_header_of
from spectrabox.radiometry.spectra.formats.envi import (
    DATA_TYPES,
    ITEM,
    WAVELENGTH_UNITS,
    is_envi_header,
)
from spectrabox.radiometry.spectra.formats.measurement_table import number, text_of
from spectrabox.radiometry.spectra.spectral_layers import REFLECTANCE, spectral_layers
from spectrabox.radiometry.system.archives import DAMAGE

MAX_BANDS, MOST_SIDE, MOST_IN_ROW = 5000, 200_000, 100_000_000     # the last: values, read at once


@dataclass(frozen=True)
class Cube:
    """A picture of C wavelengths; ``rows(first, last)`` reads (last - first, W, C) of it, in the
    file's unit.
    """

    file: str
    nm: np.ndarray              # (C,) ascending
    height: int
    width: int
    rows: Callable[[int, int], np.ndarray]


def cube_of_channels(file: str, names: Sequence[str], height: int, width: int,
                     rows: Callable[[int, int], np.ndarray]) -> Cube:
    """A picture whose channels are named by their wavelengths, as of a spectral EXR; others are
    left out.

    Raises
    ------
    InputError
        If fewer than two are.
    """
    # Of a spectral EXR's layers the reflectance T is meant.
    _, bands = spectral_layers(names, first=REFLECTANCE)
    if len(bands) < 2:
        raise InputError(f"{file} is an ordinary picture ({', '.join(names[:4])}); a hyperspectral "
                         "one has channels such as 560nm or T.560nm")
    check_sides(file, height, width, len(names))
    channels = [channel for _, channel in bands]
    return cube_of_rows(file, np.array([nm for nm, _ in bands]), height, width,
                        lambda first, last: rows(first, last)[..., channels])


def parse_wavelengths(text: str) -> np.ndarray:
    """Wavelengths (C,) in nm of FIRST:LAST:STEP, of a list v1,v2,..., or of a text file of numbers.

    Raises
    ------
    InputError
    """
    try:
        if len(parts := text.split(":")) == 3:
            first, last, step = map(float, parts)
            count = round((last - first) / step) + 1 if step > 0 and np.isfinite(step) else 0
            if not 2 <= count <= MAX_BANDS:
                raise ValueError
            return first + step * np.arange(count)
        if Path(text).is_file():
            text = ",".join(re.split(r"[\s,;]+", text_of(Path(text).read_bytes()[:1_000_000],
                                                         Path(text).name).strip()))
        nm = np.array([float(part) for part in text.split(",")])
    except (ValueError, OverflowError, OSError):
        raise InputError(f"--wavelengths {text[:60]!r} cannot be read; write 400:700:10, a list, "
                         "or the name of a text file of numbers in nm") from None
    return checked_wavelengths(nm, "--wavelengths")


def checked_wavelengths(nm: np.ndarray, name: str) -> np.ndarray:
    """The wavelengths (C,), two or more, different from one another and in nm."""
    if nm.size < 2 or not np.all(np.isfinite(nm)) or np.unique(nm).size != nm.size \
            or nm.min() < 100 or nm.max() > 1e5:
        raise InputError(f"{name}: {nm.size} wavelengths were given, not all of them different and "
                         "in nm; at least two are needed, such as 400, 410 ...")
    return nm


def cube_of_array(name: str, array: np.ndarray, nm: np.ndarray | None,
                  again: Callable[[], np.ndarray] | None = None) -> Cube:
    """A picture in an array (H, W, C) or (C, H, W): the axis that is as long as the list of
    wavelengths.

    ``again`` maps the same array anew: mapped for one block of rows, its pages leave memory with
    it.
    """
    if array.ndim != 3 or array.dtype.kind not in "fiu":
        raise InputError(f"{name} holds an array of {array.ndim} dimensions of type {array.dtype}; "
                         "three dimensions of real numbers are needed: rows, columns, wavelengths")
    nm = stated_wavelengths(name, nm)
    if nm.size not in (array.shape[2], array.shape[0]):
        raise InputError(f"{name} is an array of {' x '.join(map(str, array.shape))} and {nm.size} "
                         "wavelengths are stated; the last or the first dimension must be as long")
    axis = 2 if array.shape[2] == nm.size else 0
    height, width, bands = np.moveaxis(array, axis, 2).shape
    check_sides(name, height, width, bands)

    def rows(first: int, last: int) -> np.ndarray:
        return np.moveaxis(array if again is None else again(), axis, 2)[first:last]

    return cube_of_rows(name, nm, height, width, rows)


def cube_of_rows(name: str, nm: np.ndarray, height: int, width: int,
                 rows: Callable[[int, int], np.ndarray]) -> Cube:
    """The picture with its wavelengths in ascending order and its values as float64."""
    order = np.argsort(checked_wavelengths(nm, name))
    ascending = bool(np.all(np.diff(order) > 0))

    def ordered(first: int, last: int) -> np.ndarray:
        with np.errstate(all="ignore"):     # what is no number is left out with its pixel
            block = np.array(rows(first, last), dtype=float)
            return block if ascending else block[..., order]

    return Cube(name, nm[order], height, width, ordered)


def stated_wavelengths(name: str, nm: np.ndarray | None) -> np.ndarray:
    """The wavelengths (C,), of which there must be some."""
    if nm is None:
        raise InputError(f"{name} states no wavelengths; give them with --wavelengths 400:700:10, "
                         "or a file of them")
    return np.asarray(nm, dtype=float)


def check_sides(name: str, height: int, width: int, bands: int) -> None:
    """Raise unless these are the sides of a hyperspectral picture.

    Raises
    ------
    InputError
    """
    if not (0 < height <= MOST_SIDE and 0 < width <= MOST_SIDE and 2 <= bands <= MAX_BANDS) \
            or width * bands > MOST_IN_ROW:
        raise InputError(f"{name}: {height} x {width} pixels of {bands} bands cannot be a "
                         "hyperspectral picture; check which dimension holds the wavelengths")


# ---- files ---------------------------------------------------------------------------------------
# Files of hyperspectral pictures: ENVI images, .npy, .npz and MATLAB files. EXR comes as
# channels.
#
# Nothing in a file is executed (no pickle), and what a header promises is checked against the file
# before any of it is read. ENVI and .npy files of any size are read in part; .npz and MATLAB files
# are held in memory.

MOST_IN_MEMORY = 1_500_000_000          # bytes of a file that cannot be read in part
WAVELENGTH_NAMES = ("wavelengths_nm", "wavelengths", "wavelength", "nm", "lambda", "bands")
ENVI_VALUES = (".img", ".dat", ".raw", ".bin", ".bsq", ".bil", ".bip", "")
ENVI_AXES = {"bsq": ("bands", "lines", "samples"), "bil": ("lines", "bands", "samples"),
             "bip": ("lines", "samples", "bands")}
MATLAB_TYPES = {"double": 8, "single": 4, "uint8": 1, "int8": 1, "uint16": 2, "int16": 2,
                "uint32": 4, "int32": 4}


def open_cube(path: Path, nm: np.ndarray | None = None, variable: str | None = None) -> Cube:
    """A picture in a file of one of the formats above, but EXR (``cube_of_channels``).

    Parameters
    ----------
    nm : (C,), optional
        Wavelengths where the file states none.
    variable : str, optional
        Name of the array in a .npz or .mat file that holds several of three dimensions.

    Raises
    ------
    InputError
        If the file is missing, damaged, of no known format, or without wavelengths.
    """
    start = _start_of(path)
    if start.startswith(b"\x93NUMPY"):
        return _from_npy(path, nm)
    if start.startswith(b"PK\x03\x04"):
        return _from_npz(path, nm, variable)
    if start.startswith((b"MATLAB 7.3", b"\x89HDF")):
        raise InputError(f"{path.name} is an HDF5 file, as MATLAB 7.3 writes them; save the "
                         "picture again with save(..., '-v7') in MATLAB, or with numpy.save")
    if start.startswith(b"MATLAB"):
        return _from_matlab(path, nm, variable)
    header = path if is_envi_header(start) else envi_header_of(path)
    if header is not None:
        return _from_envi(header, nm)
    raise InputError(f"{path.name} is no hyperspectral picture that is known; known are ENVI (.hdr "
                     "beside its values), .npy, .npz, .mat and EXR with channels such as 560nm")


def _from_npy(path: Path, nm: np.ndarray | None) -> Cube:
    def mapped() -> np.ndarray:
        try:
            return np.load(path, mmap_mode="r", allow_pickle=False)
        except DAMAGE as error:
            raise InputError(f"{path.name} is damaged or holds more than plain numbers "
                             f"({_line(error)}); save the picture again with numpy.save") from None
    return cube_of_array(path.name, mapped(), nm, mapped)


def _from_npz(path: Path, nm: np.ndarray | None, variable: str | None) -> Cube:
    try:
        with zipfile.ZipFile(path) as archive, np.load(path, allow_pickle=False) as file:
            shapes = {name: _npy_shape(archive, name) for name in file.files if f"{name}.npy"
                      in archive.namelist()}
            chosen = _chosen(path.name, {name: shape for name, (shape, _) in shapes.items()},
                             variable)
            _check_size(path.name, *shapes[chosen])
            stated = next((file[name].ravel() for name in WAVELENGTH_NAMES
                           if name in shapes and np.prod(shapes[name][0]) <= MAX_BANDS), None)
            array = file[chosen]
    except DAMAGE as error:
        raise InputError(f"{path.name} is damaged or holds more than plain numbers "
                         f"({_line(error)}); save the picture again with numpy.savez") from None
    return cube_of_array(path.name, array, nm if nm is not None else stated)


def _npy_shape(archive: zipfile.ZipFile, name: str) -> tuple[tuple[int, ...], int]:
    """Shape and bytes per value that a member states, without unpacking it."""
    with archive.open(f"{name}.npy") as member:
        version = np.lib.format.read_magic(member)
        read = (np.lib.format.read_array_header_1_0 if version == (1, 0)
                else np.lib.format.read_array_header_2_0)
        shape, _, kind = read(member)
    return shape, kind.itemsize


def _from_matlab(path: Path, nm: np.ndarray | None, variable: str | None) -> Cube:
    from scipy.io import loadmat, whosmat
    from scipy.io.matlab import MatReadError

    try:
        stated = {name: (shape, MATLAB_TYPES.get(kind, 0)) for name, shape, kind in whosmat(path)}
        numeric = {name: shape for name, (shape, size) in stated.items() if size}
        chosen = _chosen(path.name, numeric, variable)
        _check_size(path.name, *stated[chosen])
        wanted = [chosen, *(name for name in WAVELENGTH_NAMES
                            if name in numeric and np.prod(numeric[name]) <= MAX_BANDS)]
        arrays = loadmat(path, variable_names=wanted)
    except (*DAMAGE, MatReadError) as error:
        raise InputError(f"{path.name} is no MATLAB file that can be read ({_line(error)}); save "
                         "it again with save(..., '-v7')") from None
    beside = next((np.asarray(arrays[name], dtype=float).ravel() for name in wanted[1:]), None)
    return cube_of_array(path.name, arrays[chosen], nm if nm is not None else beside)


def _from_envi(header: Path, nm: np.ndarray | None) -> Cube:
    text = text_of(header.read_bytes()[:10_000_000], header.name).replace("\r\n", "\n")
    keys = {match[1].strip().lower(): (match[2] if match[2] is not None else match[3]).strip()
            for match in ITEM.finditer(text)}
    size = {key: _whole(keys, key, header.name) for key in ("lines", "samples", "bands",
                                                            "header offset", "data type")}
    order = keys.get("interleave", "").lower()
    if order not in ENVI_AXES or size["data type"] not in DATA_TYPES or keys.get("file compression",
                                                                                 "0") != "0":
        raise InputError(f"{header.name}: interleave {order!r}, data type {size['data type']}, "
                         f"compression {keys.get('file compression', '0')}; bsq, bil or bip of "
                         "plain real numbers is needed")
    check_sides(header.name, size["lines"], size["samples"], size["bands"])
    values = next((path for suffix in ENVI_VALUES
                   if (path := header.with_suffix(suffix)) != header and path.is_file()), None)
    if values is None:
        raise InputError(f"{header.name} is the header of an ENVI picture; put its values "
                         f"{header.stem}.img beside it")
    byte_order = ">" if keys.get("byte order", "0") == "1" else "<"
    kind = np.dtype(byte_order + DATA_TYPES[size["data type"]])
    needed = size["header offset"] + size["lines"] * size["samples"] * size["bands"] * kind.itemsize
    if values.stat().st_size < needed:
        raise InputError(f"{values.name} is cut: its header promises {needed} bytes and "
                         f"{values.stat().st_size} are there")
    axes = ENVI_AXES[order]
    shape, offset = tuple(size[axis] for axis in axes), size["header offset"]
    order_of_axes = [axes.index(axis) for axis in ("lines", "samples", "bands")]
    factor = number(keys.get("reflectance scale factor", "1"))
    ignored = number(keys.get("data ignore value", ""))
    if not factor > 0:
        raise InputError(f"{header.name}: the reflectance scale factor {factor:g} cannot be")

    def rows(first: int, last: int) -> np.ndarray:
        with np.errstate(all="ignore"):
            # Mapped for these rows only: the pages that were read leave memory with the map.
            stored = np.memmap(values, kind, "r", offset, shape).transpose(order_of_axes)
            part = np.asarray(stored[first:last], dtype=float)
            return np.where(part == ignored, np.nan, part) / factor

    return cube_of_rows(header.name, _envi_wavelengths(keys, size["bands"], nm, header.name),
                        size["lines"], size["samples"], rows)


def _envi_wavelengths(keys: dict[str, str], bands: int, nm: np.ndarray | None,
                      name: str) -> np.ndarray:
    if nm is None and "wavelength" in keys:
        unit = keys.get("wavelength units", "nm").strip().lower()
        if unit not in WAVELENGTH_UNITS:
            raise InputError(f"{name}: the wavelength unit {unit!r} is not known; state "
                             "'wavelength units = nm'")
        nm = np.round(WAVELENGTH_UNITS[unit]
                      * np.array([number(cell) for cell in keys["wavelength"].split(",")]), 9)
    nm = stated_wavelengths(name, nm)
    if nm.size != bands:
        raise InputError(f"{name}: {nm.size} wavelengths for {bands} bands; correct the header or "
                         "--wavelengths")
    return nm


def _chosen(name: str, shapes: dict[str, tuple[int, ...]], variable: str | None) -> str:
    cubes = [key for key, shape in shapes.items() if len(shape) == 3]
    if len(cubes) == 1 and variable is None:
        return cubes[0]
    if variable is None or variable not in cubes:
        raise InputError(f"{name} holds {len(cubes)} arrays of three dimensions "
                         f"({', '.join(cubes[:12]) or 'none'}); say which with --variable")
    return variable


def _check_size(name: str, shape: tuple[int, ...], bytes_each: int) -> None:
    size = bytes_each * int(np.prod([int(side) for side in shape], dtype=object))
    if size > MOST_IN_MEMORY:
        raise InputError(f"{name} would need {size / 1e9:.1f} GB of memory; save it as ENVI or "
                         ".npy, which are read in part")


def _whole(keys: dict[str, str], key: str, name: str) -> int:
    text = keys.get(key, "0" if key == "header offset" else "")
    if not re.fullmatch(r"\d{1,12}", text):
        raise InputError(f"{name} states {key} = {text[:40]!r}; a whole number is needed")
    return int(text)


def _start_of(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(256)
    except FileNotFoundError:
        raise InputError(f"{path} is missing; give a hyperspectral picture") from None
    except OSError as error:
        raise InputError(
            f"{path} cannot be read ({error.strerror}); give a hyperspectral picture") from None


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__
