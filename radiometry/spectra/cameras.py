"""Cameras by name, which columns of a table are their bands, and how well their curves are known.

Cameras by name: those that are published, and one's own, kept as CSV files in one folder.

The folder is ``$SPECTRABOX_CAMERAS``, else ``spectrabox/cameras`` under ``$XDG_DATA_HOME`` or
``~/.local/share``. A camera's file is called after it: ``Nikon D850.csv``.
"""


from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.radiometry.files import names_a_file, write_text_whole
from spectrabox.radiometry.published import published_tables
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.formats.delimited import table_text
from spectrabox.radiometry.spectra.spectrum_files import read_table
from spectrabox.radiometry.system.words import file_stem, known_name, name_fault

COLOURS = {"red": "r", "green": "g", "blue": "b"}
WELL_KNOWN = ({"r", "g", "b"}, {"x", "y", "z"})     # neither stands for the other


def columns_of_bands(header: Sequence[str], bands: Sequence[str], name: str) -> list[int]:
    """Columns of a table in the order of a camera's bands.

    They are those of the bands' names, whatever their capitals, "red" being R; where no column has
    such a name, the order of the columns is taken for that of the bands.

    Parameters
    ----------
    header : sequence of str
        Names of the columns.
    bands : sequence of K str
        Of the camera.
    name : str
        Of the table, for the message.

    Raises
    ------
    InputError
        If some columns are named as bands and others are not, or they are named R, G, B and the
        bands X, Y, Z.
    """
    columns, known = [_plain(each) for each in header], [_plain(each) for each in bands]
    if sorted(columns) == sorted(known):
        return [columns.index(band) for band in known]
    if set(columns) & set(known) or (set(columns) in WELL_KNOWN and set(known) in WELL_KNOWN):
        raise InputError(f"{name} has columns named {', '.join(header)}, and the camera's bands "
                         f"are {', '.join(bands)}: name each column as the band that it holds")
    return list(range(len(header)))


def _plain(name: str) -> str:
    word = name.strip().casefold()
    return COLOURS.get(word, word)


# ---- how large the standard errors are that a file states of a camera's curves -------------------

ERRORS = "standard_error"       # what the names of their columns begin with


def stated_curve_error(name: str) -> float | None:
    """Standard error of the curves of a file, or of one's own camera by its name; None where none
    is stated, as of published cameras.

    Parameters
    ----------
    name : str
        As of ``named_spectra.sensitivities``.
    """
    kept = own_cameras()
    own = known_name(name, kept)
    if not names_a_file(name) and own is None:
        return None
    table = read_table(Path(name) if own is None else kept[own])
    of_errors = np.array([each.startswith(ERRORS) for each in table.names], bool)
    if not of_errors.any():
        return None
    return relative_curve_error(table.values[~of_errors], table.values[of_errors])


def relative_curve_error(curves: np.ndarray, standard_error: np.ndarray) -> float:
    """Standard error of curves, root mean square over wavelengths, of the highest peak.

    Parameters
    ----------
    curves, standard_error : (K, P) arrays
    """
    return float(np.sqrt(np.nanmean(standard_error**2)) / np.nanmax(curves))


# ---- cameras by name -----------------------------------------------------------------------------

FOLDER, SUFFIX = "SPECTRABOX_CAMERAS", ".csv"
SHORTEST_SERIAL = 5         # digits; a shorter number may be part of a model's name


def cameras_folder() -> Path:
    """Where one's own cameras are kept; the folder need not exist.

    Raises
    ------
    EnvironmentProblem
        If nothing says where.
    """
    stated = os.environ.get(FOLDER)
    if stated:
        return Path(stated)
    try:
        data = Path(os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share")
    except RuntimeError:
        raise EnvironmentProblem(f"there is no home folder; name the folder of your own cameras "
                                 f"with the variable {FOLDER}") from None
    return data / "spectrabox" / "cameras"


def own_cameras() -> dict[str, Path]:
    """Files of one's own cameras by name; empty where none are kept."""
    try:
        folder = cameras_folder()
        files = sorted(folder.glob(f"*{SUFFIX}")) if folder.is_dir() else []
    except (EnvironmentProblem, OSError):
        return {}
    return {path.stem: path for path in files}


def keep_camera(name: str, nm: np.ndarray, columns: dict[str, np.ndarray], source: str) -> Path:
    """Keep a camera's curves under a name by which every command then knows it.

    Parameters
    ----------
    name : str
    nm : (P,) array
    columns : dict of (P,) arrays
        Curves by band, and their standard errors where they are known.
    source : str

    Returns
    -------
    Path
        Its file.

    Raises
    ------
    InputError
        If it cannot be a name, or is that of a published camera or observer.
    """
    require_new_name(name)
    path = cameras_folder() / f"{file_stem(name)}{SUFFIX}"
    write_text_whole(path, table_text(nm, columns, quantity=Quantity.RELATIVE, source=source))
    return path


def known_camera(stated: str) -> str | None:
    """Name by which the curves of a photo's camera are known; None where they are not.

    Parameters
    ----------
    stated : str
        Make, model and serial number, as the photo's file states them.
    """
    words = stated.casefold().split()
    if words and words[-1].isdecimal() and len(words[-1]) >= SHORTEST_SERIAL:
        words.pop()
    # The end, not the beginning: "Canon EOS 5D" is not the Mark III, and NIKON CORPORATION
    # comes before "NIKON D810".
    matching = [
        name
        for name in (*own_cameras(), *published_tables.published_names(published_tables.CAMERAS))
        if words[-len(name.split()):] == name.casefold().split()
    ]
    return max(matching, key=len, default=None)


def known_camera_words(name: str) -> str:
    """The sentence that offers the curves of a known camera.

    Parameters
    ----------
    name : str
    """
    return (f"this camera's curves are known: {name}, of another copy of the model unless you "
            f"measured them; --sensitivity '{name}', or from = \"{name}\" under [sensitivity] in "
            "session.toml, takes them")


def require_new_name(name: str) -> None:
    """Refuse what cannot name a camera of one's own.

    Raises
    ------
    InputError
    """
    if fault := name_fault(name):
        raise InputError(f"{name!r} cannot name a camera: {fault}")
    if name in published_tables.published_names(
            published_tables.CAMERAS) + published_tables.published_names(
                published_tables.OBSERVERS):
        raise InputError(f"{name!r} is already the name of a published camera or observer; give "
                         "your own another, such as the camera and a year")
