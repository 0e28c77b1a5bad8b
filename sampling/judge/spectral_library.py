"""Libraries of measured reflectances with their names: files, folders of files, published sets."""
from __future__ import annotations

import difflib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from spectrabox.radiometry.errors import InputError
from spectrabox.radiometry.files import names_a_file
from spectrabox.radiometry.records import Quantity, WavelengthGrid
from spectrabox.radiometry.shaped import Record
from spectrabox.radiometry.spectra.formats.measurement_table import distinct
from spectrabox.radiometry.spectra.named_spectra import test_reflectances
from spectrabox.radiometry.spectra.spectrum_files import (
    SUFFIXES,
    on_grid,
    read_table,
    spectrum_of,
    spectrum_on_grid,
)
from spectrabox.sampling.prior.libraries import READERS, usable
from spectrabox.sampling.prior.mixture import PRIOR_GRID

ARCHIVES = (".mat", ".rda", ".zip")     # which state no names of their spectra
TEXTS = (".txt", ".hdr")
UNNAMED = ("", "value", "reflectance")  # names of a column that say nothing: the file's says more


Row = tuple[str, np.ndarray, np.ndarray]    # name, spectrum (P,), standard error (P,)


@dataclass(frozen=True, eq=False)
class SpectralLibrary(Record):
    """Reflectances of n materials by name, on one grid.

    Attributes
    ----------
    names, libraries : tuples of n str
        Of the material, and of the library it is from.
    spectra, standard_error : (n, P) arrays
        The error is 0 where nobody stated it.
    left_out : tuple of str
        Sentences on spectra that could not be used.
    """

    names: tuple[str, ...]
    libraries: tuple[str, ...]
    spectra: Annotated[np.ndarray, "n P"]
    standard_error: Annotated[np.ndarray, "n P"]
    left_out: tuple[str, ...]


def read_spectral_libraries(words: Sequence[str], grid: WavelengthGrid) -> SpectralLibrary:
    """Every reflectance of some libraries.

    Parameters
    ----------
    words : sequence of str
        Files of any format of spectra, folders of them, or names of published sets.
    grid : WavelengthGrid
        That each must cover: nothing is extrapolated.

    Raises
    ------
    InputError
        If one holds no reflectance that covers the grid.
    """
    names: list[str] = []
    libraries: list[str] = []
    rows: list[Row] = []
    left_out: list[str] = []
    for word in words:
        refused: list[str] = []
        spectra = list(_rows(word, grid, refused))
        if not spectra:
            more = f"; {len(refused) - 1} more like it" if len(refused) > 1 else ""
            raise InputError(refused[0] + more if refused else
                             f"{word} holds no spectra of a known format; give a file of "
                             "reflectances, a folder of them, or a published set")
        left_out += refused
        names += [name for name, _, _ in spectra]
        libraries += [Path(word).name or word] * len(spectra)
        rows += spectra
    return SpectralLibrary(tuple(names), tuple(libraries), np.array([row[1] for row in rows]),
                           np.array([row[2] for row in rows]), tuple(left_out))


def _rows(word: str, grid: WavelengthGrid, refused: list[str]) -> Iterator[Row]:
    path = Path(word)
    if path.is_dir():
        for file in sorted(path.iterdir()):
            suffix = file.suffix.lower()
            header = suffix == ".hdr" and any(file.with_suffix(other).exists()
                                              for other in (".sli", ".slb"))
            if file.is_file() and not header and suffix in (*SUFFIXES, *ARCHIVES, *TEXTS,
                                                            ".json"):
                try:
                    yield from _of_file(file, grid, refused)
                except InputError as error:
                    refused.append(str(error))
    elif names_a_file(word):
        yield from _of_file(path, grid, refused)
    else:
        yield from _published(word, grid)


def _of_file(path: Path, grid: WavelengthGrid, refused: list[str]) -> Iterator[Row]:
    if path.suffix.lower() in ARCHIVES:
        yield from _of_archive(path, grid, refused)
        return
    table = read_table(path)
    columns = [index for index, name in enumerate(table.names)
               if not name.startswith("standard_error") and table.main in (None, name)]
    named = distinct(list(table.names))
    for index in columns:
        try:
            spectrum = spectrum_of(table, role=Quantity.REFLECTANCE, column=index + 2)
            values = spectrum_on_grid(spectrum, grid)
        except InputError as refusal:
            refused.append(str(refusal))
            continue
        error = np.zeros(grid.nm.size)
        if spectrum.standard_error is not None and np.all(np.isfinite(spectrum.standard_error)):
            error = on_grid(spectrum.grid.nm, spectrum.standard_error, grid, spectrum.source)
        nameless = len(columns) == 1 and named[index].lower() in UNNAMED
        yield (path.stem if nameless else named[index]), values, error


def _of_archive(path: Path, grid: WavelengthGrid, refused: list[str]) -> Iterator[Row]:
    """Spectra of a file that states no names, by their numbers from 1."""
    number = 0
    for nm, curves in READERS[path.suffix.lower()](path):
        for curve in curves:
            number += 1
            kept, why = usable(nm, curve[None])
            if len(kept):
                yield (f"{path.stem} {number}", np.interp(grid.nm, PRIOR_GRID.nm, kept[0]),
                       np.zeros(grid.nm.size))
            else:
                reason = next(reason for reason, count in why.items() if count)
                refused.append(f"spectrum {number} of {path.name} cannot be used: {reason}")


def _published(word: str, grid: WavelengthGrid) -> Iterator[Row]:
    sets = test_reflectances(grid)
    if word not in sets:
        near = difflib.get_close_matches(word, sets, n=1, cutoff=0.4)
        nearest = f"; nearest is {near[0]!r}" if near else ""
        raise InputError(f"{word!r} is no file and no published set of reflectances{nearest}; "
                         f"known are {', '.join(sets)}")
    for number, values in enumerate(sets[word], start=1):
        yield f"{word} {number}", values, np.zeros(grid.nm.size)
