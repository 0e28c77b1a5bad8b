"""Cameras by name: those that are published, and one's own, kept as CSV files in one folder.

The folder is ``$SPECTRABOX_CAMERAS``, else ``spectrabox/cameras`` under ``$XDG_DATA_HOME`` or
``~/.local/share``. A camera's file is called after it: ``Nikon D850.csv``.
"""
from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from spectrabox.radiometry.errors import EnvironmentProblem, InputError
from spectrabox.radiometry.files import write_text_whole
from spectrabox.radiometry.published.published_tables import (
    CAMERAS,
    OBSERVERS,
    published_names,
)
from spectrabox.radiometry.records.spectra import Quantity
from spectrabox.radiometry.spectra.formats.delimited import table_text
from spectrabox.radiometry.system.words import file_stem, name_fault

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
    matching = [name for name in (*own_cameras(), *published_names(CAMERAS))
                if words[-len(name.split()):] == name.casefold().split()]
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
    if name in published_names(CAMERAS) + published_names(OBSERVERS):
        raise InputError(f"{name!r} is already the name of a published camera or observer; give "
                         "your own another, such as the camera and a year")
